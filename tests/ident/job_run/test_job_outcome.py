"""What a job says and leaves behind beside its tables."""

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check
from axcomp.data.toml import TomlError
from axcomp.ident.job import TableResult, run_job
from axcomp.ident.job.write._output import OutFolder
from axcomp.ident.report import write_report

from .screw import (
    LIST_UNIT,
    OLD_LIST,
    laser,
    offsets,
    old_list,
    screw_error,
    screw_job,
    state_conventions,
    table,
)


def test_written_lists_have_no_error_and_no_warning(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    files = [ListFile.read(path) for path in (tmp_path / "out").glob("*.lis")]
    assert len(files) == 3
    found = [*check(files), *(item for file in files for item in check([file]))]
    assert [item for item in found if item.level != "info"] == []


def test_fragment_names_no_whole_list(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"achskw1.lis", "achsmds1.add.lis", "hochlauf.add.lis"} <= names
    assert {"cnc_objects.csv", "compensations.tcscopex"} <= names
    assert "achsmds1.lis" not in names
    assert "hochlauf.lis" not in names


def test_datum_makes_the_table_zero_there(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv", offset=0.05)
    plain = run_job(screw_job(tmp_path), tmp_path / "out")
    at_zero = run_job(
        screw_job(tmp_path, measurement="datum = { at = 200.0 }"), tmp_path / "out"
    )
    pos, neg = (at_zero.tables[0].table[name][2] for name in ("pos", "neg"))
    # Mean of both directions, up to rounding of each.
    assert 0.5 * (pos + neg) == pytest.approx(0.0, abs=LIST_UNIT)
    whole = plain.tables[0].table["pos"] - at_zero.tables[0].table["pos"]
    # All nodes move by the same constant: 50 µm and the mean of 20 and 14 µm.
    np.testing.assert_allclose(whole, 0.05 + 0.017, atol=3e-4)


def test_run_effects_leave_reversal_and_mean_alone(tmp_path: Path) -> None:
    # Runs numbered per direction, each with an offset of its own.
    rng = np.random.default_rng(13)
    there = np.arange(0.0, 401.0, 50.0)
    rows = []
    for k in range(6):
        sense = 1 if k % 2 == 0 else -1
        own = np.full(len(there), sense)
        path = there[::sense]
        error = screw_error(path, own) + 2e-3 * (k // 2 - 1)
        rows.append((path, error, np.full(len(there), k + 1), own))
    target, error, run, direction = (np.concatenate(part) for part in zip(*rows))  # noqa: B905
    error = error + 1e-4 * rng.standard_normal(len(error))
    table(
        tmp_path / "laser.csv", "target,actual,run,direction",
        target, target + error, run, direction,
    )  # fmt: skip
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    nodes = np.arange(0.0, 401.0, 100.0)
    ones = np.ones(5, dtype=np.int64)
    found = result.tables[0].table
    np.testing.assert_allclose(found["pos"], screw_error(nodes, ones), atol=5e-4)
    np.testing.assert_allclose(found["neg"], screw_error(nodes, -ones), atol=5e-4)
    assert len(result.tables[0].fit.runs) == 3


def test_second_fit_of_an_axis_takes_what_the_first_leaves(tmp_path: Path) -> None:
    rng = np.random.default_rng(17)
    x, y = (
        a.ravel() for a in np.meshgrid(np.arange(0, 101, 10.0), np.arange(0, 51, 10.0))
    )
    truth = 3e-4 * x + 2e-4 * y
    noise = 1e-4 * rng.standard_normal(len(x))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, truth + noise)
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [0, 100]
[axes.Y]
number = 2
[axes.Z]
number = 3
[measurements.probe]
file = "probe.csv"
remove = "none"
columns = { "X.position" = "x", "Y.position" = "y", "Z.error" = "dz" }
[[fits]]
compensation = "cross"
axis = "Z"
master = "X"
measurement = "probe"
smoothness = 10
start = 0.0
interval = 50.0
points = 3
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 10
start = [0.0, 0.0]
interval = [50.0, 50.0]
points = [3, 2]
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 3, A1=x, A2=y)
    # Both tables together correct once; each alone for all of it would double.
    assert np.max(np.abs(left)) < 4e-4
    assert any("earlier fit" in r.message for r in result.tables[1].remarks)


def test_result_holds_what_the_interface_promises(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    run_job(screw_job(tmp_path), tmp_path / "out")
    text = (tmp_path / "out" / "result.json").read_text()
    found = json.loads(text)
    assert "NaN" not in text
    assert {"inputs", "versions", "wall_time"} <= set(found)
    assert set(found["inputs"]) == {"job.toml", "laser.csv"}
    fit = found["fits"][0]
    for key in (
        "compensation", "axis", "parameters", "standard_deviations", "support",
        "noise", "smoothness", "error", "gate", "findings", "conventions",
    ):  # fmt: skip
        assert key in fit
    assert set(fit["parameters"]["table"]) == {"pos", "neg"}
    assert np.shape(fit["support"]["neg"]) == (5,)
    for stage in ("before", "predicted", "from_file"):
        assert {"rms", "max", "A", "R", "B", "E", "M"} <= set(fit["error"][stage])
    states = {item["name"]: item["state"] for item in fit["conventions"]}
    assert states["leadscrew_sign"] == "assumed"


def test_conventions_of_the_machine_turn_the_sign(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    plain = run_job(job, tmp_path / "out")
    (tmp_path / "mill.toml").write_text("leadscrew_sign = 1\n")
    state_conventions(job)
    turned = run_job(job, tmp_path / "out")
    np.testing.assert_array_equal(
        turned.tables[0].table["pos"], -plain.tables[0].table["pos"]
    )
    states = {rule.name: rule.state for rule in turned.tables[0].conventions}
    assert states["leadscrew_sign"] == "verified"
    assert states["start_direction"] == "assumed"


def test_unknown_convention_names_the_nearest(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    (tmp_path / "mill.toml").write_text("leadscrew_sing = 1\n")
    state_conventions(job)
    with pytest.raises(TomlError, match=r"mill.toml:1: .*'leadscrew_sign'"):
        run_job(job, tmp_path / "out")


def test_gantry_partner_without_a_table_is_a_warning(tmp_path: Path) -> None:
    x = np.linspace(0.0, 100.0, 21)
    table(tmp_path / "edge.csv", "x,dy", x, 1e-4 * np.sin(x))
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [0, 100]
[axes.Y]
number = 2
gantry = "Y2"
[axes.Y2]
number = 5
[measurements.edge]
file = "edge.csv"
remove = "none"
columns = { "X.position" = "x", "Y.error" = "dy" }
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "edge"
smoothness = 1
start = 0.0
interval = 25.0
points = 5
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    warned = [r.message for r in result.tables[0].remarks if r.level == "warning"]
    assert any(
        "axis 5, gantry partner of axis 2, has no list" in text for text in warned
    )
    assert result.passed


def test_table_that_was_off_and_stays_in_the_list_is_named(tmp_path: Path) -> None:
    raw = OLD_LIST.replace("µ", "u").replace(
        "table[1].correction 0", "table[1].correction 50"
    )
    (tmp_path / "achskw1.lis").write_bytes(raw.encode("latin-1"))
    laser(tmp_path / "laser.csv")
    off = run_job(screw_job(tmp_path, axis='list = "achskw1.lis"'), tmp_path / "out")
    assert any("also holds a cross table that was off" in r.message
               for r in off.tables[0].remarks)  # fmt: skip
    on = run_job(
        screw_job(
            tmp_path, axis='list = "achskw1.lis"', measurement='active = ["cross"]'
        ),
        tmp_path / "out",
    )
    assert not any("that was off" in r.message for r in on.tables[0].remarks)


def test_load_sheet_tells_files_order_check_and_the_way_back(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    text = "\n".join(f"{step.action}: {step.detail}" for step in result.load_sheet)
    for word in (
        "achskw1.lis", "achsmds1.add.lis", "hochlauf.add.lis", "Restart the controller",
        "X[COMP ON LEAD]", "V.A.LEAD_COMP_ACTIVE.X", "P-AXIS-00465", "Go back",
        "computed, not verified",
    ):  # fmt: skip
        assert word in text
    old_list(tmp_path)
    again = run_job(screw_job(tmp_path, axis='list = "achskw1.lis"'), tmp_path / "out")
    assert "Reload the lists" in {step.action for step in again.load_sheet}


def test_load_sheet_loads_as_diff_says_and_once_for_all_axes(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    old_list(tmp_path)
    (tmp_path / "achsmds1.lis").write_text("kenngr.achs_nr 1\n")
    axis = 'list = "achskw1.lis"\nmachine_data = "achsmds1.lis"'
    path = screw_job(tmp_path, axis=axis)
    first = run_job(path, tmp_path / "out")
    steps = {step.action: step.detail for step in first.load_sheet}
    # What `axcomp diff` says of the axis list.
    assert "an axis list" in steps["Restart the controller"]
    assert "Reload the lists" not in steps
    actions = [step.action for step in first.load_sheet]
    assert actions.count("Restart the controller") == 1
    for name in ("achskw1.lis", "achsmds1.lis"):
        (tmp_path / name).write_bytes((tmp_path / "out" / name).read_bytes())
    again = {step.action for step in run_job(path, tmp_path / "out").load_sheet}
    assert {"Leave achskw1.lis as it is", "Leave achsmds1.lis as it is"} <= again
    assert not again & {"Restart the controller", "Reload the lists"}
    assert not any("Replace" in action or "Keep a copy" in action for action in again)


def test_load_sheet_asks_for_one_restart_for_two_new_lists(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    path = screw_job(tmp_path)
    text = path.read_text()
    fit = "[[fits]]" + text.partition("[[fits]]")[2]
    second = fit.replace('axis = "X"', 'axis = "Y"').replace('"laser"', '"other"')
    text = text.replace(
        "[measurements.laser]", "[axes.Y]\nnumber = 2\n[measurements.laser]"
    )
    measured = '[measurements.other]\nfile = "laser.csv"\naxis = "Y"\nremove = "none"\n'
    path.write_text(text + measured + second)
    actions = [step.action for step in run_job(path, tmp_path / "out").load_sheet]
    assert actions.count("Restart the controller") == 1


def test_a_few_runs_leave_doubt_of_their_mean_unless_a_datum_takes_it_off(
    tmp_path: Path,
) -> None:
    runs = np.array([2.0, -1.0, 3.0, -2.0, 1.0])  # µm
    laser(tmp_path / "laser.csv", runs=5, offset=1e-3 * np.repeat(runs, 18))
    deviation = []
    for measurement in ("", "datum = { at = 200.0 }"):
        done = run_job(screw_job(tmp_path, measurement=measurement), tmp_path / "out")
        found = done.fits[0]
        assert isinstance(found, TableResult)
        deviation.append(found.standard_deviation["pos"])
    # s/√5, times half the two-sided quantile of Student's t with 4 degrees of freedom that
    # holds what two deviations of a normal variable do; 0.1 µm of noise is a per cent of it.
    expected = 1e-3 * runs.std(ddof=1) / np.sqrt(5) * 2.869 / 2
    np.testing.assert_allclose(deviation[0], expected, rtol=0.03)
    assert deviation[1].max() < 0.1 * expected


def test_a_job_whose_name_is_no_utf_8_has_its_report(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    name = os.fsdecode(b"m\xfchle.toml")
    job = screw_job(tmp_path).rename(tmp_path / name)
    write_report(run_job(job, tmp_path / "out"), tmp_path / "out")
    assert (tmp_path / "out" / "report.html").is_file()


def test_termination_while_lists_are_written_waits_for_their_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    def renew(self: OutFolder, *names: Any, **how: Any) -> tuple[Path, ...]:
        signal.raise_signal(signal.SIGTERM)
        return plain(self, *names, **how)

    plain = OutFolder.renew
    monkeypatch.setattr(OutFolder, "renew", renew)
    laser(tmp_path / "laser.csv")
    before = signal.signal(signal.SIGTERM, stop)
    try:
        with pytest.raises(KeyboardInterrupt):
            run_job(screw_job(tmp_path), tmp_path / "out")
    finally:
        signal.signal(signal.SIGTERM, before)
    written = json.loads((tmp_path / "out" / "result.json").read_text())["digests"]
    assert "achskw1.lis" in written


def test_wild_readings_of_one_place_are_named_once_with_their_number(
    tmp_path: Path,
) -> None:
    # The file states no run: the readings of a place differ by nothing that could be named.
    laser(tmp_path / "laser.csv", runs=9)
    _, *rows = (tmp_path / "laser.csv").read_text().splitlines()
    cells = [row.split(",")[:-2] + row.split(",")[-1:] for row in rows]
    for k in (0, 18):
        cells[k + 3][1] = str(float(cells[k + 3][1]) + 0.2)
    lines = ["target,actual,direction", *(",".join(row) for row in cells)]
    (tmp_path / "laser.csv").write_text("\n".join(lines) + "\n")
    job = screw_job(tmp_path)
    job.write_text(job.read_text().replace('loss = "gauss"', ""))
    (fit,) = run_job(job, tmp_path / "out").fits
    words = " ".join(remark.message for remark in fit.remarks)
    assert "Wild readings lie at X = 150, positive (2 of them)." in words


def test_a_measurement_that_no_fit_uses_is_named(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    spare = '[measurements.lasr]\nfile = "laser.csv"\n[[fits]]'
    job.write_text(job.read_text().replace("[[fits]]", spare))
    told = [one.message for one in run_job(job, tmp_path / "out").remarks]
    assert [words for words in told if "no fit" in words] == [
        "Measurement 'lasr' is used by no fit."
    ]
