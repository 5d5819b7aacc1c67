"""Long text tables beside pyarrow alone: what recognising and checking them costs."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.csv as pv
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.data.measurements import read_table

ROWS = 10_000_000
_PIECE = 100_000


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of time, position and current, 270 MB."""
    path = tmp_path_factory.mktemp("long") / "log.csv"
    current = np.random.default_rng(0).normal(size=_PIECE)
    with path.open("w") as file:
        file.write("time [s],X.position [mm],X.current [A]\n")
        for start in range(0, ROWS, _PIECE):
            clock = 1e-3 * np.arange(start, start + _PIECE)
            place = 100.0 * np.sin(clock / 7.0)
            rows = zip(clock.tolist(), place.tolist(), current.tolist(), strict=True)
            file.write("".join(f"{t:.3f},{x:.6f},{i:.4f}\n" for t, x, i in rows))
    return path


def pyarrow_alone(path: Path) -> list[np.ndarray]:
    return [np.asarray(column) for column in pv.read_csv(path).columns]


@pytest.mark.benchmark(group="table: read 10 million rows")
def test_read_table(benchmark: BenchmarkFixture, log: Path) -> None:
    table = benchmark.pedantic(read_table, (log,), rounds=3, warmup_rounds=1)
    assert table.rows == ROWS
    # In turns, so that a busy machine is busy for both; the best of each counts.
    ours, alone = (
        np.min(spent, axis=0)
        for spent in zip(
            *((_spent(read_table, log), _spent(pyarrow_alone, log)) for _ in range(5)),
            strict=True,
        )
    )
    wall, cpu = (ours / alone).tolist()
    benchmark.extra_info |= {"of_pyarrow": wall, "of_pyarrow_cpu": cpu, "budget": 1.3}


def _spent(read: Callable[[Path], object], path: Path) -> tuple[float, float]:
    """Return the wall time and the processor time of a call, in s."""
    wall, cpu = time.perf_counter(), time.process_time()
    read(path)
    return time.perf_counter() - wall, time.process_time() - cpu


@pytest.mark.benchmark(group="table: read 10 million rows")
def test_read_peer_pyarrow_alone(benchmark: BenchmarkFixture, log: Path) -> None:
    columns = benchmark.pedantic(pyarrow_alone, (log,), rounds=3, warmup_rounds=1)
    assert columns[0].size == ROWS
