"""How long a person waits for a command, start of Python and imports included."""

import subprocess
import sys
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

_JOB = """\
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
axis = "X"
active = []
remove = "none"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
start = -20.0
interval = 5.0
points = 9
"""


def _run(*arguments: str, folder: Path, cache: Path) -> None:
    # A cache folder of its own: the first round compiles, all later ones find it there.
    subprocess.run(
        [sys.executable, "-m", "axcomp", *arguments],
        cwd=folder, env={"PATH": "", "XDG_CACHE_HOME": str(cache)},
        check=True, capture_output=True,
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A job of 9 targets, 5 runs, both directions, as of a small laser measurement."""
    rows = ["target,error,run,direction"]
    for run in range(1, 6):
        for direction in (1, -1):
            for i in range(9):
                scatter = 1e-3 * ((7 * i + 3 * run + direction) % 5)
                rows.append(f"{5 * i - 20},{0.01 * i + scatter:.4f},{run},{direction}")
    (tmp_path / "laser.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "job.toml").write_text(_JOB)
    return tmp_path


@pytest.mark.parametrize("warm", [False, True], ids=["first", "second"])
def test_fit_of_a_small_table_with_its_report(
    benchmark: BenchmarkFixture, folder: Path, warm: bool
) -> None:
    counter = iter(range(1000))
    cache = folder / "cache"

    def fit() -> None:
        fresh = cache if warm else folder / f"cache{next(counter)}"
        _run("fit", "job.toml", folder=folder, cache=fresh)

    if warm:
        fit()
    benchmark.pedantic(fit, rounds=5 if warm else 2)
    benchmark.extra_info["asked_s"] = 3.0 if warm else 6.0


def test_help_and_check_start_at_once(
    benchmark: BenchmarkFixture, folder: Path
) -> None:
    _run("--help", folder=folder, cache=folder)
    benchmark.pedantic(lambda: _run("--help", folder=folder, cache=folder), rounds=5)
    benchmark.extra_info["asked_s"] = 0.3
