"""What a researcher calls: a stack of effects fitted to readings, and what comes of it."""

import dataclasses
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, final

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from ..data.measurements import Measurement
from ..data.signals import find_polarity, without_spikes
from ._arguments import (
    Datum,
    by_name,
    check_alike,
    check_friction,
    check_names,
    check_options,
    check_reach,
    check_words,
    datum_of,
    models_by_name,
    names_of,
    stack_of,
)
from ._datum import datum_row, deviation_at_datum, zeroed, zeroed_deviations
from ._ipopt import least_squares_ipopt, one_vector
from ._readings import Friction, Roles, arrays_of, recording_of, without_zero_of
from ._write_job import Stated, verdicts_of, write_job
from .core import FitError
from .fit import Constraint, most_probable, scatter_of_runs
from .fit.joint import (
    AbstractEffect,
    Confusion,
    Gauge,
    JointData,
    JointFit,
    Leadscrew,
    Part,
    Temperature,
    fit_joint,
    held_out_errors,
)
from .friction import Choice, DriveSamples, choose_law
from .kinds import kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .job import JobResult

_FOLDS = 5
"""Blocks of consecutive readings that are held out in turn where there is one run."""
_MOVES, _FEW, _SURE = 0.02, 20, 0.999
"""Share of the highest speed from which on an axis moves; samples that show a direction; and
probability from which on the sign of a current is known."""
_EMPTY = 1e-10
"""Variance of a mode, relative to the largest one, that counts as zero."""


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
        common: Standard deviation that all values have in common, in mm or °: that of the
            constant which the table holds; 0 without.
        datum: Share of each value in what the table says at the datum, which is taken off all;
            None without.
    """

    effect: AbstractEffect | Friction
    model: Any
    standard_deviation: Any
    support: Int[np.ndarray, " p"]
    lags: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    common: float = 0.0
    datum: Float[np.ndarray, " p"] | None = None

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the values with two standard deviations, and return the matplotlib axes.

        Args:
            axes: To draw into; left out: a figure of its own.
        """
        from ._notebook import plot_effect

        return plot_effect(self, type(self.effect).__name__, axes)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Fit(Mapping[str, FittedEffect]):
    """A fitted stack: effects by compensation (``fit["leadscrew"]``).

    Where a compensation occurs more than once, by axis (``fit["X.leadscrew"]``).

    Attributes:
        effects: The effects by these names.
        noise: Standard deviation of one reading by axis, wild ones left out, in mm or °
            (friction: of a row behind the low-pass, in the unit of the current).
        datum: Constant of each axis that no effect holds, and its standard deviation, in mm
            or °.
        gauges: What may be moved between effects without changing their sum, and the rule.
        undetermined: What these readings cannot tell apart.
        converged: Whether the iterations reached their tolerance.
        joint: The estimator's own result; None where there is friction only.
        data: The readings as it took them.
        stated: What was asked of `fit`, for `write`.
    """

    effects: Mapping[str, FittedEffect]
    noise: Mapping[str, float]
    datum: Mapping[str, tuple[float, float]]
    gauges: tuple[Gauge, ...]
    undetermined: tuple[Confusion | str, ...]
    converged: bool
    joint: JointFit | None
    data: JointData
    stated: Stated

    def __getitem__(self, name: str) -> FittedEffect:
        return self.effects[name]

    def __iter__(self) -> Any:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)

    @property
    def suspect_runs(self) -> dict[str, tuple[Any, ...]]:
        """Runs by axis that contradict the others, as the readings name them.

        A robust loss does not count them in the mean of all, which the constant is, unless
        `remove` took off the mean of all readings.
        """
        found = {} if self.joint is None else self.joint.suspect_runs
        names = np.unique(self.stated.readings.get("run", ()))
        return {
            a: tuple(names[list(runs)].tolist()) for a, runs in found.items() if runs
        }

    def plot(self) -> "tuple[Axes, ...]":
        """Draw every effect into a panel of its own, and return the matplotlib axes."""
        from ._notebook import plot_fit

        return plot_fit(self.effects)

    def __repr__(self) -> str:
        from ._notebook import fit_text

        return fit_text(self)

    def _repr_html_(self) -> str:
        from ._notebook import fit_html

        return fit_html(self)

    @cached_property
    def held_out(self) -> dict[str, float]:
        """Root mean square error by axis at readings that a fit has not seen, in mm or °.

        Each run is left out in turn, or, where there is one run, each of five blocks of
        consecutive readings; its own offset is not taken off. Fitted anew at the smoothness
        and lags of the fit of all. Wild readings are left out, as in `noise`.
        """
        if self.joint is None:
            return {}
        run = self.data.run
        if run is None or len(np.unique(run)) < 2:
            run = np.arange(len(self.data)) * _FOLDS // max(len(self.data), 1)
        left = held_out_errors(self.joint, run)
        believed = {
            axis: left[axis][own.design.rows][own.counted]
            for axis, own in self.joint.fits.items()
        }
        return {axis: float(np.sqrt(np.mean(e**2))) for axis, e in believed.items()}

    def covariance(self, name: str) -> Float[np.ndarray, "p p"]:
        """Return the joint covariance of the values of an effect, in the order of the list.

        In mm² or °², see `Part.covariance`. A value that the readings do not tell has
        the variance inf, and NaN beside it.

        Raises:
            KeyError: If it is the name of no effect, or of a friction.
        """
        own = {
            name: one.effect
            for name, one in self.effects.items()
            if isinstance(one.effect, AbstractEffect)
        }
        if self.joint is None or name not in list(own):  # a list of names has no hash
            known = ", ".join(own) or "tables, backlash and temperature"
            msg = f"covariance: found {name!r}, expected one of {known}"
            raise KeyError(msg)
        one, joint = self.effects[name], self.joint.part(own[name].name).covariance
        return joint + one.common**2 if one.datum is None else zeroed(joint, one.datum)

    def write(
        self,
        folder: str | Path,
        lists: Mapping[int, str | Path] | None = None,
        axes: Mapping[str, int | Mapping[str, Any]] | None = None,
        gate: Mapping[str, float] | None = None,
    ) -> "JobResult":
        """Write proven lists, load sheet and ``result.json``, as ``axcomp fit`` does.

        The readings and a job file go into the folder, and the job is run: fitted anew,
        rounded to list units, read back and judged by the gate. A failed gate is no error:
        the list then lies in ``rejected/``.

        Args:
            folder: Made where it does not exist.
            lists: Lists that the controller has loaded, by number of the axis: the new ones
                keep the rest of them, and what was `active` in them stays.
            axes: Number of each axis, or its keys in a job file (``number``, ``limits``,
                ``type``, …). With one axis and one list it may be left out.
            gate: Limits, as in a job file.

        Returns:
            What the job found; `JobResult.passed` tells whether everything is fit for use.

        Raises:
            FitError: If a function says what effects keep, which a job does not know.
            AxcompError: If the job cannot be run.
        """
        return write_job(self.stated, Path(folder), lists or {}, axes or {}, gate or {})

    @cached_property
    def verdict(self) -> dict[str, str]:
        """What the report of a job says of each effect in a sentence, ready to act on.

        The job is run on numbers of axes in alphabetical order, without their old lists.

        Raises:
            FitError: If models were active, which only their lists tell: `write` takes them.
        """
        if self.stated.active:
            active = ", ".join(self.stated.active)
            msg = (
                f"verdict: {active} was active while measuring; give its list to write."
            )
            raise FitError(msg)
        with tempfile.TemporaryDirectory() as folder:
            names = {name: k + 1 for k, name in enumerate(sorted(self.stated.axes))}
            return verdicts_of(self.write(folder, axes=names), tuple(self.effects))


def fit(
    effects: Sequence[AbstractEffect | Friction],
    data: Measurement | Roles,
    *,
    loss: str = "student",
    smoothness: float | int | str = "auto",
    drift: int = 0,
    remove: str = "none",
    datum: Datum | Mapping[str, Datum] | None = None,
    active: Mapping[str, Any] | None = None,
    constraints: Mapping[str, Callable[[Any], Any] | Constraint | Sequence[Constraint]]
    | None = None,
    solver: str | None = None,
) -> Fit:
    """Fit a stack of effects to readings.

    Args:
        effects: What to fit, each at most once. Beside a `Temperature` without a leadscrew a
            line over the axis is fitted and left, as in a job: no temperature moves it.
        data: A measurement (`read`), or arrays by role in mm, °, s, °C; they count as they
            stand. ``run`` may hold numbers or names, directions are 1 and −1, ``time`` also
            instants (``datetime64``). NaN, or what is masked, is a reading that was missed;
            a drive must not have been sampled with gaps.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` does not, nor
            any where a stated smoothness leaves few readings beside the values.
        smoothness: ``"auto"``: by evidence; or the weight of the squared second differences
            of all tables, relative to 1/noise²; 0 = no prior.
        drift: Pieces of the drift of each run; 0 = an offset per run. It needs ``time``.
        remove: Takes an arbitrary zero of the instrument off the error of each axis, its
            mean or the line (over two masters, the plane) through it; what constant is left
            is the machine's, and a table of the axis holds it, as the written list does.
        datum: Position where the error is zero, one per master, also as ``{"at": …}``; for
            a table alone on its axis, whose values then say so.
        active: Models that acted while measuring, by name of the effect (`load_model`
            gives them): the new values are old + residual. Tables and backlash. ``{}``: all
            was off, which `Fit.write` asks for where a list holds what is fitted.
        constraints: What the entries of a table keep, by name of the effect:
            ``{"leadscrew": ["monotone"]}`` turns back nowhere, ``"non-negative"`` is
            nowhere below zero; or a function to values that the model keeps at or above
            zero, an array or several: ``lambda m: 0.001 - jnp.diff(m.pos)``. The most
            probable values that do,
            at the smoothness of the fit; deviations, `joint` and `held_out` stay those of
            the fit without.
        solver: ``"ipopt"`` takes constraints; the factor does not. Left out: as needed.

    Raises:
        MissingRole: If an effect needs a role that the measurement lacks.
        FitError: If arrays or options do not fit together, do not determine the effects, no
            reading lies in a table, or nothing keeps the constraints.
    """
    check_options(loss, remove, solver, smoothness, drift)
    effects = stack_of(effects)
    said, active = active is not None, models_by_name(active)
    constraints = by_name(constraints)
    if constraints and solver == "factor":
        msg = "constraints need solver='ipopt': the factor knows no inequalities."
        raise FitError(msg)
    given = arrays_of(effects, data)
    stack = [one for one in effects if isinstance(one, AbstractEffect)]
    names = names_of(effects)
    options = {"loss": loss, "smoothness": smoothness}
    if not stack:
        check_friction(
            **options, drift=drift, remove=remove, datum=datum, solver=solver
        )
    place = datum_of(stack, datum)
    check_reach(stack, given)
    treated = {"drift": drift, "remove": remove, "datum": place}
    check_names(names, effects, active, constraints)
    stated = Stated(
        effects, given, options, treated, active if said else None, names, constraints
    )  # fmt: skip
    way = cast("Literal['none', 'offset', 'line']", remove)
    recording = recording_of(stack, without_zero_of(stack, given, way))
    found: dict[str, FittedEffect] = {}
    noise: dict[str, float] = {}
    constant: dict[str, tuple[float, float]] = {}
    doubts: dict[str, float] = {}
    undetermined: list[Confusion | str] = []
    joint: JointFit | None = None
    if stack:
        joint = fit_joint(
            recording,
            [*stack, *_lines(stack, recording)],
            loss=loss,
            smoothness=smoothness if isinstance(smoothness, str) else float(smoothness),
            drift=drift,
            all_runs=remove != "none",
        )
        noise |= joint.noise
        if (
            remove == "none"
        ):  # The mean of the runs is the machine's, which few do not tell.
            for axis, every in joint.runs.items():
                aside = joint.fits[axis].design.aside
                runs = [run for run in every if run.run not in aside]
                doubts[axis] = scatter_of_runs(runs)[0] / max(len(runs), 1) ** 0.5
        constant |= {
            axis: (value, float(np.hypot(deviation, doubts.get(axis, 0.0))))
            for axis, (value, deviation) in joint.datum.items()
        }
        undetermined += joint.confusions
    holders = _holders(stack) if place is None else {}
    gauges = () if joint is None else joint.gauges
    parts = iter(() if joint is None else joint.parts)
    for name, one in zip(names, effects, strict=True):
        if isinstance(one, Friction):
            choice = _friction(one, given)
            noise.setdefault(one.axis, choice.fit.noise)
            undetermined += [
                f"{name} of {one.axis}: {why}"
                for name, why in choice.fit.undetermined.items()
            ]
            law, sigma = choice.fit.law, choice.fit.standard_deviations
            found[name] = FittedEffect(one, law, sigma, np.array([choice.fit.count]))
            continue
        part = next(parts)
        values, common = part.values, 0.0
        if holders.get(one.axis) is one:
            value, common = constant[one.axis]
            constant[one.axis] = (0.0, common)
            values = values + value
            gauges = tuple(
                dataclasses.replace(
                    each, rule=f"{each.rule} The {part.name} holds the datum."
                )
                if f"datum of {one.axis}" in each.effects
                else each
                for each in gauges
            )
        acted: Float[np.ndarray, ...] | float = 0.0
        if name in active:
            check_alike(name, active[name], part.effect.to_model(part.table, -1.0))
            acted = one.offsets(active[name])
        row = datum_row(part.effect, place)
        if name in constraints:
            values = _constrained(part, values, common, constraints[name], row, acted)
        deviation = np.hypot(part.standard_deviation, common)
        if place is not None:
            zero, doubt = float(row @ values), doubts.get(one.axis, 0.0)
            own = float(np.hypot(deviation_at_datum(part, row), doubt))
            constant[one.axis] = (constant[one.axis][0] + zero, own)
            values, deviation = values - zero, zeroed_deviations(part, row)
        table = part.effect.table(values) - acted
        found[name] = FittedEffect(
            one,
            part.effect.to_model(table, -1.0),
            part.effect.to_model(part.effect.table(deviation), 1.0),
            part.support,
            part.lags,
            common,
            None if place is None else row,
        )
    return Fit(
        effects=found,
        noise=noise,
        datum=constant,
        gauges=gauges,
        undetermined=tuple(undetermined),
        converged=joint is None or joint.converged,
        joint=joint,
        data=recording,
        stated=stated,
    )


def _lines(
    stack: Sequence[AbstractEffect], data: JointData
) -> Iterator[AbstractEffect]:
    """Yield lines over axes that no temperature moves, where no leadscrew takes them."""
    screws = {one.axis for one in stack if isinstance(one, Leadscrew)}
    for one in stack:
        if isinstance(one, Temperature) and one.axis not in screws:
            ends = one.ends(data)
            if len(ends) > 1:
                yield Leadscrew(one.axis, ends)


def _holders(stack: Sequence[AbstractEffect]) -> dict[str, AbstractEffect]:
    """Return by axis the table that holds the constant error, as in the list of a job."""
    ranks = [(kind(one.compensation).takes_constant, one) for one in stack]
    known = [(rank, one) for rank, one in ranks if rank is not None]
    found: dict[str, AbstractEffect] = {}
    for _, one in sorted(known, key=lambda pair: pair[0]):
        found.setdefault(one.axis, one)
    return found


def _friction(effect: Friction, given: Mapping[str, np.ndarray]) -> Choice:
    inertia = None if effect.inertia == "fit" else float(effect.inertia)
    velocity, acceleration, current = (given[role] for role in effect.roles[1:])
    current, _ = without_spikes(current)
    _check_drive(effect.axis, velocity, acceleration, current)
    samples = DriveSamples(given["time"], velocity, current, acceleration)
    return choose_law(samples, inertia=inertia)


def _check_drive(
    axis: str,
    velocity: Float[np.ndarray, " t"],
    acceleration: Float[np.ndarray, " t"],
    current: Float[np.ndarray, " t"],
) -> None:
    """Raise where a recording goes in one direction only, or its current opposes the motion."""
    fast = np.abs(velocity) > _MOVES * np.abs(velocity).max(initial=0.0)
    way = np.where(fast, np.sign(velocity), 0.0).astype(np.int64)
    ways = {sign: int(np.sum(way == sign)) for sign in (1, -1)}
    if min(ways.values()) < _FEW and max(ways.values()) >= _FEW:
        found = "positive" if ways[1] else "negative"
        msg = (
            f"{axis}.velocity: found motion in {found} direction only, expected both: the"
            " offset cannot be told from the friction"
        )
        raise FitError(msg)
    polarity = find_polarity(current, way, acceleration)
    if polarity.sign == -1 and polarity.confidence >= _SURE:
        msg = (
            f"{axis}.current: found one that opposes the motion ({polarity.statement}), as"
            " torque feedback is recorded, expected the current that drives it: give it"
            " with the other sign"
        )
        raise FitError(msg)


def _constrained(
    part: Part,
    values: Float[np.ndarray, " p"],
    common: float,
    constraint: Callable[[Any], Array] | Sequence[Constraint],
    datum: Float[np.ndarray, " p"],
    acted: Float[np.ndarray, "..."] | float,
) -> Float[np.ndarray, " p"]:
    """Return the most probable values of a part whose model keeps inequalities, by IPOPT.

    Args:
        part: As it was fitted.
        values: With the constant that they hold.
        common: Deviation of that constant, which moves with them.
        constraint: Of the model of the controller, as for `fit`.
        datum: Share of each in what is zero, see `datum_row`.
        acted: What a table added to its values while measuring.

    Raises:
        FitError: If nothing keeps them, the readings do not determine the values, or words
            stand for what is no table.
    """
    covariance, effect = part.covariance + common**2, part.effect
    if not np.isfinite(covariance).all():
        msg = f"constraints: the readings do not determine all of {part.name}"
        raise FitError(msg)
    sizes, modes = np.linalg.eigh(covariance)
    kept = sizes > _EMPTY * sizes.max()
    # What neither readings nor prior move stays where it is.
    span = modes[:, kept] * np.sqrt(sizes[kept])
    written = effect.table(values - datum @ values) - acted
    along = np.stack(
        [effect.table(column) for column in (span - datum @ span).T], axis=-1
    )
    if not callable(constraint):
        check_words(part, constraint)
        entries, unit = _entries(effect, written), float(np.sqrt(sizes.max()))
        rows = [_entries(effect, one) / unit for one in np.moveaxis(along, -1, 0)]
        slopes = sp.csr_array(np.stack(rows, axis=-1).reshape(-1, len(rows)))
        free = sp.eye_array(len(rows), format="csr")
        move = most_probable(constraint, entries / unit, effect.grid, slopes, free)
        return np.asarray(values + span @ move)

    def keeps(move: Float[Array, " k"], args: Any) -> Float[Array, " g"]:
        middle, along = args
        return one_vector(constraint(effect.to_model(middle + along @ move, -1.0)))

    found = least_squares_ipopt(
        lambda move, _: move,
        np.zeros(span.shape[1]),
        (jnp.asarray(written), jnp.asarray(along)),
        inequality=keeps,
    )
    if not found.converged:
        msg = f"constraints of {part.name}: IPOPT ended as '{found.status}'"
        raise FitError(msg)
    return np.asarray(values + span @ found.values)


def _entries(
    effect: AbstractEffect, values: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "..."]:
    """Return the entries of a list for the values of a table, shaped like them."""
    tables = effect.to_model(values, -1.0).tables
    return np.concatenate([np.ravel(each) for each in tables]).reshape(values.shape)
