"""One huge log instead of many small jobs: its sums spread over workers just as well."""

import contextlib
import dataclasses
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...data.measurements import LogPart, log_parts
from ..fit import Samples, TableFit, TableLayout, fit_streamed
from ._cluster import workers_of

_PARTS = 32
"""Parts of a log: enough to share out evenly, few enough to send their sums about."""
_ROWS = 1 << 19
"""Rows of a piece."""
_PIECES = 2
"""Pieces read ahead."""


_Columns = list[Float[np.ndarray, " t"]]
_Pieces = queue.Queue[_Columns | BaseException | None]


@dataclasses.dataclass(frozen=True)
class _Readings:
    """Part of a log as readings of a fit, piece by piece."""

    part: LogPart
    factor: float

    def __call__(self) -> Iterator[Samples]:
        return map(self.samples, self.columns())

    def columns(self) -> Iterator[_Columns]:
        """Yield the columns of each piece as they come from the file."""
        return self.part.columns_of(_ROWS)

    def samples(self, columns: _Columns) -> Samples:
        """Return the readings of a piece."""
        *positions, error = columns
        return Samples(
            np.stack(positions, axis=1),
            error if self.factor == 1.0 else self.factor * error,
        )


class _Ahead:
    """Readings that a thread of its own reads while those before them are summed up."""

    def __init__(self, readings: _Readings) -> None:
        self._readings = readings
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
                yield self._readings.samples(piece)
        finally:
            over.set()

    def _read(self, pieces: _Pieces, over: threading.Event) -> None:
        last: BaseException | None = None
        try:
            for piece in self._readings.columns():
                if not _put(pieces, piece, over):
                    return
        except BaseException as error:
            last = error
        _put(pieces, last, over)


def _put(
    pieces: _Pieces, piece: _Columns | BaseException | None, over: threading.Event
) -> bool:
    """Hand a piece over; return whether anybody still waits for it."""
    while not over.is_set():
        with contextlib.suppress(queue.Full):
            pieces.put(piece, timeout=0.1)
            return True
    return False


def fit_log(
    path: Path,
    layout: TableLayout,
    positions: Sequence[str],
    error: str,
    *,
    factor: float = 1.0,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "gauss",
    scheduler: str | None = None,
    workers: int = 1,
) -> TableFit:
    """Fit a table to a Parquet or CSV file of any length, in constant memory.

    The result does not depend on the number of workers.

    Args:
        path: The file; workers must see it under this name.
        layout: Where the nodes lie.
        positions: Columns of the input positions in mm or °, in the order of the layout.
        error: Column of the error.
        factor: mm or ° per unit of that column.
        smoothness: As for `fit_streamed`.
        loss: As for `fit_streamed`.
        scheduler: Address of a dask scheduler, None for this machine.
        workers: Processes of this machine; 1 works in this one.

    Raises:
        MeasurementError: If a column is missing or a cell holds no finite number.
        FitError: If the readings do not determine the table.
    """
    parts = [
        _Readings(part, factor) for part in log_parts(path, (*positions, error), _PARTS)
    ]
    local = scheduler is None and workers <= 1
    with contextlib.ExitStack() as stack:
        client: Any = None
        if not local:
            client = stack.enter_context(workers_of(scheduler, workers))

        def apply(call: Callable[[Any], Any], items: Sequence[Any]) -> Iterable[Any]:
            if client is None:
                return _in_turn(call, items)
            found: list[Any] = client.gather(client.map(call, list(items), pure=False))
            return found

        own = [_Ahead(part) for part in parts] if local else parts
        return fit_streamed(layout, own, smoothness=smoothness, loss=loss, apply=apply)


def _in_turn(call: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
    """Return what a call makes of each item; the next one is read meanwhile."""
    try:
        for item, following in zip(items, [*items[1:], None], strict=True):
            if isinstance(following, _Ahead):
                following.begin()
            yield call(item)
    finally:
        for item in items:
            if isinstance(item, _Ahead):
                item.end()
