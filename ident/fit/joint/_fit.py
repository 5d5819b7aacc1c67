"""The joint estimator: readings of several axes in, all effects with uncertainty out."""

import dataclasses
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int

from ... import core
from ..._recording import JointData
from .._table import TOO_MANY
from .._types import RunEffect, Smoothness
from ._axis import AxisFit, fit_axis
from ._design import design_of
from ._effect import AbstractEffect, Rank
from ._gauge import Rules
from ._identified import identified
from ._words import Confusion, Gauge, words_of


@dataclasses.dataclass(frozen=True)
class Part:
    """One fitted effect; signs are those of the *error*.

    Attributes:
        effect: The effect, its nodes placed and its lag fitted: ``effect.block(data)`` works.
        values: In the order of the block, mm (coefficient of a temperature: mm/mm).
        support: Readings that touch each value.
        determined: Whether the data tell the value: some reading reaches it, and it is not
            confused with another effect.
        share: Information that all others (effects, runs, datum) leave of the effect, relative
            to what it has alone: mean over its independent directions, 0 to 1. Directions that a
            gauge gives to another effect do not count; values that no reading touches are 0.
        contribution: What it adds to each reading in mm or °; NaN where an input is missing.
        fit: Of its axis.
        smoothness: Weights of the prior by name, relative to 1/noise².
    """

    effect: AbstractEffect
    values: Float[np.ndarray, " p"]
    support: Int[np.ndarray, " p"]
    determined: Bool[np.ndarray, " p"]
    share: float
    contribution: Float[np.ndarray, " t"]
    fit: AxisFit = dataclasses.field(repr=False)
    smoothness: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def standard_deviation(self) -> Float[np.ndarray, " p"]:
        """Of the values under the stated gauge, same unit; inf where the data do not tell them."""
        return np.asarray(self.fit.deviation[self.places])

    @property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Joint covariance of the values, under the gauge of the fit.

        It knows of lags and of noise that drifts, as the deviations do. A value that the
        readings do not tell has the variance inf, and NaN beside it.
        """
        return self.fit.covariance(self.places)

    @property
    def places(self) -> Int[np.ndarray, " p"]:
        """Which unknowns of its axis the values are."""
        return self.fit.design.places_of(self.name)

    @property
    def lags(self) -> Mapping[str, tuple[float, float]]:
        """Time constant in s and its standard deviation, by sensor; empty without."""
        deviation = self.fit.lag_deviation
        return {
            sensor: (lag.value, deviation[sensor])
            for sensor, lag in self.fit.lags.items()
            if sensor in self.effect.sensor_names
        }

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name

    @property
    def table(self) -> Float[np.ndarray, "..."]:
        """Values in the shape in which lists hold them."""
        return self.effect.table(self.values)

    @property
    def known(self) -> bool:
        """Whether all values that any reading reaches are determined, and there are some."""
        reached = self.support > 0
        return bool(reached.any() and self.determined[reached].all())


@dataclasses.dataclass(frozen=True)
class JointFit:
    """Effects fitted together; signs are those of the *error*.

    error = datum + sum of the effects + run effects + noise, per compensated axis.

    Attributes:
        parts: One per effect, in the order given.
        noise: Standard deviation of one reading by axis in mm or °, wild ones left out.
        residual: Error − fit (run effects included) by axis; NaN where it was not used.
        share: Weight that the loss left each reading, 0 to 1, by axis.
        wild: Readings too far off to judge the noise by, by axis.
        runs: Offset and drift of each run against the datum, by axis.
        suspect_runs: Those that contradict the others, by axis.
        gauges: What may be moved between effects without changing the sum.
        confusions: What these data cannot tell apart.
        fits: Of each axis: its stack, and what its rows tell, with the rules of the gauge.
    """

    parts: tuple[Part, ...]
    noise: Mapping[str, float]
    residual: Mapping[str, Float[np.ndarray, " t"]]
    share: Mapping[str, Float[np.ndarray, " t"]]
    wild: Mapping[str, Bool[np.ndarray, " t"]]
    runs: Mapping[str, tuple[RunEffect, ...]]
    suspect_runs: Mapping[str, tuple[int, ...]]
    gauges: tuple[Gauge, ...]
    confusions: tuple[Confusion, ...]
    fits: Mapping[str, AxisFit] = dataclasses.field(repr=False)

    @property
    def datum(self) -> dict[str, tuple[float, float]]:
        """Constant of each axis in mm or °, and its standard deviation."""
        return {axis: fit.datum for axis, fit in self.fits.items()}

    @property
    def converged(self) -> bool:
        """Whether the iterations reached their tolerance."""
        return all(fit.estimate.converged for fit in self.fits.values())

    @property
    def message(self) -> str:
        """One sentence or more on how the fit went."""
        if len(self.fits) == 1:
            return next(iter(self.fits.values())).message
        fits = self.fits.items()
        return " ".join(f"Axis {axis}: {fit.message}" for axis, fit in fits)

    def part(self, name: str) -> Part:
        """Return the part with this name.

        Raises:
            KeyError: If there is none.
        """
        return {part.name: part for part in self.parts}[name]

    def predict(
        self, data: JointData, *, runs: bool = False
    ) -> dict[str, Float[np.ndarray, " t"]]:
        """Return datum and sum of all effects by axis, in mm or °.

        A lag needs the whole recording: predict all of it, then take the rows.

        Args:
            data: Rows.
            runs: Add what was taken off the runs, drift included, by run and time.
        """
        rows, result = np.arange(len(data)), {}
        for axis, fit in self.fits.items():
            total = np.full(len(data), fit.theta[fit.design.datum])
            for part in (part for part in self.parts if part.effect.axis == axis):
                total += part.effect.curve(part.values, data)
            course = fit.design.course.columns(data, axis, rows) if runs else {}
            for rank, columns in course.items():
                total += columns @ fit.theta[fit.design.places_of_rank(rank)]
            result[axis] = total
        return result


@core.one_blas_thread()
def fit_joint(
    data: JointData,
    effects: Sequence[AbstractEffect],
    *,
    loss: str = "student",
    smoothness: Smoothness = "auto",
    drift: int = 0,
    use: Bool[np.ndarray, " t"] | None = None,
    all_runs: bool = False,
) -> JointFit:
    r"""Fit any stack of effects on one or several axes together.

    Per compensated axis $e = d + \sum_k X_k \theta_k + \text{run} + \varepsilon$ with a
    constant $d$ (the datum): tables as Gaussian fields as in `fit_table`, all smoothness
    weights by the evidence of all effects together. What may be moved between effects without
    changing the sum is fixed by rules (`JointFit.gauges`) that know of the errors only which runs
    contradict the others, and where all readings are wild; what the data cannot tell is named
    (`JointFit.confusions`), its standard deviations are infinite.

    Args:
        data: Readings; rows that lack what an axis needs are left out for that axis.
        effects: What to fit; each at most once.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` is least squares.
        smoothness: ``"auto"``: by evidence; a number: weight of the squared second
            differences of all tables, relative to 1/noise².
        drift: Pieces of the drift of each run; 0 = an offset per run only, and that only
            where there are several runs. Between these pieces' knots the reference wanders.
        use: Rows to fit; None = all. The others serve as history of lags only.
        all_runs: Count runs that contradict the others in the mean of all, as ``"gauss"`` does.

    Raises:
        FitError: If an input is missing, or the readings do not determine the effects.
    """
    placed = [effect.placed(data) for effect in effects]
    groups = _by_axis(placed)

    def fitted(axis: str) -> AxisFit:
        fit_by = partial(fit_axis, axis, groups[axis], data, smoothness, drift, use)
        fit = fit_by(loss)
        if loss == "student" and float((~fit.active).mean()) > TOO_MANY:
            # So many that agree with each other: not they are at fault.
            return fit_by("huber")
        return fit

    # Axes share no unknowns; their matrix products leave the interpreter free.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        fits = dict(zip(groups, pool.map(fitted, groups), strict=True))
    suspects = {axis: fit.suspects for axis, fit in fits.items()}
    for axis, aside in suspects.items():
        if aside and loss != "gauss" and not all_runs:
            # A run that contradicts the others must not pull their mean.
            design = dataclasses.replace(fits[axis].design, aside=aside)
            fits[axis] = dataclasses.replace(fits[axis], design=design)
    parts = {part.name: part for fit in fits.values() for part in _parts(fit)}
    gauges, confusions = words_of(fit.known for fit in fits.values())
    by_size = loss == "huber"
    kept = {a: fit.counted if by_size else fit.active for a, fit in fits.items()}
    return JointFit(
        parts=tuple(parts[effect.name] for effect in placed),
        noise={axis: fit.estimate.noise for axis, fit in fits.items()},
        residual={a: fit.over_rows(fit.residual, np.nan) for a, fit in fits.items()},
        share={axis: fit.over_rows(fit.share, 0.0) for axis, fit in fits.items()},
        wild={axis: fits[axis].over_rows(~good, False) for axis, good in kept.items()},
        runs={axis: fit.runs() for axis, fit in fits.items()},
        suspect_runs=suspects,
        gauges=gauges,
        confusions=confusions,
        fits=fits,
    )


def _parts(fit: AxisFit) -> Iterator[Part]:
    """Yield the fitted effects of an axis."""
    known, post = fit.known, fit.estimate.posterior
    priors = zip(fit.design.components, fit.design.stack.priors, strict=True)
    smoothness = {
        part.name: dict(zip(prior.names, post.weights[terms].tolist(), strict=True))
        for part, (prior, _, terms) in priors
    }
    told = fit.design.reached & ~known.confounded & ~known.hidden
    stated = [part.owner for part in fit.design.stated]
    for effect in fit.design.effects:
        places = fit.design.places_of(effect.name)
        shares = zip(known.share, stated, strict=True)
        yield Part(
            effect=effect,
            values=fit.theta[places],
            support=post.problem.sums.support[places],
            determined=told[places],
            share=min(share for share, owner in shares if owner == effect.name),
            contribution=effect.curve(fit.theta[places], fit.design.data),
            fit=fit,
            smoothness=smoothness.get(effect.name, {}),
        )


@core.one_blas_thread()
def held_out_errors(
    fit: JointFit, groups: Int[np.ndarray, " t"], *, runs: bool = False
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return each error less the sum that is fitted without its group, by axis in mm or °.

    Smoothness, lags and what the loss leaves of each reading are those of the fit. Groups that
    do not determine the effects predict their median only. NaN where a reading was not used.

    Args:
        fit: Of all rows, by `fit_joint`.
        groups: What is left out together: the run, or the block of each row.
        runs: As for `JointFit.predict`.
    """
    return {
        axis: one.over_rows(_held_out(one, groups[one.design.rows], runs), np.nan)
        for axis, one in fit.fits.items()
    }


def _held_out(
    fit: AxisFit, groups: Int[np.ndarray, " r"], runs: bool
) -> Float[np.ndarray, " r"]:
    """Return what is left of the used readings of one axis, each fitted without its group."""
    design, estimate = fit.design, fit.estimate
    columns, error, residual = design.columns, design.error, design.error.copy()
    sums = core.sums_by_group(estimate, core.Readings(error, {}), columns, groups)
    if len(sums) < 2:
        return residual  # without its only group nothing is known
    designs = {label: design.take(fit.active & (groups != label)) for label in sums}
    pins = {label: slim.pins for label, slim in designs.items()}
    counted = np.ones(design.size, bool)
    if not runs:
        counted[design.places_of_rank(Rank.RUNS)] = False
        counted[design.places_of_rank(Rank.WANDER)] = False
    for label, post in core.leave_one_out(estimate, sums, {}, pins).items():
        mask, slim = groups == label, designs[label]
        if len(slim.rows) <= slim.free:
            residual[mask] -= np.median(error[~mask])
            continue
        rules = Rules.of(slim, fit.known.ideal).beside(slim)
        values = np.where(counted, rules.project(post.values), 0.0)
        residual[mask] -= columns[mask] @ values
    return residual


@core.one_blas_thread()
def examine_design(
    data: JointData, effects: Sequence[AbstractEffect]
) -> tuple[tuple[Gauge, ...], tuple[Confusion, ...]]:
    """Return what these rows cannot tell of effects, whatever was or will be measured.

    Rows without an error are left out; with no error of an axis recorded at all every row
    counts: a planned measurement can be examined.

    Returns:
        As `JointFit.gauges` and `JointFit.confusions`.

    Raises:
        FitError: If an input is missing or no row is complete.
    """
    groups = _by_axis([effect.placed(data) for effect in effects])
    return words_of(
        identified(design_of(axis, group, data, 0, None, axis in data.error))
        for axis, group in groups.items()
    )


def _by_axis(effects: Sequence[AbstractEffect]) -> dict[str, list[AbstractEffect]]:
    """Return the effects of each compensated axis.

    Raises:
        FitError: If there is none, or the same one twice.
    """
    if not effects:
        msg = "found no effects, expected one at least."
        raise core.FitError(msg)
    result: dict[str, list[AbstractEffect]] = {}
    for effect in effects:
        group = result.setdefault(effect.axis, [])
        if any(effect.name == other.name for other in group):
            msg = f"found the {effect.name} twice, expected each effect once."
            raise core.FitError(msg)
        group.append(effect)
    return result
