"""Backlash: readings from both directions in, the width out; `_trace` has reversals."""

import dataclasses
import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import legendre
from scipy.special import fdtrc  # scipy.stats takes long to load

from ....models import Backlash
from ...core import (
    DriftNoise,
    FitError,
    Regression,
    node_shares,
    one_blas_thread,
    regress,
)

SURE = 3.0
"""Deviations from which on a backlash shows."""
_CHANCE = 0.01
_MATTERS = 0.1
"""Change relative to the width that is worth a table."""
_HIGHEST = 3
"""Order of the polynomial along the axis."""
_TARGETS = 60
"""Different positions up to which each has an error of its own."""
_NODES = 24
"""Nodes of the error along the axis where the positions are all different."""
_COMMON = "the error common to both directions, or runs"

Fitted = Callable[[Float[np.ndarray, "t k"], Float[np.ndarray, " t"]], Regression]
"""`regress` with what is known of the readings: time, weight and loss."""


@dataclasses.dataclass(frozen=True)
class Dependence:
    """How the backlash changes along the axis.

    Attributes:
        probability: Of data like these if it did not change at all.
        variation: Root mean square of the change over the measured positions, in mm or °.
        slope: Change over the measured positions, first to last, in mm or °.
        slope_deviation: Standard deviation of that.
        significant: Whether it changes by more than chance and by enough to matter.
    """

    probability: float
    variation: float
    slope: float
    slope_deviation: float
    significant: bool


@dataclasses.dataclass(frozen=True)
class Sides:
    """Readings about the mean of both directions: one each, or two per reversal of a trace.

    Attributes:
        position: Of each in mm or °.
        direction: ±1.
        before: Half the reversal error, with the scatter of the reading, in mm or °.
        wild: Which the loss rejected outright.
    """

    position: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class BacklashFit:
    """The backlash of an axis.

    The width has the sign of P-AXIS-00103: error moving positive − error moving negative is
    minus the width.

    Attributes:
        width: In mm or °.
        standard_deviation: Of the width.
        noise: How the readings (reversals) scatter.
        independent: Independent readings (reversals) that would leave the same uncertainty.
        support: Readings (reversals) used per direction of motion, positive first.
        sides: The readings, or reversals, that it rests on.
        converged: Whether the robust passes converged.
        dependence: How it changes along the axis; None where the positions are too few.
        drift: Change of the readings within a run, and the width with that taken off, where
            it shows and counts as backlash; None elsewhere.
        delay: By how much the reference is late behind the encoder in s, and the deviation of
            that, from the speeds of the reversals; None where it was not fitted.
        delay_gain: Backlash per second of delay in mm/s or °/s, where all reversals run at one
            speed, so that nothing tells them apart.
    """

    width: float
    standard_deviation: float
    noise: DriftNoise
    independent: float
    support: tuple[int, int]
    sides: Sides
    converged: bool
    dependence: Dependence | None = None
    drift: tuple[float, float] | None = None
    delay: tuple[float, float] | None = None
    delay_gain: float | None = None

    @classmethod
    def of(
        cls, found: Regression, way: Int[np.ndarray, " t"], sides: Sides, things: str
    ) -> "BacklashFit":
        """Return the fit of which the first coefficient is the width.

        Args:
            found: Regression over readings or reversals.
            way: Direction of motion of each, ±1.
            sides: These about the mean of both directions.
            things: What was fitted, in a word.

        Raises:
            FitError: If those that were kept do not determine the width.
        """
        if found.undetermined[0]:
            msg = (
                f"the {things} that agree with each other do not determine the backlash: "
                f"{int(found.wild.sum())} wild ones are left out."
            )
            raise FitError(msg)
        used = way[~found.wild]
        return cls(
            width=float(found.coefficients[0]),
            standard_deviation=float(found.standard_deviation[0]),
            noise=found.noise,
            independent=float(found.independent[0]),
            support=(int((used > 0).sum()), int((used < 0).sum())),
            sides=sides,
            converged=found.converged,
        )

    @property
    def significant(self) -> bool:
        """Whether there is a backlash by more than chance."""
        return abs(self.width) > SURE * self.standard_deviation

    @property
    def kind(self) -> str:
        """Where the play is, in words."""
        if not self.significant:
            return "no backlash shows"
        if self.width > 0:
            return "positive: play between drive and slide"
        return "negative: play between slide and measuring system"

    def compensation(self, reference: int = 1, cycles: int = 0) -> Backlash:
        """Return the model that takes this backlash away.

        Args:
            reference: Direction in which the axis is right without it (P-AXIS-00021 = 1 or
                2): that of homing and of the tables. The other choice shifts all positions by
                the width.
            cycles: Over which a reversal is spread.
        """
        return Backlash(jnp.asarray(self.width), 1 if reference > 0 else -1, cycles)


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
    _check(position, direction)
    way = direction.astype(float)
    common, places = _along(position, way)
    if run is not None:
        common = np.hstack([common, _run_offsets(run, way)])
    # What the model of the controller would take away, about the mean of both directions.
    play = -np.asarray(Backlash(jnp.ones(()), 1).offset(way)) - 0.5
    columns = np.column_stack([play, common])
    names = ["backlash", *[_COMMON] * common.shape[1]]
    fitted = functools.partial(regress, time=time, loss=loss)
    order = min(_HIGHEST, places - 1)
    found = fitted(columns, error, names=names)
    before = found.residual - 0.5 * way * found.coefficients[0]
    sides = Sides(position, direction, before, found.wild)
    return dataclasses.replace(
        BacklashFit.of(found, direction, sides, "readings"),
        dependence=dependence_along(position, columns, error, order, fitted),
        drift=None if run is None else _drift(columns, run, error, fitted),
    )


def dependence_along(
    position: Float[np.ndarray, " t"],
    columns: Float[np.ndarray, "t k"],
    target: Float[np.ndarray, " t"],
    order: int,
    fitted: Fitted,
) -> Dependence | None:
    """Return how the width changes along the axis; None where the readings do not show it.

    Args:
        position: Of readings or reversals in mm or °.
        columns: What a width of 1 does to each, then what else is fitted.
        target: Readings or reversals in mm or °.
        order: Of the highest Legendre polynomial over the measured range.
        fitted: The regression with what is known of the readings.
    """
    if order < 1 or len(target) <= columns.shape[1] + order + 3:
        return None
    low, high = float(position.min()), float(position.max())
    place = 2.0 * (position - low) / max(high - low, 1e-300) - 1.0
    shapes = columns[:, :1] * legendre.legvander(place, order)
    try:
        found = fitted(np.hstack([shapes, columns[:, 1:]]), target)
    except FitError:
        return None
    if found.undetermined[: 1 + order].any():
        return None
    part = slice(1, 1 + order)
    values, covariance = found.coefficients[part], found.covariance[part, part]
    if not covariance.any():
        # Readings without any scatter fit exactly: what they show is what there is.
        statistic = np.inf if values.any() else 0.0
    else:
        statistic = float(values @ np.linalg.pinv(covariance, hermitian=True) @ values)
        statistic /= order
    sure = min(float(found.independent[part].min()), float(len(target)))
    free = max(sure - order - 1.0, 1.0)
    probability = float(fdtrc(order, free, statistic))
    orders = np.arange(1, order + 1)
    variation = float(np.sqrt((values**2 / (2 * orders + 1)).sum()))
    ends = np.where(orders % 2 == 1, 2.0, 0.0)
    matters = variation > _MATTERS * abs(float(found.coefficients[0]))
    return Dependence(
        probability,
        variation,
        float(ends @ values),
        float(np.sqrt(max(ends @ covariance @ ends, 0.0))),
        probability < _CHANCE and matters,
    )


def _check(position: Float[np.ndarray, " t"], direction: Int[np.ndarray, " t"]) -> None:
    """Refuse readings that cannot show a backlash."""
    ranges = []
    for sign, name in ((1, "positive"), (-1, "negative")):
        places = position[direction == sign]
        if not places.size:
            msg = (
                f"no reading was approached in {name} direction: one direction does "
                "not tell the backlash."
            )
            raise FitError(msg)
        ranges.append((float(places.min()), float(places.max())))
    (low, high), (first, last) = ranges
    if max(low, first) > min(high, last):
        msg = (
            "no place was approached in both directions: expected readings at common "
            "positions."
        )
        raise FitError(msg)


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
        return np.eye(targets)[place], int(_both_ways(place, way).sum())
    count = int(np.clip(len(position) // 10, 2, _NODES))
    columns = node_shares(position, np.linspace(position.min(), position.max(), count))
    return columns[:, (columns > 0).any(axis=0)], count


def _both_ways(
    group: Int[np.ndarray, " t"], way: Float[np.ndarray, " t"]
) -> Bool[np.ndarray, " g"]:
    """Return which groups 0 … g − 1 have readings from both directions."""
    counts = [np.bincount(group[way == d], minlength=group.max() + 1) for d in (1, -1)]
    return np.asarray((np.array(counts) > 0).all(axis=0))


def _run_offsets(
    run: Int[np.ndarray, " t"], way: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "t r"]:
    """Return a column per run but the first; none where a run went one way only."""
    labels, index = np.unique(run, return_inverse=True)
    columns = np.eye(len(labels))[index][:, 1:]
    return columns if _both_ways(index, way).all() else columns[:, :0]


def _drift(
    columns: Float[np.ndarray, "t k"],
    run: Int[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    fitted: Fitted,
) -> tuple[float, float] | None:
    """Return a drift over each run, where it shows, and the width beside it."""
    within = np.zeros(len(run))
    for label in np.unique(run):
        rows = np.flatnonzero(run == label)
        within[rows] = np.linspace(-0.5, 0.5, len(rows)) if len(rows) > 1 else 0.0
    try:
        found = fitted(np.column_stack([columns, within]), error)
    except FitError:
        return None
    if not abs(found.coefficients[-1]) >= SURE * found.standard_deviation[-1]:
        return None
    return float(found.coefficients[-1]), float(found.coefficients[0])
