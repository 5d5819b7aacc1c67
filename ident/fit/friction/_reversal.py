"""How friction changes over at a reversal: cycles before, distance after, delay."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....models import AbstractFriction, FrictionCompensation
from ...core._errors import FitError

_LOOKAHEAD = 4
"""Largest `reversal_lookahead` of the controller."""
_FARTHEST = 0.02
"""mm: no friction takes longer than this to build up, however soft the drive."""
_GRID = 24
_ZOOMS = 5
_WILD = 6.0
_SMALL = 0.05
"""Share of the friction below which nothing is wild, however quiet the rest."""
_FEW = 4


@dataclasses.dataclass(frozen=True)
class ReversalFit:
    """What reversals show of the friction around them.

    Attributes:
        lookahead: Cycles before the reversal over which the current falls
            (P-COMP-00044).
        position_delay: Distance in mm after it over which the current rises
            (P-COMP-00043).
        delay_cycles: Cycles that all of it comes later (P-COMP-00058).
        position_delay_sd: Standard deviation of the distance in mm.
        lookahead_probability: That `lookahead` is the right one of 0 to 4.
        delay_probability: That `delay_cycles` is the right one of those tried.
        noise: Standard deviation of what is left around reversals, in current units.
        before: The same with neither look-ahead, nor distance, nor delay.
        reversals: How many were used.
        undetermined: What the recording cannot tell: name → reason.
    """

    lookahead: int
    position_delay: float
    delay_cycles: int
    position_delay_sd: float
    lookahead_probability: float
    delay_probability: float
    noise: float
    before: float
    reversals: int
    undetermined: dict[str, str]


def fit_reversal(
    law: AbstractFriction,
    position: Float[np.ndarray, " t"],
    velocity: Float[np.ndarray, " t"],
    current: Float[np.ndarray, " t"],
    *,
    nuisance: Float[np.ndarray, "t c"] | None = None,
    template: FrictionCompensation | None = None,
    most_delay: int = 30,
    sd: float | None = None,
) -> ReversalFit:
    """Find how the friction current changes over where the axis reverses.

    Each of the three acts in its own way: the look-ahead on the last cycles before the
    crossing, the distance on the way after it, the delay on all. Every whole number is
    tried; the distance is the best one for each, so that none of them hangs on a start
    value. Samples beyond 6 standard deviations are left out, and what successive
    residuals have in common counts in the uncertainty.

    Args:
        law: Friction in steady motion, in the unit of ``current``.
        position: Commanded, in mm, one sample per cycle of the controller.
        velocity: Commanded, in mm/s.
        current: Of friction, inertia and constant load taken off as well as they are
            known.
        nuisance: What else may be in the current and is fitted beside it, such as the
            commanded acceleration of this cycle and its neighbours: where an axis
            reverses hard, a smoothed acceleration leaves more than the friction is.
        template: Compensation with the controller's rules for open points; those that
            are assumed if left out. Its law and numbers do not matter.
        most_delay: Largest delay that is tried, in cycles.
        sd: Standard deviation of a current in motion; from the residuals if left out.

    Raises:
        FitError: If there is no reversal, or arrays differ in length or have gaps.
    """
    count = len(position)
    if not count == len(velocity) == len(current):
        msg = (
            f"found {count} positions, {len(velocity)} velocities and {len(current)}"
            " currents, expected as many of each"
        )
        raise FitError(msg)
    if not all(np.isfinite(each).all() for each in (position, velocity, current)):
        msg = "found gaps in the recording, expected numbers"
        raise FitError(msg)
    starts = _reversals(velocity)
    if not len(starts):
        msg = "found no reversal in the recording, expected motion in both directions"
        raise FitError(msg)
    rows = _around(starts, position, most_delay)
    if template is None:
        template = FrictionCompensation(law)
    template = dataclasses.replace(template, law=law, delay_cycles=0)
    search = _Search(template, position, velocity, current, rows, most_delay, nuisance)
    best, squares = search.all()
    share = _independent(search.residual(*best))
    if sd is None:
        sd = search.noise(*best)
    # A perfect recording leaves rounding: below it no two settings differ.
    sd = max(sd, 1e-9 * float(np.abs(current).max()))
    odds = np.exp(-0.5 * share * (squares - squares.min()) / sd**2)
    odds /= odds.sum()
    lookahead, distance, delay = best
    spread = search.distance_sd(best, sd) / np.sqrt(share)
    found = ReversalFit(
        lookahead=lookahead,
        position_delay=distance,
        delay_cycles=delay,
        position_delay_sd=spread,
        lookahead_probability=float(odds.sum(axis=1)[lookahead]),
        delay_probability=float(odds.sum(axis=0)[delay]),
        noise=search.noise(*best),
        before=search.noise(0, 0.0, 0),
        reversals=len(starts),
        undetermined={},
    )
    return dataclasses.replace(found, undetermined=_unknown(found, most_delay))


def _unknown(found: ReversalFit, most_delay: int) -> dict[str, str]:
    reasons: dict[str, str] = {}
    if found.reversals < _FEW:
        words = f"only {found.reversals} reversals were recorded"
        reasons = dict.fromkeys(
            ("reversal_lookahead", "position_delay", "delay_cycles"), words
        )
    if found.lookahead_probability < 0.5:
        reasons["reversal_lookahead"] = (
            f"{found.lookahead} cycles fit best, others nearly as well (probability"
            f" {found.lookahead_probability:.0%})"
        )
    if found.delay_probability < 0.5:
        reasons["delay_cycles"] = (
            f"{found.delay_cycles} cycles fit best, others nearly as well (probability"
            f" {found.delay_probability:.0%})"
        )
    if found.delay_cycles == most_delay:
        reasons["delay_cycles"] = f"it is {most_delay} cycles, the most tried, or more"
    if found.position_delay >= 0.98 * _FARTHEST:
        reasons["position_delay"] = f"it is {1e3 * _FARTHEST:g} µm or more"
    return reasons


def _reversals(velocity: Float[np.ndarray, " t"]) -> np.ndarray:
    """Return the first sample of each new direction."""
    moving = np.flatnonzero(velocity != 0)
    ways = np.sign(velocity[moving])
    return np.asarray(moving[1:][ways[1:] != ways[:-1]])


def _around(
    starts: np.ndarray, position: Float[np.ndarray, " t"], most_delay: int
) -> np.ndarray:
    """Return the samples that any of the three can touch, and as many beyond."""
    keep = np.zeros(len(position), dtype=bool)
    ends = np.append(starts[1:], len(position))
    for start, end in zip(starts, ends, strict=True):
        away = np.abs(position[start:end] - position[max(start - 1, 0)])
        near = int(np.searchsorted(np.maximum.accumulate(away), 1.5 * _FARTHEST))
        keep[max(start - 2 * _LOOKAHEAD - 10, 0) : start + near + most_delay + 10] = (
            True
        )
    return np.flatnonzero(keep)


class _Search:
    """The current around reversals for every setting, and what it leaves."""

    def __init__(
        self,
        template: FrictionCompensation,
        position: Float[np.ndarray, " t"],
        velocity: Float[np.ndarray, " t"],
        current: Float[np.ndarray, " t"],
        rows: np.ndarray,
        most_delay: int,
        nuisance: Float[np.ndarray, "t c"] | None,
    ) -> None:
        self._template = template
        self._position, self._velocity = position, velocity
        self._rows, self._current = rows, current[rows]
        self._most = most_delay
        self._nuisance = None if nuisance is None else nuisance[rows]
        self._set_keep(np.ones(len(rows), dtype=bool))

    def _set_keep(self, keep: np.ndarray) -> None:
        self._keep = keep
        self._basis = np.zeros((int(keep.sum()), 0))
        if self._nuisance is not None:
            columns = self._nuisance[keep]
            basis, size, _ = np.linalg.svd(columns, full_matrices=False)
            self._basis = basis[:, size > 1e-9 * size.max(initial=0.0)]

    def _clean(self, left: np.ndarray) -> np.ndarray:
        """Return kept residuals, one row per setting, without what the nuisance explains."""
        kept = left[..., self._keep]
        return np.asarray(kept - (kept @ self._basis) @ self._basis.T)

    def model(self, lookahead: int, distances: Float[np.ndarray, " d"]) -> np.ndarray:
        """Return the undelayed currents, one row per distance."""
        return np.asarray(
            _currents(
                dataclasses.replace(self._template, reversal_lookahead=lookahead),
                jnp.asarray(self._position),
                jnp.asarray(self._velocity),
                jnp.asarray(distances),
            )
        )

    def _delayed(self, currents: np.ndarray, delay: int) -> np.ndarray:
        before = self._rows - delay
        shifted = currents[..., np.maximum(before, 0)]
        return np.asarray(np.where(before >= 0, shifted, 0.0))

    def residual(
        self, lookahead: int, distance: float, delay: int
    ) -> Float[np.ndarray, " r"]:
        # As many distances as everywhere else: another number would compile anew.
        found = self.model(lookahead, np.full(_GRID + 1, distance))[0]
        return self._clean(self._current - self._delayed(found, delay))

    def noise(self, lookahead: int, distance: float, delay: int) -> float:
        return float(np.sqrt(np.mean(self.residual(lookahead, distance, delay) ** 2)))

    def all(self) -> tuple[tuple[int, float, int], Float[np.ndarray, "n k"]]:
        """Return the best setting, and the least squares by look-ahead and delay."""
        grid = np.concatenate([[0.0], np.geomspace(2e-5, _FARTHEST, _GRID)])
        # A first pass finds the wild samples, the second does without them.
        self._leave_out_wild(self._pass(grid)[0])
        return self._pass(grid)

    def _leave_out_wild(self, best: tuple[int, float, int]) -> None:
        left = np.abs(self.residual(*best))
        typical = 1.4826 * float(np.median(left))
        level = float(np.median(np.abs(self._current)))
        keep = left <= max(_WILD * typical, _SMALL * level)
        if keep.mean() >= 0.5:
            self._set_keep(keep)

    def _pass(
        self, grid: Float[np.ndarray, " d"]
    ) -> tuple[tuple[int, float, int], Float[np.ndarray, "n k"]]:
        table = np.empty((_LOOKAHEAD + 1, self._most + 1, len(grid)))
        for lookahead in range(_LOOKAHEAD + 1):
            currents = self.model(lookahead, grid)
            for delay in range(self._most + 1):
                left = self._current - self._delayed(currents, delay)
                table[lookahead, delay] = np.sum(self._clean(left) ** 2, axis=1)
        places = np.argmin(table, axis=2)
        squares = np.min(table, axis=2)
        best, least = (0, 0.0, 0), np.inf
        # Only what comes near the best deserves the last digits.
        for flat in np.argsort(squares, axis=None)[:6]:
            lookahead, delay = (int(k) for k in np.unravel_index(flat, squares.shape))
            at = int(places[lookahead, delay])
            distance, own = self._finest(lookahead, delay, grid, at)
            squares[lookahead, delay] = own
            if own < least:
                best, least = (lookahead, distance, delay), own
        return best, squares

    def _finest(
        self, lookahead: int, delay: int, grid: Float[np.ndarray, " d"], at: int
    ) -> tuple[float, float]:
        """Return the best distance beside a point of the grid, and its squares."""
        least = np.inf
        for _ in range(_ZOOMS):
            grid = np.linspace(
                grid[max(at - 1, 0)], grid[min(at + 1, _GRID)], _GRID + 1
            )
            left = self._current - self._delayed(self.model(lookahead, grid), delay)
            squares = np.sum(self._clean(left) ** 2, axis=1)
            at = int(np.argmin(squares))
            least = float(squares[at])
        return float(grid[at]), least

    def distance_sd(self, best: tuple[int, float, int], sd: float) -> float:
        """Return the standard deviation of the distance in mm from its slope."""
        lookahead, distance, delay = best
        step = max(1e-3 * distance, 1e-6)
        low, high = max(distance - step, 0.0), distance + step
        slope = (
            self.residual(lookahead, high, delay) - self.residual(lookahead, low, delay)
        ) / (high - low)
        information = float(slope @ slope)
        return sd / np.sqrt(information) if information > 0 else float("inf")


@eqx.filter_jit
def _currents(
    template: FrictionCompensation,
    position: Float[Array, " t"],
    velocity: Float[Array, " t"],
    distances: Float[Array, " d"],
) -> Float[Array, "d t"]:
    def one(distance: Float[Array, ""]) -> Float[Array, " t"]:
        model = dataclasses.replace(template, position_delay=distance)
        return model.run(model.start(), position, velocity)[0]

    return jax.vmap(one)(distances)


def _independent(residual: Float[np.ndarray, " r"]) -> float:
    """Return the share of samples that count as independent, from their lag of one."""
    size = float(residual @ residual)
    if size == 0 or len(residual) < _FEW:
        return 1.0
    common = float(np.clip(residual[1:] @ residual[:-1] / size, 0.0, 0.98))
    return (1 - common) / (1 + common)
