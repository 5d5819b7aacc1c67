"""Kinds of law fitted to recordings side by side, and how each predicts windows held out."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ._equation import Equation
from ._lanes import Shares, side_by_side
from ._leftout import LeftOut
from ._scout import reweigh, scout
from ._separable import Solution, solve_near
from ._smoothing import choose_weights
from ._solve import Solved, solve_stack
from ._stack import Stack, stack_of
from ._structure import AbstractStructure

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
        speaks = list(kinds)
        if kind.in_words:
            lawful = stack.with_structures(kinds)
            for k, solved in enumerate(solve_stack(lawful, held.loss, stack.all_rows)):
                fits[k][kinds[k]] = solved
                # Where the data do not carry a law, the simpler one speaks for it.
                speaks[k] = solved.problem.structure
        held.look_at(speaks, [fits[k].get(kinds[k]) for k in range(len(asked))])
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
        key = (type(kind), kind.directional, kind.names, kind.shapes)
        groups.setdefault(key, []).append(k)
    return list(groups.values())


class _HeldOut:
    """What laws leave of windows when they are solved without them.

    Which rows are wild, and how smooth a table is, is what all rows say: next to nothing of
    a window's own, and a tenth of the work of fits that start without it.
    """

    def __init__(self, stack: Stack, parts: Sequence[LeftOut]) -> None:
        self.stack, self.parts = stack, parts
        self.loss = parts[0].loss
        self.lanes = side_by_side([each.every for each in parts], stack.rows)
        self._shares: dict[bool, Shares] = {}
        self._found: list[dict[AbstractStructure, tuple[np.ndarray, np.ndarray]]] = [
            {} for _ in parts
        ]
        self._out = np.zeros(self.lanes.use.shape)
        for each, (_, own) in zip(parts, self.lanes.own, strict=True):
            windows = slice(own.start, own.stop - 1)
            self._out[windows, : each.out.shape[1]] = each.out

    def look_at(
        self,
        kinds: Sequence[AbstractStructure],
        solved: Sequence[Solved | None],
    ) -> None:
        """Solve one law for each recording, where that was not done yet.

        Args:
            kinds: The laws.
            solved: Fitted to all rows, where that was done.
        """
        new = {k: kind for k, kind in enumerate(kinds) if kind not in self._found[k]}
        for places in _of_one_kind(new):
            stack = self.stack.with_structures(
                [
                    kinds[k] if k in places else kinds[places[0]]
                    for k in range(len(kinds))
                ]
            )
            which = np.flatnonzero(np.isin(self.lanes.of, places))
            lanes = self.lanes.take(which)
            equation = Equation(stack, lanes)
            shares = self._shares_of(stack).take(which)
            known = ((k, solved[k]) for k in places)
            laws = {k: law.solution for k, law in known if law is not None}
            held, fitted = self._errors(equation, shares, laws, self._out[which])
            for k, own in lanes.own:
                parts = slice(own.start, own.stop - 1)
                self._found[k][kinds[k]] = held[parts], fitted[parts]

    def _errors(
        self,
        equation: Equation,
        shares: Shares,
        laws: Mapping[int, Solution],
        out: Float[np.ndarray, "w s"],
    ) -> tuple[Float[np.ndarray, " w"], Float[np.ndarray, " w"]]:
        """Return the mean square per fit over its window, and over the rows it uses."""
        lanes = equation.lanes
        last = np.array([own.stop - 1 for _, own in lanes.own])
        if equation.stack.structure.bends() is not None:
            weights = choose_weights(equation.take(last), shares.take(last))
            every = np.repeat(weights, [own.stop - own.start for _, own in lanes.own])
            equation = equation.smoothed(every)
        residual = solve_near(equation, shares, laws).residual
        square = np.square(residual)
        if self.loss != "gauss":
            # A wild sample says nothing of the law: no more than where the fit lets go.
            _, losses = reweigh(equation.take(last), residual[last], self.loss)
            limit = np.zeros(len(self.parts))
            limit[lanes.of[last]] = [_WILD * each.scale for each in losses]
            np.minimum(square, np.square(limit[lanes.of])[:, None], out=square)
        held = np.einsum("ws,ws->w", square, out)
        return held, np.einsum("ws,ws->w", square, lanes.use) / lanes.count

    def _shares_of(self, stack: Stack) -> Shares:
        way = stack.structure.directional
        if way not in self._shares:
            share = scout(stack, self.stack.all_rows, self.loss).full
            full = self.lanes.use * share[self.lanes.of]
            self._shares[way] = self.lanes.shares(full)
        return self._shares[way]

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
        squares, fitted = (
            np.stack([self._found[k][kind][place] for kind in speaks]) / size
            for place in (0, 1)
        )
        error = np.sqrt(squares.mean(axis=1))
        spread = np.std(squares, axis=1, ddof=1) / np.sqrt(squares.shape[1])
        spread /= 2.0 * np.maximum(error, 1e-300)
        rows = zip(
            kinds,
            np.sqrt(squares),
            error.tolist(),
            spread.tolist(),
            np.sqrt(fitted.mean(axis=1)).tolist(),
            strict=True,
        )
        return tuple(
            Candidate(kind, len(kind.names) + len(kind.shapes), *row)
            for kind, *row in rows
        )
