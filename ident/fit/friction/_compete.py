"""Kinds of law fitted to recordings side by side, and how each predicts windows held out."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ._equation import AbstractEquation
from ._equations import equation_of
from ._lanes import Shares, side_by_side
from ._leftout import LeftOut
from ._scout import reweigh, scout
from ._separable import Solution, search
from ._smoothing import choose_weights
from ._solve import Solved, solve_stack
from ._stack import Stack, stack_of
from ._structure import AbstractStructure

_NEAR = 0.1
"""Step of a logarithm of the shape up to which a law is as good as linear in it."""
_WILD = 4.0
"""Error in scales beyond which a sample says nothing of the law."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One kind of law and how it predicts what it has not seen.

    Attributes:
        structure: Kind of law.
        parameters: How many numbers it has, inertia and offset left out.
        window_error: RMS of the force error per window held out, relative to the load's RMS
            over the whole recording.
        error: Root of their mean square.
        standard_error: Of the mean square over the windows, in terms of ``error``.
        fitted_error: The same on the samples fitted, for the distance between both.
    """

    structure: AbstractStructure
    parameters: int
    window_error: Float[np.ndarray, " w"]
    error: float
    standard_error: float
    fitted_error: float

    @property
    def spread(self) -> tuple[float, float]:
        """Least and largest error over the windows."""
        return float(np.min(self.window_error)), float(np.max(self.window_error))


@dataclasses.dataclass(frozen=True)
class Competition:
    """Laws that compete for one recording.

    Attributes:
        parts: The recording and its windows.
        kinds: The laws, from simple to rich.
    """

    parts: LeftOut
    kinds: tuple[AbstractStructure, ...]


Fits = list[dict[AbstractStructure, Solved]]
"""Laws fitted to all rows, recording by recording."""


def compete(
    asked: Sequence[Competition],
) -> tuple[Fits, list[tuple[Candidate, ...]]]:
    """Return the laws in words fitted to all rows, and how each kind predicts windows.

    Args:
        asked: Recordings that can stand side by side.
    """
    stack = stack_of([each.parts.problem for each in asked])
    held = _HeldOut(stack, [each.parts for each in asked])
    fits: Fits = [{} for _ in asked]
    carried: list[list[AbstractStructure]] = [[] for _ in asked]
    for place, kind in enumerate(asked[0].kinds):
        kinds = [each.kinds[place] for each in asked]
        lawful, speaks = stack.with_structures(kinds), list(kinds)
        if kind.in_words:
            for k, solved in enumerate(solve_stack(lawful, held.loss, stack.all_rows)):
                fits[k][kinds[k]] = solved
                # Where the data do not carry a law, the simpler one speaks for it.
                speaks[k] = solved.problem.structure
        held.look_at(lawful, speaks, [fits[k].get(kinds[k]) for k in range(len(asked))])
        for own, law in zip(carried, speaks, strict=True):
            own.append(law)
    return fits, [
        held.race(k, each.kinds, own)
        for k, (each, own) in enumerate(zip(asked, carried, strict=True))
    ]


def fit_all(
    asked: Sequence[Competition], wanted: Sequence[AbstractStructure], fits: Fits
) -> None:
    """Fit one law to all rows of each recording, where that was not done yet.

    Args:
        asked: The recordings.
        wanted: The law for each.
        fits: What was fitted; what is wanted is added.
    """
    for places in _of_one_kind(
        {k: kind for k, kind in enumerate(wanted) if kind not in fits[k]}
    ):
        stack = stack_of([asked[k].parts.problem for k in places])
        stack = stack.with_structures([wanted[k] for k in places])
        solved = solve_stack(stack, asked[0].parts.loss, stack.all_rows)
        for k, each in zip(places, solved, strict=True):
            fits[k][wanted[k]] = each


def _of_one_kind(kinds: dict[int, AbstractStructure]) -> list[list[int]]:
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, kind in kinds.items():
        groups.setdefault(kind.kind, []).append(k)
    return list(groups.values())


@dataclasses.dataclass(frozen=True)
class _Errors:
    """Mean squares of what a law leaves of a recording.

    Attributes:
        held_out: Of each window, solved without it.
        fitted: Of all rows.
    """

    held_out: Float[np.ndarray, " w"]
    fitted: float


class _HeldOut:
    """What laws leave of windows when they are solved without them.

    Which rows are wild, and how smooth a table is, is what all rows say: next to nothing of
    a window's own, and a tenth of the work of fits that start without it.
    """

    def __init__(self, stack: Stack, parts: Sequence[LeftOut]) -> None:
        self.stack, self.parts = stack, parts
        self.loss = parts[0].loss
        self.lanes = side_by_side([each.every for each in parts], stack.rows)
        # Of each fit, the last of a recording being that of all rows.
        windows = [span for each in parts for span in (*each.bounds, (0, stack.rows))]
        self._windows = np.array(windows, np.int64)
        self._shares: dict[bool, Shares] = {}
        self._found: list[dict[AbstractStructure, _Errors]] = [{} for _ in parts]

    def look_at(
        self,
        stack: Stack,
        kinds: Sequence[AbstractStructure],
        solved: Sequence[Solved | None],
    ) -> None:
        """Solve one law for each recording, where that was not done yet.

        Args:
            stack: The recordings under the laws asked for.
            kinds: The laws that the data carry.
            solved: Fitted to all rows, where that was done.
        """
        new = {k: kind for k, kind in enumerate(kinds) if kind not in self._found[k]}
        for places in _of_one_kind(new):
            laws = [kinds[k if k in places else places[0]] for k in range(len(kinds))]
            if laws != [each.structure for each in stack.problems]:
                stack = self.stack.with_structures(laws)
            which = np.flatnonzero(np.isin(self.lanes.of, places))
            equation = equation_of(stack, self.lanes.take(which))
            shares = self._shares_of(stack).take(which)
            known = ((k, solved[k]) for k in places)
            found = {k: law.solution for k, law in known if law is not None}
            windows = self._windows[which]
            for k, errors in self._errors(equation, shares, windows, found).items():
                self._found[k][kinds[k]] = errors

    def _shares_of(self, stack: Stack) -> Shares:
        way = stack.structure.directional
        if way not in self._shares:
            share = scout(stack, self.stack.all_rows, self.loss).full
            full = self.lanes.use * share[self.lanes.of]
            self._shares[way] = Shares(self.lanes, full)
        return self._shares[way]

    def _errors(
        self,
        equation: AbstractEquation,
        shares: Shares,
        windows: Int[np.ndarray, "w 2"],
        laws: Mapping[int, Solution],
    ) -> dict[int, _Errors]:
        """Return what recordings with fits show of one law."""
        lanes = equation.lanes
        last = lanes.last
        if equation.stack.structure.bends() is not None:
            weights = choose_weights(equation.take(last), shares.take(last))
            every = np.repeat(weights, lanes.fits[lanes.fits > 0])
            equation = equation.smoothed(every)
        held, whole = self._residuals(equation, shares, windows, laws)
        held, fitted = np.square(held), np.square(whole)
        if self.loss != "gauss":
            # A wild sample says nothing of the law: no more than where the fit lets go.
            _, losses = reweigh(equation.take(last), whole, self.loss)
            limit = np.square([_WILD * each.scale for each in losses])[:, None]
            held, fitted = np.minimum(held, limit), np.minimum(fitted, limit)
        fitted = np.einsum("ws,ws->w", fitted, lanes.use[last]) / lanes.count[last]
        return {
            k: _Errors(self.parts[k].mean(square), float(each))
            for (k, _), square, each in zip(lanes.own, held, fitted, strict=True)
        }

    def _residuals(
        self,
        equation: AbstractEquation,
        shares: Shares,
        windows: Int[np.ndarray, "w 2"],
        laws: Mapping[int, Solution],
    ) -> tuple[Float[np.ndarray, "v s"], Float[np.ndarray, "v s"]]:
        """Return what laws leave of each row, solved without its window, and of all rows."""
        recordings = len(equation.stack.problems)
        shape = np.zeros((recordings, equation.height))
        linear = np.zeros((recordings, equation.width))
        for k, law in laws.items():
            if equation.height:
                shape[k], linear[k] = law.shape, law.factors
        held, whole, step = equation.held_out(shares, shape, linear, windows)
        if equation.height:
            self._search_far(equation, shares, windows, step, shape, held, whole)
        return held, whole

    def _search_far(
        self,
        equation: AbstractEquation,
        shares: Shares,
        windows: Int[np.ndarray, "w 2"],
        step: Float[np.ndarray, "w h"],
        shape: Float[np.ndarray, "r h"],
        held: Float[np.ndarray, "v s"],
        whole: Float[np.ndarray, "v s"],
    ) -> None:
        """Search shapes that lie so far off that tangents do not lead there."""
        lanes, (low, high) = equation.lanes, equation.bounds
        begin = shape[lanes.of]
        aim = begin + step
        far = (np.abs(step) > _NEAR) | (aim < low) | (aim > high)
        if equation.instruments:
            far[:] = True
        left = np.flatnonzero(far.any(axis=1))
        if not len(left):
            return
        point = search(equation.take(left), shares.take(left), begin[left])
        residual = dict(zip(left.tolist(), point.residual, strict=True))
        for row, every, (_, own) in zip(held, whole, lanes.own, strict=True):
            for lane in range(own.start, own.stop - 1):
                start, end = windows[lane]
                if lane in residual:
                    row[start:end] = residual[lane][start:end]
            every[:] = residual.get(own.stop - 1, every)

    def race(
        self,
        k: int,
        kinds: Sequence[AbstractStructure],
        speaks: Sequence[AbstractStructure],
    ) -> tuple[Candidate, ...]:
        """Return how laws predict the windows of a recording.

        Args:
            k: The recording.
            kinds: The laws.
            speaks: Those that the data carry, of each.
        """
        size = self.parts[k].size ** 2
        found = [self._found[k][kind] for kind in speaks]
        squares = np.stack([each.held_out for each in found]) / size
        fitted = np.array([each.fitted for each in found]) / size
        error = np.sqrt(squares.mean(axis=1))
        spread = np.std(squares, axis=1, ddof=1) / np.sqrt(squares.shape[1])
        spread /= 2.0 * np.maximum(error, 1e-300)
        rows = zip(
            kinds,
            np.sqrt(squares),
            error.tolist(),
            spread.tolist(),
            np.sqrt(fitted).tolist(),
            strict=True,
        )
        return tuple(
            Candidate(kind, len(kind.names) + len(kind.shapes), *row)
            for kind, *row in rows
        )
