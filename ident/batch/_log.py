"""One huge log instead of many small jobs: its sums spread over workers just as well."""

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...data.measurements import (
    MeasurementError,
    Table,
    TablePart,
    open_large,
)
from ..fit import (
    Apply,
    Samples,
    TableEffect,
    TableFit,
    fit_streamed,
)
from ._workers import workers_of

_PARTS = 32
"""Parts of a log: enough to share out evenly, few enough to send their sums about."""
_ROWS = 1 << 18
"""Rows of a piece."""
_APIECE = 4
"""Parts for each thread at least: else one of them ends long after the others."""


def fit_log(
    path: str | Path,
    layout: TableEffect,
    positions: Sequence[str],
    error: str,
    *,
    factor: float = 1.0,
    smoothness: float | str = "auto",
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
    log = open_large(Path(path), 0)
    if log is None:
        reason = "found no table that can be read in pieces, expected CSV or Parquet"
        raise MeasurementError(str(path), reason)
    headers = tuple(log.head.column(name).header for name in (*positions, error))
    read = partial(_samples, headers, factor)
    parts = [partial(_pieces, each, read) for each in log.parts(headers, _PARTS, _ROWS)]
    with contextlib.ExitStack() as stack:
        apply: Apply = map
        threads = min(os.cpu_count() or 1, len(parts) // _APIECE)
        if scheduler is not None or workers > 1:
            apply = partial(
                _on_workers, stack.enter_context(workers_of(scheduler, workers))
            )
        elif threads > 1:
            # Neither reading nor summing holds the interpreter.
            apply = stack.enter_context(ThreadPoolExecutor(threads)).map
        return fit_streamed(
            layout, parts, smoothness=smoothness, loss=loss, apply=apply
        ).fit


def _samples(headers: Sequence[str], factor: float, table: Table) -> Samples:
    """Return the readings of a piece: the last column is the error.

    Raises:
        CellError: If a cell holds no finite number.
    """
    *positions, error = (table.numbers(table.column(name)) for name in headers)
    return Samples(
        # Column after column: that is how they come, and how they are looked at.
        np.array(positions).T,
        error if factor == 1.0 else factor * error,
    )


def _pieces(part: TablePart, read: Callable[[Table], Samples]) -> Iterator[Samples]:
    return map(read, part.tables())


def _on_workers(
    client: Any, call: Callable[[Any], Any], items: Sequence[Any]
) -> Iterable[Any]:
    values: list[Any] = client.gather(client.map(call, list(items), pure=False))
    return values
