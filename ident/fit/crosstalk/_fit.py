"""The crosstalk estimator: motion of the master and error of the slave in, tests out."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2

from ....models import Conventions, surface_through
from ...core._errors import FitError
from ._events import cut_events, specified
from ._own import Values, own_values, stencil_columns
from ._smooth import PLENTY, smooth_values
from ._tests import Nodes, Table, choose_tests, event_table, points_of
from ._types import (
    BRANCHES,
    MOST_TESTS,
    SAFE_TESTS,
    CrosstalkFit,
    CrosstalkReadings,
    Event,
    ModeScore,
)

_CHANCE = 0.01
"""Probability under equal directions below which they differ."""
_APART = ((0, 1, 2, 3), (0, 0, 1, 1))
"""Values per branch: each its own, or both directions alike."""


def fit_crosstalk(
    readings: CrosstalkReadings,
    *,
    acceleration: float | None = None,
    deceleration: float | None = None,
    mode: int | str = "auto",
    positions: Float[np.ndarray, "p k"] | None = None,
    velocity_dependent: bool | str = "auto",
    most_tests: int = SAFE_TESTS,
    least: float = 0.3,
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
        least: Share of the specified acceleration that an event reaches.
        conventions: How accelerations and directions are told apart; None = the defaults.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If there are no events or the arguments cannot be met.
    """
    rules = Conventions() if conventions is None else conventions
    modes = _modes(mode, readings, positions, most_tests)
    up, down = specified(readings, acceleration, deceleration)
    events = cut_events(readings, up, down, least=least, conventions=rules)
    messages: list[str] = []
    apart = velocity_dependent
    if isinstance(apart, str):
        if apart != "auto":
            msg = (
                f"velocity_dependent: found {apart!r}, expected true, false or 'auto'."
            )
            raise FitError(msg)
        apart, why = _directions_differ(events)
        messages.append(why)
    groups = _APART[0] if apart else _APART[1]
    table = event_table(events, groups)
    scores: tuple[ModeScore, ...] = ()
    nodes: Nodes | None = None
    if positions is not None:
        axes = tuple(range(positions.shape[1]))
        points = np.asarray(positions, float)
    else:
        axes, nodes, scores = choose_tests(table, modes, most_tests)
        points = points_of(nodes)
    found = _values(table, axes, points, nodes, loss)
    rows = _rows(found, groups, len(points))
    wild = np.zeros(len(events), bool)
    for each, which in found.values():
        wild[which] = each.wild
    marked = tuple(
        dataclasses.replace(event, wild=bool(odd))
        for event, odd in zip(events, wild, strict=True)
    )
    messages += _remarks(marked, rows["support"], points)
    return CrosstalkFit(
        mode=1 + len(axes),
        axes=axes,
        points=points,
        values=rows["value"],
        standard_deviation=rows["deviation"],
        support=rows["support"],
        complete=np.asarray((rows["support"] > 0).all(axis=0)),
        acceleration=up,
        deceleration=down,
        velocity_dependent=bool(apart),
        noise=tuple(float(each) for each in rows["noise"]),
        events=marked,
        scores=scores,
        conventions=rules,
        messages=tuple(messages),
    )


def _modes(
    mode: int | str,
    readings: CrosstalkReadings,
    positions: Float[np.ndarray, "p k"] | None,
    most_tests: int,
) -> tuple[int, ...]:
    if not 1 <= most_tests <= MOST_TESTS:
        msg = f"found {most_tests} tests at most, expected 1 to {MOST_TESTS}."
        raise FitError(msg)
    axes = readings.positions.shape[1]
    if axes > 2:
        msg = f"found {axes} adaptation axes, expected 0, 1 or 2."
        raise FitError(msg)
    if isinstance(mode, str):
        if mode != "auto":
            msg = f"mode: found {mode!r}, expected 1, 2, 3 or 'auto'."
            raise FitError(msg)
        modes = tuple(range(1, axes + 2))
    else:
        if mode not in (1, 2, 3):
            msg = f"mode: found {mode!r}, expected 1, 2, 3 or 'auto'."
            raise FitError(msg)
        if mode - 1 > axes:
            msg = (
                f"mode {mode} needs {mode - 1} adaptation axes, the readings have the "
                f"positions of {axes}."
            )
            raise FitError(msg)
        modes = (mode,)
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


def _directions_differ(events: tuple[Event, ...]) -> tuple[bool, str]:
    """Return whether values differ by direction, from events paired at the same places."""
    table = event_table(events, _APART[0])
    counts = np.bincount(table.group, minlength=4)
    missing = [BRANCHES[k] for k in np.flatnonzero(counts == 0)]
    if missing:
        return True, (
            f"No event shows {' or '.join(missing)}: whether the directions differ cannot "
            "be told, and nothing is known there."
        )
    statistic, free = 0.0, 0
    # Means over thirds of the events by place, so that a difference anywhere counts.
    place = _thirds(table.positions)
    for positive, negative in ((0, 1), (2, 3)):
        for third in np.unique(place):
            parts = [
                table.amount[(table.group == k) & (place == third)]
                for k in (positive, negative)
            ]
            if min(len(part) for part in parts) < 3:
                parts = [part for part in parts if len(part)]
                if len(parts) < 2:
                    continue
                variance = sum(table.own_noise**2 / len(part) for part in parts)
            else:
                variance = sum(
                    max(float(np.var(part, ddof=1)), table.own_noise**2) / len(part)
                    for part in parts
                )
            middle = [float(np.median(part)) for part in parts]
            # The median of Gaussian values scatters by a half more (in variance) than the mean.
            statistic += (middle[0] - middle[1]) ** 2 / (1.57 * variance)
            free += 1
    if free and float(chi2.sf(statistic, free)) < _CHANCE:
        return True, "The values differ by the direction of motion."
    return False, "The values are alike in both directions."


def _thirds(positions: Float[np.ndarray, "n k"]) -> np.ndarray:
    result = np.zeros(len(positions), np.int64)
    for column in positions.T:
        edges = np.quantile(column, [1 / 3, 2 / 3])
        result = 3 * result + np.searchsorted(edges, column)
    return result


def _values(
    table: Table,
    axes: tuple[int, ...],
    points: Float[np.ndarray, "p k"],
    nodes: Nodes | None,
    loss: str,
) -> dict[int, tuple[Values, np.ndarray]]:
    """Return the values of each group and its rows."""
    surface = surface_through(points)
    places = table.positions[:, list(axes)]
    columns = stencil_columns(surface, places)
    result = {}
    for group in np.unique(table.group):
        rows = np.flatnonzero(table.group == group)
        part = (table.amount[rows], table.weight[rows])
        if nodes is not None and len(rows) >= PLENTY * len(points) + 3:
            values = smooth_values(nodes, places[rows], *part, loss)
        else:
            values = own_values(columns[rows], *part, table.own_noise, loss)
        result[int(group)] = values, rows
    return result


def _rows(
    found: dict[int, tuple[Values, np.ndarray]], groups: tuple[int, ...], tests: int
) -> dict[str, np.ndarray]:
    """Return values, deviations, support and noise per row of `BRANCHES`."""
    rows = {
        "value": np.full((4, tests), np.nan),
        "deviation": np.full((4, tests), np.inf),
        "support": np.zeros((4, tests), np.int64),
        "noise": np.full(4, np.nan),
    }
    for branch, group in enumerate(groups):
        if group not in found:
            continue
        values, _ = found[group]
        known = values.support > 0
        rows["value"][branch] = np.where(known, values.value, np.nan)
        rows["deviation"][branch] = values.standard_deviation
        rows["support"][branch] = values.support
        rows["noise"][branch] = values.noise
    return rows


def _remarks(
    events: tuple[Event, ...],
    support: Int[np.ndarray, "4 p"],
    points: Float[np.ndarray, "p k"],
) -> list[str]:
    """Return what must be known of events and tests."""
    branch = np.array([event.branch for event in events])
    counts = np.bincount(branch, minlength=4)
    parts = ", ".join(
        f"{count} of {name}" for count, name in zip(counts, BRANCHES, strict=True)
    )
    said = [f"{len(events)} events: {parts}."]
    wild = sum(event.wild for event in events)
    if wild:
        said.append(f"{wild} events contradict the others and were left out.")
    empty = [name for name, row in zip(BRANCHES, support, strict=True) if not row.any()]
    if empty:
        said.append(
            f"Nothing is known for {' and '.join(empty)}: the entries of a test are written "
            "all four or not at all, so no test can be written."
        )
        return said
    for number in np.flatnonzero((support == 0).any(axis=0)):
        place = ", ".join(f"{value:g}" for value in points[number])
        lost = [BRANCHES[k] for k in np.flatnonzero(support[:, number] == 0)]
        said.append(
            f"The test at ({place}) mm is left out: no event for {' and '.join(lost)}."
        )
    if len(points) > SAFE_TESTS:
        said.append(
            f"{len(points)} tests: one statement of the manuals allows fewer than 15."
        )
    return said
