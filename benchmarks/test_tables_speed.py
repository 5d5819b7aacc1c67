"""Long text tables beside pyarrow alone: what recognising and checking them costs."""

import time
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
    spent = []
    for read in (read_table, pyarrow_alone):
        began = time.process_time()
        read(log)
        spent.append(time.process_time() - began)
    benchmark.extra_info |= {"of_pyarrow_cpu": spent[0] / spent[1], "budget": 1.3}


@pytest.mark.benchmark(group="table: read 10 million rows")
def test_read_peer_pyarrow_alone(benchmark: BenchmarkFixture, log: Path) -> None:
    columns = benchmark.pedantic(pyarrow_alone, (log,), rounds=3, warmup_rounds=1)
    assert columns[0].size == ROWS
