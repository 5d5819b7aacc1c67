"""Passes over readings that come in pieces: what is asked of each, added up in order.

A fit over a stream is straight code that asks for a pass and goes on with its result
(`Asking`). Several such fits go side by side: one reading of the file serves all of them,
each with the group of readings left out that it must not see.
"""

import abc
import dataclasses
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Int

from ..core._errors import FitError
from ._grid import Grid
from ._types import Samples

Part = Callable[[], Iterable[Samples]]
"""Yields the same readings, piece by piece, every time it is called."""
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Like `map`: here one after the other, or on workers."""
Grouping = Callable[[Samples], Int[np.ndarray, " t"]]
"""Tells the group of each reading: what is left out together."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a piece lies: its part, and how many readings of the part come before it."""

    part: int
    row: int


class AbstractPass(abc.ABC):
    """What is asked of one pass; what parts give adds up with ``+``."""

    @abc.abstractmethod
    def onto(self, done: Any, grid: Grid, samples: Samples, place: Place) -> Any:
        """Return what a piece gives, added to what those before it gave (None)."""


_Result = TypeVar("_Result")

Asking = Generator[AbstractPass, Any, _Result]
"""Code that asks for passes: `ask` from within, `answer` from without."""


@dataclasses.dataclass
class Stream:
    """Readings in pieces.

    Attributes:
        grid: Nodes.
        parts: Readings; each part may be summed on another machine. Sums are added in
            this order, so that the result does not depend on who did which.
        apply: How to run a function over the parts.
        grouping: Groups of readings, None where nothing is left out.
        passes: How often the readings were read.
    """

    grid: Grid
    parts: Sequence[Part]
    apply: Apply = map
    grouping: Grouping | None = None
    passes: int = 0

    def ask(self, wanted: AbstractPass) -> Any:
        """Return what one pass gives.

        Raises:
            FitError: If there are no readings.
        """
        return self._pass({None: wanted})[0]

    def answer(
        self, asking: Mapping[int | None, Asking[_Result]]
    ) -> dict[int | None, _Result]:
        """Run fits side by side, by the group that each leaves out; return their results."""
        found: dict[int | None, _Result] = {}
        wanted: dict[int | None, AbstractPass] = {}

        def go_on(key: int | None, answer: Any) -> None:
            try:
                wanted[key] = asking[key].send(answer)
            except StopIteration as end:
                found[key] = end.value

        for key in asking:
            go_on(key, None)
        while wanted:
            now = dict(wanted)
            wanted.clear()
            for key, answer in zip(now, self._pass(now), strict=True):
                go_on(key, answer)
        return {key: found[key] for key in asking}

    def _pass(self, wanted: Mapping[int | None, AbstractPass]) -> list[Any]:
        self.passes += 1
        call = partial(_over_part, self.grid, self.grouping, tuple(wanted.items()))
        jobs = list(enumerate(self.parts))
        totals: list[Any] = [None] * len(wanted)
        for found in self.apply(call, jobs):
            totals = [
                total if own is None else added(total, own)
                for total, own in zip(totals, found, strict=True)
            ]
        if any(total is None for total in totals):
            msg = "found 0 readings, expected at least one per node."
            raise FitError(msg)
        return totals


def _over_part(
    grid: Grid,
    grouping: Grouping | None,
    wanted: Sequence[tuple[int | None, AbstractPass]],
    job: tuple[int, Part],
) -> list[Any]:
    number, part = job
    totals: list[Any] = [None] * len(wanted)
    rows = [0] * len(wanted)
    for samples in part():
        if not len(samples.error):
            continue
        some = any(left_out is not None for left_out, _ in wanted)
        groups = grouping(samples) if grouping is not None and some else None
        for k, (left_out, one) in enumerate(wanted):
            own = samples
            if left_out is not None:
                assert groups is not None  # without groups nothing can be left out
                own = samples.take(groups != left_out)
            if not len(own.error):
                continue
            totals[k] = one.onto(totals[k], grid, own, Place(number, rows[k]))
            rows[k] += len(own.error)
    return totals


def added(total: _Result | None, more: _Result) -> _Result:
    """Return a sum that may not have begun."""
    if total is None:
        return more
    before: Any = total
    result: _Result = before + more
    return result
