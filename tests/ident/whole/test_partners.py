"""Gantry partners, slopes of the temperature, backlash beside a bilateral table."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main

from .mill import LIST_UNIT, NOISE, column, cross_list, fit, table

PLACES = np.arange(0.0, 401.0, 100.0)
SCREW = np.array([0.0, 0.012, 0.02, 0.011, -0.005])
SLOPE = 50e-6
WIDTH = 0.008

JOB = """
[axes.X]
number = 1
limits = [0, 400]
{axis}
[measurements.laser]
file = "laser.csv"
remove = "none"
{active}
columns = {{ "X.position" = "target", "X.error" = "error", "X.direction" = "way", "run" = "run" }}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = {bilateral}
smoothness = 0
start = 0.0
interval = 100.0
points = 5
"""
GANTRY = """
[axes.X]
number = 1
limits = [0, 400]
[axes.Y]
number = 2
limits = [0, 300]
gantry = "Y2"
[axes.Y2]
number = 4
limits = [0, 300]
{partner}
[measurements.line]
file = "line.csv"
remove = "none"
columns = {{ "X.position" = "x", "Y.error" = "dy" }}
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "line"
smoothness = 0
start = 0.0
interval = 50.0
points = 9
"""


def laser(folder: Path, *, slope: float = 0.0, width: float = 0.0) -> None:
    rng = np.random.default_rng(21)
    there = np.arange(0.0, 401.0, 50.0)
    target = np.tile(np.concatenate([there, there[::-1]]), 3)
    way = np.tile(np.repeat([1, -1], len(there)), 3)
    run = np.repeat([1, 2, 3], 2 * len(there))
    error = np.interp(target, PLACES, SCREW) + slope * target
    error = error + np.where(way < 0, width, 0.0)
    error = error + NOISE * rng.standard_normal(len(target))
    table(folder / "laser.csv", "target,error,way,run", target, error, way, run)


def screw_by_hand(listing: ListFile, field: str = "pos") -> np.ndarray:
    """Return what the table adds at its nodes, from its entries: offset = −entry."""
    values = column(listing, "kw.ssfk", field)
    return np.array([-LIST_UNIT * values[k] for k in range(len(PLACES))])


PLAY = "kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 80\n"
HEAT = (
    "kopf.achs_nr 1\nlr_param.temp_comp 1\nlr_param.temp_comp_position_0 0\n"
    "lr_param.temp_comp_offset_0 0\nlr_param.temp_comp_coefficient -50.0\n"
    "lr_param.temp_comp_n_cycles 10\n"
)
"""An axis list that takes a slope of 50 µm/m away by itself."""


def test_leadscrew_beside_an_active_slope_leaves_the_slope_to_it(
    tmp_path: Path,
) -> None:
    laser(tmp_path, slope=SLOPE)
    (tmp_path / "xm.lis").write_text(HEAT)
    text = JOB.format(
        axis='machine_data = "xm.lis"', active="active = []", bilateral="false"
    )
    assert fit(tmp_path, text) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    left = SCREW + SLOPE * PLACES - SLOPE * PLACES + screw_by_hand(listing)
    # Twice the slope would leave 20 µm; 0.1 µm of noise on six readings per node.
    assert np.ptp(left) < 5e-4
    assert ListFile.read(tmp_path / "out" / "achsmds1.lis").integer(
        "lr_param.temp_comp"
    )


def test_leadscrew_beside_a_slope_of_which_nothing_is_said_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laser(tmp_path, slope=SLOPE)
    (tmp_path / "xm.lis").write_text(HEAT)
    text = JOB.format(axis='machine_data = "xm.lis"', active="", bilateral="false")
    assert fit(tmp_path, text) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "lr_param.temp_comp" in said
    assert 'active = ["temperature"] if it was on, [] if it was off' in said
    assert not (tmp_path / "out" / "achskw1.lis").exists()


def test_table_beside_a_law_of_the_plc_says_how_warm_it_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laser(tmp_path, slope=SLOPE)
    # As `axcomp fit` of a temperature leaves it: the PLC moves the line.
    (tmp_path / "xm.lis").write_text(HEAT.replace("-50.0", "0.0"))
    axis = 'machine_data = "xm.lis"'
    text = JOB.format(axis=axis, active="active = []", bilateral="false")
    assert fit(tmp_path, text) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "what a warm axis has grown by would be taken off twice" in said
    stated = "active = []\nalready_compensated = true"
    assert fit(tmp_path, JOB.format(axis=axis, active=stated, bilateral="false")) == 0


def test_bilateral_table_switches_the_backlash_of_the_axis_list_off(
    tmp_path: Path,
) -> None:
    laser(tmp_path, width=WIDTH)
    (tmp_path / "xm.lis").write_text(PLAY)
    text = JOB.format(
        axis='machine_data = "xm.lis"', active="active = []", bilateral="true"
    )
    assert fit(tmp_path, text) == 0
    out = tmp_path / "out"
    listing = ListFile.read(out / "achskw1.lis")
    machine = ListFile.read(out / "achsmds1.lis")
    back = 0.0 if not machine.integer("lr_param.anwahl_losekomp") else -WIDTH
    left_up = SCREW + screw_by_hand(listing)
    left_down = SCREW + WIDTH + screw_by_hand(listing, "neg") + back
    assert np.ptp(np.concatenate([left_up, left_down])) < 5e-4
    assert machine.integer("lr_param.anwahl_losekomp") == 0


def test_bilateral_table_asks_whether_the_backlash_that_it_takes_over_was_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Measured with the backlash on: the table would not hold it, and switch it off.
    laser(tmp_path, width=0.0)
    (tmp_path / "xm.lis").write_text(PLAY)
    text = JOB.format(axis='machine_data = "xm.lis"', active="", bilateral="true")
    assert fit(tmp_path, text) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "found no active" in said
    assert "switches on the backlash of X, which this leadscrew takes over" in said
    assert "active = [] if it was off" in said


def test_table_of_one_direction_asks_whether_the_backlash_beside_it_was_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laser(tmp_path, width=WIDTH)
    (tmp_path / "xm.lis").write_text(PLAY)
    text = JOB.format(axis='machine_data = "xm.lis"', active="", bilateral="false")
    # Taken as off, the table would keep half of what the backlash adds: 4 µm.
    assert fit(tmp_path, text) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert 'active = ["backlash"] if it was on, [] if it was off' in said


@pytest.mark.parametrize("bilateral", [0, 1])
def test_backlash_beside_a_table_of_both_directions_that_was_off_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bilateral: int
) -> None:
    laser(tmp_path, width=WIDTH)
    rows = [
        f"kw.ssfk.table[{k}].pos {entry}\nkw.ssfk.table[{k}].neg {entry + 80 * bilateral}\n"
        for k, entry in enumerate([0, 120, 200, 110, -50])
    ]
    (tmp_path / "x.lis").write_text(
        f"kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.kw_nr_max 5\nkw.ssfk.bilateral {bilateral}\n"
        f"kw.ssfk.kw_startpos 0\nkw.ssfk.interval 1000000\n{''.join(rows)}"
    )
    (tmp_path / "xm.lis").write_text("lr_param.ssfk 1\n")
    axis = 'list = "x.lis"\nmachine_data = "xm.lis"'
    text = JOB.format(axis=axis, active="active = []", bilateral="false")
    text = text[: text.index("bilateral")].replace('"leadscrew"', '"backlash"')
    # Both would take the lost motion back. A table of one direction has none of it.
    assert fit(tmp_path, text) == bilateral
    said = " ".join(capsys.readouterr().err.split())
    assert ("a backlash does not take it off; or lr_param.ssfk 0" in said) == bilateral


def test_backlash_that_comes_in_one_cycle_is_stopped_with_the_entry_to_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laser(tmp_path, width=WIDTH)
    (tmp_path / "xm.lis").write_text(PLAY)
    axis, active = 'machine_data = "xm.lis"', "active = []"
    text = JOB.format(axis=axis, active=active, bilateral="false")
    assert fit(tmp_path, text) == 1
    said = " ".join(capsys.readouterr().out.split())
    wanted = re.search(r"set lr_param.n_backlash_cyc (\d+) in the axis list of X", said)
    assert wanted
    spread = f"{PLAY}lr_param.n_backlash_cyc {wanted[1]}\n"
    (tmp_path / "xm.lis").write_text(spread)
    assert fit(tmp_path, text) == 0


def test_slope_that_is_the_instruments_stays_with_the_temperature(
    tmp_path: Path,
) -> None:
    laser(tmp_path, slope=SLOPE)
    (tmp_path / "xm.lis").write_text(HEAT)
    text = JOB.format(
        axis='machine_data = "xm.lis"', active="active = []", bilateral="false"
    )
    assert fit(tmp_path, text.replace('"none"', '"line"')) == 0
    added = screw_by_hand(ListFile.read(tmp_path / "out" / "achskw1.lis"))
    # No reading tells a slope: undoing that of the axis list would take 50 µm/m.
    assert abs(np.polyfit(PLACES, added, 1)[0]) < 0.05 * SLOPE


def test_half_a_gantry_is_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    assert fit(tmp_path, GANTRY.format(partner="")) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "FAILED gantry" in said
    assert "Y2 is the gantry partner of Y and has no cross" in said
    assert 'axis = "Y2"' in said
    assert (tmp_path / "out" / "rejected" / "achskw2.lis").exists()


def test_gantry_whose_partner_has_its_own_list_passes(tmp_path: Path) -> None:
    gantry(tmp_path)
    (tmp_path / "achskw4.lis").write_text(cross_list(number=4, master=1, size=0.03))
    assert fit(tmp_path, GANTRY.format(partner='list = "achskw4.lis"')) == 0
    whole = json.loads((tmp_path / "out" / "result.json").read_text())["whole"]["Y"]
    assert [c["passed"] for c in whole["gate"] if c["name"] == "gantry"] == [True]


def test_half_a_gantry_is_not_probed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    gantry(tmp_path, name="far")
    for text, passes in ((GANTRY.format(partner=""), False), (BOTH, True)):
        (tmp_path / "job.toml").write_text(text)
        out = tmp_path / f"probe{passes}"
        made = main(["probe", str(tmp_path / "job.toml"), "--out", str(out)]) == 0
        assert made == passes
    said = " ".join(capsys.readouterr().err.split())
    assert "its gantry partner Y2 has none: one of both alone twists the gantry" in said


def test_gantry_whose_partner_has_its_list_switched_off_says_what_to_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    (tmp_path / "achskw4.lis").write_text(cross_list(number=4, master=1, size=0.03))
    (tmp_path / "off.lis").write_text("kopf.achs_nr 4\nlr_param.crosscomp 0\n")
    lists = 'list = "achskw4.lis"\nmachine_data = "off.lis"'
    assert fit(tmp_path, GANTRY.format(partner=lists)) == 1
    assert "set lr_param.crosscomp 1 there" in " ".join(capsys.readouterr().out.split())


def test_gantry_whose_partner_acts_with_the_opposite_sign_is_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    (tmp_path / "achskw4.lis").write_text(cross_list(number=4, master=1, size=-0.02))
    assert fit(tmp_path, GANTRY.format(partner='list = "achskw4.lis"')) == 1
    assert gantry_gates(tmp_path) == [False]
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "Y2 is the gantry partner of Y and acts with the opposite sign: cross" in said
    )


def test_gantry_measured_with_opposite_errors_says_how_far_it_moves_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    gantry(tmp_path, size=-0.03, name="far")
    assert fit(tmp_path, BOTH) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Y2 were measured with opposite errors (cross)" in said
    # Twice 30 µm, to the noise of 0.1 µm.
    assert re.search(r"up to 0\.0[56]\d* mm apart", said)


def test_gantry_whose_partner_follows_another_axis_is_stopped(tmp_path: Path) -> None:
    gantry(tmp_path)
    (tmp_path / "achskw4.lis").write_text(cross_list(number=4, master=3, size=0.03))
    assert fit(tmp_path, GANTRY.format(partner='list = "achskw4.lis"')) == 1
    assert gantry_gates(tmp_path) == [False]


@pytest.mark.parametrize("size", [0.3, 0.003, None])
def test_gantry_whose_partner_is_moved_otherwise_says_by_how_much(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float | None
) -> None:
    # Ten times as far, a tenth as far; or alike, and by another list beside.
    gantry(tmp_path)
    text = cross_list(number=4, master=1, size=size or 0.03)
    if size is None:
        text += "kw.ssfk.unit 1\nkw.ssfk.interval 1000000\nkw.ssfk.kw_nr_max 2\n"
        text += "kw.ssfk.table[0].pos 0\nkw.ssfk.table[1].pos 300\n"
    (tmp_path / "achskw4.lis").write_text(text)
    assert fit(tmp_path, GANTRY.format(partner='list = "achskw4.lis"')) == 0
    said = " ".join(capsys.readouterr().out.split())
    beside = "has leadscrew, and Y has not"
    assert (beside if size is None else "mm apart by their lists") in said


@pytest.mark.parametrize("times", [0.1, 0.001])
def test_gantry_of_which_one_partner_is_in_another_unit_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], times: float
) -> None:
    gantry(tmp_path)
    x, error = np.loadtxt(tmp_path / "line.csv", delimiter=",", skiprows=1).T
    table(tmp_path / "far.csv", "x,dy", x, times * error)
    fit(tmp_path, BOTH)
    said = " ".join(capsys.readouterr().out.split())
    apart = "mm apart by their lists, more than half of what Y is moved. Is the unit of both"
    # A thousandth of the error is next to none, and no list holds it.
    nothing = (
        "The fit of Y2 found nothing to correct: look at its readings and at their unit"
    )
    assert (apart if times > 0.01 else nothing) in said


def test_gantry_with_backlash_of_one_partner_says_how_far_it_would_twist(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(23)
    x, way = np.tile(np.arange(0.0, 301.0, 25.0), 8), np.repeat([1, -1] * 4, 13)
    error = -4e-3 * (way < 0) + NOISE * rng.standard_normal(len(x))
    table(tmp_path / "line.csv", "x,dy,way", x, error, way)
    job = GANTRY[: GANTRY.index("columns")].format(partner="")
    job += 'columns = { "Y.position" = "x", "Y.error" = "dy", "Y.direction" = "way" }\n'
    job += '[[fits]]\ncompensation = "backlash"\naxis = "Y"\nmeasurement = "line"\n'
    assert fit(tmp_path, job) == 1
    said = " ".join(capsys.readouterr().out.split())
    (twist,) = re.findall(r"twist the gantry by up to (\S+) mm", said)
    assert float(twist) == pytest.approx(4e-3, rel=0.1)  # 0.1 µm is an entry


def gantry(folder: Path, size: float = 0.03, name: str = "line") -> None:
    rng = np.random.default_rng(22)
    x = np.tile(np.arange(0.0, 401.0, 25.0), 2)
    error = size * np.sin(np.pi * x / 400.0) + NOISE * rng.standard_normal(len(x))
    table(folder / f"{name}.csv", "x,dy", x, error)


BOTH = GANTRY.format(partner="") + GANTRY[GANTRY.index("[measurements") :].format(
    partner=""
).replace("line", "far").replace("Y.error", "Y2.error").replace('"Y"', '"Y2"')
"""Both partners of the gantry fitted, each to its own measurement."""


def gantry_gates(folder: Path) -> list[bool]:
    """Return of each partner whether the gate lets it out with the other."""
    whole = json.loads((folder / "out" / "result.json").read_text())["whole"]
    return [
        c["passed"]
        for axis in whole.values()
        for c in axis["gate"]
        if c["name"] == "gantry"
    ]


def test_gantry_partner_stays_back_with_the_one_that_its_own_gate_stops(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    gantry(tmp_path, size=0.35, name="far")
    assert fit(tmp_path, BOTH) == 1
    # 0.35 mm at once stops Y2; Y alone would twist the gantry.
    assert not list((tmp_path / "out").glob("*.lis"))
    said = " ".join(capsys.readouterr().out.split())
    assert "Y2 is the gantry partner of Y and is stopped by its own gate" in said


def test_gantry_whose_partners_do_not_come_together_is_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gantry(tmp_path)
    gantry(tmp_path, name="far")
    assert fit(tmp_path, BOTH) == 0
    assert gantry_gates(tmp_path) == [True, True]
    assert fit(tmp_path, BOTH + "manual_activation = true\n") == 1
    assert gantry_gates(tmp_path) == [False, False]
    assert "Let both wait for COMP ON, or none" in capsys.readouterr().out.replace(
        "\n", " "
    )


def test_gantry_whose_partner_has_a_table_of_zeros_is_stopped(tmp_path: Path) -> None:
    gantry(tmp_path)
    (tmp_path / "achskw4.lis").write_text(cross_list(number=4, master=1, size=0.0))
    assert fit(tmp_path, GANTRY.format(partner='list = "achskw4.lis"')) == 1
    assert gantry_gates(tmp_path) == [False]


def beside_heat(folder: Path, *, more: str = "", column: str = "") -> str:
    """Measure a screw at 30 °C and its warming; returns the job for both."""
    rng = np.random.default_rng(24)
    laser(folder, slope=SLOPE)
    heat = np.repeat(np.linspace(18.0, 32.0, 15), len(PLACES))
    place = np.tile(PLACES, 15)
    # 50 µm/m at 30 °C, the state in which the laser measured, and none at 20 °C.
    error = 0.1 * SLOPE * (heat - 20.0) * place + np.interp(place, PLACES, SCREW)
    error = error + NOISE * rng.standard_normal(len(heat))
    table(folder / "warm.csv", "place,e,t", place, error, heat)
    job = JOB.format(axis="", active=more, bilateral="false")
    return (
        job.replace('"run" = "run" }', f'"run" = "run" {column} }}')
        + """
[measurements.warm]
file = "warm.csv"
remove = "none"
columns = { "X.position" = "place", "X.error" = "e", "temperature.frame" = "t" }
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "warm"
sensor = "frame"
reference = 0.0
"""
    )


def test_slope_that_leadscrew_and_temperature_both_correct_is_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = beside_heat(tmp_path, column=', "temperature.frame" = { value = 30.0 }')
    assert fit(tmp_path, job) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "FAILED axis error" in said
    assert "correct the same error" in said
    assert "material_temperature" in said
    assert (tmp_path / "out" / "rejected" / "achskw1.lis").exists()


def test_table_beside_a_temperature_law_asks_how_warm_it_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(tmp_path, beside_heat(tmp_path)) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "it lacks temperature.frame" in said
    assert '"temperature.frame" = { value = … }' in said
    assert (tmp_path / "out" / "rejected" / "achskw1.lis").exists()


@pytest.mark.parametrize("lost", ["", "backlash"])
def test_table_of_lengths_at_the_reference_temperature_stands_beside_a_law(
    tmp_path: Path, lost: str
) -> None:
    more = "expansion = 5.0\nmaterial_temperature = 30.0"
    text = beside_heat(tmp_path, more=more)
    if lost:  # from the readings of the table, which are as long
        laser(tmp_path, slope=SLOPE, width=0.004)
        text += (
            f'[[fits]]\ncompensation = "{lost}"\naxis = "X"\nmeasurement = "laser"\n'
        )
    assert fit(tmp_path, text) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw1.lis")
    # Twice the slope would leave 20 µm; 0.1 µm of noise on six readings per node.
    assert np.ptp(SCREW + screw_by_hand(listing)) < 5e-4


def test_measurement_without_runs_is_held_out_in_stretches_beside_one_with_runs(
    tmp_path: Path,
) -> None:
    job = beside_heat(tmp_path, column=', "temperature.frame" = { value = 30.0 }')
    for name in ("laser", "warm"):
        both = 'measurements = ["laser", "warm"]\ngroup = "X"'
        job = job.replace(f'measurement = "{name}"', both)
    assert fit(tmp_path, job) == 0
    fits = json.loads((tmp_path / "out" / "result.json").read_text())["fits"]
    # Held out as a whole, the warming would leave nothing that tells the temperature.
    assert all(one["error"]["predicted"]["rms"] < 2 * NOISE for one in fits)


def rooms(folder: Path, reference: str) -> str:
    """Measure the screw in three rooms, once each; it grows from X = 0. Returns a job."""
    rng, names = np.random.default_rng(3), ["cool", "mild", "warm"]
    x = np.tile(np.arange(0.0, 401.0, 25.0), 2)
    job = "[axes.X]\nnumber = 1\n"
    for name, level in zip(names, (18.0, 24.0, 31.0), strict=True):
        warm = level + 0.3 * rng.standard_normal(len(x))
        error = np.interp(x, PLACES, SCREW) + 11e-6 * (warm - 20.0) * x
        error = error + NOISE * rng.standard_normal(len(x))
        table(folder / f"{name}.csv", "x,e,t", x, error, warm)
        job += f'[measurements.{name}]\nfile = "{name}.csv"\nremove = "none"\n'
        job += (
            'columns = { "X.position" = "x", "X.error" = "e", "temperature.s" = "t" }\n'
        )
    both = f'axis = "X"\nmeasurements = {json.dumps(names)}\ngroup = "X"\n'
    job += f'[[fits]]\ncompensation = "leadscrew"\nsmoothness = 0\n{both}'
    job += "start = 0.0\ninterval = 100.0\npoints = 5\n"
    job += f'[[fits]]\ncompensation = "temperature"\nlag = "none"\n{both}{reference}'
    return job + 'sensors = { coefficient = "s" }\n'


def test_measurements_without_runs_are_held_out_in_stretches(tmp_path: Path) -> None:
    assert fit(tmp_path, rooms(tmp_path, "reference = 0.0\n")) == 0
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["groups"][0]["held_out"] == "block"
    assert all(one["error"]["predicted"]["rms"] < 2 * NOISE for one in found["fits"])


def test_coefficient_alone_without_a_reference_says_where_it_turns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # It grows from 0 and not from the middle: the gate stops it.
    assert fit(tmp_path, rooms(tmp_path, "")) == 1
    said = " ".join(capsys.readouterr())
    assert "no reference is stated where the axis stays" in " ".join(said.split())
