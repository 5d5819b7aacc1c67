"""Jobs per second of a batch, and rows per second of a streamed log.

The peer is a plain SciPy script for the same work: read the CSV, penalised least squares per
direction with the weight by generalised cross-validation, leave each run out, write a list.
"""

import importlib.util
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.optimize import minimize_scalar

from axcomp.data.measurements import log_parts
from axcomp.ident.batch import fit_log
from axcomp.ident.batch._work import Order, Task, run_chunk
from axcomp.ident.fit import TableLayout

_HOME = Path(__file__).parents[1]
_SPEC = importlib.util.spec_from_file_location(
    "fleet", _HOME / "tests" / "ident" / "batch" / "conftest.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
_FLEET = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_FLEET)


NODES = np.linspace(-20.0, 20.0, 9)
BEND = np.diff(np.eye(9), 2, axis=0)


def smooth(
    stencil: np.ndarray, error: np.ndarray, log: float
) -> tuple[float, np.ndarray]:
    """Return the cross-validation score and the table for one weight."""
    normal = stencil.T @ stencil
    matrix = normal + np.exp(log) * BEND.T @ BEND
    values = np.linalg.solve(matrix, stencil.T @ error)
    left = error - stencil @ values
    used = float(np.trace(np.linalg.solve(matrix, normal)))
    return float(left @ left) / (len(left) - used) ** 2, values


def scipy_fit(x: np.ndarray, error: np.ndarray) -> np.ndarray:
    stencil = np.maximum(1 - np.abs(x[:, None] - NODES) / 5.0, 0.0)
    best = minimize_scalar(
        lambda log: smooth(stencil, error, log)[0], bounds=(-12, 12), method="bounded"
    )
    return smooth(stencil, error, float(best.x))[1]


def scipy_job(csv: Path, out: Path) -> None:
    """Do what a careful script does: fit, cross-validate, hold out runs, write."""
    x, error, sense, run = np.loadtxt(csv, delimiter=",", skiprows=1).T
    lines = []
    for side, name in ((1, "pos"), (-1, "neg")):
        own = sense == side
        table = scipy_fit(x[own], error[own])
        for label in np.unique(run):
            rest = own & (run != label)
            scipy_fit(x[rest], error[rest])
        entries = np.rint(10.0 * table).astype(int)
        lines += [f"kw.ssfk.table[{k}].{name} {e}\n" for k, e in enumerate(entries)]
    out.mkdir(parents=True)
    (out / "achskw1.lis").write_text("".join(lines))


def mean_of(benchmark: BenchmarkFixture) -> float:
    assert benchmark.stats is not None
    return float(benchmark.stats["mean"])


def test_leadscrew_jobs(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    names = _FLEET.fleet(tmp_path / "jobs", 256)
    tasks = [Task(name, str(tmp_path / "jobs" / f"{name}.toml"), "") for name in names]
    rounds = iter(range(100))

    def run() -> None:
        order = Order(str(tmp_path / f"out{next(rounds)}"), "bench")
        for k in range(0, len(tasks), 64):
            run_chunk(tasks[k : k + 64], order)

    run()  # compile outside the clock
    start = time.process_time()
    benchmark.pedantic(run, rounds=3, iterations=1)
    cpu = (time.process_time() - start) / 3 / len(tasks)
    benchmark.extra_info |= {
        "jobs_per_core_second": len(tasks) / mean_of(benchmark),
        "cpu_ms_per_job": 1e3 * cpu,
    }


def test_leadscrew_jobs_by_scipy(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    names = _FLEET.fleet(tmp_path / "jobs", 64)
    rounds = iter(range(100))

    def run() -> None:
        out = tmp_path / f"out{next(rounds)}"
        for name in names:
            scipy_job(tmp_path / "jobs" / f"{name}.csv", out / name)

    benchmark.pedantic(run, rounds=3, iterations=1, warmup_rounds=1)
    rate = len(names) / mean_of(benchmark)
    benchmark.extra_info |= {"jobs_per_core_second": rate}


@pytest.mark.parametrize("jobs", [100, 1_000])
def test_batch_from_the_command_line(
    benchmark: BenchmarkFixture, tmp_path: Path, jobs: int
) -> None:
    _FLEET.fleet(tmp_path / "jobs", jobs)
    command = [
        sys.executable,
        "-m",
        "axcomp",
        "batch",
        str(tmp_path / "jobs" / "*.toml"),
    ]
    command += ["--workers", "2", "--out", str(tmp_path / "out")]
    call = {"check": True, "capture_output": True}
    benchmark.pedantic(subprocess.run, args=(command,), kwargs=call, rounds=1)
    benchmark.extra_info |= {"jobs_per_second": jobs / mean_of(benchmark)}


@pytest.mark.parametrize("rows", [4_000_000, 16_000_000])
def test_streamed_plane(benchmark: BenchmarkFixture, tmp_path: Path, rows: int) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "log.parquet"
    schema = pa.schema(dict.fromkeys("xye", pa.float64()))
    with pq.ParquetWriter(path, schema) as file:
        for _ in range(rows // 1_000_000):
            x, y = rng.uniform(0.0, 1000.0, (2, 1_000_000))
            error = 0.02 * np.sin(x / 200.0) * np.cos(y / 150.0)
            error += rng.normal(0.0, 0.002, len(x))
            file.write_table(pa.table({"x": x, "y": y, "e": error}))
    nodes = np.linspace(0.0, 1000.0, 101)
    layout = TableLayout((nodes, nodes))
    fit_log(path, layout, ("x", "y"), "e")  # compile outside the clock
    start = time.perf_counter()
    read = sum(
        len(piece) for part in log_parts(path, "xye", 8) for piece in part.pieces()
    )
    reading = time.perf_counter() - start
    assert read == rows
    benchmark.pedantic(fit_log, args=(path, layout, ("x", "y"), "e"), rounds=2)
    mean = mean_of(benchmark)
    benchmark.extra_info |= {
        "rows_per_second": rows / mean,
        "of_reading": reading / mean,
    }
