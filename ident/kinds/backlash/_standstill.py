"""Backlash from readings that were approached in both directions."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import Backlash
from ...core import FitError, node_shares, one_blas_thread, refuse_confounded, regress
from ._types import SURE, BacklashFit, dependence_of, polynomials, refuse_undetermined

_HIGHEST = 3
"""Order of the polynomial along the axis."""
_TARGETS = 60
"""Different positions up to which each has an error of its own."""
_NODES = 24
"""Nodes of the error along the axis where the positions are all different."""


@one_blas_thread()
def fit_backlash(
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
    *,
    run: Int[np.ndarray, " t"] | None = None,
    time: Float[np.ndarray, " t"] | None = None,
    loss: str = "student",
) -> BacklashFit:
    r"""Fit the backlash to readings approached in both directions.

    $e = m(s) + r_{run} - \tfrac12 d\,w$: what is common to both directions is free along the
    axis (one value per target, or linear between nodes), so only differences at the same
    place count. Standard deviations know of drift over the order of the readings.

    Args:
        position: Of the axis in mm or °.
        error: Actual − commanded in mm or °, measured at standstill.
        direction: Of approach, +1 or −1.
        run: Repeated run of each reading, None = no runs. Every run that went both ways has an
            offset of its own.
        time: Of each reading in s; None = in the order of the rows.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If a direction is missing or no place was approached in both.
    """
    keep = _check(position, error, direction)
    rows = np.flatnonzero(keep)
    position, error, way = position[rows], error[rows], direction[rows].astype(float)
    clock = None if time is None else time[rows]
    common, places = _along(position, way)
    if run is not None:
        common = np.hstack([common, _run_offsets(run[rows], way)])
    # What the model of the controller would take away, about the mean of both directions.
    play = -np.asarray(Backlash(jnp.ones(()), 1).offset(way)) - 0.5
    columns = np.column_stack([play, common])
    found = regress(columns, error, time=clock, names=_names(columns), loss=loss)
    refuse_undetermined(found, "readings")
    drift = None
    if run is not None:
        within = np.hstack([columns, _within_runs(run[rows])])
        drift = _drift(within, error, clock, loss)
    order = min(_HIGHEST, places - 1)
    dependence = None
    if order >= 1 and len(error) > columns.shape[1] + order + 3:
        shape = play[:, None] * polynomials(position, order)
        try:
            richer = regress(np.hstack([shape, common]), error, time=clock, loss=loss)
            dependence = dependence_of(richer, order, len(error))
        except FitError:
            dependence = None
    wild = np.zeros(len(keep), bool)
    wild[rows[found.wild]] = True
    residual = np.full(len(keep), np.nan)
    residual[rows] = found.residual
    used = way[~found.wild]
    return BacklashFit(
        width=float(found.coefficients[0]),
        standard_deviation=float(found.standard_deviation[0]),
        noise=found.noise,
        independent=float(found.independent[0]),
        support=(int((used > 0).sum()), int((used < 0).sum())),
        residual=residual,
        wild=wild,
        dependence=dependence,
        drift=drift,
    )


def _check(
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
) -> Bool[np.ndarray, " t"]:
    """Return the rows that can be used, after the arguments are checked."""
    keep = np.isfinite(position) & np.isfinite(error)
    if not np.isin(direction, (1, -1)).all():
        found = int(direction[~np.isin(direction, (1, -1))][0])
        msg = f"direction: found {found}, expected +1 or -1."
        raise FitError(msg)
    for sign, name in ((1, "positive"), (-1, "negative")):
        if not (direction[keep] == sign).any():
            msg = (
                f"no reading was approached in {name} direction: one direction does "
                "not tell the backlash."
            )
            raise FitError(msg)
    ranges = [position[keep & (direction == sign)] for sign in (1, -1)]
    low = max(float(each.min()) for each in ranges)
    high = min(float(each.max()) for each in ranges)
    if low > high:
        msg = (
            "no place was approached in both directions: expected readings at common "
            "positions."
        )
        raise FitError(msg)
    return np.asarray(keep)


def _names(columns: Float[np.ndarray, "t k"]) -> list[str]:
    """Return the columns in words: what is common to both directions has no name."""
    common = "the error common to both directions, or runs"
    return ["backlash", *[common] * (columns.shape[1] - 1)]


def _along(
    position: Float[np.ndarray, " t"], way: Float[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "t k"], int]:
    """Return the columns of what both directions share, and the places in both."""
    span = max(float(np.ptp(position)), 1e-12)
    ordered = np.argsort(position)
    fresh = np.diff(position[ordered], prepend=-np.inf) > 1e-4 * span
    place = np.empty(len(position), np.int64)
    place[ordered] = np.cumsum(fresh) - 1
    targets = int(place.max()) + 1
    if targets <= _TARGETS and 2 * targets <= len(position):
        both = [len(np.unique(way[place == k])) == 2 for k in range(targets)]
        return np.eye(targets)[place], sum(both)
    count = int(np.clip(len(position) // 10, 2, _NODES))
    columns = node_shares(position, np.linspace(position.min(), position.max(), count))
    return columns[:, (columns > 0).any(axis=0)], count


def _within_runs(run: Int[np.ndarray, " t"]) -> Float[np.ndarray, "t 1"]:
    """Return the place of each reading in its run, −0.5 at the start and 0.5 at the end."""
    result = np.zeros((len(run), 1))
    for label in np.unique(run):
        rows = np.flatnonzero(run == label)
        result[rows, 0] = np.linspace(-0.5, 0.5, len(rows)) if len(rows) > 1 else 0.0
    return result


def _drift(
    columns: Float[np.ndarray, "t k"],
    error: Float[np.ndarray, " t"],
    clock: Float[np.ndarray, " t"] | None,
    loss: str,
) -> tuple[float, float] | None:
    """Return a drift within the runs, the last column, and the width beside it."""
    try:
        found = regress(columns, error, time=clock, loss=loss)
    except FitError:
        return None
    if not abs(found.coefficients[-1]) >= SURE * found.standard_deviation[-1]:
        return None
    return float(found.coefficients[-1]), float(found.coefficients[0])


def _run_offsets(
    run: Int[np.ndarray, " t"], way: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "t r"]:
    """Return a column per run but the first; none where runs went one way only."""
    labels, index = np.unique(run, return_inverse=True)
    index = index.reshape(-1)
    both = [len(np.unique(way[index == k])) == 2 for k in range(len(labels))]
    if not all(both):
        return np.zeros((len(run), 0))
    columns = np.eye(len(labels))[index][:, 1:]
    try:
        refuse_confounded(np.column_stack([np.ones(len(run)), way, columns]))
    except FitError:
        return np.zeros((len(run), 0))
    return columns
