"""Pieces that a thread reads while those before them are summed up."""

import contextlib
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from ._types import Samples

_PIECES = 2
"""Pieces read ahead."""

_Pieces = queue.Queue[Any]


class Ahead:
    """Readings of a part, read ahead; a `Part`."""

    def __init__(
        self, read: Callable[[], Iterable[Any]], make: Callable[[Any], Samples]
    ) -> None:
        """Name what reads pieces, in the thread, and what makes readings of one."""
        self._source, self._make = read, make
        self._pieces: _Pieces | None = None
        self._over = threading.Event()

    def begin(self) -> None:
        """Start to read; no more than a few pieces lie in memory."""
        self._over = threading.Event()
        self._pieces = queue.Queue(_PIECES)
        threading.Thread(
            target=self._read, args=(self._pieces, self._over), daemon=True
        ).start()

    def end(self) -> None:
        """Stop to read what nobody waits for."""
        self._over.set()
        self._pieces = None

    def __call__(self) -> Iterator[Samples]:
        if self._pieces is None:
            self.begin()
        pieces, self._pieces, over = self._pieces, None, self._over
        assert pieces is not None
        try:
            while (piece := pieces.get()) is not None:
                if isinstance(piece, BaseException):
                    raise piece
                # Made here: a thread that ends leaves what it took of memory behind.
                yield self._make(piece)
        finally:
            over.set()

    def _read(self, pieces: _Pieces, over: threading.Event) -> None:
        last: BaseException | None = None
        try:
            for piece in self._source():
                if not _put(pieces, piece, over):
                    return
        except BaseException as error:  # raised where the pieces are waited for
            last = error
        _put(pieces, last, over)


def _put(pieces: _Pieces, piece: Any, over: threading.Event) -> bool:
    """Hand a piece over; return whether anybody still waits for it."""
    while not over.is_set():
        with contextlib.suppress(queue.Full):
            pieces.put(piece, timeout=0.1)
            return True
    return False


def in_turn(call: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[Any]:
    """Return what a call makes of each job of a pass; the next part is read meanwhile.

    An `Apply` for parts that are `Ahead`.
    """
    parts: list[Ahead] = [part for _, part in jobs]
    try:
        for job, following in zip(jobs, [*parts[1:], None], strict=True):
            if following is not None:
                following.begin()
            yield call(job)
    finally:
        for part in parts:
            part.end()
