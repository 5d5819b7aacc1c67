"""What goes into a crosstalk fit and what comes out: arrays and their meaning."""

import dataclasses
import math
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import Conventions, Crosstalk, surface_through

BRANCHES = (
    "acceleration in positive direction",
    "acceleration in negative direction",
    "deceleration in positive direction",
    "deceleration in negative direction",
)
"""Rows of the values, in the order of `axcomp.models.Crosstalk`."""
MOST_TESTS = 15
"""Measurement tests that a list holds at most ([001] p.84)."""
SAFE_TESTS = 14
"""Tests that satisfy both statements of the manuals (P-COMP-00083 < 15)."""

Directions = Literal["given", "differ", "alike", "unknown"]
"""Whether the values differ by the direction of motion: unknown where a branch has no event."""


@dataclasses.dataclass(frozen=True)
class CrosstalkReadings:
    """Motion of the master axis and the error of the slave axis, row by row in time.

    Attributes:
        time: In s, ascending.
        acceleration: Of the master in mm/s².
        velocity: Of the master in mm/s.
        error: Of the slave, actual − encoder (or commanded at rest) in mm; NaN = missed.
        positions: Of the axes on which it may depend (adaptation axes) in mm, shape
            ``(t, k)``; k = 0 where there are none.
    """

    time: Float[np.ndarray, " t"]
    acceleration: Float[np.ndarray, " t"]
    velocity: Float[np.ndarray, " t"]
    error: Float[np.ndarray, " t"]
    positions: Float[np.ndarray, "t k"]


@dataclasses.dataclass(frozen=True)
class Event:
    """One acceleration of the master cut out of a log.

    Attributes:
        start: First row.
        stop: Row after the last.
        branch: Sign of the acceleration and direction, a row of `BRANCHES`.
        positions: Of the adaptation axes in mm, weighted like the readings of the event.
        peak: Largest acceleration in mm/s², with its sign.
        value: Error of the slave at the specified acceleration that this event shows, in mm.
        standard_deviation: Of that, from the scatter within the event.
        wild: Set aside because it contradicts the others.
    """

    start: int
    stop: int
    branch: int
    positions: tuple[float, ...]
    peak: float
    value: float
    standard_deviation: float
    wild: bool = False


@dataclasses.dataclass(frozen=True)
class ModeScore:
    """How well a choice of tests predicts events that it has not seen.

    Attributes:
        mode: 1, 2 or 3.
        axes: Adaptation axes, columns of the positions.
        counts: Number of tests along each.
        held_out: Root mean square of the held-out events in mm, wild ones limited.
        chosen: Whether this is the one.
    """

    mode: int
    axes: tuple[int, ...]
    counts: tuple[int, ...]
    held_out: float
    chosen: bool


@dataclasses.dataclass(frozen=True)
class CrosstalkFit:
    """The crosstalk from a master to a slave; signs are those of the *error*.

    Attributes:
        mode: 1, 2 or 3.
        axes: Adaptation axes used, columns of the positions.
        points: Of the tests in mm, shape ``(p, k)``; the last axis runs fastest in a grid.
        values: Error at the specified accelerations in mm, rows as `BRANCHES`; NaN where the
            readings do not tell it.
        standard_deviation: Of the values; inf where the readings do not tell it.
        support: Events that touch each value.
        complete: Tests of which all four values are measured: only these can be written.
        acceleration: Specified, in mm/s², positive.
        deceleration: Specified, in mm/s², negative.
        velocity_dependent: Whether the directions differ; else both rows are equal.
        directions: Why.
        noise: Standard deviation of one event of median weight in mm, per row of `BRANCHES`.
        events: All that were cut out.
        scores: Choices compared by hold-out; empty where the tests were given.
        conventions: How accelerations and directions are defined.
    """

    mode: int
    axes: tuple[int, ...]
    points: Float[np.ndarray, "p k"]
    values: Float[np.ndarray, "4 p"]
    standard_deviation: Float[np.ndarray, "4 p"]
    support: Int[np.ndarray, "4 p"]
    complete: Bool[np.ndarray, " p"]
    acceleration: float
    deceleration: float
    velocity_dependent: bool
    directions: Directions
    noise: tuple[float, ...]
    events: tuple[Event, ...]
    scores: tuple[ModeScore, ...]
    conventions: Conventions

    @property
    def determined(self) -> bool:
        """Whether all values of all tests are measured."""
        return bool(self.complete.all())

    def compensation(self, cycles: int = 0) -> Crosstalk | None:
        """Return the model that takes this error away, from the complete tests.

        None where no test is complete, or where those that are span no surface.

        Args:
            cycles: Of the sin² filter (P-COMP-00064).
        """
        if not self.complete.any():
            return None
        points = self.points[self.complete]
        try:
            surface = surface_through(points)
        except ValueError:
            return None
        rules = self.conventions
        return Crosstalk(
            surface,
            jnp.asarray(-rules.crosstalk_sign * self.values[:, self.complete]),
            jnp.asarray(self.acceleration),
            jnp.asarray(self.deceleration),
            velocity_dependent=self.velocity_dependent,
            cycles=cycles,
            **rules.of_crosstalk,
        )

    def coverage(
        self, workspace: Float[np.ndarray, "k 2"], resolution: int = 41
    ) -> float:
        """Return the share of a workspace that the complete tests cover, 0 to 1.

        Args:
            workspace: From where to where each adaptation axis of the fit goes, in mm.
            resolution: Places looked at along each axis.
        """
        model = self.compensation()
        if model is None:
            return 0.0
        if not self.axes:
            return 1.0
        lines = [np.linspace(low, high, resolution) for low, high in workspace]
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
        return float(np.mean(np.asarray(model.covers(grid.reshape(-1, len(lines))))))

    def largest_error(self) -> float:
        """Return the largest known value in mm."""
        known = np.abs(self.values[np.isfinite(self.values)])
        return float(known.max()) if known.size else math.nan
