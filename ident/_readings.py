"""Readings for a fit: a measurement file, or arrays by role, as the estimator takes them.

`Friction`, the effect that takes no joint readings, stands here with its roles.
"""

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, final

import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from ..data.measurements import (
    KINDS,
    ColumnSpec,
    Lines,
    Measurement,
    MeasurementError,
    MissingRole,
    derive_direction,
    derive_error,
    derive_motion,
    direction_of,
    find_role,
    measurement,
    nearest,
    read_table,
    recorded_motion,
    restart_of,
    without_motion,
)
from .core import FitError
from .fit.joint import AbstractEffect, JointData, Number, Temperature, is_number

Roles = Mapping[str, ArrayLike]
"""Arrays by role (``"X.position"``, ``"temperature.scale"``, ``"run"``) in mm, °, s, °C."""

_MOTION = ("velocity", "acceleration")


@final
@dataclasses.dataclass(frozen=True)
class Friction:
    """Friction law of an axis, from the current of its drive; fitted by itself.

    Attributes:
        axis: Name of the compensated axis.
        inertia: ``"fit"``, or known, in drive units per mm/s².
    """

    axis: str
    inertia: Number | Literal["fit"] = "fit"

    compensation: ClassVar[str] = "friction"
    no_keys: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        word = isinstance(self.inertia, str) and self.inertia == "fit"
        if not word and not is_number(self.inertia):
            msg = f"inertia: found {self.inertia!r}, expected 'fit' or a number"
            raise FitError(msg)

    @property
    def roles(self) -> tuple[str, ...]:
        """Roles of the readings that it needs."""
        kinds = ("velocity", "acceleration", "current")
        return ("time", *(f"{self.axis}.{kind}" for kind in kinds))


def read(
    path: str | Path,
    columns: Mapping[str, str | tuple[str, str]] | None = None,
    *,
    axis: str | None = None,
    masters: Sequence[str] = (),
    increments: Mapping[str, float] | None = None,
    skip: int | Sequence[int] = 0,
    header: int | Sequence[int] | None = None,
    rows: tuple[int, int] | None = None,
) -> Measurement:
    """Return a measurement file in mm, °, s and °C.

    Args:
        path: Of any format that `axcomp read` recognises.
        columns: Role → column, or (column, unit): ``{"X.error": ("dx", "um")}``. Left out:
            the roles that the file names itself.
        axis: Axis of a file that names roles without one.
        masters: Axes that x and y of a mesh stand for.
        increments: mm or ° per encoder increment by axis, for the unit ``inc``.
        skip: Lines of a text table that are left out: so many at the top, or which.
        header: Its lines with the names of the columns; empty: there are none.
        rows: Its first and last line of numbers.

    Raises:
        OSError: If the file cannot be read.
        MeasurementError: If it holds nothing usable, or a column, role or unit is not known.
    """
    specs: dict[str, ColumnSpec] = {}
    for role, column in (columns or {}).items():
        pair = (column,) if isinstance(column, str) else tuple(column or ())
        if not 1 <= len(pair) <= 2 or not all(isinstance(part, str) for part in pair):
            msg = f"columns: {role}: found {column!r}, expected a column, or (column, unit)"
            raise MeasurementError(str(path), msg)
        specs[role] = ColumnSpec(pair[0], pair[1] if len(pair) > 1 else None)
    if rows is not None and np.shape(rows) != (2,):
        msg = f"rows: found {rows!r}, expected the first and the last line of numbers"
        raise MeasurementError(str(path), msg)
    table = read_table(Path(path), lines=Lines.of(skip, header, rows))
    return measurement(table, specs, axis=axis, masters=masters, increments=increments)


def without_zero_of(
    stack: Sequence[AbstractEffect],
    given: dict[str, np.ndarray],
    kind: Literal["none", "offset", "line"],
) -> dict[str, np.ndarray]:
    """Return the arrays, the errors without the zero of the instrument."""
    result = dict(given)
    for axis in dict.fromkeys(one.axis for one in stack) if kind != "none" else ():
        from .readings import without_zero  # loads more than a fit needs

        roles = [role for one in stack if one.axis == axis for role in one.roles]
        own = dict.fromkeys(role for role in roles if role.endswith(".position"))
        places = [given[role] for role in own]
        error = given[f"{axis}.error"]
        result[f"{axis}.error"] = without_zero(error, places, kind, given.get("run"))
    return result


def arrays_of(
    effects: Sequence[AbstractEffect | Friction], data: Measurement | Roles
) -> dict[str, np.ndarray]:
    """Return the arrays by role that the effects need, and runs, time and places of the axes.

    Errors of a measurement in motion are those that a standstill would show. What is masked
    is NaN; instants (``datetime64``) are seconds from the first one.
    """
    beside = ["run", "time", *(f"{one.axis}.position" for one in effects)]
    wanted = list[str]()
    if isinstance(data, Measurement):
        axes = [one.axis for one in effects if isinstance(one, AbstractEffect)]
        data = without_motion(data, axes).with_gaps()
    elif (names := getattr(data, "columns", None)) is not None:
        names = getattr(data, "column_names", names)  # of pandas, polars, or pyarrow
        data = {str(name): data[name] for name in names}
    elif not isinstance(data, Mapping):
        msg = f"data: found {type(data).__name__}, expected a measurement or arrays by role"
        raise FitError(msg)
    else:
        _refuse_unknown(data)
    for one in effects:
        wanted += one.roles
        if isinstance(one, AbstractEffect):
            wanted.append(f"{one.axis}.error")
    found: dict[str, np.ndarray] = {}
    for role in dict.fromkeys([*beside, *wanted]):
        if isinstance(data, Measurement):
            values = _measured(data, role)
        else:
            values = None if role not in data else _filled(data[role], role)
            if values is not None and role.endswith(".direction"):
                values = _directions(values, role)
        if values is None and role not in wanted:
            continue
        if values is None:
            known = ", ".join(data) if isinstance(data, Mapping) else ""
            msg = f"the effects need {role!r}, found arrays of {known}"
            raise FitError(msg)
        found[role] = _row_of(values, role)
    return found


def _refuse_unknown(data: Mapping[str, object]) -> None:
    """Raise where a name looks like a role and is none: what it holds would be left out."""
    for name in data:
        if "." in str(name) and find_role(str(name)) is None:
            axis, _, kind = str(name).partition(".")
            msg = f"data: found {name!r}, expected '{axis}.{nearest(kind, KINDS)}' or others"
            raise FitError(msg)


def _filled(given: ArrayLike, role: str) -> np.ndarray:
    """Return an array, what is masked in it as NaN: a reading that was missed.

    Raises:
        FitError: If a run is masked, or values are traced.
    """
    if isinstance(given, Tracer):
        msg = f"{role}: found traced values, expected numbers: fit_linear is differentiable"
        raise FitError(msg)
    if not np.ma.is_masked(given):
        return np.asarray(given)
    if role == "run":
        msg = "run: found masked rows, expected the run of every reading"
        raise FitError(msg)
    return np.asarray(np.ma.filled(np.ma.asarray(given).astype(float), np.nan))


def _row_of(values: np.ndarray, role: str) -> np.ndarray:
    """Return numbers, one per row; runs may have names, instants become seconds.

    Raises:
        FitError: If they are others.
    """
    shape = np.shape(values)
    if role == "time" and values.dtype.kind in "mM" and values.size:
        values = (values - np.fmin.reduce(values)) / np.timedelta64(1, "s")
    known = values.dtype.kind not in "cmM" or role == "run"
    with contextlib.suppress(TypeError, ValueError):
        if len(shape) == 1 and shape != (0,) and known:
            # A copy: what becomes of the caller's array is no matter of the fit any more.
            return np.array(values, None if role == "run" else np.float64)
    msg = f"{role}: found {values.dtype} of shape {shape}, expected one number per row"
    raise FitError(msg)


def _directions(given: np.ndarray, role: str) -> np.ndarray:
    """Return directions as ±1, NaN where not known, of numbers or of words as in a file.

    Raises:
        FitError: If they are others: of 0 and 1 a backlash would come out twice as wide.
    """
    if given.dtype.kind in "SUO":
        given = given.astype(str) if given.dtype.kind == "S" else given
        given = np.reshape([_direction(each) for each in given.ravel()], given.shape)
    strange = given[~(np.isin(given, (-1, 1)) | np.isnan(given))]
    if given.dtype == bool or strange.size:
        msg = (
            f"{role}: found {(*strange, True)[0]}, expected 1 and -1 "
            "(np.where(forwards, 1, -1)), NaN where not known"
        )
        raise FitError(msg)
    return given


def _direction(cell: Any) -> float:
    """Return a direction as ±1, NaN where not known; 0 of what is none."""
    try:
        return float("nan" if cell is None else cell)
    except ValueError:
        return float(direction_of(str(cell)) or 0)


def _measured(data: Measurement, role: str) -> np.ndarray | None:
    """Return the values of a role; errors, directions and motion are derived if need be."""
    known = find_role(role)
    if role in data.values:
        if known is not None and known.axis is not None and known.kind in _MOTION:
            return recorded_motion(data, known.axis, known.kind)
        return data.values[role]
    if role in ("run", "time"):
        return None
    if known is not None and known.axis is not None and known.kind == "direction":
        return derive_direction(data, known.axis).astype(np.float64)
    if known is not None and known.axis is not None and known.kind == "error":
        return derive_error(data, known.axis)
    if known is not None and known.axis is not None and known.kind in _MOTION:
        return np.asarray(getattr(derive_motion(data, known.axis), known.kind))
    raise MissingRole(str(data.source), role, "for the effects", data.values.keys())


def recording_of(
    stack: Sequence[AbstractEffect], given: Mapping[str, np.ndarray]
) -> JointData:
    """Return arrays by role as a joint fit takes them.

    Runs have no offset of their own beside a temperature: it could not be told from what
    the temperature does from run to run.
    """
    tables: dict[str, dict[str, np.ndarray]] = {}
    for text, values in given.items():
        role = find_role(text)
        if role is None:
            msg = f"found {text!r}, expected a role such as X.position or temperature.a"
            raise FitError(msg)
        name = role.axis or role.sensor
        if name is not None and role.kind != "current":
            tables.setdefault(role.kind, {})[name] = values
    run = None
    if "run" in given:
        try:
            run = np.unique(given["run"], return_inverse=True)[1].astype(np.int64)
        except TypeError:
            msg = "run: found numbers beside names or None, expected one or the other"
            raise FitError(msg) from None
    heated = [one.axis for one in stack if isinstance(one, Temperature)]
    data = JointData(
        **tables,
        time=given.get("time"),
        run=run,
        runs=dict.fromkeys(heated),
        clock_number=None,
        own_zero=None,
    )
    time = data.time
    if heated and time is not None and (row := restart_of(time, run)) is not None:
        msg = (
            f"time: goes back to {time[row]:g} s at index {row}: two recordings, or a clock"
            " that was set back, expected one clock for what follows a temperature"
        )
        raise FitError(msg)
    return data
