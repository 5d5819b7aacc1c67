"""The output folder: whole files or none, and no failed list that looks valid."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from axcomp.data.files import sync_folder
from axcomp.data.lists import ListFile
from axcomp.ident.job import OutputError, run_job, write_atomically
from axcomp.ident.report import write_report

JOB = """
[axes.X]
number = 1
[measurements.m]
file = "m.csv"
remove = "none"
columns = { "X.position" = "x", "X.error" = { column = "e", unit = "um" } }
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "m"
smoothness = 1
start = 0.0
interval = 10.0
points = 5
"""


def job(folder: Path, size: float = 1.0, gate: str = "") -> Path:
    rows = "".join(f"{2 * k},{size * (k % 7)}\n" for k in range(21))
    (folder / "m.csv").write_text("x,e\n" + rows)
    (folder / "job.toml").write_text(JOB + gate)
    return folder / "job.toml"


GATE = "[gate]\nmax_correction = 0.001\n"


def test_list_that_fails_the_gate_lies_in_rejected_only(tmp_path: Path) -> None:
    result = run_job(job(tmp_path, gate=GATE), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert not result.passed
    assert names == {"rejected", "result.json"}
    rejected = {path.name for path in (tmp_path / "out" / "rejected").iterdir()}
    assert rejected == {"achskw1.lis", "achsmds1.add.lis"}
    failed = [check for check in result.fits[0].gate if not check.passed]
    assert [check.name for check in failed] == ["max_correction"]
    assert failed[0].where.startswith("at X = ")
    assert "Do not load" in {step.action for step in result.load_sheet}
    # The proof still says what the rejected list would do.
    assert result.fits[0].error["from_file"].rms < result.fits[0].error["before"].rms


def test_list_of_an_earlier_run_is_moved_beside_the_rejected_one(
    tmp_path: Path,
) -> None:
    run_job(job(tmp_path), tmp_path / "out")
    earlier = (tmp_path / "out" / "achskw1.lis").read_bytes()
    result = run_job(job(tmp_path, size=2.0, gate=GATE), tmp_path / "out")
    assert not (tmp_path / "out" / "achskw1.lis").exists()
    assert not (tmp_path / "out" / "achsmds1.add.lis").exists()
    kept = tmp_path / "out" / "rejected" / "achskw1.earlier.lis"
    assert kept.read_bytes() == earlier
    assert any("achskw1.lis of an earlier run was moved" in r.message
               for r in result.remarks)  # fmt: skip


def test_list_of_an_axis_that_the_job_had_before_goes(tmp_path: Path) -> None:
    path = job(tmp_path)
    run_job(path, tmp_path / "out")
    path.write_text(path.read_text().replace("number = 1", "number = 2"))
    result = run_job(path, tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").glob("achs*.lis")} == {
        "achskw2.lis", "achsmds2.add.lis"
    }  # fmt: skip
    assert any("achskw1.lis of an earlier run was moved" in r.message
               for r in result.remarks)  # fmt: skip


def test_start_up_entries_of_an_earlier_run_go_with_its_list(tmp_path: Path) -> None:
    run_job(job(tmp_path), tmp_path / "out")
    run_job(job(tmp_path, gate=GATE), tmp_path / "out")
    assert not (tmp_path / "out" / "hochlauf.add.lis").exists()


def test_run_that_passes_takes_the_rejected_list_away(tmp_path: Path) -> None:
    run_job(job(tmp_path, gate=GATE), tmp_path / "out")
    run_job(job(tmp_path), tmp_path / "out")
    assert (tmp_path / "out" / "achskw1.lis").exists()
    assert not (tmp_path / "out" / "rejected" / "achskw1.lis").exists()


def test_same_job_writes_the_same_lists_again(tmp_path: Path) -> None:
    first = run_job(job(tmp_path), tmp_path / "out")
    before = {p: p.read_bytes() for p in (tmp_path / "out").glob("*.lis")}
    second = run_job(job(tmp_path), tmp_path / "out")
    assert {p: p.read_bytes() for p in (tmp_path / "out").glob("*.lis")} == before
    assert second.files == first.files


def test_a_list_edited_by_hand_is_kept_before_the_next_run(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run_job(job(tmp_path), out)
    edited = (out / "achskw1.lis").read_bytes().replace(b"Ende", b"# mine\nEnde")
    (out / "achskw1.lis").write_bytes(edited)
    result = run_job(job(tmp_path), out)
    assert (out / "kept" / "achskw1.lis").read_bytes() == edited
    assert (out / "achskw1.lis").read_bytes() != edited
    assert any("kept as kept/achskw1.lis" in r.message for r in result.remarks)
    # What nobody touched is the job's own, and the copy is made once.
    again = run_job(job(tmp_path), out)
    assert {path.name for path in (out / "kept").iterdir()} == {"achskw1.lis"}
    assert not any("kept" in r.message for r in again.remarks)


def test_an_edited_list_that_the_gate_stops_now_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run_job(job(tmp_path, gate=GATE), out)
    rejected = out / "rejected" / "achskw1.lis"
    rejected.write_bytes(b"mine")
    run_job(job(tmp_path), out)
    assert rejected.read_bytes() == b"mine"  # the list passes now: its place is another
    run_job(job(tmp_path, gate=GATE), out)
    assert (out / "kept" / "rejected" / "achskw1.lis").read_bytes() == b"mine"


def test_drawings_of_others_are_kept_before_the_next_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = run_job(job(tmp_path), out)
    drawn = [path for path in write_report(first, out) if path.suffix == ".svg"]
    drawn[0].write_text("<svg>mine</svg>")
    (out / "plots" / "mine.svg").write_text("<svg/>")  # nothing writes over this one
    result = run_job(job(tmp_path), out)
    write_report(result, out)
    kept = out / "kept" / "plots"
    assert [path.name for path in kept.iterdir()] == [drawn[0].name]
    assert (kept / drawn[0].name).read_text() == "<svg>mine</svg>"
    assert drawn[0].read_text() != "<svg>mine</svg>"
    assert [r.message for r in result.remarks if "kept as" in r.message]


def test_list_and_report_of_another_job_are_kept(tmp_path: Path) -> None:
    out, path = tmp_path / "out", job(tmp_path)
    page, *_ = write_report(run_job(path, out), out)
    theirs = {p.name: p.read_bytes() for p in (page, out / "achskw1.lis")}
    other = path.with_name("other.toml")
    other.write_text(path.read_text().replace("points = 5", "points = 6"))
    write_report(run_job(other, out), out)
    for name, content in theirs.items():
        assert (out / "kept" / name).read_bytes() == content


def test_list_of_another_machine_is_kept_from_a_job_of_the_same_name(
    tmp_path: Path,
) -> None:
    out, path = tmp_path / "out", job(tmp_path)
    run_job(path, out)
    theirs = (out / "achskw1.lis").read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    text = job(other, size=2.0).read_text()
    (other / "job.toml").write_text('[machine]\nid = "other"\n' + text)
    run_job(other / "job.toml", out)
    assert (out / "kept" / "achskw1.lis").read_bytes() == theirs


def test_no_draft_is_left_behind(tmp_path: Path) -> None:
    run_job(job(tmp_path), tmp_path / "out")
    assert list((tmp_path / "out").glob("**/*.part")) == []


def test_failed_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "achskw1.lis"
    target.write_bytes(b"old")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        write_atomically(target, b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.skipif(
    not Path("/proc/self/fd").is_dir(), reason="needs the files that a process has open"
)
def test_a_folder_is_synced_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rejected").mkdir()
    files = [tmp_path / "result.json", tmp_path / "rejected" / "achskw1.lis"]
    for file in files:
        file.write_bytes(b"x")
    open_before = set(Path("/proc/self/fd").iterdir())
    seen: list[Path] = []

    def note(handle: int) -> None:
        seen.append(Path(f"/proc/self/fd/{handle}").readlink())

    monkeypatch.setattr(os, "fsync", note)
    sync_folder(tmp_path)
    # A name counts only once what it stands for is there: the folders come last.
    assert set(seen[:2]) == set(files)
    assert set(seen[2:]) == {tmp_path, tmp_path / "rejected"}
    assert set(Path("/proc/self/fd").iterdir()) == open_before


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX permissions")
@pytest.mark.skipif(
    hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anywhere"
)
def test_folder_without_write_permission_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir(mode=0o555)
    with pytest.raises(OutputError, match="cannot write into the output folder: Perm"):
        run_job(job(tmp_path), tmp_path / "out")


def test_folder_below_a_file_is_refused(tmp_path: Path) -> None:
    path = job(tmp_path)
    with pytest.raises(OutputError, match="cannot write into the output folder: "):
        run_job(path, path / "out")


WRITER = """
import sys
from pathlib import Path
from axcomp.ident.job.write._output import write_atomically
target = Path(sys.argv[1])
contents = [letter * 200_000 + b"# Ende\\n" for letter in (b"a", b"b")]
print("ready", flush=True)
while True:
    for content in contents:
        write_atomically(target, content)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_kill_while_writing_leaves_a_whole_file(tmp_path: Path) -> None:
    target = tmp_path / "achskw1.lis"
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(target)], stdout=subprocess.PIPE
    )
    assert writer.stdout is not None
    with writer, writer.stdout:
        assert writer.stdout.readline() == b"ready\n"
        deadline = time.monotonic() + 30.0
        while not target.exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.05)  # somewhere in the middle of the next writes
        writer.send_signal(signal.SIGKILL)
    content = target.read_bytes()
    assert len(content) == 200_007
    assert len(set(content[:200_000])) == 1
    # What is left of the draft has a name that nobody loads.
    assert {path.name for path in tmp_path.iterdir()} <= {
        "achskw1.lis", "achskw1.lis.part",
    }  # fmt: skip


def test_max_points_is_written_only_where_the_default_is_too_small(
    tmp_path: Path,
) -> None:
    rows = "x,e\n" + "".join(
        f"{k / 50},{k / 1000 + 0.01 * (k % 3)}\n" for k in range(1700)
    )
    (tmp_path / "m.csv").write_text(rows)
    small, big = "interval = 10.0\npoints = 5", "interval = 0.02\npoints = 1500"
    (tmp_path / "job.toml").write_text(JOB.replace(small, big))
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    written = ListFile.read(tmp_path / "out" / "achskw1.lis")
    # kw_nr_max must stay below max_points.
    assert written.integer("kw.ssfk.kw_nr_max") == 1500
    assert written.integer("kw.ssfk.max_points") == 1501
    assert "Restart the controller" in {step.action for step in result.load_sheet}
    run_job(job(tmp_path), tmp_path / "out")
    assert ListFile.read(tmp_path / "out" / "achskw1.lis").get(
        "kw.ssfk.max_points"
    ) is None  # fmt: skip
