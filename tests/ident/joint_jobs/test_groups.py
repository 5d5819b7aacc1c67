"""Fits that share a group: identified together, written and proven like single ones."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.job import (
    BacklashResult,
    JobError,
    JobResult,
    LeftOutResult,
    TableResult,
    TemperatureResult,
    load_job,
    run_job,
)
from axcomp.ident.report import write_report

from . import machine as m


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("together")
    m.probe(900).write(made)
    return made


@pytest.fixture(scope="module")
def result(folder: Path) -> JobResult:
    """Everything at once: five effects on two axes, one group."""
    found = run_job(m.job(folder, m.EVERYTHING), folder / "out")
    write_report(found, folder / "out")
    return found


def test_whole_sum_leaves_the_noise_on_readings_that_the_fit_did_not_see(
    result: JobResult,
) -> None:
    assert result.passed
    for one in result.groups[0].axes:
        # 900 readings: their rms is known to 2.4 %; 3 of those, and rounding.
        assert one.error["predicted"].sound.rms < 1.08 * m.NOISE
        assert one.error["before"].sound.rms > 8 * m.NOISE


def test_passes_that_come_back_to_a_place_predict_each_other(tmp_path: Path) -> None:
    rng, there = np.random.default_rng(11), np.linspace(0.0, 400.0, 21)
    x = np.tile([*there, *there[::-1]], 4)
    way = np.tile(np.repeat([1.0, -1.0], 21), 4)
    error = 0.010 * np.sin(x / 60.0) + 2e-5 * x - 0.5 * m.WIDTH * (1.0 - way)
    error += m.NOISE * rng.normal(size=x.size)
    head = "X.position,X.direction,X.error"
    table = np.column_stack([x, way, error])
    np.savetxt(tmp_path / "probe.csv", table, "%.6f", ",", header=head, comments="")
    (one,) = (
        run_job(m.job(tmp_path, m.LEADSCREW + m.BACKLASH), tmp_path / "out")
        .groups[0]
        .axes
    )
    # The rms of 168 readings is known to 5.5 %, and three of four passes tell the curve to half
    # of the noise. Held out at one place of all passes, the end of the travel made it 1.0 µm.
    assert one.error["predicted"].sound.rms < 1.25 * m.NOISE


def test_all_written_files_together_leave_the_noise(result: JobResult) -> None:
    for one in result.groups[0].axes:
        # The files are fitted to these readings: a little less than the noise.
        assert one.error["from_file"].sound.rms < 1.05 * m.NOISE


def test_sum_of_a_group_is_what_its_files_add(folder: Path, result: JobResult) -> None:
    out, probe = folder / "out", m.probe(900)
    one = next(each for each in result.groups[0].axes if each.axis == "X")
    x, way, warm = (
        probe[name][one.rows]
        for name in ("X.position", "X.direction", "temperature.scale")
    )
    screw: Any = ListFile.read(out / "achskw1.lis").table("kw.ssfk", "pos")
    machine = ListFile.read(out / "achsmds1.add.lis")
    law = np.genfromtxt(out / "temperature_X.csv", delimiter=",", names=True)
    nodes = 25.0 * np.arange(len(screw))
    by_hand = -1e-4 * np.interp(x, nodes, [screw[k] for k in range(len(screw))])
    by_hand -= 1e-4 * (machine.integer("getriebe[0].lose") or 0) * (way < 0)
    by_hand += 1e-6 * np.interp(warm, law["temperature"], law["coefficient"]) * x
    # The table is looked up at the position with the other offsets: 20 µm at 0.1 µm/mm.
    np.testing.assert_allclose(one.from_file - one.before, by_hand, atol=1e-5)


def test_each_effect_comes_back_as_it_was_made(result: JobResult) -> None:
    screw, play, growth, _, warm = result.fits
    assert isinstance(play, BacklashResult)
    assert abs(play.width - m.WIDTH) < 4 * play.fit.standard_deviation
    assert isinstance(growth, TemperatureResult)
    assert growth.fit.coefficient is not None
    slope = growth.fit.coefficient.slope[0]
    # 5 K, 400 mm and 900 readings of 0.5 µm: 0.03e-6 per K; the sensor's own noise beside.
    assert slope == pytest.approx(m.GROWTH, abs=2e-7)
    assert isinstance(warm, TemperatureResult)
    assert warm.fit.offset.slope[0] == pytest.approx(-m.SPINDLE, rel=0.02)
    assert isinstance(screw, TableResult)
    # The table of 20 °C: the temperature takes nothing there.
    shown = screw.fit.values - m.screw(screw.nodes[0])
    # 25 mm cells of a wave of 346 mm: the chord lies 0.3 µm off, and 3 sd beside.
    assert np.abs(shown).max() < 4e-4 + 3 * float(screw.fit.standard_deviation.max())


def test_backlash_and_table_together_stand_on_the_reference_flank(
    result: JobResult, folder: Path
) -> None:
    machine = ListFile.read(folder / "out" / "achsmds1.add.lis")
    assert machine.integer("lr_param.anwahl_losekomp") == 1
    screw = result.fits[0]
    assert isinstance(screw, TableResult)
    # Moving positive the axis is right without backlash: the table starts at 0, not at
    # half the width (3 µm); its deviation there is 0.1 µm.
    assert abs(float(screw.fit.values[0])) < 5e-4


def test_result_names_shares_freedoms_and_the_sum(
    result: JobResult, folder: Path
) -> None:
    stored = json.loads((folder / "out" / "result.json").read_text())
    (group,) = stored["groups"]
    assert group["name"] == "all"
    assert group["fits"] == [0, 1, 2, 3, 4]
    assert [fit["group"] for fit in stored["fits"]] == ["all"] * 5
    assert len(group["effects"]) == 5
    assert all(effect["written"] for effect in group["effects"])
    sentences = " ".join(gauge["sentence"] for gauge in group["gauges"])
    assert "may be moved between the leadscrew of X and the" in sentences
    assert set(group["axes"]) == {"X", "Z"}
    assert set(group["axes"]["X"]["error"]) == {"before", "predicted", "from_file"}
    assert group["confusions"] == []


def test_report_shows_the_group_before_its_fits(
    result: JobResult, folder: Path
) -> None:
    page = (folder / "out" / "report.html").read_text()
    place = [
        page.index(f"{words}</h2>") for words in ("group all", "1. Leadscrew of X")
    ]
    assert place == sorted(place)
    for words in (
        "The whole error over time, before and after",
        "What these readings cannot tell apart",
        "What may be moved between effects without changing their sum",
        "what the rest of its group leaves of the error of X",
        "temperature of X (scale)",
    ):
        assert words in page
    assert (folder / "out" / "plots" / "group-1-sum.svg").is_file()
    assert result.groups[0].held_out == "block"


def test_group_of_one_is_that_fit_alone(folder: Path, tmp_path: Path) -> None:
    plane = m.PLANE.replace('group = "all"\n', "")
    results = []
    for name, fits in (("one", m.PLANE), ("alone", plane)):
        path = tmp_path / name
        path.mkdir()
        (path / "probe.csv").write_bytes((folder / "probe.csv").read_bytes())
        results.append(run_job(m.job(path, fits), path / "out").fits[0])
    one, alone = results
    assert isinstance(one, TableResult)
    assert isinstance(alone, TableResult)
    assert np.array_equal(one.table[""], alone.table[""])
    assert one.group is None


@pytest.mark.usefixtures("no_drawing")
def test_what_readings_cannot_tell_is_named_and_the_rest_written(
    tmp_path: Path,
) -> None:
    m.probe(900, rising=True).write(tmp_path)
    fits = m.LEADSCREW + m.BACKLASH + m.GROWING
    found = run_job(m.job(tmp_path, fits), tmp_path / "out")
    assert not found.passed
    left = [fit for fit in found.fits if isinstance(fit, LeftOutResult)]
    assert [fit.compensation for fit in left] == ["leadscrew", "temperature"]
    words = next(r.message for r in left[1].remarks if r.level == "error")
    assert "temperature of X (scale) is left out" in words
    assert "at another temperature" in words
    assert found.groups[0].confusions
    written = {str(file) for file in found.files}
    assert "achskw1.lis" not in written
    assert "temperature_X.csv" not in written
    # The backlash of X is told well.
    assert "achsmds1.add.lis" in written
    machine = ListFile.read(tmp_path / "out" / "achsmds1.add.lis")
    assert machine.integer("getriebe[0].lose") == pytest.approx(60, abs=2)  # 0.1 µm
    write_report(found, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "2 of 3 fits cannot be told from these readings" in page
    assert "Nothing: see the remarks above." in page


def test_active_table_of_a_group_becomes_old_plus_residual(
    folder: Path, result: JobResult, tmp_path: Path
) -> None:
    old = (folder / "out" / "achskw3.lis").read_text()
    (tmp_path / "old.lis").write_text(old)
    whole = result.fits[3]
    assert isinstance(whole, TableResult)
    probe = m.probe(900)
    # Measured with that list on: only what the spindle does is left of Z.
    left = m.table(probe["X.position"], probe["Y.position"])
    probe.columns["Z.error"] = probe["Z.error"] - left
    probe.write(tmp_path)
    path = m.job(tmp_path, m.PLANE + m.WARM, z='list = "old.lis"\n', active='["plane"]')
    found = run_job(path, tmp_path / "out").fits[0]
    assert isinstance(found, TableResult)
    moved = found.table[""] - whole.table[""]
    # The residual is noise: 900 readings over 63 nodes, 0.5 µm each.
    assert np.abs(moved).max() < 6e-4
    assert any("old +" in remark.message for remark in found.remarks)


GROUP = 'group = "all"\n'


@pytest.mark.parametrize(
    ("fits", "match"),
    [
        (m.PLANE + m.WARM.replace(GROUP, GROUP + 'loss = "gauss"\n'),
         r"fits\[1\]\.loss: found 'gauss' in group 'all', of which fits\[0\] has"),
        (m.PLANE + m.WARM.replace("lag =", "steady = { sensor = 's', within = 1.0 }\nlag ="),
         "steady: found in group 'all'"),
        (m.PLANE + m.WARM + m.BACKLASH.replace('"X"', '"Z"').replace(GROUP, ""),
         "probe, from which group 'all' explains the whole error of Z"),
        ('[[fits]]\ncompensation = "friction"\naxis = "X"\nmeasurement = "probe"\n' + GROUP,
         r"fits\[0\]\.group: found friction in group 'all': it works on the current"),
    ],
)  # fmt: skip
def test_what_cannot_be_one_fit_is_refused(
    folder: Path, tmp_path: Path, fits: str, match: str
) -> None:
    (tmp_path / "probe.csv").write_bytes((folder / "probe.csv").read_bytes())
    with pytest.raises(JobError, match=match):
        load_job(m.job(tmp_path, fits))


CONSTANT = """
[axes.X]
number = 1
limits = [0.0, 400.0]
[measurements.m]
file = "m.csv"
active = []
remove = "none"
[measurements.m.columns]
time = "t"
run = "run"
"X.position" = "x"
"X.direction" = "d"
"temperature.scale" = "T"
"X.error" = "e"
"""


def test_an_error_that_is_the_same_everywhere_is_judged_beside_a_law_of_zeros(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(3)
    place = np.tile(np.r_[0.0:401.0:25.0, 400.0:-1.0:-25.0], 8)
    way, run = np.tile(np.repeat([1, -1], 17), 8), np.repeat(np.arange(8), 34)
    warm = 20.0 + 1.2 * run + 0.02 * rng.normal(size=place.size)
    time, error = 5.0 * np.arange(place.size), np.full(place.size, -0.0058)
    table = np.column_stack([time, run, place, way, warm, error])
    head = "t,run,x,d,T,e"
    np.savetxt(tmp_path / "m.csv", table, "%.6f", ",", header=head, comments="")
    keys = {
        "leadscrew": "start = 0.0\ninterval = 25.0\npoints = 17",
        "backlash": "",
        "temperature": 'sensor = "scale"',
    }
    common = 'axis = "X"\nmeasurement = "m"\ngroup = "X"'
    fits = "".join(
        f'[[fits]]\ncompensation = "{name}"\n{common}\n{own}\n'
        for name, own in keys.items()
    )
    (tmp_path / "job.toml").write_text(CONSTANT + fits)
    found = run_job(tmp_path / "job.toml", tmp_path / "out")
    # The table takes all of it: the last digit of the file, and of the list.
    assert found.groups[0].axes[0].error["from_file"].rms < 2e-6
