"""One huge log instead of many small jobs: its sums spread over workers just as well."""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...data.measurements import LogPart, log_parts
from ..fit import Ahead, Samples, TableFit, TableLayout, fit_streamed, in_turn
from ._cluster import workers_of

_PARTS = 32
"""Parts of a log: enough to share out evenly, few enough to send their sums about."""
_ROWS = 1 << 19
"""Rows of a piece."""

_Columns = list[Float[np.ndarray, " t"]]


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
                return in_turn(call, items)
            found: list[Any] = client.gather(client.map(call, list(items), pure=False))
            return found

        own = [Ahead(part.columns, part.samples) for part in parts] if local else parts
        return fit_streamed(layout, own, smoothness=smoothness, loss=loss, apply=apply)
