"""A backlash job: from readings in both directions to the entries of the axis list."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check
from axcomp.ident.job import BacklashResult, JobError, run_job
from axcomp.ident.kinds.backlash.page import body
from axcomp.ident.report import headline_of, write_report
from axcomp.ident.report._scale import Scale

WIDTH = 0.0123
NOISE = 0.0004

JOB = """
[axes.X]
number = 1
{axis}
[measurements.dial]
file = "dial.csv"
axis = "X"
active = {active}
{columns}
[[fits]]
compensation = "backlash"
axis = "X"
measurement = "dial"
"""


def readings(folder: Path, width: float = WIDTH, runs: int = 4) -> None:
    """A dial gauge at 12 places: a screw error common to both ways, and the play."""
    rng = np.random.default_rng(3)
    rows = ["target,error,run,direction"]
    for run in range(1, runs + 1):
        for way in (1, -1):
            for x in np.linspace(0.0, 330.0, 12)[::way]:
                error = 0.02 * np.sin(x / 60.0) - 0.5 * way * width
                error += NOISE * rng.normal()
                rows.append(f"{x},{error:.6f},{run},{way}")
    (folder / "dial.csv").write_text("\n".join(rows) + "\n")


def run(
    folder: Path, axis: str = "", active: str = "[]", columns: str = ""
) -> BacklashResult:
    path = folder / "job.toml"
    path.write_text(JOB.format(axis=axis, active=active, columns=columns))
    result = run_job(path, folder / "out").fits[0]
    assert isinstance(result, BacklashResult)
    return result


def test_entries_for_an_axis_list_that_nobody_gave_ask_for_a_restart(
    tmp_path: Path,
) -> None:
    readings(tmp_path)
    run(tmp_path)
    sheet = json.loads((tmp_path / "out" / "result.json").read_text())["load_sheet"]
    actions = {step["action"] for step in sheet}
    # Without a compensation list there is nothing to reload.
    assert "Restart the controller" in actions
    assert "Reload the lists" not in actions


def test_size_comes_back_within_its_deviation(tmp_path: Path) -> None:
    readings(tmp_path)
    found = run(tmp_path)
    # 3 standard deviations, one seeded draw.
    assert abs(found.width - WIDTH) <= 3 * found.fit.standard_deviation
    assert found.fit.standard_deviation < NOISE


def test_written_entries_take_the_reversal_error_away(tmp_path: Path) -> None:
    readings(tmp_path)
    found = run(tmp_path)
    # Half the width to either side, and then only the noise of the readings.
    assert found.error["before"].rms == pytest.approx(WIDTH / 2, rel=0.05)
    assert found.error["from_file"].rms < 1.2 * NOISE
    assert found.error["predicted"].rms < 1.4 * NOISE


def test_backlash_that_does_not_settle_fails_its_gate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # With so few passes no robust fit comes to rest.
    monkeypatch.setattr("axcomp.ident.core._robust._PASSES", 1)
    readings(tmp_path)
    found = run(tmp_path)
    assert [check.name for check in found.gate if not check.passed] == ["settled"]
    assert not (tmp_path / "out" / "achsmds1.add.lis").exists()


def test_fragment_holds_size_selection_and_cycles_and_nothing_else(
    tmp_path: Path,
) -> None:
    readings(tmp_path)
    found = run(tmp_path)
    listing = ListFile.read(tmp_path / "out" / "achsmds1.add.lis")
    assert listing.integer("lr_param.anwahl_losekomp") == 1
    assert listing.integer("getriebe[0].lose") == round(found.width * 1e4)
    assert listing.integer("lr_param.n_backlash_cyc") == found.cycles
    assert not (tmp_path / "out" / "achskw1.lis").exists()
    assert [f for f in check([listing]) if f.level != "info"] == []


def test_existing_axis_list_keeps_its_reference_flank(tmp_path: Path) -> None:
    readings(tmp_path)
    (tmp_path / "achsmds1.lis").write_text(
        "kopf.achs_nr 1\nlr_param.anwahl_losekomp 2\ngetriebe[0].lose 90\n"
    )
    found = run(tmp_path, axis='machine_data = "achsmds1.lis"')
    edited = ListFile.read(tmp_path / "out" / "achsmds1.lis")
    assert edited.integer("lr_param.anwahl_losekomp") == 2
    assert found.reference == -1


def test_cycles_spread_all_that_moves_the_axis_at_a_reversal(tmp_path: Path) -> None:
    # 9.8 µm want 2 cycles; beside the 4 µm that a table of both directions adds, 3.
    readings(tmp_path, width=0.0098)
    alone = run(tmp_path)
    rows = [f"kw.ssfk.table[{k}].pos -20\nkw.ssfk.table[{k}].neg 20\n" for k in (0, 1)]
    (tmp_path / "achskw1.lis").write_text(
        "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.bilateral 1\n"
        "kw.ssfk.kw_nr_max 2\nkw.ssfk.kw_startpos 0\nkw.ssfk.interval 3300000\n"
        + "".join(rows)
    )
    beside = run(tmp_path, axis='list = "achskw1.lis"', active='["leadscrew"]')
    assert (alone.cycles, beside.cycles) == (2, 3)
    assert all(line.passed for line in beside.gate)
    listing = ListFile.read(tmp_path / "out" / "achsmds1.add.lis")
    assert listing.integer("lr_param.n_backlash_cyc") == 3


def test_active_backlash_is_added_to(tmp_path: Path) -> None:
    readings(tmp_path, width=WIDTH - 0.009)
    (tmp_path / "achsmds1.lis").write_text(
        "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 90\n"
    )
    found = run(tmp_path, axis='machine_data = "achsmds1.lis"', active='["backlash"]')
    # The list unit of 0.1 µm adds to 3 standard deviations.
    assert abs(found.width - WIDTH) <= 3 * found.fit.standard_deviation + 1e-4
    assert found.error["from_file"].rms < 1.2 * NOISE


@pytest.mark.parametrize(
    ("play", "where"), [(WIDTH, "positive"), (0.0, "none"), (-WIDTH, "negative")]
)
def test_the_play_is_named_by_its_own_sign_where_entries_acted(
    play: float, where: str, tmp_path: Path
) -> None:
    # All three are measured as less than nothing.
    readings(tmp_path, width=play - 0.02)
    (tmp_path / "achsmds1.lis").write_text(
        "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 200\n"
    )
    found = run(tmp_path, axis='machine_data = "achsmds1.lis"', active='["backlash"]')
    # 3 standard deviations, one seeded draw.
    assert abs(found.width - play) <= 3 * found.fit.standard_deviation
    assert found.type.startswith(f"{where}:")
    assert any(one.message.startswith(where.capitalize()) for one in found.remarks)


@pytest.mark.parametrize("active", ["[]", '["backlash"]'])
def test_a_backlash_that_was_off_and_stays_on_where_none_shows_is_named(
    active: str, tmp_path: Path
) -> None:
    readings(tmp_path, width=0.0)
    (tmp_path / "achsmds1.lis").write_text(
        "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 90\n"
    )
    found = run(tmp_path, axis='machine_data = "achsmds1.lis"', active=active)
    loud = [each.message for each in found.remarks if each.level == "error"]
    # What acted while measuring is in the readings: nothing more is wanted.
    assert len(loud) == (active == "[]")
    assert found.judgement.verdict == ("undetermined" if loud else "good")
    assert all("achsmds1.lis stays on" in words for words in loud)
    assert found.files == ()
    # What concerns one fit is said of it alone.
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written["remarks"] == []


def test_active_without_axis_list_is_refused(tmp_path: Path) -> None:
    readings(tmp_path)
    with pytest.raises(JobError, match="no axis list that switches it on is given"):
        run(tmp_path, active='["backlash"]')


def test_a_backlash_behind_a_wandering_zero_is_not_called_none(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    places = np.linspace(0.0, 330.0, 12)
    rows, zero = ["t,target,error,way"], 0.0
    for row in range(48):
        way = 1 if row // 12 % 2 == 0 else -1
        zero += 2e-3 * rng.normal()
        x = places[::way][row % 12]
        rows.append(f"{60 * row},{x},{zero - 1e-3 * way:.6f},{way}")
    (tmp_path / "dial.csv").write_text("\n".join(rows) + "\n")
    names = '"X.position" = "target", "X.error" = "error", "X.direction" = "way"'
    columns = f'columns = {{ time = "t", {names} }}'
    job = JOB.format(axis="", active="[]", columns=columns)
    (tmp_path / "job.toml").write_text(job)
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    assert not result.passed
    said = [one.message for one in result.fits[0].remarks if one.level == "error"]
    assert any("do not tell whether there is a backlash" in words for words in said)


def test_no_backlash_writes_nothing_and_says_so(tmp_path: Path) -> None:
    readings(tmp_path, width=0.0)
    found = run(tmp_path)
    assert not (tmp_path / "out" / "achsmds1.add.lis").exists()
    assert any("No backlash shows" in remark.message for remark in found.remarks)
    scale = Scale("mm", "µm")
    assert "with the list" not in headline_of(found, scale).sentence


def test_a_list_of_another_fit_is_none_of_a_backlash_that_is_not_written(
    tmp_path: Path,
) -> None:
    readings(tmp_path, width=0.0)
    path = tmp_path / "job.toml"
    path.write_text(
        JOB.format(axis="", active="[]", columns='remove = "none"')
        + '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "dial"\n'
        "start = 0.0\ninterval = 30.0\npoints = 12\n"
    )
    found, screw = run_job(path, tmp_path / "out").fits
    assert {file.name for file in screw.files} == {"achskw1.lis", "achsmds1.add.lis"}
    assert found.files == ()
    # Not of a list that would not help: there is none.
    assert [str(one.code) for one in found.judgement.reasons] == ["nothing_written"]


def test_the_labels_of_the_picture_are_not_cut_off(tmp_path: Path) -> None:
    readings(tmp_path)
    (plot,) = body(run(tmp_path), Scale("mm", "µm")).plots
    plot.figure.draw_without_rendering()
    for axes in plot.figure.axes:
        for label in (axes.xaxis.label, axes.yaxis.label):
            box = label.get_window_extent()
            assert box.y0 >= 0.0, label.get_text()
            assert box.y1 <= plot.figure.bbox.y1, label.get_text()


def of_trace(
    folder: Path, time: np.ndarray, place: np.ndarray, actual: np.ndarray
) -> BacklashResult:
    table = np.column_stack([time, place, actual])
    np.savetxt(folder / "dial.csv", table, "%.6f", ",", header="t,enc,ref", comments="")
    columns = (
        "[measurements.dial.columns]\n"
        'time = { column = "t", unit = "s" }\n'
        '"X.position" = { column = "enc", unit = "mm" }\n'
        '"X.encoder" = { column = "enc", unit = "mm" }\n'
        '"X.actual" = { column = "ref", unit = "mm" }\n'
    )
    return run(folder, columns=columns)


def test_trace_over_reversals_gives_the_size_too(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 60.0, 0.01)
    # Two amplitudes, so that reversals differ in speed and a delay would show.
    size = np.where(time < 30.0, 20.0, 35.0)
    place = size * np.sin(2 * np.pi * time / 6.0)
    way = np.where(np.cos(2 * np.pi * time / 6.0) >= 0, 1.0, -1.0)
    actual = place - 0.5 * way * WIDTH + NOISE * rng.normal(size=time.size)
    found = of_trace(tmp_path, time, place, actual)
    # 4 standard deviations, one seeded draw; and the deviation must mean something.
    assert abs(found.width - WIDTH) <= 4 * found.fit.standard_deviation
    assert found.fit.standard_deviation < 0.1 * WIDTH


def test_an_instrument_that_is_late_contradicts_no_error(tmp_path: Path) -> None:
    time = np.arange(0.0, 40.0, 0.005)
    # One feed: lost motion and what the instrument is late by go the same way.
    ramp = np.clip(np.abs(time % 8.0 - 4.0) - 2.0, -1.9, 1.9)
    place = np.convolve(np.pad(50.0 * ramp, 20, "edge"), np.full(41, 1 / 41), "valid")
    way = np.sign(np.gradient(place))
    true = place - 0.5 * way * WIDTH
    actual = np.interp(time - 0.006, time, true)
    actual += NOISE * np.random.default_rng(5).normal(size=time.size)
    found = of_trace(tmp_path, time, place, actual)
    assert abs(found.width - WIDTH) <= 4 * found.fit.standard_deviation


def test_result_and_report_say_what_was_found(tmp_path: Path) -> None:
    readings(tmp_path)
    path = tmp_path / "job.toml"
    path.write_text(JOB.format(axis="", active="[]", columns=""))
    result = run_job(path, tmp_path / "out")
    tree = json.loads((tmp_path / "out" / "result.json").read_text())["fits"][0]
    assert tree["parameters"]["backlash"] == pytest.approx(WIDTH, abs=NOISE)
    assert tree["standard_deviations"]["backlash"] > 0
    page, *plots = write_report(result, tmp_path / "out")
    text = page.read_text()
    assert "play between drive and slide" in text
    assert "NaN" not in text
    assert len(plots) == 1


def test_backlash_beside_a_bilateral_leadscrew_is_refused(tmp_path: Path) -> None:
    readings(tmp_path)
    path = tmp_path / "job.toml"
    second = (
        '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "dial"\n'
        "bilateral = true\nstart = 0.0\ninterval = 30.0\npoints = 12\n"
    )
    path.write_text(JOB.format(axis="", active="[]", columns="") + second)
    with pytest.raises(JobError, match="both of which compensate the reversal"):
        run_job(path, tmp_path / "out")


@pytest.mark.parametrize("drift", [0.0, 0.01])
def test_a_drift_over_passes_that_alternate_is_told_with_the_width_less_it(
    tmp_path: Path, drift: float
) -> None:
    readings(tmp_path, runs=5)
    lines = (tmp_path / "dial.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    for k, row in enumerate(rows):
        row[1] = f"{float(row[1]) + drift * k / len(rows):.6f}"
    text = "\n".join([lines[0], *map(",".join, rows)]) + "\n"
    (tmp_path / "dial.csv").write_text(text)
    said = [each.message for each in run(tmp_path).remarks]
    told = [each for each in said if each.startswith("The readings drift by 10 µm")]
    assert len(told) == (drift > 0.0)
    # The width is 12.3 µm, known to 0.1 µm; a drift of 1 µm from pass to pass adds as much.
    widths = [
        re.findall(r"width is ([\d.]+) µm, not (\d+\.\d+)", each) for each in told
    ]
    assert all(abs(float(w[0][0]) - 12.3) < 0.3 for w in widths)
    assert all(abs(float(w[0][1]) - 13.3) < 0.3 for w in widths)
