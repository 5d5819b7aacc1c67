"""Backlash from readings that were approached in both directions."""

import numpy as np
from jaxtyping import Float, Int

from ....models import Leadscrew
from ...core._errors import FitError
from ...core._regression import Regression, refuse_confounded, regress
from ._dependence import HIGHEST, dependence_of, dependence_warning, polynomials
from ._spread import carried_by, carried_warning
from ._types import SURE, BacklashFit

_TARGETS = 60
"""Different positions up to which each has an error of its own."""
_NODES = 24
"""Nodes of the error along the axis where the positions are all different."""


def fit_backlash(
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
    *,
    run: Int[np.ndarray, " t"] | None = None,
    run_effects: str = "offset",
    time: Float[np.ndarray, " t"] | None = None,
    table: Leadscrew | None = None,
    table_active: bool = False,
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
        run: Repeated run of each reading, None = no runs.
        run_effects: ``"offset"`` lets every run that went both ways have its own; ``"drift"``
            adds a drift within the runs, the same in all; ``"none"``.
        time: Of each reading in s; None = in the order of the rows.
        table: Leadscrew table of the axis, to see whether it already carries the backlash.
        table_active: Whether that table was active while measuring.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If a direction is missing or no place was approached in both.
    """
    keep = _check(position, error, direction)
    position, error, direction = position[keep], error[keep], direction[keep]
    way = direction.astype(float)
    common, names, places = _along(position, way)
    if run_effects not in ("none", "offset", "drift"):
        msg = (
            f"run_effects: found {run_effects!r}, expected 'none', 'offset' or 'drift'."
        )
        raise FitError(msg)
    if run is not None and run_effects != "none":
        offsets = _run_offsets(run[keep], direction)
        common = np.hstack([common, offsets])
        names += [f"offset of run {k + 2}" for k in range(offsets.shape[1])]
    steady = common
    slope = None if run is None else _within_runs(run[keep])[:, None]
    if slope is not None and run_effects == "drift":
        common, names = np.hstack([common, slope]), [*names, "drift within a run"]
    clock = None if time is None else time[keep]
    columns = np.column_stack([-0.5 * way, common])
    found = regress(columns, error, time=clock, names=["backlash", *names], loss=loss)
    warnings = []
    if slope is not None and run_effects == "offset":
        warnings += _drift_warning(columns, slope, error, clock, loss)
    order = min(HIGHEST, places - 1)
    dependence = None
    if order >= 1 and len(error) > columns.shape[1] + order + 3:
        # A change along the axis and a drift within the runs look alike: without the latter.
        shape = -0.5 * way[:, None] * polynomials(position, order)
        try:
            richer = regress(np.hstack([shape, steady]), error, time=clock, loss=loss)
        except FitError:
            # Drift of the runs and a change along the axis may look the same.
            richer = None
        if richer is not None:
            dependence = dependence_of(richer, 0, order, len(error))
    if dependence is not None and dependence.significant:
        warnings.append(dependence_warning(dependence))
    width = float(found.coefficients[0])
    if table is not None:
        twice = carried_warning(width, carried_by(table, position), table_active)
        warnings += [] if twice is None else [twice]
    wild = np.zeros(len(keep), bool)
    wild[np.flatnonzero(keep)[found.wild]] = True
    residual = np.full(len(keep), np.nan)
    residual[keep] = found.residual
    return BacklashFit(
        width=width,
        standard_deviation=float(found.standard_deviation[0]),
        names=("backlash", *names),
        covariance=found.covariance,
        noise=found.noise,
        independent=float(found.independent[0]),
        support=tuple(int((way[~found.wild] == sign).sum()) for sign in (1, -1)),  # type: ignore[arg-type]
        dependence=dependence,
        delay=None,
        reversals=(),
        take_up=None,
        residual=residual,
        wild=wild,
        warnings=tuple(warnings),
        message=sentence(width, found, int(found.wild.sum()), "readings"),
    )


def sentence(width: float, found: Regression, wild: int, things: str) -> str:
    """Return what was found, in a sentence."""
    text = (
        f"{len(found.residual)} {things}: {1e3 * width:.2f} µm ± "
        f"{1e3 * found.standard_deviation[0]:.2f} µm."
    )
    return text + (f" {wild} wild {things} were left out." if wild else "")


def _check(
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    direction: Int[np.ndarray, " t"],
) -> np.ndarray:
    keep = np.isfinite(position) & np.isfinite(error)
    if not np.isin(direction, (1, -1)).all():
        found = int(direction[~np.isin(direction, (1, -1))][0])
        msg = f"direction: found {found}, expected +1 or -1."
        raise FitError(msg)
    for sign, name in ((1, "positive"), (-1, "negative")):
        if not (direction[keep] == sign).any():
            msg = (
                f"no reading was approached in {name} direction: one direction alone does "
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


def _along(
    position: Float[np.ndarray, " t"], way: Float[np.ndarray, " t"]
) -> tuple[Float[np.ndarray, "t k"], list[str], int]:
    """Return the columns of what both directions share, names, and places in both."""
    span = max(float(np.ptp(position)), 1e-12)
    ordered = np.argsort(position)
    fresh = np.diff(position[ordered], prepend=-np.inf) > 1e-4 * span
    place = np.empty(len(position), np.int64)
    place[ordered] = np.cumsum(fresh) - 1
    targets = int(place.max()) + 1
    if targets <= _TARGETS and 2 * targets <= len(position):
        columns = np.eye(targets)[place]
        both = [len(np.unique(way[place == k])) == 2 for k in range(targets)]
        where = [float(position[place == k].mean()) for k in range(targets)]
        return columns, [f"error at {each:.6g}" for each in where], sum(both)
    count = int(np.clip(len(position) // 10, 2, _NODES))
    nodes = np.linspace(position.min(), position.max(), count)
    columns = np.column_stack(
        [np.interp(position, nodes, unit) for unit in np.eye(count)]
    )
    columns = columns[:, (columns > 0).any(axis=0)]
    return columns, [f"error near node {k + 1}" for k in range(columns.shape[1])], count


def _within_runs(run: Int[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return the place of each reading in its run, −0.5 at the start and 0.5 at the end."""
    result = np.zeros(len(run))
    for label in np.unique(run):
        rows = np.flatnonzero(run == label)
        result[rows] = np.linspace(-0.5, 0.5, len(rows)) if len(rows) > 1 else 0.0
    return result


def _drift_warning(
    columns: Float[np.ndarray, "t k"],
    slope: Float[np.ndarray, "t 1"],
    error: Float[np.ndarray, " t"],
    clock: Float[np.ndarray, " t"] | None,
    loss: str,
) -> list[str]:
    """Return the warning that a drift within the runs counts as backlash, if it shows."""
    try:
        found = regress(np.hstack([columns, slope]), error, time=clock, loss=loss)
    except FitError:
        return []
    drift, deviation = found.coefficients[-1], found.standard_deviation[-1]
    if abs(drift) < SURE * deviation:
        return []
    return [
        f"The readings drift by {1e3 * drift:.1f} µm within a run, which counts as backlash: "
        f"with the drift taken off it is {1e3 * found.coefficients[0]:.1f} µm."
    ]


def _run_offsets(
    run: Int[np.ndarray, " t"], direction: Int[np.ndarray, " t"]
) -> Float[np.ndarray, "t r"]:
    """Return a column per run but the first; none where runs went one way only."""
    labels, index = np.unique(run, return_inverse=True)
    index = index.reshape(-1)
    both = [len(np.unique(direction[index == k])) == 2 for k in range(len(labels))]
    if not all(both):
        return np.zeros((len(run), 0))
    columns = np.eye(len(labels))[index][:, 1:]
    try:
        refuse_confounded(np.column_stack([np.ones(len(run)), direction, columns]))
    except FitError:
        return np.zeros((len(run), 0))
    return columns
