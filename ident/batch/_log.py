"""One huge log instead of many small jobs: its sums spread over workers just as well."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...data.measurements import LogPart, log_parts
from ..fit import (
    Ahead,
    Apply,
    FitError,
    Part,
    Samples,
    TableFit,
    TableLayout,
    cores,
    fit_streamed,
)
from ._cluster import workers_of

_PARTS = 32
"""Parts of a log: enough to share out evenly, few enough to send their sums about."""
_ROWS = 1 << 18
"""Rows of a piece."""
_APIECE = 4
"""Parts for each thread at least: else one of them ends long after the others."""

_Columns = list[Float[np.ndarray, " t"]]


@dataclasses.dataclass(frozen=True)
class _Readings:
    """Part of a log as readings of a fit, piece by piece.

    Attributes:
        part: Of the log.
        factor: mm or ° per unit of the error.
        threads: Whether columns are read side by side.
    """

    part: LogPart
    factor: float
    threads: bool = False

    def __call__(self) -> Iterator[Samples]:
        return map(self.samples, self.columns())

    def columns(self, checked: bool = False) -> Iterator[_Columns]:
        """Yield the columns of each piece as they come from the file."""
        return self.part.columns_of(_ROWS, threads=self.threads, checked=checked)

    def samples(self, columns: _Columns) -> Samples:
        """Return the readings of a piece."""
        *positions, error = columns
        return Samples(
            # Column after column: that is how they come, and how they are looked at.
            np.array(positions).T,
            error if self.factor == 1.0 else self.factor * error,
        )


def fit_log(
    path: Path,
    layout: TableLayout,
    positions: Sequence[str],
    error: str,
    *,
    factor: float = 1.0,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "student",
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
    with contextlib.ExitStack() as stack:
        own, apply = _shared(parts, scheduler, workers, stack)
        try:
            found = fit_streamed(
                layout, own, smoothness=smoothness, loss=loss, apply=apply
            )
        except FitError:
            _refuse_gaps(parts)
            raise
        return found.fit


def _shared(
    parts: Sequence[_Readings],
    scheduler: str | None,
    workers: int,
    stack: contextlib.ExitStack,
) -> tuple[Sequence[Part], Apply]:
    """Return the parts and what sums them up: on workers, on threads or one by one."""
    if scheduler is not None or workers > 1:
        client: Any = stack.enter_context(workers_of(scheduler, workers))

        def apply(call: Callable[[Any], Any], items: Sequence[Any]) -> Iterable[Any]:
            found: list[Any] = client.gather(client.map(call, list(items), pure=False))
            return found

        return parts, apply
    threads = min(cores(), len(parts) // _APIECE)
    if threads > 1:
        # Neither reading nor summing holds the interpreter.
        return parts, stack.enter_context(ThreadPoolExecutor(threads)).map
    parts = [dataclasses.replace(part, threads=True) for part in parts]
    return [Ahead(part.columns, part.samples) for part in parts], map


def _refuse_gaps(parts: Sequence[_Readings]) -> None:
    """Name the first cell that holds no finite number, after a fit that met one.

    Raises:
        MeasurementError: If there is one.
    """
    for part in parts:
        for _ in part.columns(checked=True):
            pass
