"""The joint estimator: readings of several axes in, all effects with uncertainty out."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import (
    FitError,
    Readings,
    compact,
    cores,
    leave_one_out,
    one_blas_thread,
    sums_by_group,
)
from .._table import TOO_MANY
from ._axis import AxisFit, Smoothness, fit_axis
from ._design import design_of
from ._effect import AbstractEffect, Rank
from ._gauge import Rules
from ._identified import identified
from ._result import JointFit
from ._words import Confusion, Gauge, words_of


def fit_joint(
    data: JointData,
    effects: Sequence[AbstractEffect],
    *,
    loss: str = "student",
    smoothness: Smoothness = "auto",
    drift: int = 0,
    use: Bool[np.ndarray, " t"] | None = None,
) -> JointFit:
    r"""Fit any stack of effects on one or several axes together.

    Per compensated axis $e = d + \sum_k X_k \theta_k + \text{run} + \varepsilon$ with a
    constant $d$ (the datum): tables as Gaussian fields as in `fit_table`, all smoothness
    weights by the evidence of all effects together. What may be moved between effects without
    changing the sum is fixed by rules that do not depend on the errors (`JointFit.gauges`); what
    the data cannot tell is named (`JointFit.confusions`), its standard deviations are infinite.

    Args:
        data: Readings; rows that lack what an axis needs are left out for that axis.
        effects: What to fit; each at most once.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` is least squares.
        smoothness: ``"auto"``: by evidence; a number: weight of the squared second
            differences of all tables, relative to 1/noise²; or the weights of an earlier fit by
            name of the effect (`Part.smoothness`).
        drift: Pieces of the drift of each run; 0 = an offset per run only, and that only
            where there are several runs. Between these pieces' knots the reference wanders.
        use: Rows to fit; None = all. The others serve as history of lags only.

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

    with one_blas_thread():
        # Axes share no unknowns; their matrix products leave the interpreter free.
        with ThreadPoolExecutor(min(len(groups), cores())) as pool:
            fits = dict(zip(groups, pool.map(fitted, groups), strict=True))
        parts = {part.name: part for fit in fits.values() for part in fit.parts()}
        runs = {axis: fit.runs() for axis, fit in fits.items()}
        gauges, confusions = words_of(fit.known for fit in fits.values())
    return JointFit(
        parts=tuple(parts[effect.name] for effect in placed),
        noise={axis: fit.estimate.noise for axis, fit in fits.items()},
        residual={a: fit.over_rows(fit.residual, np.nan) for a, fit in fits.items()},
        share={axis: fit.over_rows(fit.share, 0.0) for axis, fit in fits.items()},
        wild={axis: fit.over_rows(~fit.active, False) for axis, fit in fits.items()},
        runs=runs,
        gauges=gauges,
        confusions=confusions,
        fits=fits,
    )


def held_out_errors(
    fit: JointFit, data: JointData, groups: Int[np.ndarray, " t"], *, runs: bool = False
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return each error less the sum that is fitted without its group, by axis in mm or °.

    Smoothness, lags and what the loss leaves of each reading are those of the fit. Groups that
    do not determine the effects predict their median only. NaN where a reading was not used.

    Args:
        fit: Of all rows, by `fit_joint`.
        data: Its readings.
        groups: What is left out together: the run, or the block of each row.
        runs: As for `JointFit.predict`.
    """
    result = {}
    for axis, axis_fit in fit.fits.items():
        rows = axis_fit.design.rows
        result[axis] = np.full(len(data), np.nan)
        error = data.error[axis][rows]
        with one_blas_thread():
            result[axis][rows] = _held_out(axis_fit, error, groups[rows], runs)
    return result


def _held_out(
    fit: AxisFit,
    error: Float[np.ndarray, " r"],
    groups: Int[np.ndarray, " r"],
    runs: bool,
) -> Float[np.ndarray, " r"]:
    """Return what is left of the used readings of one axis, each fitted without its group."""
    design, estimate = fit.design, fit.estimate
    columns, residual = compact(design.columns), np.array(error)
    sums = sums_by_group(estimate, Readings(error, {}), columns, groups)
    if len(sums) < 2:
        return residual  # without its only group nothing is known
    designs = {label: design.take(groups != label) for label in sums}
    pins = {label: slim.pins for label, slim in designs.items()}
    counted = np.ones(design.size, bool)
    if not runs:
        counted[design.places_of_rank(Rank.RUNS)] = False
        counted[design.places_of_rank(Rank.WANDER)] = False
    for label, post in leave_one_out(estimate, sums, {}, pins).items():
        mask, slim = groups == label, designs[label]
        if len(slim.rows) <= slim.free:
            residual[mask] -= np.median(error[~mask])
            continue
        rules = Rules.of(slim, fit.known.ideal).beside(slim)
        values = np.where(counted, rules.project(post.values), 0.0)
        residual[mask] -= columns[mask] @ values
    return residual


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
    with one_blas_thread():
        return words_of(
            identified(
                design_of(axis, group, data, 0, None, axis in data.error), data, 0
            )
            for axis, group in _by_axis([e.placed(data) for e in effects]).items()
        )


def _by_axis(effects: Sequence[AbstractEffect]) -> dict[str, list[AbstractEffect]]:
    """Return the effects of each compensated axis.

    Raises:
        FitError: If there is none, or the same one twice.
    """
    if not effects:
        msg = "found no effects, expected one at least."
        raise FitError(msg)
    result: dict[str, list[AbstractEffect]] = {}
    names: set[str] = set()
    for effect in effects:
        if effect.name in names:
            msg = f"found the {effect.name} twice, expected each effect once."
            raise FitError(msg)
        names.add(effect.name)
        result.setdefault(effect.axis, []).append(effect)
    return result
