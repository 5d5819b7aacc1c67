"""What a researcher calls: read a measurement, fit a stack of effects to it."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Bool, Int

from ..data.measurements import (
    ColumnSpec,
    Measurement,
    MissingRole,
    derive_direction,
    derive_error,
    find_role,
    measurement,
    read_table,
)
from ._effects import AbstractEffect, Friction
from .core import FitError
from .fit.joint import Confusion, Gauge, JointData, JointFit, fit_joint, refit_joint
from .friction import Choice, DriveSamples, Known, choose_law

Roles = Mapping[str, ArrayLike]
"""Arrays by role (``"X.position"``, ``"temperature.scale"``, ``"run"``) in mm, °, s, °C."""

_FOLDS = 5
"""Blocks of consecutive readings that are held out in turn where there is one run."""


def read(
    path: str | Path,
    columns: Mapping[str, str | tuple[str, str]] | None = None,
    *,
    axis: str | None = None,
    masters: Sequence[str] = (),
    increments: Mapping[str, float] | None = None,
) -> Measurement:
    """Return a measurement file in mm, °, s and °C.

    Args:
        path: CSV, Parquet, TwinCAT Scope text, MATLAB, ISO 230-2 runs, bed mesh, height map.
        columns: Role → column, or (column, unit): ``{"X.error": ("dx", "um")}``. Left out:
            the roles that the file names itself.
        axis: Axis of a file that names roles without one.
        masters: Axes that x and y of a mesh stand for.
        increments: mm or ° per encoder increment by axis, for the unit ``inc``.

    Raises:
        OSError: If the file cannot be read.
        MeasurementError: If it holds nothing usable, or a column, role or unit is not known.
    """
    specs = {
        role: ColumnSpec(column) if isinstance(column, str) else ColumnSpec(*column)
        for role, column in (columns or {}).items()
    }
    return measurement(
        read_table(Path(path)), specs, axis=axis, masters=masters, increments=increments
    )


@final
@dataclasses.dataclass(frozen=True)
class FittedEffect:
    """One effect of a fit.

    Attributes:
        effect: As it was stated.
        model: The controller's model that takes the error off; of `axcomp.models`.
        standard_deviation: Shaped like the model, same units; inf where the readings do not
            tell a value. Of a friction: by name of the parameter.
        support: Readings that touch each value.
        lags: Time constant in s and its standard deviation, by sensor; empty without.
    """

    effect: AbstractEffect | Friction
    model: Any
    standard_deviation: Any
    support: Int[np.ndarray, " p"]
    lags: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Fit(Mapping[str, FittedEffect]):
    """A fitted stack: effects by compensation (``fit["leadscrew"]``).

    Where a compensation occurs more than once, by axis (``fit["X.leadscrew"]``).

    Attributes:
        effects: The effects by these names.
        noise: Standard deviation of one reading by axis, wild ones left out, in mm or °
            (friction: in the unit of the current).
        datum: Constant of each axis that no effect holds, and its standard deviation, in mm
            or °.
        gauges: What may be moved between effects without changing their sum, and the rule.
        undetermined: What these readings cannot tell apart.
        converged: Whether the iterations reached their tolerance.
        joint: The estimator's own result; None where there is friction only.
        data: The readings as it took them.
    """

    effects: Mapping[str, FittedEffect]
    noise: Mapping[str, float]
    datum: Mapping[str, tuple[float, float]]
    gauges: tuple[Gauge, ...]
    undetermined: tuple[Confusion | str, ...]
    converged: bool
    joint: JointFit | None
    data: JointData

    def __getitem__(self, name: str) -> FittedEffect:
        return self.effects[name]

    def __iter__(self) -> Any:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)

    @cached_property
    def held_out(self) -> dict[str, float]:
        """Root mean square error by axis at readings that a fit has not seen, in mm or °.

        Each run is left out in turn, or, where there is one run, each of five blocks of
        consecutive readings; its own offset is not taken off. Fitted anew at the smoothness
        and lags of the fit of all.
        """
        if self.joint is None:
            return {}
        run = self.data.run
        if run is None or len(np.unique(run)) < 2:
            run = np.arange(len(self.data)) * _FOLDS // max(len(self.data), 1)
        off = {axis: np.full(len(self.data), np.nan) for axis in self.joint.axes}
        for block in np.unique(run):
            own: Bool[np.ndarray, " t"] = run == block
            predicted = refit_joint(self.joint, self.data, use=~own).predict(self.data)
            for axis, error in off.items():
                error[own] = (self.data.error[axis] - predicted[axis])[own]
        return {axis: float(np.sqrt(np.nanmean(e**2))) for axis, e in off.items()}


def fit(
    effects: Sequence[AbstractEffect | Friction],
    data: Measurement | Roles,
    *,
    loss: str = "student",
    smoothness: float | int | str = "auto",
    drift: int = 0,
) -> Fit:
    """Fit a stack of effects to readings.

    Args:
        effects: What to fit, each at most once.
        data: A measurement (`read`), or arrays by role in mm, °, s, °C; they count as they
            stand. ``run`` may hold numbers or names. NaN is a reading that was missed.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` does not.
        smoothness: ``"auto"``: by evidence; or the weight of the squared second differences
            of all tables, relative to 1/noise²; 0 = no prior.
        drift: Pieces of the drift of each run; 0 = an offset per run.

    Raises:
        MissingRole: If an effect needs a role that the measurement lacks.
        FitError: If arrays do not fit together, or do not determine the effects.
    """
    given = _arrays(effects, data)
    positional = [one for one in effects if isinstance(one, AbstractEffect)]
    recording = _recording(given)
    found: list[FittedEffect] = []
    noise: dict[str, float] = {}
    undetermined: list[Confusion | str] = []
    joint: JointFit | None = None
    if positional:
        stack = [one.to_joint() for one in positional]
        joint = fit_joint(
            recording,
            stack,
            loss=loss,
            smoothness=smoothness if isinstance(smoothness, str) else float(smoothness),
            drift=drift,
        )
        noise |= joint.noise
        undetermined += joint.confusions
        for effect, part in zip(positional, joint.parts, strict=True):
            fitted = part.effect
            model = effect.to_model(part.table, -1.0, fitted)
            deviation = effect.to_model(part.deviation_table, 1.0, fitted)
            found.append(
                FittedEffect(effect, model, deviation, part.support, part.lags)
            )
    for one in effects:
        if isinstance(one, Friction):
            choice = _friction(one, given)
            noise.setdefault(one.axis, choice.fit.noise)
            undetermined += [
                f"{name} of {one.axis}: {why}"
                for name, why in choice.fit.undetermined.items()
            ]
            law, sigma = choice.fit.law, choice.fit.standard_deviations
            counted = np.array([choice.fit.count])
            found.append(FittedEffect(one, law, sigma, counted))
    kinds = [one.effect.compensation for one in found]
    names = {
        kind if kinds.count(kind) == 1 else f"{one.effect.axis}.{kind}": one
        for kind, one in zip(kinds, found, strict=True)
    }
    if len(names) < len(found):
        msg = f"found an effect twice among {', '.join(kinds)}, expected each once an axis"
        raise FitError(msg)
    return Fit(
        effects=names,
        noise=noise,
        datum={} if joint is None else joint.datum,
        gauges=() if joint is None else joint.gauges,
        undetermined=tuple(undetermined),
        converged=joint is None or joint.converged,
        joint=joint,
        data=recording,
    )


def _friction(effect: Friction, given: Mapping[str, np.ndarray]) -> Choice:
    inertia = None if effect.inertia == "fit" else float(effect.inertia)
    velocity, acceleration, current = (given[role] for role in effect.roles[1:])
    samples = DriveSamples(given["time"], velocity, current, acceleration)
    return choose_law(samples, known=Known(inertia=inertia))


def _arrays(
    effects: Sequence[AbstractEffect | Friction], data: Measurement | Roles
) -> dict[str, np.ndarray]:
    """Return the arrays by role that the effects need, and runs and time."""
    wanted = ["run", "time"]
    for one in effects:
        wanted += one.roles
        if isinstance(one, AbstractEffect):
            wanted.append(f"{one.axis}.error")
    found: dict[str, np.ndarray] = {}
    for role in dict.fromkeys(wanted):
        if isinstance(data, Measurement):
            values = _measured(data.with_gaps(), role)
        else:
            values = None if role not in data else np.asarray(data[role])
        if values is None and role in ("run", "time") and role not in wanted[2:]:
            continue
        if values is None:
            known = ", ".join(data) if isinstance(data, Mapping) else ""
            msg = f"the effects need {role!r}, found arrays of {known}"
            raise FitError(msg)
        found[role] = np.asarray(values, None if role == "run" else np.float64)
    return found


def _measured(data: Measurement, role: str) -> np.ndarray | None:
    """Return the values of a role; errors and directions are derived where they can be."""
    if role in data.values:
        return data.values[role]
    if role in ("run", "time"):
        return None
    known = find_role(role)
    if known is not None and known.axis is not None and known.kind == "direction":
        return derive_direction(data, known.axis).astype(np.float64)
    if known is not None and known.axis is not None and known.kind == "error":
        return derive_error(data, known.axis)
    raise MissingRole(str(data.source), role, "for the effects", data.values.keys())


def _recording(given: Mapping[str, np.ndarray]) -> JointData:
    """Return arrays by role as a joint fit takes them."""
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
        run = np.unique(given["run"], return_inverse=True)[1].astype(np.int64)
    return JointData(**tables, time=given.get("time"), run=run)
