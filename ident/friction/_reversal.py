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

from ...data.signals import median
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
    range_of,
)
from ._weights import ridged

_FARTHEST, _NOTHING = 0.02, 1e-6
"""mm: no friction takes longer to build up, however soft the drive, and below is none."""
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


@dataclasses.dataclass(frozen=True)
class ReversalFit:
    """What reversals show of the friction around them.

    Attributes:
        lookahead: Cycles before the reversal over which the current falls (P-COMP-00044).
        position_delay: Distance in mm after it over which the current rises (P-COMP-00043).
        delay_cycles: Cycles that all of it comes later (P-COMP-00058).
        position_delay_sd: Standard deviation of the distance in mm.
        lookahead_probability: That `lookahead` is the right one of 0 to 4.
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
    moving, msg = np.flatnonzero(velocity != 0), ""
    starts = moving[1:][np.diff(np.sign(velocity[moving])) != 0]
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
    rows, share = _rows(samples, position, starts), share_of(position, velocity)
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


@dataclasses.dataclass(frozen=True)
class _Setting:
    """Look-ahead and delay in cycles, distance in mm, logarithms of the shape."""

    lookahead: int
    delay: int
    distance: float
    shape: Shape


@dataclasses.dataclass(frozen=True, eq=False)
class _Search:
    """The load for every setting, and what it leaves.

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
        self, setting: _Setting, use: Int[np.ndarray, " r"]
    ) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " r"]]:
        """Return the factors of all columns, and what they leave of some samples."""
        before = use - setting.delay
        rows = self.columns(tuple(setting.shape))[before]
        rows = self.share(setting.distance)[setting.lookahead, before, None] * rows
        design = np.concatenate([rows, self.beside[use]], axis=1)
        load = self.recording.target[use]
        gram = design.T @ design
        factors = ridged(gram, design.T @ load)
        error = load - design @ factors
        # Once more for what rounding leaves of normal equations.
        change: np.ndarray = ridged(gram, design.T @ error)
        return factors + change, error - design @ change

    def grid(
        self, shape: Shape, keep: Bool[np.ndarray, " t"], delays: range
    ) -> Float[np.ndarray, "l d s"]:
        """Return the sums of squares by look-ahead, delay and distance; else infinite."""
        use, load = np.flatnonzero(keep), self.recording.target[keep]
        columns, beside = self.columns(tuple(shape)), self.beside[use]
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
        self, setting: _Setting, use: Int[np.ndarray, " r"]
    ) -> tuple[_Setting, float]:
        """Return the best distance and shape beside a setting, and the squares left."""
        place = int(np.searchsorted(_DISTANCES, setting.distance))
        ends = _DISTANCES[max(place - 1, 0)], _DISTANCES[place : place + 2][-1]
        shapes = self.structure.bounds(range_of(np.abs(self.velocity[use])))
        low, high = np.column_stack([ends, shapes])
        start, inside = np.append(setting.distance, setting.shape), 1e-3 * (high - low)
        unit = np.linalg.norm(self.solve(setting, use)[1]) or 1.0

        def at(point: Float[np.ndarray, " q"]) -> _Setting:
            distance, shape = float(point[0]), point[1:].copy()
            return dataclasses.replace(setting, distance=distance, shape=shape)

        optimum = least_squares(
            lambda point: self.solve(at(point), use)[1] / unit,
            np.clip(start, low + inside, high - inside),
            bounds=(low, high),
            x_scale=high - low,
            max_nfev=_TRIALS,
        )
        if 2.0 * optimum.cost < 1.0:
            return at(optimum.x), 2.0 * float(optimum.cost * unit**2)
        return setting, float(unit**2)


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
    use, bounds = np.flatnonzero(keep), search.structure.bounds
    shape = bounds(range_of(np.abs(search.velocity[use]))).mean(axis=0)
    # A first pass finds the wild samples and the shape, the second does without them.
    best, _ = _best(search, shape, keep, delay, 1)
    error = search.solve(best, use)[1]
    loads = search.recording.target[use], error
    level, typical = (median(np.abs(values)) for values in loads)
    good = np.abs(error) <= max(_WILD * 1.4826 * typical, _SMALL * level)
    if good.mean() >= 0.5:
        keep[use[~good]] = False
        use = use[good]
    best, squares = _best(search, best.shape, keep, best.delay, _CLOSE)
    if best.distance < _NOTHING:
        best = dataclasses.replace(best, distance=0.0)
    factors, error = search.solve(best, use)
    # Successive residuals have something in common: fewer of them count as independent.
    common = float(error[1:] @ error[:-1]) / max(float(error @ error), 1e-300)
    common = min(max(common, 0.0), 0.98)
    share = (1 - common) / (1 + common)
    # A perfect recording leaves rounding: below it no two settings differ.
    floor = 1e-9 * float(np.abs(search.recording.target).max())
    noise = max(float(np.sqrt(np.mean(error**2))), floor)
    step = max(1e-3 * best.distance, 1e-6)
    ends = max(best.distance - step, 0.0), best.distance + step
    errors = [search.solve(dataclasses.replace(best, distance=d), use)[1] for d in ends]
    slope = float(np.linalg.norm(errors[1] - errors[0])) / (ends[1] - ends[0])
    odds = np.exp(-0.5 * share * (squares - squares.min()) / noise**2)
    odds /= odds.sum()
    columns = search.columns(tuple(best.shape))
    law_factors = factors[: columns.shape[1]]
    steady = columns @ law_factors
    acting = search.share(best.distance)[best.lookahead] * steady
    delayed = np.pad(acting, (best.delay, 0))[: len(acting)]
    result = ReversalFit(
        lookahead=best.lookahead,
        position_delay=best.distance,
        delay_cycles=best.delay,
        position_delay_sd=noise / slope / np.sqrt(share) if slope > 0 else np.inf,
        lookahead_probability=float(odds.sum(axis=1)[best.lookahead]),
        delay_probability=float(odds.sum(axis=0)[best.delay]),
        noise=float(np.sqrt(np.mean(error[search.near[use]] ** 2))),
        reversals=reversals,
        missing=steady - delayed,
    )
    criterion = 2.0 * len(use) * np.log(noise)
    criterion += np.log(len(use)) * (len(law_factors) + len(best.shape))
    return result, float(criterion)


def _best(
    search: _Search, shape: Shape, keep: Bool[np.ndarray, " t"], delay: int, close: int
) -> tuple[_Setting, Float[np.ndarray, "l d"]]:
    """Return the best setting about a delay, and least squares by look-ahead and delay."""
    delays = range(max(delay - _ASIDE, 0), min(delay + _ASIDE, _MOST_DELAY) + 1)
    table = search.grid(shape, keep, delays)
    places, squares = np.argmin(table, axis=2), np.min(table, axis=2)
    use, results = np.flatnonzero(keep), []
    # Only what comes near the best deserves the last digits.
    for flat in np.argsort(squares, axis=None)[:close]:
        at = lookahead, delay = divmod(int(flat), squares.shape[1])
        setting = _Setting(lookahead, delay, float(_DISTANCES[places[at]]), shape)
        results.append(search.refined(setting, use))
        squares[at] = results[-1][1]
    return min(results, key=lambda result: result[1])[0], squares
