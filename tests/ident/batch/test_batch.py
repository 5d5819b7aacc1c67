"""A batch without its processes: what is collected, grouped, kept and asked for."""

import errno
import json
import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pv
import pyarrow.parquet as pq
import pytest

from axcomp.ident.batch import (
    COLUMNS,
    VERSION,
    BatchError,
    Task,
    collect_jobs,
    query_results,
    read_results,
    summarise,
)
from axcomp.ident.batch._folder import locked
from axcomp.ident.batch._table import write_results
from axcomp.ident.batch._work import Order, Outcome, examine, published, run_chunk
from axcomp.ident.cli import main
from axcomp.ident.job import load_job, run_job

from ..test_job_crosstalk import JOB, log

Fleet = Callable[[Path, int], list[str]]


def tasks_of(folder: Path, names: Sequence[str]) -> list[Task]:
    import hashlib

    paths = [folder / f"{name}.toml" for name in names]
    return [
        Task(path.stem, path, hashlib.sha256(path.read_bytes()).hexdigest())
        for path in paths
    ]


@pytest.fixture(scope="module")
def batch(
    tmp_path_factory: pytest.TempPathFactory,
    fleet: Fleet,
    readings: Callable[[int, float], str],
) -> Path:
    """Run a small fleet in this process: one loud machine, one broken job, one rejected.

    And one that has the file of another.
    """
    folder = tmp_path_factory.mktemp("batch")
    jobs = folder / "jobs"
    names = fleet(jobs, 18)
    (jobs / "00004.csv").write_text(readings(4, 20.0))
    (jobs / "00005.csv").write_text("x,e\n1,two\n")
    (jobs / "00017.csv").write_text(readings(3, 1.0))
    gate = "\n[gate]\nmax_correction = 1.0e-4\n"
    (jobs / "00006.toml").write_text((jobs / "00006.toml").read_text() + gate)
    out = folder / "out"
    out.mkdir()
    found = run_chunk(tasks_of(jobs, names), Order(str(out), "test"))
    write_results(out, [row for one in found for row in one.rows])
    return folder


def test_lists_and_results_of_a_batch_are_those_of_single_jobs_to_the_bit(
    batch: Path, tmp_path: Path
) -> None:
    for name in ("00000", "00003", "00007"):
        run_job(batch / "jobs" / f"{name}.toml", tmp_path / name)
        theirs = batch / "out" / "unverified" / name
        mine, own = (
            json.loads((folder / "result.json").read_text())
            for folder in (tmp_path / name, theirs)
        )
        for result in (mine, own):
            result.pop("wall_time")
        assert mine == own
        for file in own["files"]:
            if file != "result.json":
                assert (tmp_path / name / file).read_bytes() == (
                    theirs / file
                ).read_bytes()


def test_a_job_that_fails_is_a_row_with_its_reason_and_leaves_no_files(
    batch: Path,
) -> None:
    (row,) = query_results(batch / "out", "state = 'failed'").to_pylist()
    assert row["job"] == "00005"
    assert "00005.csv" in row["reason"]
    assert not list((batch / "out").rglob("00005"))


def test_a_fleet_whose_template_leaves_a_constant_to_nobody_fails_job_by_job(
    tmp_path: Path, fleet: Fleet
) -> None:
    names = fleet(tmp_path / "jobs", 2)
    for name in names:
        path = tmp_path / "jobs" / f"{name}.toml"
        path.write_text(path.read_text().replace('remove = "none"\n', ""))
        # A laser whose zero is 0.1 mm off; the errors of the fleet are within 0.04 mm.
        head, *rows = path.with_suffix(".csv").read_text().splitlines()
        cells = [row.split(",") for row in rows]
        moved = [f"{x},{float(e) + 100.0},{d},{r}" for x, e, d, r in cells]
        path.with_suffix(".csv").write_text("\n".join([head, *moved]) + "\n")
    out = tmp_path / "out"
    out.mkdir()
    found = run_chunk(tasks_of(tmp_path / "jobs", names), Order(str(out), "test"))
    rows = [row for one in found for row in one.rows]
    assert [row["state"] for row in rows] == ["failed", "failed"]
    for row in rows:
        assert "measurements.laser: found a constant of" in row["reason"]
        assert 'remove = "none"' in row["reason"]


def test_a_rejected_list_has_its_report_and_a_passed_one_none(batch: Path) -> None:
    out = batch / "out" / "unverified"
    assert (out / "00006" / "rejected" / "achskw1.lis").is_file()
    assert (out / "00006" / "report.html").is_file()
    assert not (out / "00000" / "report.html").exists()
    rows = query_results(
        batch / "out", "state = 'done' and not passed", "job, gate_failed", "job"
    ).to_pylist()
    # The loud machine has too much to correct, the other one no leave to correct.
    assert [row["job"] for row in rows] == ["00004", "00006"]
    assert all(row["gate_failed"] for row in rows)


def test_lists_with_verified_conventions_do_not_go_to_unverified(
    tmp_path: Path, fleet: Fleet
) -> None:
    (name,) = fleet(tmp_path, 1)
    job = tmp_path / f"{name}.toml"
    rules = [
        rule
        for rule in load_job(job).conventions.listing()
        # What no verdict asks for does not keep a list from the verified ones.
        if rule.name.startswith("leadscrew_") and rule.decides
    ]
    (tmp_path / "known.toml").write_text(
        "\n".join(f"{rule.name} = {json.dumps(rule.value)}" for rule in rules)
    )
    text = job.read_text().replace("[machine]", '[machine]\nconventions = "known.toml"')
    job.write_text(text)
    (found,) = run_chunk(tasks_of(tmp_path, [name]), Order(str(tmp_path / "out"), "t"))
    assert [row["verified"] for row in found.rows] == [True], found.rows
    assert (tmp_path / "out" / "lists" / name / "achskw1.lis").is_file()


def test_a_table_of_jobs_says_the_same_as_the_job_files(
    tmp_path: Path, fleet: Fleet
) -> None:
    names = fleet(tmp_path / "jobs", 3)
    template = (tmp_path / "jobs" / "00000.toml").read_text()
    (tmp_path / "kind.toml").write_text(template)
    rows = ["job,template,title,machine.id,machine.measured_at,measurements.laser.file"]
    rows += [
        f"axis-{name},kind.toml,{name},007,2026-01-0{k + 1},jobs/{name}.csv"
        for k, name in enumerate(names)
    ]
    (tmp_path / "fleet.csv").write_text("\n".join(rows) + "\n")
    items = collect_jobs([tmp_path / "fleet.csv"], tmp_path / "out")
    assert [item.name for item in items] == [f"axis-{name}" for name in names]
    for item, name in zip(items, names, strict=True):
        assert item.text is not None
        item.path.parent.mkdir(parents=True, exist_ok=True)
        item.path.write_text(item.text)
        job = load_job(item.path)
        assert job.spec.machine.id == "007"
        assert job.inputs == (job.file(f"../../jobs/{name}.csv"),)
        assert job.spec.fits == load_job(tmp_path / "jobs" / f"{name}.toml").spec.fits


@pytest.mark.parametrize("mark", [",", ";"])
def test_cells_of_a_table_of_jobs_may_be_separated_by_semicolons(
    tmp_path: Path, mark: str
) -> None:
    limits = "[0.0, 400.0]" if mark == ";" else '"[0.0, 400.0]"'
    rows = [["job", "fits.0.axis", "axes.X.number", "axes.X.limits"]]
    rows += [["one", "X", "7", limits]]
    (tmp_path / "fleet.csv").write_text("\r\n".join(map(mark.join, rows)) + "\r\n")
    (item,) = collect_jobs([tmp_path / "fleet.csv"], tmp_path / "out")
    assert item.text is not None
    axis = tomllib.loads(item.text)["axes"]["X"]
    assert axis == {"number": 7, "limits": [0.0, 400.0]}


def test_files_of_a_template_and_of_a_cell_lie_beside_them(tmp_path: Path) -> None:
    head = "[axes.X]\nnumber = 1\n[measurements.m]\n"
    (tmp_path / "own").mkdir()
    template = tmp_path / "own" / "kind.toml"
    template.write_text(f'{head}files = ["a.csv", "b.csv"]\n')
    rows = ["job,template,measurements.m.files", "one,own/kind.toml,"]
    rows += ["two,own/kind.toml,\"['c.csv', 'd.csv']\""]
    (tmp_path / "fleet.csv").write_text("\n".join(rows) + "\n")
    items = collect_jobs([tmp_path / "fleet.csv"], tmp_path / "out")
    found = []
    for item in items:
        assert item.text is not None
        files = tomllib.loads(item.text)["measurements"]["m"]["files"]
        found.append([(item.path.parent / file).resolve() for file in files])
    root = tmp_path.resolve()
    assert found == [
        [root / "own" / "a.csv", root / "own" / "b.csv"],
        [root / "c.csv", root / "d.csv"],
    ]


def test_every_key_of_a_job_can_be_a_column(tmp_path: Path) -> None:
    cells = {
        "title": "x", "axes.X.number": 1, "measurements.m.file": "m.csv",
        "measurements.m.columns.X.position": "p", "fits.0.compensation": "leadscrew",
        "fits.0.axis": "X", "fits.0.measurement": "m", "fits.0.points": 5,
        "fits.0.start": 0.0, "fits.0.interval": 1.0, "gate.max_slope": None,
    }  # fmt: skip
    pq.write_table(pa.table({k: [v] for k, v in cells.items()}), tmp_path / "t.parquet")
    (tmp_path / "m.csv").write_text("p\n1\n")
    (item,) = collect_jobs([tmp_path / "t.parquet"], tmp_path)
    assert item.text is not None
    item.path.parent.mkdir()
    item.path.write_text(item.text)
    spec = load_job(item.path).spec
    assert spec.fits[0].axis == "X"
    assert spec.measurements["m"].columns["X.position"] == "p"


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("nothing-*.toml", "found no such file"),
        (".", "found a folder, expected files"),
        ("twice.csv", "two jobs named 'a'"),
        ("name.csv", "expected a name fit for a folder"),
        ("long.csv", "expected a name fit for a folder"),
        ("other.csv", "expected keys of a job"),
        ("columns.csv", "found the column 'fits.0.axis' twice"),
    ],
)
def test_what_cannot_be_collected_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, argument: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "twice.csv").write_text("job,fits.0.axis\na,X\na,Y\n")
    (tmp_path / "name.csv").write_text("job,fits.0.axis\n../x,X\n")
    (tmp_path / "long.csv").write_text(f"job,fits.0.axis\n{300 * 'x'},X\n")
    (tmp_path / "columns.csv").write_text("fits.0.axis,fits.0.axis\nX,Y\n")
    (tmp_path / "other.csv").write_text("x,y\n1,2\n")
    with pytest.raises(BatchError, match=words):
        collect_jobs([argument], tmp_path)


def test_a_job_that_is_linked_into_folders_reads_the_files_beside_each_link(
    tmp_path: Path, fleet: Fleet, readings: Callable[[int, float], str]
) -> None:
    fleet(tmp_path / "template", 1)
    for k in range(2):
        (tmp_path / f"m{k}").mkdir()
        (tmp_path / f"m{k}" / "job.toml").symlink_to(
            tmp_path / "template" / "00000.toml"
        )
        (tmp_path / f"m{k}" / "00000.csv").write_text(readings(k + 1, 1.0))
    tasks = collect_jobs([str(tmp_path / "m*" / "job.toml")], tmp_path / "out")
    assert [task.name for task in tasks] == ["m0-job", "m1-job"]
    done = run_chunk(tasks, Order(str(tmp_path / "out"), "t"))
    for one, task in zip(done, tasks, strict=True):
        run_job(task.path, tmp_path / task.name)
        listed = tmp_path / "out" / str(one.rows[0]["folder"]) / "achskw1.lis"
        alone = tmp_path / task.name / "achskw1.lis"
        assert listed.read_bytes() == alone.read_bytes()
    assert done[0].rows[0]["table"] != done[1].rows[0]["table"]


def test_a_job_named_in_two_ways_is_one(
    tmp_path: Path, fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet(tmp_path / "jobs", 1)
    monkeypatch.chdir(tmp_path)
    path = Path("jobs") / "00000.toml"
    named = [str(path), str(path.resolve()), f"jobs/../{path}"]
    assert [task.name for task in collect_jobs(named, tmp_path)] == ["00000"]


def test_cells_of_a_table_mean_what_the_same_words_mean_in_a_job(
    tmp_path: Path,
) -> None:
    cells = {
        "job": "0",
        "measurements.m.file": "runs/m.csv",
        "measurements.m.material_temperature": "25.0",
        "measurements.m.columns.X.position": "1",
        "verify.job": "again.toml",
        "fits.0.axis": "X",
    }
    lines = [",".join(cells), ",".join(cells.values())]
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    (task,) = collect_jobs([str(tmp_path / "t.csv")], tmp_path / "out")
    assert task.name == "0"
    job = tomllib.loads(str(task.text))
    assert job["measurements"]["m"] == {
        "file": "../../runs/m.csv",
        "material_temperature": 25.0,
        "columns": {"X.position": "1"},
    }
    assert job["verify"]["job"] == "../../again.toml"


def test_a_folder_is_locked_for_one_batch_and_free_after_it(tmp_path: Path) -> None:
    with locked(tmp_path):
        with pytest.raises(BatchError, match="another batch running"), locked(tmp_path):
            pass
    with locked(tmp_path):
        pass


def test_a_disk_without_room_is_no_fault_of_the_job(
    tmp_path: Path, fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    from axcomp.ident.job.write import _output

    def full(path: Path, content: bytes, **options: bool) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(_output, "write_atomically", full)
    (found,) = run_chunk(
        tasks_of(tmp_path, fleet(tmp_path, 1)), Order(str(tmp_path / "out"), "t")
    )
    assert isinstance(found, Outcome)
    assert found.full
    assert not list((tmp_path / "out").rglob("*.lis"))


def test_files_that_the_disk_does_not_take_are_not_moved_to_their_place(
    tmp_path: Path, fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    from axcomp.ident.batch import _work

    names = fleet(tmp_path, 3)
    sync = _work.sync_folder

    def full(folder: Path) -> None:
        if folder.name == names[1]:
            raise OSError(errno.ENOSPC, "No space left on device", str(folder))
        sync(folder)

    monkeypatch.setattr(_work, "sync_folder", full)
    out = tmp_path / "out"
    found = run_chunk(tasks_of(tmp_path, names), Order(str(out), "t"))
    assert [one.name for one in found] == names
    assert [one.full for one in found] == [False, True, False]
    there = sorted(path.name for path in (out / "unverified").iterdir())
    assert there == [names[0], names[2]]
    assert not list((out / ".work").rglob("*.lis"))


def test_a_job_whose_measurement_changed_is_to_be_done_again(
    tmp_path: Path, fleet: Fleet, readings: Callable[[int, float], str]
) -> None:
    names = fleet(tmp_path / "jobs", 3)
    (tmp_path / "jobs" / "00002.csv").write_text("x,e\n1,two\n")
    tasks = tasks_of(tmp_path / "jobs", names)
    order = Order(str(tmp_path / "out"), "t")
    done = run_chunk(tasks, order)
    assert [one.rows[0]["state"] for one in done] == ["done", "done", "failed"]
    for k in (1, 2):
        (tmp_path / "jobs" / f"{k:05d}.csv").write_text(readings(7, 1.0))
    # The folder of the first run must not be taken for the result of this one.
    again = run_chunk(tasks, order)
    assert [one.rows[0]["state"] for one in again] == ["done"] * 3
    assert again[0].rows == done[0].rows
    assert again[1].rows[0]["table"] != done[1].rows[0]["table"]


def ordered(folder: Path, fleet: Fleet, count: int) -> tuple[list[Task], Order]:
    """A fleet in the folder, and the order to run it."""
    tasks = tasks_of(folder / "jobs", fleet(folder / "jobs", count))
    return tasks, Order(str(folder / "out"), "t")


def test_a_job_that_can_no_longer_run_leaves_no_list_of_before(
    tmp_path: Path, fleet: Fleet
) -> None:
    tasks, order = ordered(tmp_path, fleet, 2)
    run_chunk(tasks, order)
    (tmp_path / "jobs" / "00001.csv").unlink()
    (lost,) = examine(tasks, order)
    assert lost.rows[0]["state"] == "failed"
    out = tmp_path / "out"
    assert [path.name for path in (out / "unverified").iterdir()] == ["00000"]
    # Nothing is lost: a list may be on the machine.
    assert (out / "earlier" / "00001" / "achskw1.lis").is_file()


def test_a_damaged_result_is_made_again(tmp_path: Path, fleet: Fleet) -> None:
    tasks, order = ordered(tmp_path, fleet, 1)
    table = run_chunk(tasks, order)[0].rows[0]["table"]
    result = tmp_path / "out" / "unverified" / "00000" / "result.json"
    for content in ("{}", "[]", '{"inputs": {', ""):
        result.write_text(content)
        assert run_chunk(tasks, order)[0].rows[0].get("table") == table


def test_a_list_that_was_changed_by_hand_is_made_again_and_kept(
    tmp_path: Path, fleet: Fleet
) -> None:
    tasks, order = ordered(tmp_path, fleet, 1)
    run_chunk(tasks, order)
    listed = tmp_path / "out" / "unverified" / "00000" / "achskw1.lis"
    before = listed.read_bytes()
    changed = before.replace(b"-", b"")
    listed.write_bytes(changed)
    run_chunk(tasks, order)
    assert listed.read_bytes() == before
    earlier = tmp_path / "out" / "earlier" / "00000" / "achskw1.lis"
    assert earlier.read_bytes() == changed


def test_a_job_does_not_replace_the_list_that_it_reads(
    tmp_path: Path, fleet: Fleet
) -> None:
    (name,) = fleet(tmp_path / "jobs", 1)
    order = Order(str(tmp_path / "out"), "t")
    run_chunk(tasks_of(tmp_path / "jobs", [name]), order)
    listed = tmp_path / "out" / "unverified" / name / "achskw1.lis"
    before = listed.read_bytes()
    job = tmp_path / "jobs" / f"{name}.toml"
    measured = job.read_text().replace("active = []", 'active = ["leadscrew"]')
    axis = f'number = 1\nlist = "../out/unverified/{name}/achskw1.lis"\n'
    job.write_text(measured.replace("number = 1\n", axis))
    (row,) = run_chunk(tasks_of(tmp_path / "jobs", [name]), order)[0].rows
    assert row["state"] == "failed"
    assert "the job reads it, and would replace it" in row["reason"]
    assert listed.read_bytes() == before


def test_a_changed_second_measurement_is_looked_at_again(
    tmp_path: Path, fleet: Fleet, readings: Callable[[int, float], str]
) -> None:
    first, second = fleet(tmp_path / "jobs", 2)
    job = tmp_path / "jobs" / f"{first}.toml"
    job.write_text(job.read_text() + f'[verify]\njob = "{second}.toml"\n')
    tasks = tasks_of(tmp_path / "jobs", [first])
    order = Order(str(tmp_path / "out"), "t")
    done = run_chunk(tasks, order)[0].rows[0]
    assert run_chunk(tasks, order)[0].rows[0]["wall_time"] == done["wall_time"]
    (tmp_path / "jobs" / f"{second}.csv").write_text(readings(1, 2.0))
    again = run_chunk(tasks, order)[0].rows[0]
    assert again["inputs_sha256"] != done["inputs_sha256"]
    assert again["wall_time"] != done["wall_time"]


def test_a_list_of_before_that_cannot_be_taken_away_is_not_told_as_a_new_one(
    tmp_path: Path,
    fleet: Fleet,
    readings: Callable[[int, float], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tasks, order = ordered(tmp_path, fleet, 1)
    run_chunk(tasks, order)
    listed = tmp_path / "out" / "unverified" / "00000" / "achskw1.lis"
    before = listed.read_bytes()
    (tmp_path / "jobs" / "00000.csv").write_text(readings(7, 1.0))

    def denied(path: Path, target: Path) -> Path:
        # What Windows says where a file of the folder is open; root is denied nothing.
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "rename", denied)
    (row,) = run_chunk(tasks, order)[0].rows
    assert row["state"] == "failed"
    assert "the lists of an earlier run cannot be moved away" in row["reason"]
    assert listed.read_bytes() == before


def test_rows_of_a_job_are_those_that_its_files_give(
    tmp_path: Path,
    fleet: Fleet,
    friction_fleet: Fleet,
    plane_job: Callable[..., None],
) -> None:
    names = fleet(tmp_path / "jobs", 1)
    friction = friction_fleet(tmp_path / "friction", 1)
    grid = [(0.5 * x, 0.5 * y) for x in range(7) for y in range(5)]
    rows = [f"{x},{y},{1e-3 * (x * y + x)}" for x, y in grid]
    (tmp_path / "jobs" / "p.csv").write_text("x,y,e\n" + "\n".join(rows) + "\n")
    plane_job(tmp_path / "jobs" / "plane.toml", "p.csv", 4, 1.0)
    tasks = tasks_of(tmp_path / "jobs", [*names, "plane"])
    tasks += [
        Task("friction", task.path, task.sha256)
        for task in tasks_of(tmp_path / "friction", friction)
    ]
    out = tmp_path / "out"
    order = Order(str(out), "t")
    for task, done in zip(tasks, run_chunk(tasks, order), strict=True):
        assert done.rows[0]["state"] == "done", done.rows
        # As text, which tells 1 from 1.0 and a list from an array.
        assert repr(published(task, order)) == repr(done.rows)


def test_the_table_carries_its_version_and_the_meaning_of_every_column(
    batch: Path,
) -> None:
    table = read_results(batch / "out")
    assert table.schema.metadata[b"axcomp.schema"] == str(VERSION).encode()
    assert table.column_names == list(COLUMNS)
    for name, (_, meaning) in COLUMNS.items():
        assert table.schema.field(name).metadata[b"meaning"].decode() == meaning
    later = table.replace_schema_metadata({"axcomp.schema": str(VERSION + 1)})
    pq.write_table(later, batch / "later.parquet")
    with pytest.raises(BatchError, match=f"found version {VERSION + 1}"):
        read_results(batch / "later.parquet")


def test_a_crosstalk_has_its_row(tmp_path: Path) -> None:
    log(tmp_path, moves=12)
    job = tmp_path / "job.toml"
    job.write_text(JOB.format(axis="", active="[]", keys="", columns=""))
    (tmp_path / "out").mkdir()
    (found,) = run_chunk(tasks_of(tmp_path, ["job"]), Order(str(tmp_path / "out"), "t"))
    write_results(tmp_path, found.rows)
    (row,) = read_results(tmp_path).to_pylist()
    assert row["state"] == "done"
    # Of its four quadrants the noisiest; 0.5 µm of noise in readings, means of some.
    assert 0.0 < row["noise"] < 5e-4


def test_every_column_stands_in_the_documentation() -> None:
    page = Path(__file__).parents[3] / "docs" / "batch.md"
    text = page.read_text()
    assert [name for name in COLUMNS if f"`{name}`" not in text] == []


def test_questions_to_the_table_are_answered_on_the_command_line(
    batch: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = str(batch / "out")
    asked = ["results", out, "--where", "machine_id = 'm1'", "--order", "job"]
    assert main([*asked, "--select", "job, passed", "--json"]) == 0
    rows = json.loads(capfd.readouterr().out)
    # Machine m1 has the jobs 6 to 11, the first of them was rejected.
    assert rows == [{"job": f"{k:05d}", "passed": k > 6} for k in range(6, 12)]
    assert main(asked) == 0
    shown = capfd.readouterr().out
    assert pv.read_csv(pa.py_buffer(shown.encode())).num_rows == 6
    assert not re.search(r"\.0*[1-9]\d{6}", shown)  # no mm with 17 digits
    assert main(["results", out, "--where", "nothing = 1"]) == 1
    assert "nothing" in capfd.readouterr().err
    assert main(["results", str(batch)]) == 1
    assert "expected the folder of a finished batch" in capfd.readouterr().err


def test_every_column_can_be_asked_for_by_its_name(batch: Path) -> None:
    every = query_results(batch / "out").column_names
    assert query_results(batch / "out", select=", ".join(every)).column_names == every


def test_a_question_cannot_reach_other_files(batch: Path) -> None:
    with pytest.raises(BatchError, match=r"does not exist|disabled"):
        query_results(batch / "out", select="(SELECT count(*) FROM '/etc/passwd')")


def test_the_summary_finds_what_failed_what_is_loud_and_what_grows(batch: Path) -> None:
    summary = summarise(batch / "out")
    assert (summary.jobs, summary.failed, summary.rejected) == (18, 1, 2)
    assert summary.unverified == 15  # of the rejected ones there is none to verify
    (spread,) = summary.spreads
    assert spread["count"] == 17
    half = {stage: own[0] for stage, own in spread["percentiles"].items()}
    assert half["from_file"] < 0.5 * half["before"]
    assert {one["job"] for one in summary.outliers if one["stage"] == "from_file"} == {
        "00004"
    }
    (twins,) = summary.twins
    assert twins["jobs"] == ["00003", "00017"]
    page = (batch / "out" / "summary.html").read_text()
    assert "00003, 00017" in page
    assert sum(summary.gate.values()) >= 2
    assert "<svg" in page
    assert "mathdefault" not in page  # powers of ten as the text of a formula
    assert json.loads((batch / "out" / "summary.json").read_text())["jobs"] == 18


def test_failures_that_differ_in_numbers_alone_are_shown_once_with_the_numbers_of_one(
    tmp_path: Path,
) -> None:
    texts = [f"a.csv:{k}: found {k} mm, expected at most 700" for k in (811, 907)]
    rows = [{"job": t, "state": "failed", "reason": t, "passed": False} for t in texts]
    write_results(tmp_path, [*rows, rows[0] | {"job": "b", "reason": "No readings."}])
    summary = summarise(tmp_path)
    assert summary.failed == 3
    # Which of the two stands for both does not matter.
    shown = {reason.replace("907", "811"): n for reason, n in summary.reasons.items()}
    assert shown == {"found 811 mm, expected at most 700": 2, "No readings.": 1}


def test_a_trend_needs_several_measurements_that_agree(tmp_path: Path) -> None:
    def row(machine: str, month: int, rms: float) -> dict[str, object]:
        return {
            "job": f"{machine}-{month}", "state": "done", "passed": True, "axis": "X",
            "verified": True, "machine_id": machine, "compensation": "leadscrew",
            "measured_at": f"2026-{month:02d}-01", "before_rms": rms, "unit": "mm",
            "from_file_rms": 1e-3, "predicted_rms": 1e-3, "gate_failed": [],
        }  # fmt: skip

    old, new = tmp_path / "old", tmp_path / "new"
    for folder, months in ((old, (1, 2, 3)), (new, (4, 5))):
        folder.mkdir()
        rows = [row("wears", m, 0.010 + 0.001 * m) for m in months]
        rows += [row("rests", m, 0.010 + 0.001 * (m % 2)) for m in months]
        rows += [row("fresh", m, 0.010 * m) for m in months if m > 3]
        write_results(folder, rows)
    assert summarise(new).trends == ()
    (trend,) = summarise(new, [old]).trends
    assert (trend["machine"], trend["measurements"]) == ("wears", 5)
    # 1 µm a month of 28 to 31 days is 12 µm a year, by the median within one.
    assert trend["per_year"] == pytest.approx(0.012, abs=0.001)


def test_lost_motion_that_grows_is_a_trend_before_the_error_is_one(
    tmp_path: Path,
) -> None:
    def row(month: int) -> dict[str, object]:
        return {
            "job": f"{month}", "state": "done", "passed": True, "axis": "X",
            "verified": True, "machine_id": "m", "compensation": "leadscrew",
            "measured_at": f"2026-{month:02d}-01", "unit": "mm", "gate_failed": [],
            "before_rms": 0.010 + 0.001 * (month % 2), "before_B": 0.002 + 0.001 * month,
        }  # fmt: skip

    write_results(tmp_path, [row(month) for month in range(1, 7)])
    (trend,) = summarise(tmp_path).trends
    assert trend["figure"] == "B"
    assert trend["per_year"] == pytest.approx(0.012, abs=0.001)


def test_a_fit_that_measured_next_to_nothing_stands_out(tmp_path: Path) -> None:
    def row(number: int, rms: float) -> dict[str, object]:
        return {
            "job": f"{number}", "state": "done", "passed": True, "axis": "X",
            "verified": True, "compensation": "leadscrew", "unit": "mm",
            "before_rms": rms, "from_file_rms": rms / 10, "gate_failed": [],
        }  # fmt: skip

    sizes = [0.010 + 0.001 * (k % 5) for k in range(11)]
    write_results(tmp_path, [row(k, rms) for k, rms in enumerate([*sizes, 12e-6])])
    found = [(one["job"], one["stage"]) for one in summarise(tmp_path).outliers]
    assert found == [
        ("11", "before")
    ]  # in mm, where µm were stated; a good fit is none


def test_a_table_that_is_that_of_the_fleet_turned_round_stands_out(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(0)
    common = rng.normal(0.0, 0.01, 20)

    def row(number: int, share: float, alike: float = 1.0) -> dict[str, object]:
        own = share * common * alike + 0.002 * rng.normal(size=20) * (3.0 - 2.0 * alike)
        return {
            "job": f"{number}", "state": "done", "passed": True, "axis": "X",
            "verified": True, "compensation": "leadscrew", "unit": "mm",
            "before_rms": 0.01, "from_file_rms": 1e-3, "gate_failed": [],
            "table": own.tolist(),
        }  # fmt: skip

    write_results(tmp_path, [row(k, -1.0 if k == 7 else 1.0) for k in range(14)])
    (one,) = summarise(tmp_path).outliers
    assert (one["job"], one["stage"]) == ("7", "table")
    # The noise of 20 entries is a fifth of them.
    assert one["times"] == pytest.approx(-1.0, abs=0.15)
    assert "table turned round" in (tmp_path / "summary.html").read_text()
    # Tables that have nothing in common are none turned round.
    unlike = [row(k, -1.0 if k == 7 else 1.0, alike=0.0) for k in range(14)]
    write_results(tmp_path, unlike)
    assert not summarise(tmp_path).outliers


@pytest.mark.slow
def test_a_batch_from_the_command_line_writes_all_that_it_says(
    tmp_path: Path, fleet: Fleet, capfd: pytest.CaptureFixture[str]
) -> None:
    fleet(tmp_path, 4)
    out = tmp_path / "out"
    arguments = ["batch", str(tmp_path / "*.toml"), "--out", str(out), "--workers", "1"]
    assert main([*arguments, "--reports", "--json"]) == 0
    said = capfd.readouterr()
    assert json.loads(said.out)["jobs"] == 4
    assert "4 lists lie in unverified/" in said.err
    assert sorted(path.name for path in out.iterdir()) == [
        "batch.json", "batch.lock", "results.parquet", "summary.html",
        "summary.json", "unverified",
    ]  # fmt: skip
    assert len(list(out.glob("unverified/*/report.html"))) == 4
    manifest = json.loads((out / "batch.json").read_text())
    assert manifest["finished"] >= manifest["started"]
    assert len(manifest["jobs"]) == 4
    assert main([*arguments, "--resume"]) == 0
    assert main(arguments) == 1
    assert "expected --resume" in capfd.readouterr().err
