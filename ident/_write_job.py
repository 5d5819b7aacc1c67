"""A fit as a job: its readings and a job file in a folder, run as ``axcomp fit`` does."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Bool

from ..data.measurements import MissingRole, find_role
from ..data.measurements._units import LIBRARY_UNIT
from ._job_text import job_text
from ._readings import Friction
from .core import FitError
from .fit.joint import AbstractEffect, AbstractTable, Temperature

if TYPE_CHECKING:
    from .job import JobResult

_UNIT = 1e-4
"""Unit of a list in mm or °: less is rounding."""
_SIGNED = "# Fit.write writes over this file while it is as written: {}\n"
"""How a job ends: with the digest of what stands before."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Stated:
    """What was asked of a fit.

    Attributes:
        effects: In order.
        readings: Arrays by role in mm, °, s, °C, before anything was taken off.
        options: Keys of each fit.
        treated: Keys of the measurement.
        active: Models that acted while measuring, by name of the effect; None: nobody said.
        names: Of the effects.
        constraints: What effects keep, by name: words, or a function.
    """

    effects: tuple[AbstractEffect | Friction, ...]
    readings: Mapping[str, np.ndarray]
    options: Mapping[str, Any]
    treated: Mapping[str, Any]
    active: Mapping[str, Any] | None
    names: tuple[str, ...]
    constraints: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def active_kinds(self) -> tuple[str, ...]:
        """Compensations of the effects that acted while measuring."""
        pairs = zip(self.names, self.effects, strict=True)
        acted = self.active or {}
        kinds = (one.compensation for name, one in pairs if name in acted)
        return tuple(dict.fromkeys(kinds))

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that the effects or their inputs name."""
        found = [one.axis for one in self.effects]
        for text in self.readings:
            role = find_role(text)
            if role is not None and role.axis is not None:
                found.append(role.axis)
        return tuple(dict.fromkeys(found))


def write_job(
    stated: Stated,
    folder: Path,
    lists: Mapping[int, str | Path],
    axes: Mapping[str, int | Mapping[str, Any]],
    gate: Mapping[str, float],
) -> "JobResult":
    """Write readings and job into a folder, run the job there; see `Fit.write`."""
    from .job import run_job
    from .job.write._output import signed

    functions = [name for name, each in stated.constraints.items() if callable(each)]
    if functions:
        msg = (
            f"write: found constraints of {', '.join(functions)} as a function, which a job "
            "does not keep: its lists would be those of the fit without them."
        )
        raise FitError(msg)
    numbered = _numbered(stated, lists, axes)
    _refuse_half_active(stated, numbered)
    folder.mkdir(parents=True, exist_ok=True)
    path, readings = folder / "job.toml", folder / "readings.parquet"
    _refuse_strange(path, readings)
    fits = list(_fits(stated))
    job: dict[str, Any] = {
        "axes": numbered,
        "measurements": {"readings": _measurement(stated, readings, numbered)},
        "gate": dict(gate),
        "fits": fits,
    }
    path.write_bytes(signed(job_text(job) + "\n", _SIGNED))
    try:
        return run_job(path, folder)
    except MissingRole as error:
        msg = (
            f"write: found no {error.role} among the readings, expected it {error.why}"
        )
        raise FitError(msg) from None


def verdicts_of(result: "JobResult", names: Sequence[str]) -> dict[str, str]:
    """Return the verdict on each fit of a job, by the names of the effects."""
    from .report import headline_of, scale_of

    return {
        name: headline_of(one, scale_of(one.unit)).sentence
        for name, one in zip(names, result.fits, strict=True)
    }


def _numbered(
    stated: Stated,
    lists: Mapping[int, str | Path],
    axes: Mapping[str, int | Mapping[str, Any]],
) -> dict[str, dict[str, Any]]:
    """Return the keys of each axis in a job file, its number and list among them."""
    if not isinstance(axes, Mapping) or not all(
        isinstance(given, int | np.integer | Mapping) for given in axes.values()
    ):
        msg = f"axes: found {axes!r}, expected numbers or keys, axes={{'X': 1, …}}"
        raise FitError(msg)
    known: dict[str, dict[str, Any]] = {
        name: dict(given) if isinstance(given, Mapping) else {"number": int(given)}
        for name, given in axes.items()
    }
    if not known and len(stated.axes) == 1 and len(lists) == 1:
        known = {stated.axes[0]: {"number": next(iter(lists))}}
    missing = [name for name in stated.axes if "number" not in known.get(name, {})]
    if missing:
        msg = f"axes: found no number of {', '.join(missing)}, expected axes={{'X': 1, …}}"
        raise FitError(msg)
    for number, path in lists.items():
        own = [keys for keys in known.values() if keys["number"] == number]
        if len(own) != 1:
            msg = f"lists: found axis {number}, expected one of {axes}"
            raise FitError(msg)
        own[0]["list"] = str(Path(path).absolute())
    return known


def _refuse_half_active(stated: Stated, axes: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse what a job cannot say: a table on while measuring, and its like of a list off."""
    from .exchange import load_model

    active = stated.active or {}
    for name, one in zip(stated.names, stated.effects, strict=True):
        path, step = (axes[one.axis].get(key) for key in ("list", "increment"))
        if name in active and path is not None and isinstance(one, AbstractTable):
            listed = load_model(path, increment=step).get(one.compensation)
            acted = one.offsets(active[name])
            apart = 0.0 if listed is None else np.abs(one.offsets(listed) - acted).max()
            if apart > _UNIT:
                msg = (
                    f"write: found a {one.compensation} in {path} that differs from the active"
                    f" model of {name} by {apart:.2g} mm or °, expected the list that acted"
                )
                raise FitError(msg)
        if name in active or one.compensation not in stated.active_kinds:
            continue
        if path is not None and one.compensation in load_model(path, increment=step):
            msg = (
                f"write: found {name} in {path} and not active, expected it active as the "
                f"other {one.compensation} was: a job says so of a whole measurement"
            )
            raise FitError(msg)


def _refuse_strange(path: Path, readings: Path) -> None:
    """Refuse to write over a job, or readings, that are not as an earlier write left them."""
    from .job.write._output import is_signed

    own = path.is_file() and is_signed(path.read_bytes(), _SIGNED)
    there = [file.name for file in (path, readings) if file.exists()]
    if there and not own:
        msg = (
            f"write: found {' and '.join(there)} in {path.parent}, not as a write left it,"
            " expected another folder: it would be lost"
        )
        raise FitError(msg)


def _measurement(
    stated: Stated, path: Path, axes: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Write the readings and return the keys of the measurement."""
    import pyarrow as pa  # takes long to load
    import pyarrow.parquet as pq

    arrays, columns = dict(stated.readings), {}
    if "run" in arrays:
        arrays["run"] = np.unique(arrays["run"], return_inverse=True)[1].astype(
            np.int64
        )
    for text in arrays:
        role = find_role(text)
        assert role is not None  # `fit` has seen to it
        turns = axes.get(role.axis or "", {}).get("type", "linear") != "linear"
        columns[text] = {"column": text}
        if role.dimensions:
            angles = [each for each in role.dimensions if each.startswith("ang")]
            dimension = angles[0] if angles and turns else role.dimensions[0]
            columns[text]["unit"] = LIBRARY_UNIT[dimension]
    treated = {key: value for key, value in stated.treated.items() if value}
    if (place := treated.pop("datum", None)) is not None:
        treated["datum"] = {"at": list(place)}
        if treated["remove"] == "none":
            del treated["remove"]
    heated = [one for one in stated.effects if isinstance(one, Temperature)]
    references = {float(one.reference_temperature) for one in heated}
    if len(references) > 1:
        found = " and ".join(f"{each:g}" for each in sorted(references))
        msg = (
            f"write: found reference temperatures of {found} °C, expected one: a job has one "
            "per measurement"
        )
        raise FitError(msg)
    if references - {20.0}:
        treated["reference_temperature"] = references.pop()
    # A lag remembers the temperature of a missed reading; a table has no row for one.
    complete = slice(None) if heated else _complete(arrays)
    table = {
        text: pa.array(np.asarray(values)[complete], from_pandas=True)
        for text, values in arrays.items()
    }
    pq.write_table(pa.table(table), path)
    if stated.active is not None:
        treated["active"] = list(stated.active_kinds)
    return {"file": path.name, "columns": columns} | treated


def _complete(arrays: Mapping[str, np.ndarray]) -> Bool[np.ndarray, " t"]:
    """Return which rows a fit counts: an error that is there, where nothing else is missing."""
    gaps = {
        text: np.isnan(values)
        for text, values in arrays.items()
        if np.issubdtype(np.asarray(values).dtype, np.floating)
    }
    errors = [gap for text, gap in gaps.items() if text.endswith(".error")]
    if len(errors) == 1:
        return np.asarray(~np.any([*gaps.values()], axis=0))
    if not errors:
        return np.ones(len(next(iter(arrays.values()))), bool)
    return np.asarray(~np.all(errors, axis=0))


def _fits(stated: Stated) -> Iterator[dict[str, Any]]:
    """Return the keys of each fit; what shares its readings is one group."""
    together = [one for one in stated.effects if isinstance(one, AbstractEffect)]
    several = len(together) > 1 or stated.treated["drift"]
    for name, one in zip(stated.names, stated.effects, strict=True):
        keys = _keys(one) | {"measurement": "readings"}
        if name in stated.constraints:
            words = list(stated.constraints[name])
            keys |= {"solver": "ipopt", "constraints": words}
        if isinstance(one, AbstractEffect):
            keys |= {k: v for k, v in stated.options.items() if one.grid or k == "loss"}
            if several:
                keys["group"] = "stack"
        yield keys


def _keys(effect: AbstractEffect | Friction) -> dict[str, Any]:
    """Return the keys of a fit that an effect states."""
    keys: dict[str, Any] = {"compensation": effect.compensation}
    for field in dataclasses.fields(effect):
        value = None if field.name in effect.no_keys else getattr(effect, field.name)
        if value not in (None, {}, field.default):
            keys[field.name] = value
    if isinstance(effect, Temperature):
        lag, *others = dict.fromkeys(effect.lags.values())
        if others:
            msg = f"write: found {effect.name} with several lags, expected one: a job has one"
            raise FitError(msg)
        lag = {"fit": "auto", 0.0: "none"}.get(lag, lag)
        keys |= {"lag": lag, "reference": float(effect.reference)}
        if len(effect.sensors) == 2 and len(effect.sensor_names) == 1:
            keys["sensor"] = keys.pop("sensors")["offset"]
    return keys
