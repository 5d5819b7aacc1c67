"""A batch among faults, with real processes: what was done is there once, complete."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from axcomp.ident.batch import query_results, read_results
from axcomp.ident.batch._workers import _ONE_THREAD
from axcomp.ident.cli import main

pytestmark = pytest.mark.slow

Fleet = Callable[[Path, int], list[str]]

_PATIENCE = 120.0
"""Seconds to wait for anything; machines that run tests are slow at times."""


def start(*arguments: object, cwd: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "axcomp", "batch", *map(str, arguments)]
    return subprocess.Popen(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def wait_for(what: Callable[[], bool]) -> None:
    end = time.monotonic() + _PATIENCE
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


def done(out: Path) -> int:
    return len(list(out.glob("unverified/*")))


def workers(batch: int) -> list[int]:
    """Return the worker processes of a batch: those that its server has forked."""
    parents, servers = dict[int, int](), set[int]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            own = int(stat.parent.name)
            fields = stat.read_text().rpartition(")")[2].split()
            parents[own] = int(fields[1])
            if b"forkserver" in (stat.parent / "cmdline").read_bytes():
                servers.add(own)
    return [own for own in servers if parents.get(parents[own]) == batch]


def test_the_process_that_workers_are_forked_from_runs_one_thread() -> None:
    # A thread of it would be missing in its children, with the locks that it held.
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "import distributed, axcomp.ident.job\n"
        "assert len(list(Path('/proc/self/task').iterdir())) == 1\n"
        "xla = sys.modules.get('jax._src.xla_bridge')\n"
        "assert xla is None or not xla.backends_are_initialized()\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | _ONE_THREAD,
        capture_output=True,
        text=True,
        timeout=_PATIENCE,
        check=False,
    )
    assert told.returncode == 0, told.stderr


def check_lists(out: Path, names: list[str]) -> None:
    """Every good job's list is there once, complete, and its row as well."""
    own = read_results(out)["job"].to_pylist()
    assert len(own) == len(set(own))
    assert set(names) <= set(own)
    places = sorted(path.name for path in (out / "unverified").iterdir())
    assert places == sorted(names)
    for name in names:
        folder = out / "unverified" / name
        assert (folder / "achskw1.lis").read_text().rstrip().endswith("Ende")
        assert json.loads((folder / "result.json").read_text())["passed"]
    assert not list(out.rglob("*.part"))
    assert not (out / ".work").exists()


linux = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="needs /proc to find the workers"
)


@linux
def test_a_killed_worker_a_corrupt_job_and_an_endless_one_cost_only_themselves(
    tmp_path: Path, fleet: Fleet, endless_job: Callable[[Path, str], None]
) -> None:
    names = fleet(tmp_path / "jobs", 24)
    (tmp_path / "jobs" / "corrupt.toml").write_text("[axes.X]\nnumber = = 1\n")
    (tmp_path / "jobs" / "00007.csv").write_bytes(b"x,e,dir,run\n1,2,\xff\xfe,what\n")
    endless_job(tmp_path / "jobs", "endless")
    out = tmp_path / "out"
    batch = start(
        tmp_path / "jobs" / "*.toml", "--out", out, "--workers", 2,
        "--time-limit", 4, cwd=tmp_path,
    )  # fmt: skip
    wait_for(lambda: done(out) > 1)
    os.kill(workers(batch.pid)[0], signal.SIGKILL)
    _, said = batch.communicate(timeout=_PATIENCE)
    assert batch.returncode == 1
    assert "Traceback" not in said
    names.remove("00007")
    check_lists(out, names)
    rows = query_results(out, "state = 'failed'", "job, reason").to_pylist()
    reasons = {row["job"]: row["reason"] for row in rows}
    assert set(reasons) == {"corrupt", "00007", "endless"}
    assert "corrupt.toml:2: not TOML" in reasons["corrupt"]
    assert "00007.csv" in reasons["00007"]
    assert "took more than 4 s" in reasons["endless"]
    assert "26 jobs, 3 failed" in said


def test_jobs_that_all_take_too_long_are_told_so(
    tmp_path: Path, endless_job: Callable[[Path, str], None]
) -> None:
    # Eight deaths of two workers; four that met a job while it waited made it the culprit.
    (tmp_path / "jobs").mkdir()
    endless_job(tmp_path / "jobs", "0")
    for k in range(1, 8):
        (tmp_path / "jobs" / f"{k}.toml").write_bytes(
            (tmp_path / "jobs" / "0.toml").read_bytes()
        )
    out = tmp_path / "out"
    batch = start(
        tmp_path / "jobs" / "*.toml", "--out", out, "--workers", 2,
        "--time-limit", 0.2, cwd=tmp_path,
    )  # fmt: skip
    batch.communicate(timeout=_PATIENCE)
    reasons = query_results(out, select="reason").to_pylist()
    words = "took more than 0.2 s (--time-limit) and was given up"
    assert [row["reason"] for row in reasons] == [words] * 8


@linux
@pytest.mark.heavy  # a signal meets one process of many: seen to pass by once under load
def test_an_interrupted_batch_says_so_and_nothing_else(
    tmp_path: Path, fleet: Fleet, endless_job: Callable[[Path, str], None]
) -> None:
    fleet(tmp_path / "jobs", 8)
    endless_job(tmp_path / "jobs", "endless")
    out = tmp_path / "out"
    batch = start(
        tmp_path / "jobs" / "*.toml", "--out", out, "--workers", 2, cwd=tmp_path
    )
    wait_for(lambda: done(out) > 0)
    # As a terminal does: to the batch and all of its workers.
    os.killpg(batch.pid, signal.SIGINT)
    _, said = batch.communicate(timeout=_PATIENCE)
    assert batch.returncode == 130, said
    assert "axcomp: interrupted" in said
    assert "Traceback" not in said


def test_a_killed_batch_goes_on_and_a_second_one_is_refused(
    tmp_path: Path, fleet: Fleet, capsys: pytest.CaptureFixture[str]
) -> None:
    names = fleet(tmp_path / "jobs", 40)
    out = tmp_path / "out"
    options = (tmp_path / "jobs" / "*.toml", "--out", out, "--workers", 1)
    first = start(*options, cwd=tmp_path)
    wait_for((out / "batch.json").exists)
    assert main(["batch", *map(str, options)]) == 1
    said = capsys.readouterr().err
    assert re.search(f"another batch running in it .process {first.pid}.", said)
    wait_for(lambda: done(out) > 0)
    first.kill()
    first.communicate()
    before = done(out)
    assert 0 < before < len(names)
    stamps = {
        path: path.stat().st_mtime_ns for path in (out / "unverified").glob("*/*.lis")
    }
    assert main(["batch", *map(str, options)]) == 1
    assert "expected --resume" in capsys.readouterr().err
    again = start(*options, "--resume", cwd=tmp_path)
    _, said = again.communicate(timeout=_PATIENCE)
    assert again.returncode == 0, said
    check_lists(out, names)
    # Nothing that was there is written twice.
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())


def _small_disk(folder: Path, size: str) -> bool:
    """Mount a small disk of memory; False where this user may not."""
    folder.mkdir()
    mount = shutil.which("mount")
    if mount is None or os.name == "nt" or os.geteuid() != 0:
        return False
    command = [mount, "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "disk"
    if not _small_disk(folder, "600k"):
        pytest.skip("needs the right to mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_stops_the_batch_and_room_lets_it_go_on(
    tmp_path: Path, small_disk: Path, fleet: Fleet
) -> None:
    names = fleet(tmp_path / "jobs", 40)
    out = small_disk / "out"
    options = (tmp_path / "jobs" / "*.toml", "--out", out, "--workers", 1)
    batch = start(*options, cwd=tmp_path)
    _, said = batch.communicate(timeout=_PATIENCE)
    assert batch.returncode == 1
    assert re.search(r"axcomp: .*(no room left|No space left).*--resume", said), said
    assert not list(out.rglob("*.part"))
    for folder in out.glob("unverified/*"):
        assert (folder / "achskw1.lis").read_text().rstrip().endswith("Ende")
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)
    again = start(*options, "--resume", cwd=tmp_path)
    _, said = again.communicate(timeout=_PATIENCE)
    assert again.returncode == 0, said
    check_lists(out, names)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler and two workers as a user would; yield address and processes."""
    note = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = subprocess.Popen(
        [
            *dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
            "--scheduler-file", str(note),
        ],
        **quiet,  # type: ignore[call-overload]
    )  # fmt: skip
    processes = [scheduler]
    try:
        wait_for(note.exists)
        wait_for(lambda: note.stat().st_size > 0)
        address = json.loads(note.read_text())["address"]
        processes += [
            subprocess.Popen(
                [
                    *dask, "worker", address, "--nthreads", "1", "--no-dashboard",
                    "--local-directory", str(tmp_path / f"worker{k}"),
                ],
                **quiet,  # type: ignore[call-overload]
            )
            for k in range(2)
        ]  # fmt: skip
        yield address, processes
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(15)
            process.kill()
            process.wait()


def test_a_scheduler_and_two_workers_elsewhere_do_it_and_may_get_lost(
    tmp_path: Path,
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
    fleet: Fleet,
) -> None:
    address, processes = cluster
    names = fleet(tmp_path / "jobs", 20)
    out = tmp_path / "out"
    options = (tmp_path / "jobs" / "*.toml", "--scheduler", address)
    batch = start(*options, "--out", out, cwd=tmp_path)
    _, said = batch.communicate(timeout=_PATIENCE)
    assert batch.returncode == 0, said
    check_lists(out, names)
    fleet(tmp_path / "jobs", 120)
    lost = tmp_path / "lost"
    batch = start(*options, "--out", lost, cwd=tmp_path)
    wait_for(lambda: done(lost) > 0)
    processes[0].kill()
    _, said = batch.communicate(timeout=_PATIENCE)
    assert batch.returncode == 1
    assert re.search(r"axcomp: .*scheduler was lost; \d+ of 120 jobs are done", said)
    assert "Traceback" not in said
    assert "--resume" in said
    # Without it workers ask for their scheduler until they are killed.
    for process in processes[1:]:
        process.kill()
