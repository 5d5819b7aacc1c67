"""The crosstalk estimator: motion of the master and error of the slave in, tests out."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2

from ....models import Conventions, surface_through
from ...core import FitError, one_blas_thread
from ._events import cut_events, specified
from ._tests import Table, choose_tests, fit_values, points_of, surface_columns
from ._types import (
    BRANCHES,
    MOST_TESTS,
    SAFE_TESTS,
    CrosstalkFit,
    CrosstalkReadings,
    Directions,
    Event,
    ModeScore,
)

_CHANCE = 0.01
"""Probability under equal directions below which they differ."""
_FEW = 3
"""Events below which their scatter is believed from within them."""
_MEDIAN = 1.57
"""Variance of the median of Gaussian values, in that of the mean."""
_APART = ((0, 1, 2, 3), (0, 0, 1, 1))
"""Values per branch: each its own, or both directions alike."""
_TOUCHED = 1e-9


@one_blas_thread()
def fit_crosstalk(
    readings: CrosstalkReadings,
    *,
    acceleration: float | None = None,
    deceleration: float | None = None,
    mode: int | str = "auto",
    positions: Float[np.ndarray, "p k"] | None = None,
    velocity_dependent: bool | str = "auto",
    most_tests: int = SAFE_TESTS,
    conventions: Conventions | None = None,
    loss: str = "student",
) -> CrosstalkFit:
    """Fit the tests of a crosstalk list to acceleration events of a log.

    Every event is reduced to one value (`cut_events`); the values are the readings of a table
    over the adaptation axes, one per sign of the acceleration and direction.

    Args:
        readings: Log of master and slave.
        acceleration: Specified, in mm/s², above 0; None = as measured.
        deceleration: Specified, in mm/s², below 0; None = as measured.
        mode: 1, 2 or 3 (number of adaptation axes + 1), or ``"auto"``: events held out choose.
        positions: Of the tests in mm, one column per adaptation axis (of the mode; of the
            readings where that is ``"auto"``); None = chosen from the events.
        velocity_dependent: Values of their own per direction; ``"auto"``: if they differ.
        most_tests: Tests at most, 1 to 15.
        conventions: How accelerations and directions are defined; None = the defaults.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If there are no events or the arguments cannot be met.
    """
    rules = Conventions() if conventions is None else conventions
    modes = _modes(mode, readings, positions, most_tests)
    if isinstance(velocity_dependent, str) and velocity_dependent != "auto":
        msg = (
            f"velocity_dependent: found {velocity_dependent!r}, expected true, false or "
            "'auto'."
        )
        raise FitError(msg)
    up, down = specified(readings, acceleration, deceleration)
    events = cut_events(readings, up, down, conventions=rules)
    directions: Directions = "given"
    apart = velocity_dependent
    if isinstance(apart, str):
        directions = _directions(events)
        apart = directions != "alike"
    groups = _APART[0] if apart else _APART[1]
    table = Table.of(events, groups)
    scores: tuple[ModeScore, ...] = ()
    if positions is not None:
        axes = tuple(range(positions.shape[1]))
        points = np.asarray(positions, float)
    else:
        axes, nodes, scores = choose_tests(table, modes, most_tests)
        points = points_of(nodes)
    columns = surface_columns(points, table.positions[:, list(axes)])
    rows = _Rows(len(points))
    wild = np.zeros(len(events), bool)
    for group in np.unique(table.group):
        mine = table.group == group
        found = fit_values(columns[mine], table.take(mine), loss)
        wild[mine] = found.wild
        support = (columns[mine][~found.wild] > _TOUCHED).sum(axis=0)
        lacking = found.undetermined | (support == 0)
        for branch in np.flatnonzero(np.array(groups) == group):
            rows.value[branch] = np.where(lacking, np.nan, found.coefficients)
            rows.deviation[branch] = np.where(lacking, np.inf, found.standard_deviation)
            rows.support[branch] = np.where(lacking, 0, support)
            rows.noise[branch] = found.noise.white
    return CrosstalkFit(
        mode=1 + len(axes),
        axes=axes,
        points=points,
        values=rows.value,
        standard_deviation=rows.deviation,
        support=rows.support,
        complete=np.asarray((rows.support > 0).all(axis=0)),
        acceleration=up,
        deceleration=down,
        velocity_dependent=bool(apart),
        directions=directions,
        noise=tuple(float(each) for each in rows.noise),
        events=tuple(
            dataclasses.replace(event, wild=bool(odd))
            for event, odd in zip(events, wild, strict=True)
        ),
        scores=scores,
        conventions=rules,
    )


class _Rows:
    """Values, deviations, support and noise per row of `BRANCHES`; nothing known yet."""

    def __init__(self, tests: int) -> None:
        self.value = np.full((len(BRANCHES), tests), np.nan)
        self.deviation = np.full((len(BRANCHES), tests), np.inf)
        self.support: Int[np.ndarray, "4 p"] = np.zeros(
            (len(BRANCHES), tests), np.int64
        )
        self.noise = np.full(len(BRANCHES), np.nan)


def _modes(
    mode: int | str,
    readings: CrosstalkReadings,
    positions: Float[np.ndarray, "p k"] | None,
    most_tests: int,
) -> tuple[int, ...]:
    """Return the modes to choose from, after the arguments are checked."""
    if not 1 <= most_tests <= MOST_TESTS:
        msg = f"found {most_tests} tests at most, expected 1 to {MOST_TESTS}."
        raise FitError(msg)
    axes = readings.positions.shape[1]
    if axes > 2:
        msg = f"found {axes} adaptation axes, expected 0, 1 or 2."
        raise FitError(msg)
    if mode not in (1, 2, 3, "auto"):
        msg = f"mode: found {mode!r}, expected 1, 2, 3 or 'auto'."
        raise FitError(msg)
    modes = tuple(range(1, axes + 2)) if isinstance(mode, str) else (mode,)
    if modes[-1] - 1 > axes:
        msg = (
            f"mode {mode} needs {modes[-1] - 1} adaptation axes, the readings have the "
            f"positions of {axes}."
        )
        raise FitError(msg)
    if positions is not None:
        if not 1 <= len(positions) <= MOST_TESTS:
            msg = f"found {len(positions)} tests, expected 1 to {MOST_TESTS}."
            raise FitError(msg)
        if positions.shape[1] > axes or positions.shape[1] + 1 not in modes:
            msg = (
                f"the tests have positions of {positions.shape[1]} axes, expected "
                f"{modes[-1] - 1}."
            )
            raise FitError(msg)
        try:
            surface_through(np.asarray(positions, float))
        except ValueError as error:
            raise FitError(str(error)) from error
    return modes


def _directions(events: tuple[Event, ...]) -> Directions:
    """Return whether values differ by direction, from events paired at the same places."""
    table = Table.of(events, _APART[0])
    if (np.bincount(table.group, minlength=len(BRANCHES)) == 0).any():
        return "unknown"
    statistic, free = 0.0, 0
    # Medians over thirds of the events by place, so that a difference anywhere counts.
    place = np.zeros(len(events), np.int64)
    for column in table.positions.T:
        edges = np.quantile(column, [1 / 3, 2 / 3])
        place = 3 * place + np.searchsorted(edges, column)
    for pair in ((0, 1), (2, 3)):
        for third in np.unique(place):
            parts = [table.amount[(table.group == k) & (place == third)] for k in pair]
            fewest = min(len(part) for part in parts)
            if not fewest:
                continue
            seen = [
                float(np.var(part, ddof=1)) if fewest >= _FEW else 0.0 for part in parts
            ]
            variance = sum(
                max(each, table.own_noise**2) / len(part)
                for each, part in zip(seen, parts, strict=True)
            )
            apart = float(np.median(parts[0]) - np.median(parts[1]))
            statistic += apart**2 / (_MEDIAN * variance)
            free += 1
    differ = free and float(chi2.sf(statistic, free)) < _CHANCE
    return "differ" if differ else "alike"
