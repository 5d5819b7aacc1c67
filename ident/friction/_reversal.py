r"""How friction changes over at a reversal: cycles before, distance after, delay.

The load of a drive is $J a + o + \sum_j c_j\, s\, x_j(v)$: the columns $x_j$ of its friction law,
weighted around reversals by $s$ (`FrictionCompensation.shares`: look-ahead, distance) and both of
them `delay_cycles` late. Friction at low speeds is seen where the weights act, so both are found
together: each trial of the three, and of a shape, leaves a linear problem in the $c_j$.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import least_squares

from ...data.signals import NORMAL, median
from ..core import FitError, one_blas_thread
from ._equation import Equation, Recording, record
from ._samples import DriveSamples, Trace
from ._simulate import LOOKAHEADS, share_of
from ._structures import (
    AbstractStructure,
    CoulombViscous,
    KnotTable,
    Shape,
    Stribeck,
    default_knots,
)
from ._weights import ridged

_FARTHEST, _NOTHING = 0.02, 1e-6
"""mm: no friction takes longer to build up, however soft the drive, and below is none."""
_JITTER = 1e-3
"""mm: a motion that turns back sooner is noise of the encoder of an axis that stands."""
_DISTANCES = np.concatenate([[0.0], np.geomspace(1e-4, _FARTHEST, 20)])
"""Where the search for the distance starts, in mm: a wrong delay makes up for larger steps."""
_MOST_DELAY = 30
"""Largest delay that is tried, in cycles."""
_ASIDE = 4
"""Cycles on each side of the best delay that are looked at closely."""
_ROUGH = 6
"""Knots per direction of the table that shows where the delay is."""
_MARGIN = 10
"""Cycles that are looked at beyond those that look-ahead and delay touch."""
_REVERSALS = 64
"""Reversals that are looked at closely, at most; samples around others are left out."""
_CLOSE, _TRIALS = 3, 15
"""Pairs of look-ahead and delay whose distance and shape are searched, and steps at most."""
_WILD = 6.0
_SMALL = 0.05
"""Share of the friction below which nothing is wild, however quiet the rest."""
_FEW = 4
"""Reversals below which nothing is known of them."""

Place = Float[np.ndarray, " q"]
"""A distance in mm, then the logarithms of a shape."""


@dataclasses.dataclass(frozen=True)
class ReversalFit:
    """What reversals show of the friction around them.

    Attributes:
        lookahead: Cycles before the reversal over which the current falls (P-COMP-00044).
        position_delay: Distance in mm after it over which the current rises (P-COMP-00043).
        delay_cycles: Cycles that all of it comes later (P-COMP-00058).
        position_delay_sd: Standard deviation of the distance in mm.
        lookahead_probability: That `lookahead` is the right one of 0 to 4.
        lookahead_seen: Whether any motion shows it. Where the axis stands before all
            reversals none does: it is 0, and its probability 1.
        delay_probability: That `delay_cycles` is the right one of those tried.
        noise: Standard deviation of what is left around reversals, in drive units.
        reversals: How many there are.
        missing: What look-ahead, distance and delay take from that friction per sample, in
            drive units. Added to the load, it leaves what steady friction gives.
    """

    lookahead: int
    position_delay: float
    delay_cycles: int
    position_delay_sd: float
    lookahead_probability: float
    lookahead_seen: bool
    delay_probability: float
    noise: float
    reversals: int
    missing: Trace

    @property
    def numbers(self) -> dict[str, int | float]:
        """Look-ahead, distance and delay by the names of their list entries."""
        return {
            "reversal_lookahead": self.lookahead,
            "position_delay": self.position_delay,
            "delay_cycles": self.delay_cycles,
        }

    @property
    def undetermined(self) -> dict[str, str]:
        """What the recording cannot tell: name → reason."""
        reasons: dict[str, str] = {}
        if self.reversals < _FEW:
            words = f"only {self.reversals} reversals were recorded"
            reasons = dict.fromkeys(self.numbers, words)
        sure = self.lookahead_probability, self.delay_probability
        names = "reversal_lookahead", "delay_cycles"
        for name, probability in zip(names, sure, strict=True):
            if probability < 0.5:
                reasons[name] = (
                    f"{self.numbers[name]} cycles fit best, others nearly as well"
                    f" (probability {probability:.0%})"
                )
        if self.delay_cycles == _MOST_DELAY:
            words = f"it is {_MOST_DELAY} cycles, the most tried, or more"
            reasons["delay_cycles"] = words
        if self.position_delay >= 0.98 * _FARTHEST:
            reasons["position_delay"] = f"it is {1e3 * _FARTHEST:g} µm or more"
        return reasons


def fit_reversal(
    samples: DriveSamples,
    position: Trace,
    velocity: Trace,
    *,
    inertia: float | None = None,
) -> ReversalFit:
    """Find how the friction current changes over where the axis reverses, and the law with it.

    A Stribeck curve and a table per direction are tried, and the one taken that leaves least
    (Bayesian information criterion). A rough table shows where the delay is; distance and shape
    are searched beside it. Samples beyond 6 standard deviations are left out; what successive
    residuals have in common counts in the uncertainty.

    Args:
        samples: The recording, one sample per cycle of the controller.
        position: Commanded, in mm.
        velocity: Commanded, in mm/s.
        inertia: In drive units per mm/s², where it is known.

    Raises:
        FitError: If there is no reversal, or arrays differ in length or have gaps.
    """
    recording = record(samples, inertia, 1)
    velocity, msg = _without_jitter(velocity, samples.cycle), ""
    starts = _turns(velocity)
    if not len(position) == len(velocity) == len(samples.time):
        msg = (
            f"found {len(position)} positions, {len(velocity)} velocities and"
            f" {len(samples.time)} samples, expected as many of each"
        )
    elif not (np.isfinite(position).all() and np.isfinite(velocity).all()):
        msg = "found gaps in the recording, expected numbers"
    elif not len(starts):
        msg = "found no reversal in the recording, expected motion in both directions"
    if msg:
        raise FitError(msg)
    near, far = _rows(samples, position, starts)
    # What a drive holds at rest tells nothing of the friction in motion.
    rows, share = (near & (velocity != 0), far), share_of(position, velocity)
    # A rough table shows where the delay is, whatever the law.
    coarse = KnotTable(True, default_knots(recording.speed, _ROUGH))
    kinds = coarse, Stribeck(True), KnotTable(True, recording.knots)
    rough, *searches = (
        _Search(recording, kind, velocity, *rows, share) for kind in kinds
    )
    with one_blas_thread():
        table = rough.grid(np.zeros(0), rows[0] | rows[1], range(_MOST_DELAY + 1))
        delay = int(np.argmin(table.min(axis=(0, 2))))
        fits = [_fitted(search, len(starts), delay) for search in searches]
    return min(fits, key=lambda result: result[1])[0]


@dataclasses.dataclass(frozen=True, eq=False)
class _Search:
    """The load for every look-ahead and delay in cycles, and every place, and what it leaves.

    Attributes:
        recording: The load sample by sample.
        near: Samples that look-ahead, distance or delay can touch.
        far: Others in motion, where only the delay acts.
        share: How much of the friction acts by distance, look-ahead by look-ahead.
    """

    recording: Recording
    structure: AbstractStructure
    velocity: Trace
    near: Bool[np.ndarray, " t"]
    far: Bool[np.ndarray, " t"]
    share: Callable[[float], Float[np.ndarray, "l t"]]

    @cached_property
    def beside(self) -> Float[np.ndarray, "t c"]:
        """Columns beside friction: constant load, accelerations, further loads.

        Around hard reversals a smoothed acceleration leaves much: there those of the command
        stand beside it. Elsewhere they would stand in for viscous friction of a sine.
        """
        step = self.recording.samples.cycle
        acceleration = np.diff(self.velocity, prepend=self.velocity[:1]) / step
        acceleration[self.far] = 0.0
        shifted = [np.roll(acceleration, lag) for lag in (-1, 0, 1, 2)]
        equation = Equation(self.recording, CoulombViscous())  # both directions alike
        return np.column_stack([*shifted, equation.beside])

    @cached_property
    def columns(self) -> Callable[[tuple[float, ...]], Float[np.ndarray, "t k"]]:
        """The columns of steady friction by their shape."""
        return lru_cache(2)(
            lambda shape: self.structure.columns(self.velocity, np.array([shape]))[0]
        )

    def solve(
        self, lookahead: int, delay: int, place: Place, use: Int[np.ndarray, " r"]
    ) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " r"]]:
        """Return the factors of all columns, and what they leave of some samples."""
        distance, *shape = place.tolist()
        acting = self.share(distance)[lookahead, :, None] * self.columns(tuple(shape))
        design = np.concatenate([acting[use - delay], self.beside[use]], axis=1)
        load = self.recording.target[use]
        factors = ridged(design.T @ design, design.T @ load)
        return factors, load - design @ factors

    def grid(
        self, shape: Shape, keep: Bool[np.ndarray, " t"], delays: range
    ) -> Float[np.ndarray, "l d s"]:
        """Return the sums of squares by look-ahead, delay and distance; else infinite."""
        use, load = np.flatnonzero(keep), self.recording.target[keep]
        columns, beside = self.columns(tuple(shape.tolist())), self.beside[use]
        split, total = columns.shape[1], float(load @ load)
        costs = np.full((LOOKAHEADS, _MOST_DELAY + 1, len(_DISTANCES)), np.inf)
        for delay in delays:
            design = np.concatenate([columns[use - delay], beside], axis=1)
            gram, moment = design.T @ design, design.T @ load
            for place, distance in enumerate(_DISTANCES):
                for lookahead, share in enumerate(self.share(float(distance))):
                    # Steady friction, and what is different where not all of it acts.
                    rows = np.flatnonzero(share[use - delay] != 1.0)
                    steady = design[rows]
                    acting = steady.copy()
                    acting[:, :split] *= share[use[rows] - delay, None]
                    right = moment + (acting - steady).T @ load[rows]
                    normal = gram + acting.T @ acting - steady.T @ steady
                    gain = right @ ridged(normal, right)
                    costs[lookahead, delay, place] = total - gain
        return np.asarray(np.maximum(costs, 0.0))

    def refined(
        self, cycles: tuple[int, int], number: int, shape: Shape, use: np.ndarray
    ) -> tuple[Place, float]:
        """Return the best place beside a distance of the grid, and the squares left."""
        ends = _DISTANCES[max(number - 1, 0)], _DISTANCES[number : number + 2][-1]
        shapes = self.structure.bounds(np.abs(self.velocity[use]))
        low, high = np.column_stack([ends, shapes])
        start, inside = np.append(_DISTANCES[number], shape), 1e-3 * (high - low)
        unit = float(np.linalg.norm(self.solve(*cycles, start, use)[1])) or 1.0
        optimum = least_squares(
            lambda place: self.solve(*cycles, place, use)[1] / unit,
            np.clip(start, low + inside, high - inside),
            bounds=(low, high),
            x_scale=high - low,
            max_nfev=_TRIALS,
        )
        if 2.0 * optimum.cost < 1.0:
            return optimum.x, 2.0 * float(optimum.cost) * unit**2
        return start, unit**2

    def best(
        self, shape: Shape, keep: Bool[np.ndarray, " t"], delay: int, close: int
    ) -> tuple[tuple[int, int], Place, Float[np.ndarray, "l d"]]:
        """Return the best look-ahead, delay and place about a delay, and least squares of each."""
        delays = range(max(delay - _ASIDE, 0), min(delay + _ASIDE, _MOST_DELAY) + 1)
        table = self.grid(shape, keep, delays)
        numbers, squares = np.argmin(table, axis=2), np.min(table, axis=2)
        use, places = np.flatnonzero(keep), dict[tuple[int, int], Place]()
        # Only what comes near the best deserves the last digits.
        for flat in np.argsort(squares, axis=None)[:close].tolist():
            cycles = divmod(flat, squares.shape[1])
            refined = self.refined(cycles, int(numbers[cycles]), shape, use)
            places[cycles], squares[cycles] = refined
        cycles = min(places, key=lambda each: squares[each])
        return cycles, places[cycles], squares


def _turns(velocity: Trace) -> Int[np.ndarray, " r"]:
    """Return the first sample of each motion against the one before it."""
    moving = np.flatnonzero(velocity != 0)
    return np.asarray(moving[1:][np.diff(np.sign(velocity[moving])) != 0])


def _without_jitter(velocity: Trace, cycle: float) -> Trace:
    """Return the velocity with 0 where the axis stands but for the noise of its encoder."""
    motion = np.searchsorted(_turns(velocity), np.arange(len(velocity)), side="right")
    way = cycle * np.abs(np.bincount(motion, velocity))
    return np.where(way[motion] < _JITTER, 0.0, velocity)


def _rows(
    samples: DriveSamples, position: Trace, starts: Int[np.ndarray, " r"]
) -> tuple[Bool[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Return which samples are around reversals, and which others in motion."""
    around, near = np.zeros((2, len(position)), bool)
    stride = -(-len(starts) // _REVERSALS)
    ends = np.append(starts[1:], len(position))
    for number, (start, end) in enumerate(zip(starts, ends, strict=True)):
        distance = np.abs(position[start:end] - position[max(start - 1, 0)])
        reach = int(np.searchsorted(np.maximum.accumulate(distance), 1.5 * _FARTHEST))
        first = max(start - 2 * LOOKAHEADS - _MARGIN, 0)
        span = slice(first, start + reach + _MOST_DELAY + _MARGIN)
        around[span] = True
        near[span] |= number % stride == 0
    good = ~samples.saturated
    good[:_MOST_DELAY] = False
    return near & good, good & ~around & samples.in_motion


def _fitted(search: _Search, reversals: int, delay: int) -> tuple[ReversalFit, float]:
    """Return what reversals show, wild samples left out, and the criterion of the law.

    The delay is about that of `delay`.
    """
    keep = search.near | search.far
    use = np.flatnonzero(keep)
    shape = search.structure.bounds(np.abs(search.velocity[use])).mean(axis=0)
    # A first pass finds the wild samples and the shape, the second does without them.
    cycles, place, _ = search.best(shape, keep, delay, 1)
    error = search.solve(*cycles, place, use)[1]
    loads = search.recording.target[use], error
    level, typical = (median(np.abs(values)) for values in loads)
    good = np.abs(error) <= max(_WILD * NORMAL * typical, _SMALL * level)
    if good.mean() >= 0.5:
        keep[use[~good]] = False
        use = use[good]
    cycles, place, squares = search.best(place[1:], keep, cycles[1], _CLOSE)
    place[0] *= place[0] >= _NOTHING
    (lookahead, delay), distance, shape = cycles, float(place[0]), place[1:]
    shares = search.share(distance)
    looked = np.flatnonzero(search.near | search.far) - delay
    seen = bool((shares != shares[0])[:, looked].any())
    lookahead *= seen
    factors, error = search.solve(*cycles, place, use)
    # Successive residuals have something in common: fewer of them count as independent.
    common = float(error[1:] @ error[:-1]) / max(float(error @ error), 1e-300)
    common = min(max(common, 0.0), 0.98)
    share = (1 - common) / (1 + common)
    # A perfect recording leaves rounding: below it no two settings differ.
    floor = 1e-9 * float(np.abs(search.recording.target).max())
    noise = max(float(np.sqrt(np.mean(error**2))), floor)
    step = max(1e-3 * distance, 1e-6)
    ends = [max(distance - step, 0.0), distance + step]
    errors = [search.solve(*cycles, np.append(d, shape), use)[1] for d in ends]
    slope = float(np.linalg.norm(errors[1] - errors[0])) / (ends[1] - ends[0])
    odds = np.exp(-0.5 * share * (squares - squares.min()) / noise**2)
    odds /= odds.sum()
    columns = search.columns(tuple(shape.tolist()))
    law_factors = factors[: columns.shape[1]]
    steady = columns @ law_factors
    acting = shares[lookahead] * steady
    delayed = np.pad(acting, (delay, 0))[: len(acting)]
    result = ReversalFit(
        lookahead=lookahead,
        position_delay=distance,
        delay_cycles=delay,
        position_delay_sd=noise / slope / np.sqrt(share) if slope > 0 else np.inf,
        lookahead_probability=float(odds.sum(axis=1)[lookahead]) if seen else 1.0,
        lookahead_seen=seen,
        delay_probability=float(odds.sum(axis=0)[delay]),
        noise=float(np.sqrt(np.mean(error[search.near[use]] ** 2))),
        reversals=reversals,
        missing=steady - delayed,
    )
    criterion = 2.0 * len(use) * np.log(noise)
    criterion += np.log(len(use)) * (len(law_factors) + len(shape))
    return result, float(criterion)
