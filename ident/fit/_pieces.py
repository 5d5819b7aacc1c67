"""Passes over readings in pieces, of which a thread reads those that come next."""

import abc
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

from ..core import FitError
from ._types import Samples

Part = Callable[[], Iterable[Samples]]
"""Yields the same readings, piece by piece, every time it is called."""
Apply = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
"""Like `map`: here one after the other, or on workers."""

_Result = TypeVar("_Result")


@dataclasses.dataclass(frozen=True)
class Place:
    """Where a piece lies: its part, and how many readings of the part come before it."""

    part: int
    row: int


class AbstractPass(abc.ABC):
    """What is asked of one pass over readings; what parts give adds up with ``+``."""

    @abc.abstractmethod
    def onto(self, done: Any, samples: Samples, place: Place) -> Any:
        """Return what a piece gives, added to what those before it gave (None)."""


@dataclasses.dataclass
class Stream:
    """Readings in pieces.

    Attributes:
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        apply: How to run a function over the parts.
        passes: How often the readings were read.
    """

    parts: Sequence[Part]
    apply: Apply = map
    passes: int = 0

    def ask(self, wanted: AbstractPass) -> Any:
        """Return what one pass gives.

        Raises:
            FitError: If there are no readings.
        """
        self.passes += 1
        total: Any = None
        for found in self.apply(
            partial(_over_part, wanted), list(enumerate(self.parts))
        ):
            total = found if total is None else added(total, found)
        if total is None:
            msg = "found no readings, expected at least one per node."
            raise FitError(msg)
        return total


def _over_part(wanted: AbstractPass, job: tuple[int, Part]) -> Any:
    number, part = job
    total, row = None, 0
    for samples in part():
        if len(samples.error):
            total = wanted.onto(total, samples, Place(number, row))
            row += len(samples.error)
    return total


def added(total: _Result | None, more: _Result | None) -> _Result:
    """Return a sum that may not have begun."""
    if total is None or more is None:
        found = more if total is None else total
        assert found is not None
        return found
    both: Any = total
    result: _Result = both + more
    return result


@dataclasses.dataclass(frozen=True)
class Ahead:
    """Readings of a part, of which a thread reads the next piece; a `Part`.

    Attributes:
        read: Reads the pieces one after the other, in the thread.
        make: Makes readings of a piece. Not in the thread: when it ends it leaves what it
            took of memory behind.
    """

    read: Callable[[], Iterable[Any]]
    make: Callable[[Any], Samples]

    def __call__(self) -> Iterator[Samples]:
        pieces = iter(self.read())
        with ThreadPoolExecutor(1) as thread:
            later = thread.submit(next, pieces, None)
            while (piece := later.result()) is not None:
                later = thread.submit(next, pieces, None)
                yield self.make(piece)
