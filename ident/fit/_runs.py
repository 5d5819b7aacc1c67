"""Offsets and drifts of runs: which the table keeps, which are far off, what their mean leaves."""

from collections.abc import Sequence

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg
from jaxtyping import Float, Int
from scipy.ndimage import median
from scipy.special import stdtr, stdtrit

from ..core import Readings, Stack, TableEffect
from ._types import RunEffect

_RIDGE, _EXACT, _HARDLY = 1e-9, 1e-6, 0.05
"""Holds nodes without readings; shares of an offset and of a drift, that a table leaves of it, up
to which the table does it as well."""
_FAR = 1e-3
"""Chance of any run at all being as far off the others, below which it is named."""
_LOUD = 3.0
"""A run with this many times the scatter of the median run is named."""
TWO_SIGMA = 0.97725
"""Share of a normal variable below two standard deviations."""


def kept_by_table(
    table: TableEffect, readings: Readings, drift: bool
) -> Float[np.ndarray, "pg k"]:
    """Return the offsets, then drifts, of runs that a table does as well, orthonormal columns.

    A mean offset is the constant of the table, and offsets of lines that grow from line to line
    are a slope of it; its smoothness tells those of set-ups that adjoin. A drift that all runs
    share is a slope where all go the same way over their places; where they go there and back it
    is that slope upward and its opposite downward. What readings hardly tell apart the table keeps.

    Args:
        table: Beside the runs.
        readings: With the number of the run of each, and its place within it for drifts.
        drift: Whether the runs have one.
    """
    run, nodes = readings.inputs["run"], Stack((table,)).matrix(readings)
    each = sp.csr_array((np.ones(len(run)), (np.arange(len(run)), run)))
    # What smoothness does not see of the table.
    straight = scipy.linalg.orth(nodes @ table.prior.straight)
    shared, alike = each.T @ straight, (each.T @ each).toarray()
    offsets = _null(alike, alike - shared @ shared.T, _EXACT)
    if not drift:
        return offsets
    place = sp.csr_array(each * readings.inputs["order"][:, None])
    columns = sp.csr_array(sp.hstack([each, place]))
    normal = sp.csc_array(nodes.T @ nodes + _RIDGE * sp.eye_array(table.size))
    own, shared = (columns.T @ columns).toarray(), (nodes.T @ columns).toarray()
    left = own - shared.T @ scipy.sparse.linalg.splu(normal).solve(shared)
    # What table and offsets leave of the drifts.
    half = len(own) // 2
    first, last = slice(half), slice(half, None)
    inverse = np.linalg.pinv(left[first, first], rcond=_EXACT, hermitian=True)
    beyond = left[last, last] - left[last, first] @ inverse @ left[first, last]
    drifts = _null(own[last, last], beyond, _HARDLY)
    return np.asarray(scipy.linalg.block_diag(offsets, drifts))


def _null(
    own: Float[np.ndarray, "g g"], left: Float[np.ndarray, "g g"], least: float
) -> Float[np.ndarray, "g k"]:
    """Return the orthonormal combinations of columns of which less than a share is left."""
    shares, vectors = scipy.linalg.eigh(left, own + _RIDGE * np.eye(len(own)))
    return np.linalg.qr(vectors[:, shares < least])[0]


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
    factor = 0.5 * float(stdtrit(count - 1, TWO_SIGMA))
    offset, drift = (factor * np.sqrt(between)).tolist()
    return offset, drift
