"""Crosstalk: master motion and slave error in, tests of modes 1 to 3 out.

Read before: `_events` (accelerations cut out of a log, one value each), `_tests` (where the
tests stand, by events held out).
"""

import dataclasses
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtrc, ndtri  # scipy.stats takes long to load

from ....models import Conventions, Crosstalk, LegacyCrosstalk, surface_through
from ...core import FitError, filled, one_blas_thread
from .._protocol import DEFAULT_RULES
from . import SAFE_TESTS
from ._events import (
    BRANCHES as BRANCHES,
    CrosstalkReadings as CrosstalkReadings,
    Events as Events,
    cut_events as cut_events,
    specified,
)
from ._tests import ModeScore, Table, choose_tests, points_of

MOST_TESTS = 15
"""Measurement tests that a list holds at most ([001] p.84)."""
_CHANCE = 0.01
"""Probability under equal directions below which they differ."""
_SURE = 0.0027
"""Probability of three standard deviations, shared by all values that are looked at."""
_FEW = 3
"""Events below which their scatter is believed from within them."""
_MEDIAN = 1.57
"""Variance of the median of Gaussian values, in that of the mean."""
_APART, _ALIKE = (0, 1, 2, 3), (0, 0, 1, 1)
"""Values per branch: each its own, or both directions alike."""
_TOUCHED = 1e-9
_SAME = 1e-6
"""mm within which two tests stand at the same place."""

Directions = Literal["given", "differ", "alike", "unknown"]
"""Whether the values differ by the direction of motion: unknown where a branch has no event."""


@dataclasses.dataclass(frozen=True)
class CrosstalkFit:
    """The crosstalk from a master to a slave; signs are those of the *error*.

    Attributes:
        axes: Adaptation axes used, columns of the positions.
        points: Of the tests in mm, shape ``(p, k)``; the last axis runs fastest in a grid.
        values: Error at the specified accelerations in mm, rows as `BRANCHES`; NaN where the
            readings do not tell it.
        standard_deviation: Of the values; inf where the readings do not tell it.
        support: Events that touch each value.
        acceleration: Specified, in mm/s², positive.
        deceleration: Specified, in mm/s², negative.
        velocity_dependent: Whether the directions differ; else both rows are equal.
        directions: Why.
        noise: Standard deviation of one event of median weight in mm, per row of `BRANCHES`.
        events: All that were cut out.
        scores: Choices compared by hold-out; empty where the tests were given.
        converged: Whether the robust passes converged.
        conventions: How accelerations and directions are defined.
    """

    axes: tuple[int, ...]
    points: Float[np.ndarray, "p k"]
    values: Float[np.ndarray, "4 p"]
    standard_deviation: Float[np.ndarray, "4 p"]
    support: Int[np.ndarray, "4 p"]
    acceleration: float
    deceleration: float
    velocity_dependent: bool
    directions: Directions
    noise: Float[np.ndarray, "4"]
    events: Events
    scores: tuple[ModeScore, ...]
    converged: bool
    conventions: Conventions

    @property
    def mode(self) -> int:
        """Of the list: 1, 2 or 3."""
        return 1 + len(self.axes)

    @property
    def complete(self) -> Bool[np.ndarray, " p"]:
        """Tests of which all four values are measured: only these can be written."""
        return np.asarray(np.isfinite(self.values).all(axis=0))

    @property
    def full(self) -> Float[np.ndarray, " n"]:
        """Size of the specified acceleration that each event is a part of, in mm/s²."""
        slows = self.events.branch >= 2
        return np.where(slows, -self.deceleration, self.acceleration)

    @property
    def significant(self) -> bool:
        """Whether any value is more than chance over all of them would show."""
        rows = slice(None) if self.velocity_dependent else slice(0, 4, 2)
        value, spread = self.values[rows], self.standard_deviation[rows]
        known = np.isfinite(value) & np.isfinite(spread)
        if not known.any():
            return False
        limit = -float(ndtri(0.5 * _SURE / int(known.sum())))
        return bool((np.abs(value[known]) > limit * spread[known]).any())

    def kept(self, active: Crosstalk | None) -> Bool[np.ndarray, " p"]:
        """Return which tests are written: all four values measured, or known from before.

        Args:
            active: The list that was active while measuring: its tests keep what they hold
                where nothing was measured.
        """
        if active is None:
            return self.complete
        known = are_among(self.points, np.asarray(active.surface.points))
        return np.asarray(self.complete | known)

    def compensation(self, active: Crosstalk | None = None) -> Crosstalk | None:
        """Return the list that takes this error away, as the controller runs it.

        Without a filter, and with values of its own for each direction. None where no test
        is kept, or where those that are span no surface.

        Args:
            active: The list that was active while measuring, to which this one adds.
        """
        kept, rules = self.kept(active), self.conventions
        points = self.points[kept]
        try:
            surface = surface_through(points)
        except ValueError:
            return None
        offset = np.where(self.complete, -self.values, 0.0)[:, kept]
        if active is not None:
            offset = offset + full_offsets(active, active, points)
        return Crosstalk(
            surface,
            jnp.asarray(rules.crosstalk_sign * offset),
            jnp.asarray(self.acceleration),
            jnp.asarray(self.deceleration),
            **rules.of_crosstalk,
        )


def are_among(
    points: Float[np.ndarray, "q k"], others: Float[np.ndarray, "p k"]
) -> Bool[np.ndarray, " q"]:
    """Return which of these places are tests of another list."""
    apart = np.abs(points[:, None, :] - others[None, :, :])
    return np.asarray((apart <= _SAME).all(axis=-1).any(axis=-1))


def full_offsets(
    model: Crosstalk | LegacyCrosstalk,
    by: Crosstalk,
    points: Float[np.ndarray, "p k"] | None = None,
) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at each place, by row of `BRANCHES`.

    Args:
        model: The list.
        by: A list that says what full acceleration is, and what is deceleration.
        points: Places of the adaptation axes in mm; left out: the tests of that list.
    """
    places = np.asarray(by.surface.points if points is None else points, dtype=float)
    count = len(places)
    velocity = np.repeat([1.0, -1.0, 1.0, -1.0], count)
    pull = np.repeat([float(by.acceleration), float(by.deceleration)], 2 * count)
    if by.by_speed:
        pull = pull * velocity
    added = model.offset(pull, velocity, np.tile(places, (4, 1)))
    return np.asarray(added).reshape(4, count)


@one_blas_thread()
def fit_crosstalk(
    readings: CrosstalkReadings,
    *,
    acceleration: float | None = None,
    deceleration: float | None = None,
    conventions: Conventions = DEFAULT_RULES,
    **options: Any,
) -> CrosstalkFit:
    """Fit the tests of a crosstalk list to acceleration events of a log.

    Every event is reduced to one value (`cut_events`); the values are the readings of a table
    over the adaptation axes, one per sign of the acceleration and direction.

    Args:
        readings: Log of master and slave.
        acceleration: Specified, in mm/s², above 0; None = as measured.
        deceleration: Specified, in mm/s², below 0; None = as measured.
        conventions: How accelerations and directions are defined.
        options: As for `fit_events`.

    Raises:
        FitError: If there are no events or the arguments cannot be met.
    """
    rates = specified(readings, acceleration, deceleration)
    events = cut_events(readings, *rates, conventions=conventions)
    return fit_events(events, rates, conventions, **options)


def fit_events(
    events: Events,
    rates: tuple[float, float],
    rules: Conventions,
    *,
    mode: int | str = "auto",
    positions: Float[np.ndarray, "p k"] | None = None,
    velocity_dependent: bool | Literal["auto"] = "auto",
    most_tests: int = SAFE_TESTS,
    loss: str = "student",
) -> CrosstalkFit:
    """Fit the tests of a crosstalk list to events.

    Args:
        events: Of a log.
        rates: Specified acceleration and deceleration in mm/s².
        rules: How accelerations and directions are defined.
        mode: 1, 2 or 3 (number of adaptation axes + 1), or ``"auto"``: events held out choose.
        positions: Of the tests in mm, one column per adaptation axis (of the mode; of the
            readings where that is ``"auto"``); None = chosen from the events.
        velocity_dependent: Values of their own per direction; ``"auto"``: if they differ.
        most_tests: Tests at most, 1 to 15.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the arguments cannot be met.
    """
    directions: Directions = "given"
    apart = velocity_dependent
    if isinstance(apart, str):
        directions = _directions(events)
        apart = directions != "alike"
    groups = _APART if apart else _ALIKE
    table = Table.of(events, groups)
    scores: tuple[ModeScore, ...] = ()
    if positions is not None:
        axes = tuple(range(positions.shape[1]))
        points = np.asarray(positions, float)
    else:
        every = tuple(range(1, table.positions.shape[1] + 2))
        modes = (mode,) if isinstance(mode, int) else every
        axes, nodes, scores = choose_tests(table, modes, most_tests)
        points = points_of(nodes)
    try:
        surface = surface_through(points)
    except ValueError as error:
        raise FitError(str(error)) from error
    stencil = surface.stencil(jnp.asarray(filled(table.positions[:, list(axes)])))
    columns = np.array(stencil.matrix())[: len(events)]
    shape = len(BRANCHES), len(points)
    values, deviation = np.full(shape, np.nan), np.full(shape, np.inf)
    support, noise = np.zeros(shape, np.int64), np.full(len(BRANCHES), np.nan)
    wild, converged = np.zeros(len(events), bool), True
    for group in np.unique(table.group):
        mine, rows = table.group == group, np.array(groups) == group
        found = table.take(mine).fit(columns[mine], loss)
        wild[mine] = found.wild
        converged &= found.converged
        touching = (columns[mine][~found.wild] > _TOUCHED).sum(axis=0)
        known = ~found.undetermined & (touching > 0)
        values[rows] = np.where(known, found.coefficients, np.nan)
        deviation[rows] = np.where(known, found.standard_deviation, np.inf)
        support[rows], noise[rows] = np.where(known, touching, 0), found.noise.white
    return CrosstalkFit(
        axes=axes,
        points=points,
        values=values,
        standard_deviation=deviation,
        support=support,
        acceleration=rates[0],
        deceleration=rates[1],
        velocity_dependent=bool(apart),
        directions=directions,
        noise=noise,
        events=dataclasses.replace(events, wild=wild),
        scores=scores,
        converged=converged,
        conventions=rules,
    )


def _directions(events: Events) -> Directions:
    """Return whether values differ by direction, from events paired at the same places."""
    table = Table.of(events, _APART)
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
            seen = [np.var(part, ddof=1) if fewest >= _FEW else 0.0 for part in parts]
            variance = sum(
                max(float(each), table.own_noise**2) / len(part)
                for each, part in zip(seen, parts, strict=True)
            )
            apart = float(np.median(parts[0]) - np.median(parts[1]))
            statistic += apart**2 / (_MEDIAN * variance)
            free += 1
    differ = free and float(chdtrc(free, statistic)) < _CHANCE
    return "differ" if differ else "alike"
