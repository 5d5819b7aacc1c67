"""Recordings of equal shape side by side, each under a law of the same kind."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from ._lanes import Lanes, side_by_side
from ._problem import Problem
from ._structure import AbstractStructure


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Stack:
    """Equations with the same kinds of columns, rows filled up with zeros.

    Attributes:
        problems: One per recording; their laws differ in places of knots only.
        shared: What does not depend on the law, by name.
    """

    problems: tuple[Problem, ...]
    shared: dict[object, np.ndarray]

    @property
    def one(self) -> Problem:
        """Any of them, for what they have in common."""
        return self.problems[0]

    @property
    def structure(self) -> AbstractStructure:
        """Kind of law; where knots lie differs."""
        return self.one.structure

    @cached_property
    def rows(self) -> int:
        """Rows of the longest recording."""
        return max(len(each.target) for each in self.problems)

    def with_structures(self, kinds: Sequence[AbstractStructure]) -> "Stack":
        """Return the same recordings under other laws."""
        pairs = zip(self.problems, kinds, strict=True)
        other = Stack(tuple(a.with_structure(b) for a, b in pairs), self.shared)
        other.__dict__["all_rows"] = self.all_rows  # the same object, told by identity
        return other

    @cached_property
    def all_rows(self) -> Lanes:
        """One fit per recording, to all rows that may be used."""
        return side_by_side([each.all_rows for each in self.problems], self.rows)

    def _once(self, name: object, of: Callable[[Problem], np.ndarray]) -> np.ndarray:
        if name not in self.shared:
            self.shared[name] = self._filled([of(each) for each in self.problems])
        return self.shared[name]

    def _filled(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Stack arrays over rows, filled up with zeros."""
        first = arrays[0]
        if len(arrays) == 1:
            return np.ascontiguousarray(first)[None]
        found = np.zeros((len(arrays), self.rows, *first.shape[1:]), first.dtype)
        for into, array in zip(found, arrays, strict=True):
            into[: len(array)] = array
        return found

    @property
    def target(self) -> Float[np.ndarray, "r s"]:
        """See `Problem`."""
        return self._once("target", lambda each: each.target)

    @property
    def usable(self) -> Bool[np.ndarray, "r s"]:
        """See `Problem`."""
        return self._once("usable", lambda each: each.usable)

    @property
    def beside(self) -> Float[np.ndarray, "r s f"]:
        """The columns that do not belong to friction."""
        name = f"beside{self.structure.directional}"
        return self._once(name, lambda each: each.beside)

    @property
    def sign(self) -> Float[np.ndarray, "r s"]:
        """Of each row's velocity."""
        return self._once("sign", lambda each: np.sign(each.samples.velocity))

    @property
    def way(self) -> Int[np.ndarray, "r s"]:
        """Which of the directions that have factors of their own each row goes."""
        if self.structure.directional:
            return self._once("way", lambda each: (each.samples.velocity < 0) * 1)
        return self._once("one_way", lambda each: np.zeros(len(each.target), np.int64))

    @cached_property
    def place(self) -> Int[np.ndarray, "r s"]:
        """The first of the two neighbouring factors of friction that each row meets."""
        cell = self._once(self._alike("cell"), lambda each: each.pairs()[0])
        return np.asarray(cell + len(self.structure.factors) * self.way)

    @cached_property
    def pair(self) -> Float[np.ndarray, "r s 2"]:
        """Their columns, with the sign of each row's velocity."""
        return self._once(self._alike("pair"), lambda each: each.signed_pair)

    def _alike(self, name: str) -> tuple[object, ...]:
        """Return the name of what a law per direction has in common with one for both."""
        return name, *(each.structure.alike for each in self.problems)

    def profiles(
        self, shapes: Float[np.ndarray, "w h"], of: Int[np.ndarray, " w"] | None
    ) -> tuple[Float[np.ndarray, "w s"], Float[np.ndarray, "h w s"]]:
        """Return the column that follows the shape, signed, and its derivatives.

        Whatever the direction; rows at rest and those that fill up have none.

        Args:
            shapes: Logarithms, fit by fit.
            of: Recording of each fit; one of each where left out.
        """
        of = np.arange(len(shapes)) if of is None else of
        speed = self._once("speed", lambda each: each.speed_of(False))
        values, slopes = self.structure.shaped_profiles(speed, of, shapes)
        sign = self.sign[of]
        return np.multiply(values, sign, out=values), np.multiply(
            slopes, sign, out=slopes
        )

    @cached_property
    def right(self) -> Float[np.ndarray, "r s k1"]:
        """The linear columns that follow no shape, and last the target.

        Rows that may not be used have none, so that they enter no sum.
        """
        width = self.one.still_width
        found = np.zeros((len(self.problems), self.rows, width + 1))
        for into, each in zip(found, self.problems, strict=True):
            each.put_still(into[: len(each.target), :width])
        found[:, :, width] = self.target
        if not self.usable.all():
            found[~self.usable] = 0.0
        return found

    @property
    def still(self) -> Float[np.ndarray, "r s k"]:
        """See `Problem`."""
        return self.right[:, :, :-1]

    @cached_property
    def still_instrument(self) -> Float[np.ndarray, "r s k"]:
        """See `Problem`."""
        return self._filled([each.still_instrument for each in self.problems])

    @cached_property
    def size(self) -> Float[np.ndarray, "r k"]:
        """RMS of each of these columns."""
        square = np.einsum("rsk,rsk->rk", self.still, self.still)
        return np.asarray(np.sqrt(square / self.lengths[:, None]))

    @cached_property
    def lengths(self) -> Int[np.ndarray, " r"]:
        """Rows of each recording, those that fill it up left out."""
        return np.array([len(each.target) for each in self.problems])

    @cached_property
    def bounds(self) -> tuple[Float[np.ndarray, "r h"], Float[np.ndarray, "r h"]]:
        """Least and largest logarithms of the shape."""
        pairs = [each.bounds for each in self.problems]
        return np.stack([low for low, _ in pairs]), np.stack(
            [high for _, high in pairs]
        )

    @cached_property
    def starts(self) -> Float[np.ndarray, "r m h"]:
        """Logarithms to start from, filled up with the last ones."""
        every = [list(each.structure.starts(each.speed)) for each in self.problems]
        many = max(map(len, every))
        return np.stack([np.stack(one + one[-1:] * (many - len(one))) for one in every])

    def shaped(
        self,
        shapes: Float[np.ndarray, "w h"],
        of: Int[np.ndarray, " w"],
        *,
        instrument: bool = False,
    ) -> tuple[Float[np.ndarray, "d w s"], Float[np.ndarray, "h d w s"]]:
        """Return the columns that follow the shape, per direction, and their derivatives.

        Args:
            shapes: Logarithms, fit by fit.
            of: Recording of each fit, ascending.
            instrument: Of the noise-free motion.
        """
        if self.one.filtered:
            return self._shaped_alone(shapes, of, instrument)
        speed, sign = self._moves(of, instrument)
        values, slopes = self.structure.shaped_profiles(speed, of, shapes)
        return sign * values, sign * slopes[:, None]

    def shaped_values(
        self, shapes: Float[np.ndarray, "w h"], of: Int[np.ndarray, " w"], step: int = 1
    ) -> Float[np.ndarray, "d w s"]:
        """Return what `shaped` does without the derivatives, of every so-manieth row."""
        if self.one.filtered:
            return self._shaped_alone(shapes, of, False)[0][..., ::step]
        speed, sign = self._moves(of, False, step)
        return np.asarray(sign * self.structure.shaped_values(speed, of, shapes))

    def _moves(
        self, of: np.ndarray, instrument: bool, step: int = 1
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return speeds of the recordings, and signs per direction fit by fit."""
        end = "_instrument" if instrument else ""
        speed = self._once("speed" + end, lambda each: each.speed_of(instrument))
        way = f"{self.structure.directional}{end}"
        signs = self._once("signs" + way, lambda each: each.signs_of(instrument).T)
        sign = np.ascontiguousarray(np.moveaxis(signs[:, ::step], 2, 0))[:, of]
        return np.ascontiguousarray(speed[:, ::step]), sign

    def _shaped_alone(
        self, shapes: np.ndarray, of: np.ndarray, instrument: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        found = []
        for k, problem in enumerate(self.problems):
            own = shapes[of == k]
            if len(own):
                found.append(problem.shaped(own, instrument=instrument))

        def joined(place: int) -> np.ndarray:
            parts = [each[place] for each in found]
            widths = [(0, 0)] * (parts[0].ndim - 1)
            return np.concatenate(
                [np.pad(p, [*widths, (0, self.rows - p.shape[-1])]) for p in parts], -2
            )

        return joined(0), joined(1)

    @cached_property
    def penalty(self) -> Float[np.ndarray, "r k k"] | None:
        """The smoothness prior over all linear factors."""
        every = [each.penalty() for each in self.problems]
        found = [each for each in every if each is not None]
        return np.stack(found) if found else None

    @cached_property
    def floor(self) -> Float[np.ndarray, " r"]:
        """Root mean square of each load."""
        loads = [float(np.sqrt(np.mean(each.load**2))) for each in self.problems]
        return np.array(loads)


_TOGETHER = 32
"""Recordings that go side by side: more would leave the caches of a processor."""


def alike(
    asked: Sequence[tuple[Problem, Sequence[AbstractStructure], str]],
) -> list[list[int]]:
    """Return which recordings can stand side by side, by number.

    Shorter ones are filled up: they must not be much shorter.

    Args:
        asked: Recordings with their laws and the name of the loss.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    for place, (problem, kinds, loss) in enumerate(asked):
        key = (
            loss,
            len(problem.target).bit_length(),
            problem.lowpass.factor,
            problem.sigma is None,
            problem.has_instrument,
            problem.known.offset is None,
            problem.fixed_names,
            tuple(each.kind for each in kinds),
        )
        groups.setdefault(key, []).append(place)
    return [
        places[start : start + _TOGETHER]
        for places in groups.values()
        for start in range(0, len(places), _TOGETHER)
    ]


def stack_of(problems: Sequence[Problem]) -> Stack:
    """Return recordings side by side; they must have the same kinds of columns."""
    return Stack(tuple(problems), {})


def alone(problem: Problem) -> Stack:
    """Return one recording by itself."""
    return stack_of([problem])
