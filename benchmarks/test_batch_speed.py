"""Jobs per second of a batch, and rows per second of a streamed log.

The peer is a plain SciPy script for the same work: read the CSV, penalised least squares per
direction with the weight by generalised cross-validation, leave each run out, write a list.
"""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.optimize import least_squares, minimize_scalar
from scipy.signal import savgol_filter
from threadpoolctl import threadpool_limits

from tests.ident.batch import conftest as fleets

ONE_THREAD = os.environ | {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}
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
    best: Any = minimize_scalar(
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


def scipy_friction_job(csv: Path, out: Path) -> None:
    """Do what a careful script does: fit kinds of law, each held out by windows, write.

    Coulomb + viscous and Stribeck, for both directions alike and apart, and hat tables of five
    sizes likewise: what a friction job compares. Least squares with `least_squares` where a
    speed is to be found, else `lstsq`; no loss but the square, no smoothness, no deviations.
    """
    time, x, current = np.loadtxt(csv, delimiter=",", skiprows=1).T
    step = time[1] - time[0]
    velocity = np.asarray(savgol_filter(x, 11, 3, deriv=1, delta=step))
    acceleration = np.asarray(savgol_filter(x, 11, 3, deriv=2, delta=step))
    fast = np.abs(velocity) > 1e-3 * np.abs(velocity).max()
    v, a, i = velocity[fast], acceleration[fast], current[fast]
    speed, sense = np.abs(v), np.sign(v)
    window = np.arange(len(v)) * 10 // len(v)

    def design(way: bool, columns: np.ndarray) -> np.ndarray:
        sides = [sense > 0, sense < 0] if way else [sense != 0]
        parts = [np.where(side, sense, 0.0)[:, None] * columns for side in sides]
        rest = [a[:, None]] if way else [a[:, None], np.ones((len(v), 1))]
        return np.concatenate([*rest, *parts], axis=1)

    def solve(matrix: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.linalg.lstsq(matrix[rows], i[rows], rcond=None)[0]

    def stribeck(way: bool, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        def columns(place: float) -> np.ndarray:
            drop = np.exp(-np.square(speed / np.exp(place)))
            return design(way, np.stack([np.ones_like(v), speed, drop], axis=1))

        def left(p: np.ndarray) -> np.ndarray:
            matrix = columns(p[0])
            return np.asarray((i - matrix @ solve(matrix, rows))[rows])

        found = [least_squares(left, [np.log(start)]) for start in (2.0, 10.0, 50.0)]
        matrix = columns(float(min(found, key=lambda each: each.cost).x[0]))
        return matrix, solve(matrix, rows)

    everything = np.ones(len(v), bool)
    errors, laws = [], []
    for way in (False, True):
        linear = [np.stack([np.ones_like(v), speed], axis=1)]
        for count in (3, 5, 8, 12, 20):
            knots = np.quantile(speed, np.linspace(0, 1, count))
            hats = [np.interp(speed, knots, hat) for hat in np.eye(count)]
            linear.append(np.stack(hats, axis=1))
        for columns in linear:
            matrix = design(way, columns)
            square = 0.0
            for k in range(10):
                factors = solve(matrix, window != k)
                square += np.sum((i - matrix @ factors)[window == k] ** 2)
            errors.append(square)
            laws.append(matrix @ solve(matrix, everything))
        square = 0.0
        for k in range(10):
            matrix, factors = stribeck(way, window != k)
            square += np.sum((i - matrix @ factors)[window == k] ** 2)
        errors.append(square)
        matrix, factors = stribeck(way, everything)
        laws.append(matrix @ factors)
    best = np.abs(laws[int(np.argmin(errors))])
    order = np.argsort(speed)
    at = np.geomspace(speed.min(), speed.max(), 20)
    heights = np.interp(at, speed[order], best[order])
    out.mkdir(parents=True)
    lines = [
        f"frict_comp.table[{k}].in {1000 * p:.0f}\nfrict_comp.table[{k}].out {h / 0.012:.0f}\n"
        for k, (p, h) in enumerate(zip(at, heights, strict=True))
    ]
    (out / "achskw1.lis").write_text("".join(lines))


def mean_of(benchmark: BenchmarkFixture) -> float:
    assert benchmark.stats is not None
    return float(benchmark.stats["mean"])


_WORKER = """
import hashlib, json, pathlib, sys, time
from axcomp.ident.batch import Task
from axcomp.ident.batch._work import Order, run_chunk

jobs, out, size = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
paths = sorted(jobs.glob("*.toml"))
tasks = [
    Task(p.stem, p, hashlib.sha256(p.read_bytes()).hexdigest()) for p in paths
]
found = []
for again in range(4):
    order = Order(f"{out}{again}", "bench")
    cpu, wall = time.process_time(), time.perf_counter()
    for k in range(0, len(tasks), size):
        done = run_chunk(tasks[k : k + size], order)
        assert all(one.rows[0]["state"] == "done" for one in done)
    found.append((time.process_time() - cpu, time.perf_counter() - wall))
print(json.dumps([min(each) / len(tasks) for each in zip(*found[1:])]))
"""
"""What a worker of a batch does: a process of its own, since the import hook of the tests,
which looks at every array, would take several times as long as the work."""


def as_worker(jobs: Path, out: Path, size: int) -> dict[str, float]:
    """Return processor and wall time per job of one worker, compiled and warm."""
    command = [sys.executable, "-c", _WORKER, str(jobs), str(out), str(size)]
    text = subprocess.run(command, check=True, capture_output=True, env=ONE_THREAD)
    cpu, wall = json.loads(text.stdout)
    return {"cpu_ms_per_job": 1e3 * cpu, "jobs_per_second": 1.0 / wall}


def test_leadscrew_jobs(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    fleets.fleet(tmp_path / "jobs", 256)
    arguments = (tmp_path / "jobs", tmp_path / "out", 64)
    found = benchmark.pedantic(as_worker, args=arguments, rounds=1)
    benchmark.extra_info |= found


def test_friction_jobs(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    fleets.friction_fleet(tmp_path / "jobs", 64)
    arguments = (tmp_path / "jobs", tmp_path / "out", 64)
    found = benchmark.pedantic(as_worker, args=arguments, rounds=1)
    benchmark.extra_info |= found


def test_leadscrew_jobs_by_scipy(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    names = fleets.fleet(tmp_path / "jobs", 64)
    rounds = iter(range(100))

    def run() -> None:
        out = tmp_path / f"out{next(rounds)}"
        for name in names:
            scipy_job(tmp_path / "jobs" / f"{name}.csv", out / name)

    benchmark.pedantic(run, rounds=3, iterations=1, warmup_rounds=1)
    rate = len(names) / mean_of(benchmark)
    benchmark.extra_info |= {"jobs_per_core_second": rate}


def test_friction_jobs_by_scipy(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    names = fleets.friction_fleet(tmp_path / "jobs", 8)
    rounds = iter(range(100))

    def run() -> None:
        out = tmp_path / f"out{next(rounds)}"
        for name in names:
            scipy_friction_job(tmp_path / "jobs" / f"{name}.csv", out / name)

    # Rates per core: threads of BLAS would fight for the other one.
    with threadpool_limits(1, "blas"):
        benchmark.pedantic(run, rounds=2, iterations=1, warmup_rounds=1)
    rate = len(names) / mean_of(benchmark)
    benchmark.extra_info |= {"jobs_per_core_second": rate}


@pytest.mark.parametrize("jobs", [100, 1_000, 10_000])
def test_batch_from_the_command_line(
    benchmark: BenchmarkFixture, tmp_path: Path, jobs: int
) -> None:
    fleets.fleet(tmp_path / "jobs", jobs)
    from_the_command_line(benchmark, tmp_path, jobs)


@pytest.mark.parametrize("jobs", [100, 1_000, 10_000])
def test_friction_from_the_command_line(
    benchmark: BenchmarkFixture, tmp_path: Path, jobs: int
) -> None:
    fleets.friction_fleet(tmp_path / "jobs", jobs)
    from_the_command_line(benchmark, tmp_path, jobs)


def from_the_command_line(
    benchmark: BenchmarkFixture, tmp_path: Path, jobs: int
) -> None:
    """Run a batch as a user does, two workers, and note the rate."""
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


_STREAM = """
import json, pathlib, resource, sys, time
import numpy as np
import pyarrow.parquet as pq
from axcomp.data.measurements import open_large
from axcomp.ident.batch import fit_log
from axcomp.ident.fit import TableEffect

nodes = np.linspace(0.0, 1000.0, 101)
layout = TableEffect((nodes, nodes))
small, path = map(pathlib.Path, sys.argv[1:])
fit_log(small, layout, ("x", "y"), "e")  # compile outside the clock
start = time.perf_counter()
for part in open_large(path).parts("xye", 8, 1 << 18):
    for table in part.tables():
        pass
read = time.perf_counter()
fit_log(path, layout, ("x", "y"), "e")
end = time.perf_counter()
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
# Last, as by default it keeps the bytes of all that it has read.
began = time.perf_counter()
for batch in pq.ParquetFile(path).iter_batches(columns=["x", "y", "e"]):
    for column in batch.columns:
        column.to_numpy()
plainly = time.perf_counter() - began
print(json.dumps([plainly, read - start, end - read, peak]))
"""


def streamed(small: Path, path: Path) -> tuple[float, float, float, float]:
    """Return seconds to read by pyarrow alone and by ours, to fit, and the most MB."""
    command = [sys.executable, "-c", _STREAM, str(small), str(path)]
    text = subprocess.run(command, check=True, capture_output=True)
    plainly, reading, fitting, peak = json.loads(text.stdout)
    return plainly, reading, fitting, peak


def write_log(path: Path, rows: int) -> None:
    """Write a plane's readings in pieces of a million."""
    rng = np.random.default_rng(0)
    schema = pa.schema(dict.fromkeys("xye", pa.float64()))
    with pq.ParquetWriter(path, schema) as file:
        for _ in range(rows // 1_000_000):
            x, y = rng.uniform(0.0, 1000.0, (2, 1_000_000))
            error = 0.02 * np.sin(x / 200.0) * np.cos(y / 150.0)
            error += rng.normal(0.0, 0.002, len(x))
            file.write_table(pa.table({"x": x, "y": y, "e": error}))


@pytest.mark.parametrize("loss", ["gauss", "student"])
def test_streamed_job(benchmark: BenchmarkFixture, tmp_path: Path, loss: str) -> None:
    write_log(tmp_path / "log.parquet", 10_000_000)
    job = tmp_path / "job.toml"
    fleets.plane_job(
        job, "log.parquet", 101, 10.0, read="stream = true", fit=f'loss = "{loss}"'
    )
    command = [sys.executable, "-m", "axcomp", "fit", str(job)]
    command += ["--out", str(tmp_path / "out")]
    call = {"check": True, "capture_output": True}
    benchmark.pedantic(subprocess.run, args=(command,), kwargs=call, rounds=1)
    (tmp_path / "log.parquet").unlink()
    # Of all that was started from here, this command has by far the most.
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    benchmark.extra_info |= {"peak_MB": peak}


@pytest.mark.parametrize("rows", [25_000_000, 100_000_000])
def test_streamed_plane(benchmark: BenchmarkFixture, tmp_path: Path, rows: int) -> None:
    write_log(tmp_path / "small.parquet", 1_000_000)
    write_log(tmp_path / "log.parquet", rows)
    plainly, reading, fitting, peak = benchmark.pedantic(
        streamed, args=(tmp_path / "small.parquet", tmp_path / "log.parquet"), rounds=1
    )
    (tmp_path / "log.parquet").unlink()  # gigabytes, which pytest would keep
    benchmark.extra_info |= {
        "rows_per_second": rows / fitting,
        "of_reading": reading / fitting,
        "of_reading_by_pyarrow": plainly / fitting,
        "peak_MB": peak,
    }
