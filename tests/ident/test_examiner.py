"""Jobs that nobody plans for: what they end in, and what they leave untouched."""

import json
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from axcomp.data.toml import TomlError
from axcomp.ident.cli import main
from axcomp.ident.cli._app import _again
from axcomp.ident.job import JobError, load_job, run_job
from axcomp.ident.report import headline_of, scale_of

JOB = """
[machine]
{machine}
[axes.X]
number = 1
{axis}
[measurements.laser]
file = "laser.csv"
remove = "none"
active = []
[measurements.laser.columns]
"X.position" = "x"
"X.error" = "e"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
start = 0.0
interval = 100.0
points = 5
{fit}
"""
NODES = np.arange(0.0, 401.0, 100.0)
TRUTH = np.array([0.0, 0.012, 0.02, 0.011, -0.005])


def write_job(
    folder: Path, *, machine: str = "", axis: str = "", fit: str = "", scale: float = 1
) -> Path:
    """Write a job on a table that its nodes can hold, with 0.1 µm of noise."""
    x = np.repeat(np.arange(0.0, 401.0, 20.0), 3)
    noise = 1e-4 * np.random.default_rng(3).standard_normal(len(x))
    error = scale * np.interp(x, NODES, TRUTH) + noise
    rows = (f"{a!r},{b!r}" for a, b in zip(x.tolist(), error.tolist(), strict=True))
    (folder / "laser.csv").write_text("\n".join(["x,e", *rows]) + "\n")
    job = folder / "job.toml"
    job.write_text(JOB.format(machine=machine, axis=axis, fit=fit))
    return job


def spoil(folder: Path, row: int, cell: str) -> None:
    """Replace the error of one row, counted from 0."""
    lines = (folder / "laser.csv").read_text().splitlines()
    lines[row + 1] = f"{lines[row + 1].split(',')[0]},{cell}"
    (folder / "laser.csv").write_text("\n".join(lines) + "\n")


def test_rms_is_that_of_all_readings_and_of_the_sound_ones_beside_it(
    tmp_path: Path,
) -> None:
    job = write_job(tmp_path)
    spoil(tmp_path, 31, "1.0")
    run_job(job, tmp_path / "out")
    (fit,) = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    values = np.loadtxt(tmp_path / "laser.csv", delimiter=",", skiprows=1)[:, 1]
    before = fit["error"]["before"]
    # As measured: not a digit but those of floating point may differ.
    assert before["rms"] == pytest.approx(np.sqrt(np.mean(values**2)), rel=1e-12)
    assert before["max"] == 1.0
    sound = np.delete(values, 31)
    assert before["rms_without_wild"] == pytest.approx(
        np.sqrt(np.mean(sound**2)), rel=1e-12
    )
    assert before["max_without_wild"] == pytest.approx(np.abs(sound).max())
    for stage in ("predicted", "from_file"):
        # The list takes nothing off the wild reading.
        assert fit["error"][stage]["max"] > 0.9
    # 4 sd of the noise, a reading's own pull on the table, and rounding.
    assert fit["error"]["from_file"]["max_without_wild"] < 1e-3


def test_without_wild_readings_both_figures_are_the_same(tmp_path: Path) -> None:
    result = run_job(write_job(tmp_path, fit='loss = "gauss"'), tmp_path / "out")
    tree = json.loads((tmp_path / "out" / "result.json").read_text())
    figures = tree["fits"][0]["error"]["before"]
    assert figures["rms_without_wild"] == figures["rms"]
    assert result.tables[0].error["before"].sound is result.tables[0].error["before"]


def test_node_whose_only_readings_are_wild_is_not_called_unmeasured(
    tmp_path: Path,
) -> None:
    job = write_job(tmp_path, fit="")
    lines = (tmp_path / "laser.csv").read_text().splitlines()
    # Readings at the nodes only, one of them wild.
    kept = [line for line in lines[1:] if float(line.split(",")[0]) % 100 == 0]
    (tmp_path / "laser.csv").write_text("\n".join(["x,e", *kept]) + "\n")
    for row in (6, 7, 8):
        spoil(tmp_path, row, f"{0.5 + row / 10}")
    result = run_job(job, tmp_path / "out")
    said = [r.message for r in result.tables[0].remarks if "support 0" in r.message]
    empty = int((result.tables[0].fit.support == 0).sum())
    assert bool(said) == (empty > 0)
    assert all("not measured, or only wild ones" in text for text in said)


def test_stretch_that_its_neighbours_do_not_tell_is_not_called_scatter(
    tmp_path: Path,
) -> None:
    # Exact zigzag: a block left out cannot be foretold, and yet nothing scatters.
    job = write_job(tmp_path, fit='smoothness = 0\nloss = "gauss"')
    x = np.repeat(np.arange(0.0, 401.0, 20.0), 3)
    error = np.interp(x, NODES, [0.02, -0.02, 0.02, -0.02, 0.02])
    rows = (f"{a!r},{b!r}" for a, b in zip(x.tolist(), error.tolist(), strict=True))
    (tmp_path / "laser.csv").write_text("\n".join(["x,e", *rows]) + "\n")
    fit = run_job(job, tmp_path / "out").tables[0]
    assert fit.held_out == "block"
    assert fit.error["predicted"].rms > fit.error["before"].rms
    text = headline_of(fit, scale_of(fit.unit)).sentence
    assert "its surroundings do not tell" in text
    assert "drift" not in text


def test_marker_for_no_reading_is_refused_with_its_line(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    spoil(tmp_path, 4, "1e308")
    with pytest.raises(Exception, match=r"laser\.csv: line 6: found 1e\+308 mm or °"):
        run_job(job, tmp_path / "out")


def test_conventions_that_are_no_text_are_named_with_their_line(
    tmp_path: Path,
) -> None:
    job = write_job(tmp_path, machine='conventions = "mill.toml"')
    (tmp_path / "mill.toml").write_bytes(b"# fine\n# \xff\n")
    with pytest.raises(TomlError, match=r"mill\.toml:2: found byte 0xff, expected UTF"):
        load_job(job)


@pytest.mark.parametrize(
    ("key", "content", "match"),
    [
        ("list", "lr_param.ssfk 1\n", "found an axis list in .*, expected a comp"),
        ("list", "zahl_kw 1\n", "found a startup list in .*, expected a comp"),
        ("list", "x,e\n1,2\n", "found none of the entries of such a list"),
        ("machine_data", "kw.ssfk.unit 1\n", "a compensation list in .* an axis list"),
        ("machine_data", "zahl_kw 1\n", "found a startup list in .* an axis list"),
    ],
)
def test_file_that_is_another_kind_of_list_is_refused(
    tmp_path: Path, key: str, content: str, match: str
) -> None:
    job = write_job(tmp_path, axis=f'{key} = "given.lis"')
    (tmp_path / "given.lis").write_text(content)
    with pytest.raises(JobError, match=match):
        run_job(job, tmp_path / "out")


@pytest.mark.parametrize("content", ["", "# nothing yet\n\n( still nothing\n"])
def test_empty_list_is_one_to_be_filled(tmp_path: Path, content: str) -> None:
    job = write_job(tmp_path, axis='list = "given.lis"')
    (tmp_path / "given.lis").write_text(content)
    run_job(job, tmp_path / "out")
    assert (tmp_path / "out" / "achskw1.lis").read_text().startswith(content)


OLD = """kopf.achs_nr 1
kw.ssfk.interval 1000000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 2
kw.ssfk.table[0].pos 5
kw.ssfk.table[1].pos 6
"""


def test_old_table_in_unknown_increments_is_replaced_where_it_was_off(
    tmp_path: Path,
) -> None:
    job = write_job(tmp_path, axis='list = "old.lis"')
    (tmp_path / "old.lis").write_text(OLD)
    fit = run_job(job, tmp_path / "out").tables[0]
    assert any("cannot be compared" in remark.message for remark in fit.remarks)
    # 0.1 µm noise on some 12 readings per node, and 0.05 µm of rounding.
    assert np.abs(fit.table["pos"] - TRUTH).max() < 3e-4


@pytest.mark.parametrize("more", ["[gate]\nmax_change = 0.1\n", "nodes"])
def test_old_table_in_unknown_increments_is_refused_where_it_is_needed(
    tmp_path: Path, more: str
) -> None:
    job = write_job(tmp_path, axis='list = "old.lis"')
    (tmp_path / "old.lis").write_text(OLD)
    text = job.read_text()
    nodes = "start = 0.0\ninterval = 100.0\npoints = 5\n"
    job.write_text(text.replace(nodes, "") if more == "nodes" else text + more)
    with pytest.raises(JobError, match="the worth of an increment of axis 1"):
        run_job(job, tmp_path / "out")


def test_failed_job_leaves_no_empty_folder(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    spoil(tmp_path, 4, "nan")
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 1
    assert (tmp_path / "out").exists()


def test_lists_of_the_user_in_the_output_folder_are_safe(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    mine = {"achskw1.lis": b"kopf.achs_nr 1\n", "achsmds1.lis": b"lr_param.ssfk 0\n"}
    for name, content in mine.items():
        (tmp_path / name).write_bytes(content)
    result = run_job(job, tmp_path)
    text = " ".join(remark.message for remark in result.remarks)
    assert "it was kept as kept/achskw1.lis" in text
    assert "achsmds1.lis lies in the output folder and is not of this run" in text
    run_job(job, tmp_path)
    kept = {file.name: file.read_bytes() for file in (tmp_path / "kept").iterdir()}
    assert kept == {"achskw1.lis": mine["achskw1.lis"]}
    assert (tmp_path / "achsmds1.lis").read_bytes() == mine["achsmds1.lis"]


def test_what_other_programs_and_jobs_left_in_the_output_folder_is_kept(
    tmp_path: Path,
) -> None:
    job, out = write_job(tmp_path), tmp_path / "out"
    out.mkdir()
    mine = {
        "result.json": b'{"files": ["achskw1.lis"]}',
        "report.html": b"<p>mine</p>",
        "achskw1.lis": b"# mine\n",
    }
    for name, content in mine.items():
        (out / name).write_bytes(content)
    run_job(job, out)
    assert {p.name: p.read_bytes() for p in (out / "kept").iterdir()} == mine
    first = (out / "achskw1.lis").read_bytes()
    run_job(job, out)  # its own files are written over
    assert len([*(out / "kept").iterdir()]) == len(mine)
    run_job(job.rename(tmp_path / "other.toml"), out)
    assert (out / "kept" / "achskw1.1.lis").read_bytes() == first


def test_second_list_of_the_user_is_kept_beside_the_first(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    for content in (b"# one\n", b"# two\n"):
        (tmp_path / "result.json").unlink(missing_ok=True)
        (tmp_path / "achskw1.lis").write_bytes(content)
        run_job(job, tmp_path)
    kept = {file.name: file.read_bytes() for file in (tmp_path / "kept").iterdir()}
    assert kept == {"achskw1.lis": b"# one\n", "achskw1.1.lis": b"# two\n"}


def test_failed_gate_leaves_the_list_of_the_user_in_its_place(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    job.write_text(job.read_text() + "[gate]\nmax_correction = 0.001\n")
    (tmp_path / "achskw1.lis").write_bytes(b"# mine\n")
    result = run_job(job, tmp_path)
    assert not result.passed
    assert (tmp_path / "achskw1.lis").read_bytes() == b"# mine\n"
    assert any("is not of this run" in remark.message for remark in result.remarks)


MESH = """[bed_mesh {name}]
version = 1
points =
  {rows}
x_count = 4
y_count = 3
min_x = 10.0
max_x = 70.0
min_y = 5.0
max_y = 65.0
"""
MESH_JOB = """
[axes.A]
number = 7
[axes.B]
number = 8
[axes.C]
number = 9
[measurements.bed]
file = "printer.cfg"
remove = "none"
{profile}
[[fits]]
compensation = "plane"
axis = "C"
masters = ["A", "B"]
measurement = "bed"
smoothness = 0
loss = "gauss"
"""


def mesh_job(folder: Path, profile: str = "") -> Path:
    texts = []
    for name, step in (("default", 0.01), ("warm", 0.02)):
        cells = [[step * (i + 10 * j) for i in range(4)] for j in range(3)]
        rows = "\n  ".join(", ".join(f"{z:.6f}" for z in row) for row in cells)
        texts.append(MESH.format(name=name, rows=rows))
    (folder / "printer.cfg").write_text("\n".join(texts))
    job = folder / "job.toml"
    job.write_text(MESH_JOB.format(profile=profile))
    return job


def test_mesh_gives_the_nodes_and_its_axes_are_those_of_the_fit(
    tmp_path: Path,
) -> None:
    fit = run_job(mesh_job(tmp_path), tmp_path / "out").tables[0]
    assert [nodes.tolist() for nodes in fit.nodes] == [
        [10.0, 30.0, 50.0, 70.0],
        [5.0, 35.0, 65.0],
    ]
    expected = -0.01 * (np.arange(4) + 10 * np.arange(3)[:, None])
    # Whole list units, and every node rests on its own reading.
    np.testing.assert_allclose(fit.table[""], expected, atol=1e-9)


def test_profile_of_a_mesh_is_chosen_in_the_job(tmp_path: Path) -> None:
    job = mesh_job(tmp_path, 'profile = "warm"')
    fit = run_job(job, tmp_path / "out").tables[0]
    assert fit.table[""][0, 1] == pytest.approx(-0.02)


def test_profile_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    job = mesh_job(tmp_path, 'profile = "cold"')
    with pytest.raises(Exception, match="found profiles default, warm, expected 'cold"):
        run_job(job, tmp_path / "out")


def test_profile_of_a_file_without_profiles_is_refused(tmp_path: Path) -> None:
    job = write_job(tmp_path)
    old = 'file = "laser.csv"'
    job.write_text(job.read_text().replace(old, f'{old}\nprofile = "default"'))
    with pytest.raises(JobError, match=r"profile: found CSV in laser\.csv, expected"):
        run_job(job, tmp_path / "out")


def test_interrupt_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    job = write_job(tmp_path)

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("axcomp.ident.job._run.fit_all", interrupted)
    assert main(["fit", str(job), "--out", str(tmp_path / "out")]) == 130
    assert capfd.readouterr().err == "axcomp: interrupted\n"
    assert not (tmp_path / "out").exists()


def test_interrupt_that_python_dropped_comes_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sent = threading.Event()
    monkeypatch.setattr("os.kill", lambda *_: sent.set())
    lost = SimpleNamespace(exc_type=KeyboardInterrupt)
    _again(lost)  # type: ignore[arg-type]
    # It comes 20 ms later; a busy machine may take its time.
    assert sent.wait(10.0)


def test_hook_for_dropped_errors_is_put_back(tmp_path: Path) -> None:
    before = sys.unraisablehook
    main(["fit", str(tmp_path / "none.toml")])
    assert sys.unraisablehook is before


@pytest.mark.parametrize(
    ("entries", "match"),
    [
        ("kw.ssfk.unit 1\nkw.ssfk.interval 9\nkw.ssfk.kw_nr_max 2147483647\n"
         "kw.ssfk.table[0].pos 1\n", "kw_nr_max: found 2147483647 values, expected"),
        ("kw.crosscomp.unit 1\nkw.crosscomp.last_index 2147483646\n"
         "kw.crosscomp.master_ax_nr 1\nkw.crosscomp.table[0].setpoint 1\n",
         "last_index: found 2147483647 values, expected at most"),
        ("kw.crosscomp2.unit 1\nkw.crosscomp2.interval 9\n"
         "kw.crosscomp2.last_index_master1 99999\n"
         "kw.crosscomp2.last_index_master2 99999\n"
         "kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n"
         "kw.crosscomp2.table[0][0].correction 1\n",
         "last_index_master1 and 2: found 10000000000 values, expected at most"),
    ],
)  # fmt: skip
def test_mistyped_size_of_a_table_does_not_fill_the_memory(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], entries: str, match: str
) -> None:
    (tmp_path / "a.lis").write_text(f"kopf.achs_nr 1\n{entries}")
    (tmp_path / "m.csv").write_text("A1.position,A2.position\n1,1\n2,2\n")
    motion = str(tmp_path / "m.csv")
    assert main(["simulate", str(tmp_path / "a.lis"), "--motion", motion]) == 1
    assert match in capfd.readouterr().err


@pytest.mark.parametrize("cell", ["nan", "inf", "foo", ""])
def test_single_column_with_a_bad_cell_keeps_its_header(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], cell: str
) -> None:
    (tmp_path / "a.lis").write_text("kopf.achs_nr 1\n")
    (tmp_path / "m.csv").write_text(f"A1.position,A2.position\n1,1\n{cell},2\n")
    (tmp_path / "one.csv").write_text(f"A1.position\n1\n{cell or 'oops'}\n")
    for name in ("m.csv", "one.csv"):
        motion = str(tmp_path / name)
        assert main(["simulate", str(tmp_path / "a.lis"), "--motion", motion]) == 1
        assert f"{name}:3: column 'A1.position': found" in capfd.readouterr().err


def test_folder_that_a_file_cannot_be_written_to_is_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.lis").write_text(
        "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 9\nkw.ssfk.kw_nr_max 1\n"
        "kw.ssfk.table[0].pos 1\n"
    )
    (tmp_path / "m.csv").write_text("A1.position\n1\n2\n")
    target = tmp_path / "none" / "o.csv"
    arguments = ["--motion", str(tmp_path / "m.csv"), "--out", str(target)]
    assert main(["simulate", str(tmp_path / "a.lis"), *arguments]) == 2
    assert f"found {target.parent}, which does not exist" in capfd.readouterr().err


def contradicted(folder: Path) -> Path:
    """Write a job on readings at its nodes, three of which contradict all others."""
    job, file = write_job(folder), folder / "laser.csv"
    head, *rows = file.read_text().splitlines()
    kept = [row for row in rows if float(row.split(",")[0]) % 100 == 0]
    file.write_text("\n".join([head, *kept]) + "\n")
    for row, cell in ((6, "1.1"), (7, "1.2"), (8, "1.3")):
        spoil(folder, row, cell)
    return job


def test_readings_that_contradict_all_others_are_followed_to_their_middle(
    tmp_path: Path,
) -> None:
    fit = run_job(contradicted(tmp_path), tmp_path / "out").tables[0]
    assert fit.fit.converged
    # The median of three readings, and not some place on the way to it.
    assert fit.fit.values[2] == pytest.approx(1.2, abs=1e-3)
    assert not fit.passed


def test_fit_that_does_not_settle_fails_its_gate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # With so few passes no robust fit comes to rest.
    monkeypatch.setattr("axcomp.ident.core._robust._PASSES", 1)
    fit = run_job(write_job(tmp_path), tmp_path / "out").tables[0]
    assert [check.name for check in fit.gate if not check.passed] == ["settled"]
    assert any("did not settle: its values are not" in r.message for r in fit.remarks)
    assert not (tmp_path / "out" / "achskw1.lis").exists()
