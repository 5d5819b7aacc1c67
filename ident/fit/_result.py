"""From an estimate to what is said of a table: deviations, runs, suspects."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.ndimage import maximum_filter, median
from scipy.special import ndtri, stdtr, stdtrit

from ...data.signals import NORMAL, independent, resolution
from .. import core
from ..core._readings import Vector
from ._types import RunEffect, Samples, TableFit

_NOTHING, _HOPELESS = 1e-12, 1e3
"""Scatter in mm or ° that is none; uncertainty of a node, in ranges of the readings, that no
extrapolation explains."""
_TRUSTED = 0.5
"""A node whose nearest readings keep less than this share of their weight is named."""
_CHANCE = 0.01
"""That any lone reading of sound ones is named."""
_ALIKE, _FEWEST = 2.0, 20
"""Readings beside each other of which one alone is news, from which on runs err along their way;
how many, beyond those that the table takes, tell it."""
_TORN, _STEPS, _RUNS, _IN_A_ROW, _EVEN = 8.0, 3.0, 3, 4, 2.0
"""Robust deviations, and steps of the instrument, by which readings of a run lie off the others;
runs that tell that, and how many readings one after the other; from one to the next at most so
many times as far."""
_FAR = 1e-3
"""Chance of any run at all being as far off the others, below which it is named."""
_LOUD = 3.0
"""A run with this many times the scatter of the median run is named."""
_TWO_SIGMA = 0.97725
"""Share of a normal variable below two standard deviations."""
ALIKE = (
    "Readings of a run that follow each other err alike (heat, air): the standard deviations "
    "are no smaller than those of the mean of the runs."
)


def wild_readings(
    stack: core.Stack, readings: core.Readings, about: Vector, loss: core.Loss
) -> tuple[Bool[np.ndarray, " t"], Float[np.ndarray, "3 n"]]:
    """Return which readings are wild by their residuals about an estimate, and where.

    That is: readings next to each unknown of the table, the weight they keep, those that are
    wild; these add up over pieces. A wild one pulls a little where the loss is Huber's.
    """
    ratio = residual_of(stack, readings, about) / loss.scale
    wild = np.abs(ratio) > loss.wild_from
    table, nearest = stack.effects[0], nearest_nodes(stack, readings)
    rows = (None, loss.share(ratio), wild)
    nodes = np.stack([np.bincount(nearest, row, table.size) for row in rows])
    return wild, nodes


def nearest_nodes(stack: core.Stack, readings: core.Readings) -> Int[np.ndarray, " t"]:
    """Return the unknown of the table that each reading has the largest share in."""
    nodes, shares = stack.effects[0].design(readings)
    return np.asarray(nodes[np.arange(len(nodes)), shares.argmax(axis=1)])


def residual_of(
    stack: core.Stack, readings: core.Readings, values: Vector
) -> Float[np.ndarray, " t"]:
    """Return reading − fit."""
    return core.sums_of(stack, readings, values, core.Loss(), core.Sums.empty(stack))[1]


def result_of(
    layout: core.TableEffect,
    estimate: core.Estimate,
    loss: str,
    *,
    count: int,
    spread: float = np.inf,
    runs: Sequence[int] = (),
    nodes: Float[np.ndarray, "3 n"] | None = None,
) -> TableFit:
    """Return what an estimate says of a table, its first effect; arrays over readings are empty.

    Args:
        layout: Where the nodes lie.
        estimate: The estimate.
        loss: Its name.
        count: Number of readings.
        spread: Range of the readings in mm or °; infinite: any uncertainty is accepted.
        runs: Runs that have effects of their own.
        nodes: Of `wild_readings`; None: no node is suspect.

    Raises:
        FitError: If the readings do not determine the table.
    """
    post, table = estimate.posterior, layout
    variances = estimate.spread(lambda post: (post.values, post.inverse_diagonal))
    deviation = np.sqrt(variances[: table.size])
    unscaled = np.maximum(post.inverse_diagonal[: table.size], 1e-300)
    scale = sp.diags_array(deviation / np.sqrt(unscaled))
    support = post.problem.sums.support[: table.size]
    worst = float(deviation[support > 0].max(initial=0.0))
    # Rounding can leave a singular matrix just definite.
    if worst > _HOPELESS * max(spread, estimate.noise, _NOTHING):
        msg = (
            "the readings do not determine the table: the least known node is uncertain "
            f"by {worst:.3g}."
        )
        raise core.FitError(msg)
    suspects: list[int] = []
    if nodes is not None:
        nearest, weight, _ = nodes
        # A share of 0.5 is the Student weight at two scales. A lone reading must be further off,
        # and of many nodes the furthest lies far off by chance, the less the more readings it has.
        read = np.maximum(nearest, 1)
        chance = float(-ndtri(0.5 * _CHANCE / max(int(np.sum(nearest > 0)), 1)))
        far = estimate.noise / estimate.loss.scale * chance / np.sqrt(read)
        least = np.where(read > 1, _TRUSTED, 0.5 * _TRUSTED)
        limit = np.minimum(least, estimate.loss.share(far)) * nearest
        doubted = (nearest > 0) & (weight < limit)
        suspects = np.flatnonzero(table.to_table(doubted).reshape(-1)).tolist()
    return TableFit(
        layout=layout,
        values=table.to_table(post.values[: table.size]),
        standard_deviation=table.to_table(deviation),
        support=table.to_table(support),
        noise=estimate.noise,
        smoothness=dict(zip(table.prior.names, post.weights.tolist(), strict=True)),
        loss=loss,
        residual=np.zeros(0),
        wild=np.zeros(0, bool),
        runs=_run_effects(post, runs, estimate.scatter[0]),
        suspect_nodes=tuple(suspects),
        suspect_runs=(),
        covariance=sp.csr_array(scale @ post.covariance(table.offsets) @ scale),
        converged=estimate.converged,
        message=estimate.message(count),
        estimate=estimate,
    )


def folds_of(
    fit: TableFit,
    groups: Mapping[int, core.Sums],
    zeros: Mapping[int, Float[np.ndarray, "q m"]],
) -> dict[int, TableFit]:
    """Return the table without each group of readings, as `leave_one_out` takes them.

    Smoothness and loss are those of the whole fit.
    """
    assert fit.estimate is not None  # that of all readings has one
    folds = {}
    for label, post in core.leave_one_out(fit.estimate, groups, zeros, {}).items():
        estimate = dataclasses.replace(fit.estimate, posterior=post, stated=True)
        count = int(post.problem.count)
        fold = result_of(fit.layout, estimate, fit.loss, count=count)
        fold = fold if fit.keeps is None else fit.keeps(fold)
        folds[label] = dataclasses.replace(fold, estimate=None)
    return folds


def _run_effects(
    post: core.Posterior, runs: Sequence[int], variance: float
) -> tuple[RunEffect, ...]:
    """Return offset and drift of every run with their deviations."""
    stack = post.problem.stack
    effect = stack.effects[-1]
    if not runs or not isinstance(effect, core.GroupEffect):
        return ()
    by_group, border = effect.by_group, slice(stack.here(-1).start - stack.band, None)
    inverse = post.factor.border_inverse[border, border]
    values = by_group @ post.values[stack.here(-1)]
    deviations = np.sqrt(variance * (by_group @ inverse * by_group).sum(axis=1))
    rows = np.zeros((4, len(runs)))
    rows[: 2 * effect.parts : 2] = values.reshape(effect.parts, -1)
    rows[1 : 2 * effect.parts : 2] = deviations.reshape(effect.parts, -1)
    pairs = zip(runs, rows.T.tolist(), strict=True)
    return tuple(RunEffect(run, *row) for run, row in pairs)


def far_runs(runs: Sequence[RunEffect]) -> tuple[int, ...]:
    """Return runs that lie further off the others than those of one machine in a thousand.

    Each offset against mean and scatter of the others, by Student's t.
    """
    count = len(runs)
    if count < 3:
        return ()
    offset = np.array([run.offset for run in runs])
    offset_sd = np.array([run.offset_sd for run in runs])
    free = count - 1
    # Of the others alone, by the deviations from the mean of all.
    deviation = offset - offset.mean()
    square = np.sum(deviation**2) - deviation**2 * count / free
    scatter = np.maximum(np.sqrt(np.maximum(square, 0.0) / (free - 1)), offset_sd)
    distance = np.abs(deviation) * count / free
    t = distance / (scatter * np.sqrt(1.0 + 1.0 / free))
    # Of two others the scatter is hardly known: as if of three.
    far = 2.0 * stdtr(max(count - 2, 2), -t) < _FAR / count
    return tuple(run.run for run, is_far in zip(runs, far, strict=True) if is_far)


def suspect_runs(
    runs: Sequence[RunEffect],
    residual: Float[np.ndarray, " t"],
    run: Int[np.ndarray, " t"] | None,
) -> tuple[int, ...]:
    """Return which of some runs contradict the others: far off them, or scattering far more."""
    if len(runs) < 3 or run is None:
        return ()
    labels = np.array([effect.run for effect in runs])
    scatter = np.asarray(median(np.abs(residual), run, labels))
    loud = labels[scatter > _LOUD * np.median(scatter)].tolist()
    return tuple(sorted({*loud, *far_runs(runs)}))


def scatter_of_runs(runs: Sequence[RunEffect]) -> tuple[float, float]:
    """Return the standard deviations of offsets and of drifts of some runs.

    Less what the noise of their readings explains. The factor of Student's t makes two of them
    hold as many cases as of a normal variable.
    """
    count = len(runs)
    if count < 2:
        return 0.0, 0.0
    values = np.array([[run.offset, run.drift] for run in runs])
    deviations = np.array([[run.offset_sd, run.drift_sd] for run in runs])
    noise = np.square(deviations).sum(axis=0) / (count - 1)
    # The mean of drifts is what the table did not keep.
    values[:, 0] -= values[:, 0].mean()
    between = np.maximum(np.square(values).sum(axis=0) / (count - 1) - noise, 0.0)
    factor = 0.5 * float(stdtrit(count - 1, _TWO_SIGMA))
    offset, drift = (factor * np.sqrt(between)).tolist()
    return offset, drift


def doubt_of_curves(
    fit: TableFit, samples: Samples, node: Int[np.ndarray, " t"]
) -> Float[np.ndarray, " n"]:
    """Return the variance of each node beyond that of readings that err by themselves.

    Heat and air make each run a curve of its own beside its offset and drift. Then neighbours
    of a run err alike, and smoothing over them tells a node no better than the mean of the runs
    at the node itself. Zero where runs do not show that.

    Args:
        fit: Of the samples.
        samples: With their runs; without, nothing shows.
        node: Nearest unknown of the table to each reading.
    """
    table = fit.layout
    none = np.zeros(table.size)
    if samples.run is None:
        return none
    good = ~fit.wild
    run, order = samples.readings.inputs["run"][good], samples.order
    place, left = run * table.size + node[good], fit.residual[good]
    when = np.arange(len(good)) if order is None else order
    passed, first, inverse = np.unique(place, return_index=True, return_inverse=True)
    mean = np.bincount(inverse, left) / np.bincount(inverse)
    at = passed % table.size
    count = np.bincount(at, minlength=table.size)
    mean -= (np.bincount(at, mean, table.size) / np.maximum(count, 1))[at]
    along = np.lexsort([when[good][first], passed // table.size])
    free = int((count[count > 0] - 1).sum()) - 2 * int(run.max(initial=0))
    if free < _FEWEST:
        return none
    times = len(mean) / independent(mean[along])
    if times < _ALIKE:
        return none
    variance = np.square(table.to_values(fit.standard_deviation))
    most = mean @ mean / free / np.maximum(count, 1)
    shared = np.minimum(times * variance, most) - variance
    shared = np.where(count > 1, shared, (times - 1.0) * variance)
    return np.asarray(np.maximum(shared, 0.0))


def none_left_out(share: float) -> str:
    """Return what to do where so large a share of the readings contradicts a table."""
    return (
        f"{share:.0%} of the readings lie far off the others, too many to be left out. Where they"
        " agree with each other, they contradict a table of these nodes: take others. Else they"
        " are faults of the instrument: leave them out (skip), or measure again."
    )


def runs_apart(
    fit: TableFit, samples: Samples, node: Int[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " n"]]:
    """Return where some runs contradict the others on a stretch, and what a node may be off by it.

    No offset or drift explains that, and where several do, no reading is wild: nobody can tell
    which of them are right, and the table lies between them.

    Args:
        fit: Of the samples.
        samples: With their runs; without, nothing shows.
        node: Nearest unknown of the table to each reading.

    Returns:
        By how much the run of each reading lies off the others, else zero; variance of each node.
    """
    table, good = fit.layout, np.flatnonzero(~fit.wild)
    size = table.size
    apart, none = np.zeros(len(node)), np.zeros(size)
    if samples.run is None or not good.size:
        return apart, none
    at, run = node[good], samples.readings.inputs["run"][good]
    passed, inverse = np.unique(run * size + at, return_inverse=True)
    count = np.bincount(passed % size, minlength=size)
    off = fit.residual[good]
    off = off - median(off, at, np.arange(size))[at]
    off -= median(off, run, np.arange(run.max() + 1))[run]
    compared = count[at] >= _RUNS
    if not compared.any():
        return apart, none
    scatter = NORMAL * float(np.median(np.abs(off[compared])))
    least = max(_TORN * scatter, _STEPS * resolution(samples.error), _NOTHING)
    side = np.where(compared & (np.abs(off) > least), np.sign(off), 0.0)
    along = np.lexsort([good if samples.order is None else samples.order[good], run])
    height = np.log(np.maximum(np.abs(off[along]), least))
    other = np.abs(np.diff(height)) > np.log(_EVEN)
    other |= (np.diff(run[along]) != 0) | (np.diff(side[along]) != 0)
    stretch = np.concatenate([[0], np.cumsum(other)])
    torn = np.zeros(len(off), bool)
    torn[along] = (np.bincount(stretch) >= _IN_A_ROW)[stretch] & (side[along] != 0.0)
    apart[good] = np.where(torn, off, 0.0)
    means, place = np.bincount(inverse, off) / np.bincount(inverse), passed % size
    centred = means - (np.bincount(place, means, size) / np.maximum(count, 1))[place]
    free = np.maximum(count - 1, 1)
    square = np.bincount(place, centred**2, size) / (free * np.maximum(count, 1))
    doubt = square * np.square(0.5 * stdtrit(free, _TWO_SIGMA))
    doubt[np.bincount(at, torn, size) == 0] = 0.0
    # Smoothness carries it to the nodes beside.
    return apart, table.to_values(maximum_filter(table.to_table(doubt), 3))
