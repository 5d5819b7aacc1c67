"""Jobs end to end with a known truth: what is written does to the error."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.job import JobError, run_job

from .screw import LIST_UNIT, laser, offsets, screw_error, screw_job, table


def test_defaults_find_the_same_table_as_plain_means(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    plain = run_job(job, tmp_path / "out")
    text = job.read_text().replace("smoothness = 0", "").replace('loss = "gauss"', "")
    job.write_text(text)
    auto = run_job(job, tmp_path / "out")
    for name in ("pos", "neg"):
        shift = auto.tables[0].table[name] - plain.tables[0].table[name]
        # Inside two standard errors, and rounding of both.
        allowed = 2 * auto.tables[0].standard_deviation[name] + LIST_UNIT
        assert np.all(np.abs(shift) < allowed)


@pytest.mark.parametrize("loss", ["gauss", "student"])
def test_run_that_is_far_off_is_said_to_count_where_it_does(
    tmp_path: Path, loss: str
) -> None:
    rng = np.random.default_rng(12)
    target, run = np.tile(np.linspace(0.0, 200.0, 11), 5), np.repeat(range(5), 11)
    error = 1e-4 * rng.standard_normal(55) + np.where(run == 3, 0.046, 0.0)
    table(tmp_path / "laser.csv", "target,error,run", target, error, run)
    (tmp_path / "job.toml").write_text(
        f"""
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
axis = "X"
remove = "none"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
loss = "{loss}"
start = 0.0
interval = 20.0
points = 11
"""
    )
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tree["fits"]
    off = np.mean(fit["parameters"]["table"]["pos"])
    deviation = np.mean(fit["standard_deviations"]["table"]["pos"])
    said = " ".join(remark["message"] for remark in fit["remarks"])
    counts = loss == "gauss"
    assert f"and {'counts' if counts else 'does not count'} in their mean" in said
    # A fifth of the 46 µm, which four other runs contradict: it must be in the deviation.
    assert off == pytest.approx(0.0092 if counts else 0.0, abs=1e-4)
    assert (deviation > 0.0046) == counts


def test_runs_that_contradict_each_other_are_named_with_the_stretch(
    tmp_path: Path,
) -> None:
    there = np.arange(0.0, 401.0, 50.0)
    torn = np.abs(np.concatenate([there, there[::-1]]) - 175.0) <= 75.0
    offset = 0.06 * np.outer([0, 1, 0, 1, 0], torn).reshape(-1)
    laser(tmp_path / "laser.csv", runs=5, offset=offset)
    job = screw_job(tmp_path)
    fine = job.read_text().replace("interval = 100.0", "interval = 50.0")
    job.write_text(fine.replace("points = 5", "points = 9"))
    (fit,) = run_job(job, tmp_path / "out").tree["fits"]
    said = " ".join(remark["message"] for remark in fit["remarks"])
    assert "contradict each other at X = 100 to 250, run 2, 4 by" in said


@pytest.mark.parametrize(("limits", "short"), [([-10, 410], False), ([-90, 900], True)])
def test_table_that_leaves_out_a_part_of_the_travel_says_so(
    tmp_path: Path, limits: list[int], short: bool
) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, axis=f"limits = {limits}")
    (fit,) = run_job(job, tmp_path / "out").fits
    said = " ".join(remark.message for remark in fit.remarks)
    words = "The table covers X = 0 to 400 of a travel from -90 to 900 (limits)"
    assert (words in said) == short


@pytest.mark.parametrize(("points", "far"), [(5, ""), (6, "500"), (9, "500 to 800")])
def test_a_table_that_goes_on_beyond_its_readings_is_doubted(
    tmp_path: Path, points: int, far: str
) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path)
    job.write_text(job.read_text().replace("points = 5", f"points = {points}"))
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(r.message for r in fit.remarks if r.level == "warning")
    words = f"X = {far}: there nobody measured, and the table holds its edge"
    assert (words in said) == bool(far)
    # The controller holds the edge of a table: so does the table beyond its readings.
    entries = fit.table["pos"]
    assert not far or np.ptp(entries[4:]) == 0.0
    # What would go on straight is another answer: the deviation has it.
    assert not far or (fit.standard_deviation["pos"][5:] > 1e-3).all()


def one_way(folder: Path, there: np.ndarray, error: np.ndarray, nodes: str) -> Path:
    """A job of readings with 0.3 µm of noise, its smoothness and loss by the data."""
    noise = 3e-4 * np.random.default_rng(0).normal(size=len(there))
    table(folder / "laser.csv", "target,actual", there, there + error + noise)
    text = screw_job(folder).read_text()
    for line in ("bilateral = true", "smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    keys = "start = 0.0\ninterval = 100.0\npoints = 5"
    (folder / "job.toml").write_text(text.replace(keys, nodes))
    return folder / "job.toml"


@pytest.mark.parametrize("word", ["monotone", "non-negative"])
def test_a_table_with_constraints_holds_its_edge_as_well(
    tmp_path: Path, word: str
) -> None:
    there = np.tile(np.arange(0.0, 151.0, 10.0), 3)
    nodes = "start = 0.0\ninterval = 20.0\npoints = 21"
    keys = f'{nodes}\nsolver = "ipopt"\nconstraints = ["{word}"]'
    one_way(tmp_path, there, 0.04 * (there / 150.0) ** 2, keys)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "X = 180 to 400: there nobody measured, and the table holds its edge" in said
    # The edge is 10 mm beyond the last reading, where the error grows by 0.5 µm a mm.
    assert np.abs(fit.table["pos"][9:] - 0.04).max() < 7e-3


def test_a_node_that_readings_touch_from_afar_was_not_read(tmp_path: Path) -> None:
    there = np.tile(np.arange(0.0, 161.0, 10.0), 3)
    nodes = "setpoints = [0.0, 25.0, 50.0, 75.0, 100.0, 125.0, 150.0, 400.0]"
    job = one_way(tmp_path, there, 0.04 * (there / 150.0) ** 2, nodes)
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert (
        "No reading lies at X = 400: there nobody measured, and the table holds its edge"
        in said
    )
    # What the last reading says; straight on it would be more than 0.1 mm.
    assert abs(fit.table["pos"][-1] - 0.0455) < 6e-3


def test_readings_that_end_in_a_cell_are_not_given_up_for_its_end(
    tmp_path: Path,
) -> None:
    there = np.tile(np.arange(0.0, 321.0, 10.0), 3)
    job = one_way(
        tmp_path, there, 5e-4 * there, "start = 0.0\ninterval = 100.0\npoints = 5"
    )
    (fit,) = run_job(job, tmp_path / "out").tables
    # Held at 0.16 mm, the node at 400 would miss the readings up to 320 by 8 µm.
    assert fit.error["from_file"].max < 1.5e-3


@pytest.mark.parametrize(
    "nodes",
    [
        "start = 0.0\ninterval = 100.0\npoints = 5",
        "setpoints = [0.0, 10.0, 20.0, 30.0, 400.0]",
    ],
)
def test_a_gap_without_nodes_and_places_outside_are_none_that_nobody_has_seen(
    tmp_path: Path, nodes: str
) -> None:
    there = np.tile(np.arange(0.0, 401.0, 10.0), 3)
    if nodes.startswith("setpoints"):
        there = there[(there <= 30.0) | (there == 400.0)]
    else:
        there = np.append(there, -30000.0)  # where the place was lost
    error = 1e-4 * np.clip(there, 0.0, 400.0)
    (fit,) = run_job(one_way(tmp_path, there, error, nodes), tmp_path / "out").tables
    assert abs(fit.table["pos"][-1] - 0.04) < 1e-3


@pytest.mark.parametrize("at", [380.0, 280.0])
def test_a_datum_where_nothing_was_read_is_doubted(tmp_path: Path, at: float) -> None:
    there = np.tile(np.arange(0.0, 301.0, 10.0), 3)
    job = one_way(
        tmp_path, there, 5e-5 * (there - at), "start = 0\ninterval = 50\npoints = 9"
    )
    job.write_text(
        job.read_text().replace('remove = "none"', f"datum = {{ at = {at} }}")
    )
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert ("Nothing was read at X = 380, where the instrument" in said) == (at > 300.0)


def test_constraints_do_not_judge_what_follows_the_other_direction(
    tmp_path: Path,
) -> None:
    place = np.tile(np.arange(0.0, 401.0, 20.0), 3)
    there, way = np.append(place, place[place <= 200.0]), np.ones(len(place))
    way = np.append(way, -np.ones(len(there) - len(place)))
    error = np.where(way > 0, -1e-4 * there, 1e-3 + 2e-5 * there)
    noise = 2e-4 * np.random.default_rng(0).normal(size=len(there))
    read = there + error + noise
    table(tmp_path / "laser.csv", "target,actual,direction", there, read, way)
    text = screw_job(tmp_path).read_text()
    for line in ("smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    keys = 'solver = "ipopt"\nconstraints = ["monotone"]\nstart ='
    (tmp_path / "job.toml").write_text(text.replace("start =", keys))
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    # It rises where it was read; beyond, in the other direction, the error falls.
    measured = np.array([1.0, 3.0, 5.0]) * 1e-3
    assert np.abs(fit.table["neg"][:3] - measured).max() < 5e-4


def test_a_direction_that_was_not_read_follows_the_other_where_that_bends(
    tmp_path: Path,
) -> None:
    place = np.arange(0.0, 801.0, 50.0)

    def error(x: np.ndarray) -> np.ndarray:
        return np.where(x < 200.0, 0.05 * (x - 200.0) / 1000.0, 0.0)

    # Level where + was read: what is smooth goes on level.
    ways = [(place[place >= 200.0], 1), (place[::-1], -1)] * 3
    where = np.concatenate([at for at, _ in ways])
    way = np.concatenate([np.full(len(at), sign) for at, sign in ways])
    noise = 2e-4 * np.random.default_rng(0).normal(size=len(where))
    read = where + error(where) - 0.002 * (way < 0) + noise
    table(tmp_path / "laser.csv", "target,actual,direction", where, read, way)
    text = screw_job(tmp_path).read_text()
    for line in ("smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    text = text.replace("points = 5", "points = 17").replace("= 100.0", "= 50.0")
    (tmp_path / "job.toml").write_text(text)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    words = (
        "X = 0 to 150: there nobody measured, and the table follows the other direction"
    )
    assert words in said
    # Three readings a node of 0.2 µm, and the gap once more.
    off = fit.table["pos"] - error(place)
    assert np.abs(off).max() < 0.001


def test_a_flat_table_may_go_on_beyond_its_readings(tmp_path: Path) -> None:
    there = np.tile(np.arange(0.0, 401.0, 50.0), 4)
    error = 0.012 + 2e-4 * np.random.default_rng(0).normal(size=len(there))
    table(tmp_path / "laser.csv", "target,actual", there, there + error)
    text = screw_job(tmp_path).read_text().replace("points = 5", "points = 9")
    for line in ("bilateral = true", "smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    (tmp_path / "job.toml").write_text(text)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").fits
    assert not any("nobody measured. End" in r.message for r in fit.remarks)


@pytest.mark.parametrize(
    ("limits", "beyond"), [("[0, 400]", 0), ("[2, 398]", 0), ("[60, 400]", 12)]
)
def test_readings_where_the_axis_cannot_go_are_doubted(
    tmp_path: Path, limits: str, beyond: int
) -> None:
    laser(tmp_path / "laser.csv")
    job = screw_job(tmp_path, axis=f"limits = {limits}")
    (fit,) = run_job(job, tmp_path / "out").fits
    said = " ".join(r.message for r in fit.remarks if r.level == "warning")
    words = f"{beyond} of 54 readings lie beyond the limits of X"
    assert (words in said) == (beyond > 0)
    assert ("beyond the limits" in said) == (beyond > 0)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        (0.0, "none"),
        (
            250.0,
            "20 of 36 readings lie outside the table, where its edge is held. Are unit",
        ),
        (
            5000.0,
            "36 of 36 readings lie outside the table. Are unit and origin of their",
        ),
    ],
)
def test_positions_that_mostly_lie_outside_the_table_are_doubted(
    tmp_path: Path, shift: float, words: str
) -> None:
    there = np.tile(np.arange(0.0, 401.0, 50.0), 4)
    error = screw_error(there, np.ones(len(there)))
    error += 1e-3 * np.random.default_rng(0).normal(size=len(there))
    there += shift
    table(tmp_path / "laser.csv", "target,actual", there, there + error)
    job = screw_job(tmp_path)
    text = job.read_text()
    for line in ("bilateral = true", "smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    job.write_text(text)
    said = []
    try:
        (fit,) = run_job(job, tmp_path / "out").fits
        said = [r.message for r in fit.remarks if r.level == "warning"]
    except JobError as error:
        said = [str(error)]
    assert any(words in each for each in said) == (shift > 0.0)


@pytest.mark.parametrize(
    ("points", "flat", "moved"), [(5, False, True), (5, True, False), (9, False, False)]
)
def test_readings_beyond_the_table_that_move_its_end_are_said(
    tmp_path: Path, points: int, flat: bool, moved: bool
) -> None:
    there = np.tile(np.arange(0.0, 401.0, 25.0), 4)
    error = 4e-3 * np.sin((np.minimum(there, 200.0) if flat else there) / 60.0)
    error += 3e-4 * np.random.default_rng(0).normal(size=len(there))
    table(tmp_path / "laser.csv", "target,actual", there, there + error)
    text = screw_job(tmp_path).read_text()
    for line in ("bilateral = true", "smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    text = text.replace("interval = 100.0", "interval = 50.0")
    (tmp_path / "job.toml").write_text(text.replace("points = 5", f"points = {points}"))
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").fits
    said = " ".join(r.message for r in fit.remarks if r.level == "warning")
    assert (
        "They move the table away from the readings at X = 200 by " in said
    ) == moved
    # No closer nodes follow what lies beyond them.
    assert "Closer nodes" not in said


def test_written_leadscrew_list_takes_the_error_away(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    result = run_job(screw_job(tmp_path), tmp_path / "out")
    position = np.tile(np.linspace(0.0, 400.0, 81), 2)
    direction = np.repeat([1, -1], 81)
    error = screw_error(position, direction)
    left = error + offsets(tmp_path / "out", 1, A1=position, D=direction)
    assert result.passed
    # A wrong sign would leave 40 µm; 0.1 µm of noise on 6 readings per node and 0.05 µm
    # of rounding leave well under 0.5 µm.
    assert np.max(np.abs(error)) > 0.015
    assert np.max(np.abs(left)) < 5e-4


def test_written_cross_list_takes_the_error_away(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(-10.0, 410.0, 85)
    nodes = np.arange(-10.0, 411.0, 60.0)
    truth = 0.02 * np.sin(nodes / 90.0)
    table(
        tmp_path / "edge.csv", "x,dy", x,
        np.interp(x, nodes, truth) + 1e-4 * rng.standard_normal(len(x)),
    )  # fmt: skip
    (tmp_path / "job.toml").write_text("""
[axes.X]
number = 1
limits = [-10, 410]
[axes.Y]
number = 2
[measurements.edge]
file = "edge.csv"
remove = "none"
columns = { "X.position" = "x", "Y.error" = "dy" }
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "edge"
smoothness = 0
start = -10.0
interval = 60.0
points = 8
n_cycles = 20
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 2, A1=nodes)
    assert result.passed
    # 0.1 µm of noise on some ten readings per node, 0.05 µm of rounding.
    assert np.max(np.abs(left)) < 3e-4
    written = ListFile.read(tmp_path / "out" / "achskw2.lis")
    assert written.integer("kw.crosscomp.n_cycles") == 20
    assert written.integer("kw.crosscomp.master_ax_nr") == 1


def plane_job(tmp_path: Path, rules: str = "") -> tuple[np.ndarray, ...]:
    """Write a probed plane and its job; return X, Y and the true error."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(-40.0, 61.0, 10.0), np.arange(-70.0, 31.0, 10.0))
    x, y = x.ravel(), y.ravel()
    # Bilinear, and different along the two masters: swapped indices would show.
    truth = 1e-4 * x - 3e-4 * y + 2e-6 * x * y
    noise = 1e-4 * rng.standard_normal(len(x))
    table(tmp_path / "probe.csv", "x,y,dz", x, y, 1e3 * (truth + noise))
    (tmp_path / "rules.toml").write_text(rules)
    (tmp_path / "job.toml").write_text("""
[machine]
conventions = "rules.toml"
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
name = "Z_ACHSE"
[measurements.probe]
file = "probe.csv"
remove = "none"
[measurements.probe.columns]
"X.position" = { column = "x", unit = "mm" }
"Y.position" = { column = "y", unit = "mm" }
"Z.error" = { column = "dz", unit = "um" }
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 10
start = [-40.0, -70.0]
interval = [20.0, 10.0]
points = [6, 11]
""")
    return x, y, truth


def test_oblong_plane_passes_with_either_order_of_its_indices(tmp_path: Path) -> None:
    _, _, truth = plane_job(tmp_path, 'plane_index = "ij"\n')
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    assert result.passed
    assert {one["level"] for one in result.fits[0].findings} <= {"info"}
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    # The last node along master 1, the first along master 2; 0.5 µm as below.
    entry = listing.integer("kw.crosscomp2.table[5][0].correction")
    assert entry == pytest.approx(-1e4 * truth[10], abs=5)


def test_a_plane_holds_its_edge_where_nothing_was_read(tmp_path: Path) -> None:
    plane_job(tmp_path)
    text = (
        (tmp_path / "job.toml")
        .read_text()
        .replace("points = [6, 11]", "points = [10, 11]")
    )
    (tmp_path / "job.toml").write_text(text)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert (
        "No reading lies at X = 80 to 140: there nobody measured, and the table holds its edge"
        in said
    )
    # By the truth at X = 60, for Y = 30 and -70: 0.6 and 18.6 µm; 0.1 µm of noise.
    assert re.search(
        r"44 of 110 node values \(errors of 0\.\d+ µm to 18\.\d µm\)", said
    )
    (entries,) = fit.table.values()
    assert np.ptp(entries[:, 5:], axis=1).max() == 0.0


@pytest.mark.parametrize("interval", ["[100.0, 10.0]", "[50.0, 10.0]"])
def test_what_lies_between_two_places_nobody_has_seen(
    tmp_path: Path, interval: str
) -> None:
    plane_job(tmp_path)
    rows = (tmp_path / "probe.csv").read_text().splitlines()
    ends = [row for row in rows[1:] if float(row.split(",")[0]) in (-40.0, 60.0)]
    (tmp_path / "probe.csv").write_text("\n".join([rows[0], *ends, *ends]) + "\n")
    points = "[2, 11]" if interval.startswith("[1") else "[3, 11]"
    text = (tmp_path / "job.toml").read_text().replace("[20.0, 10.0]", interval)
    (tmp_path / "job.toml").write_text(text.replace("[6, 11]", points))
    if points == "[2, 11]":
        assert run_job(tmp_path / "job.toml", tmp_path / "out").passed
        return
    with pytest.raises(JobError, match="no reading lies between X = -40 and 60"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


@pytest.mark.parametrize("limits", ["[0, 400]", "[-100, 500]"])
def test_nodes_that_are_proposed_are_nodes_that_a_job_may_have(
    tmp_path: Path, limits: str
) -> None:
    x = np.tile(np.arange(0.0, 401.0, 50.0), 4)
    error = 0.02 * np.sin(x / 90.0) + 1e-4 * np.random.default_rng(0).normal(
        size=len(x)
    )
    table(tmp_path / "edge.csv", "x,dy", x, error)
    job = f"""
[axes.X]
number = 1
limits = {limits}
[axes.Y]
number = 2
[measurements.edge]
file = "edge.csv"
remove = "none"
active = []
columns = {{ "X.position" = "x", "Y.error" = "dy" }}
[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "edge"
start = -300.0
interval = 10.0
points = 101
"""
    (tmp_path / "job.toml").write_text(job)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    proposed = re.search(r"Nodes that suit these readings: (.*?)\.(?: |$)", said)
    assert proposed is not None
    assert ("start = -100" in proposed[1]) == (limits == "[-100, 500]")
    keys = "start = -300.0\ninterval = 10.0\npoints = 101"
    (tmp_path / "job.toml").write_text(
        job.replace(keys, proposed[1].replace(", ", "\n"))
    )
    assert run_job(tmp_path / "job.toml", tmp_path / "again").tables


def test_written_plane_list_takes_the_error_away(tmp_path: Path) -> None:
    x, y, truth = plane_job(tmp_path)
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    left = truth + offsets(tmp_path / "out", 3, A1=x, A2=y)
    assert result.passed
    # 0.1 µm of noise, one or two readings per node, 3 sigma, 0.05 µm of rounding.
    assert np.max(np.abs(left)) < 4e-4
    written = ListFile.read(tmp_path / "out" / "achskw3.lis")
    assert written.text("kw.crosscomp2.grid") == "RECTANGULAR"
    assert written.text("kopf.log_achs_name") == "Z_ACHSE"
    first = json.loads((tmp_path / "out" / "result.json").read_text())["fits"][0]
    assert np.shape(first["parameters"]["table"]) == (11, 6)
    # In mm and with the sign of the entry, which for a plane is the offset.
    assert first["parameters"]["table"][0][0] == pytest.approx(-truth[0], abs=5e-4)


def test_table_of_a_modulo_axis_closes(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    angle = np.tile(np.arange(0.0, 360.0, 10.0), 2)
    error = 4e-3 * np.sin(np.deg2rad(angle)) + 1e-3
    run = np.repeat([1, 2], 36)
    noise = 1e-4 * rng.standard_normal(len(angle))
    table(tmp_path / "c.csv", "run,c,e", run, angle, error + noise)
    (tmp_path / "job.toml").write_text("""
[axes.C]
number = 6
type = "rotary"
modulo = [0.0, 360.0]
[measurements.table]
file = "c.csv"
remove = "none"
columns = { run = "run", "C.position" = "c", "C.error" = "e" }
[[fits]]
compensation = "leadscrew"
axis = "C"
measurement = "table"
smoothness = 0
modulo = true
start = 0.0
interval = 30.0
points = 13
""")
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    values = result.tables[0].table["pos"]
    assert result.tables[0].unit == "deg"
    assert values[0] == values[-1]
    at = np.array([-1.0, 0.0, 359.0, 361.0, 719.0])
    added = offsets(tmp_path / "out", 6, A6=at)
    # −1°, 359° and 719° are one place, up to the rounding of the wrapped angle.
    assert added[0] == pytest.approx(added[2], abs=1e-9)
    assert added[4] == pytest.approx(added[2], abs=1e-9)
    # Offset = −error; sagitta of a sine over 30° nodes is 0.14e-3, plus noise.
    assert added[1] == pytest.approx(-1e-3, abs=3e-4)


@pytest.mark.parametrize("stream", ["false", "true"])
@pytest.mark.parametrize("jump", [0.0, 0.015])
def test_a_zero_that_moves_within_a_log_is_told(
    tmp_path: Path, stream: str, jump: float
) -> None:
    rng = np.random.default_rng(3)
    time = 0.01 * np.arange(24_000)
    phase = (time / 15.0) % 2.0
    place = 200.0 * np.where(phase < 1.0, phase, 2.0 - phase)
    way = np.where(phase < 1.0, 1.0, -1.0)
    error = screw_error(place, way) + 5e-4 * rng.standard_normal(len(time))
    error += np.where(time > 110.0, jump, 0.0)
    table(tmp_path / "log.csv", "t,x,e,way", time, place, error, way)
    columns = 'time = "t", "X.position" = "x", "X.error" = "e", "X.direction" = "way"'
    (tmp_path / "job.toml").write_text(
        f"""
[axes.X]
number = 1
[measurements.log]
file = "log.csv"
active = []
remove = "none"
stream = {stream}
columns = {{ {columns} }}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "log"
bilateral = true
start = 0.0
interval = 10.0
points = 21
"""
    )
    found = run_job(tmp_path / "job.toml", tmp_path / "out").fits[0]
    said = [one.message for one in found.remarks if "wanders in time" in one.message]
    assert len(said) == (jump > 0)


def test_a_local_error_that_comes_again_in_each_run_is_the_machines(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(0)
    there = np.arange(0.0, 401.0, 10.0)
    target = np.tile(np.concatenate([there, there[::-1]]), 4)
    way = np.tile(np.repeat([1, -1], len(there)), 4)
    run = np.repeat(np.arange(4), 2 * len(there))
    error = screw_error(target, way) + np.where(target == 200.0, 0.012, 0.0)
    error += 5e-4 * rng.standard_normal(len(target))
    table(tmp_path / "laser.csv", "target,error,way,run", target, error, way, run)
    columns = '"X.position" = "target", "X.error" = "error", "X.direction" = "way"'
    (tmp_path / "job.toml").write_text(
        f"""
[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
active = []
remove = "none"
columns = {{ {columns}, run = "run" }}
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
start = 0.0
interval = 10.0
points = 41
"""
    )
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    assert result.passed
    up, down = np.array([200.0, 200.0]), np.array([1, -1])
    left = screw_error(up, down) + 0.012 + offsets(tmp_path / "out", 1, A1=up, D=down)
    # Means of four readings, three deviations, beside the rounding.
    assert np.max(np.abs(left)) < 3 * 5e-4 / 2 + LIST_UNIT


def test_a_direction_that_was_read_in_part_follows_the_other_one(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(2)
    there = np.arange(0.0, 401.0, 25.0)
    target = np.tile(np.concatenate([there, there[::-1]]), 3)
    way = np.tile(np.repeat([1, -1], len(there)), 3)
    run = np.repeat(np.arange(3), 2 * len(there))
    # On the way back the instrument saw the first quarter only.
    seen = (way > 0) | (target <= 100.0)
    error = 0.02 * np.sin(target / 60.0) - np.where(way < 0, 0.004, 0.0)
    error += 1e-4 * rng.standard_normal(len(target))
    columns = (each[seen] for each in (target, error, way, run))
    table(tmp_path / "laser.csv", "target,error,way,run", *columns)
    job = screw_job(tmp_path, fit="").read_text()
    job = job.replace("smoothness = 0", "").replace("100.0", "25.0")
    job = job.replace("points = 5", "points = 17").replace('loss = "gauss"', "")
    (tmp_path / "job.toml").write_text(job)
    result = run_job(tmp_path / "job.toml", tmp_path / "out")
    said = [one.message for one in result.fits[0].remarks]
    assert any(
        "in − direction lies at X = 125 to 400: there nobody measured, and the table follows"
        in words
        for words in said
    )
    place = np.array([300.0])
    added = offsets(tmp_path / "out", 1, A1=place, D=np.array([-1]))
    # Its lost motion is the same there; straight on the table would be tens of um off.
    assert abs(added[0] + 0.02 * np.sin(5.0) - 0.004) < 1e-3


def test_the_edge_is_held_however_loud_a_single_reading_is(tmp_path: Path) -> None:
    there = np.tile(np.arange(0.0, 251.0, 12.5), 60)
    loud = 3e-3 * np.random.default_rng(1).normal(size=len(there))
    nodes = "start = 0.0\ninterval = 25.0\npoints = 17"
    job = one_way(tmp_path, there, 3e-5 * there + loud, nodes)
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "No reading lies at X = 275 to 400: there nobody measured" in said
    # Straight on it would gain 4.5 µm more, of which 15 µm of noise would hide nothing.
    assert np.ptp(fit.table["pos"][10:]) == 0.0
    assert (fit.standard_deviation["pos"][-1:] > 3e-3).all()


def test_only_wild_readings_at_the_end_are_no_missing_readings(tmp_path: Path) -> None:
    there = np.arange(0.0, 401.0, 10.0)
    error = 1e-4 * there + np.where(there > 395.0, 0.2, 0.0)
    nodes = "start = 0.0\ninterval = 10.0\npoints = 41"
    (fit,) = run_job(one_way(tmp_path, there, error, nodes), tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "Only wild readings lie at X = 400: there none counts" in said
    assert "nobody measured" not in said


def test_directions_that_end_at_different_places_keep_what_they_lie_apart(
    tmp_path: Path,
) -> None:
    ends = {1: 300.0, -1: 150.0}
    parts = [np.arange(0.0, end + 1.0, 12.5) for end in ends.values()] * 5
    where = np.concatenate(parts)
    way = np.concatenate(
        [np.full(len(at), s) for at, s in zip(parts, [*ends] * 5, strict=True)]
    )
    noise = 1e-3 * np.random.default_rng(0).normal(size=len(where))
    read = where + 2e-5 * where - 0.008 * (way < 0) + noise
    table(tmp_path / "laser.csv", "target,actual,direction", where, read, way)
    text = screw_job(tmp_path).read_text()
    for line in ("smoothness = 0", 'loss = "gauss"'):
        text = text.replace(line, "")
    text = text.replace("points = 5", "points = 17").replace("= 100.0", "= 25.0")
    (tmp_path / "job.toml").write_text(text)
    (fit,) = run_job(tmp_path / "job.toml", tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "No reading lies at X = 325 to 400: there nobody measured" in said
    assert "No reading in − direction lies at X = 175 to 300: there nobody" in said
    # 8 µm everywhere, to five readings of 1 µm at the last node of each.
    apart = fit.table["pos"] - fit.table["neg"]
    assert apart == pytest.approx(0.008, abs=1.5e-3)
    assert np.ptp(apart[7:]) < 2e-4


def test_a_datum_beyond_the_first_reading_stays_zero(tmp_path: Path) -> None:
    there = np.tile(np.arange(25.0, 401.0, 25.0), 4)
    nodes = "start = 0.0\ninterval = 25.0\npoints = 17"
    job = one_way(tmp_path, there, 1e-4 * there, nodes)
    job.write_text(job.read_text().replace('remove = "none"', "datum = { at = 0.0 }"))
    (fit,) = run_job(job, tmp_path / "out").tables
    # A set-up that is right at its zero and off by 2.5 µm at the first reading.
    assert fit.table["pos"][0] == pytest.approx(0.0, abs=LIST_UNIT)
    assert fit.table["pos"][1] == pytest.approx(2.5e-3, abs=3e-4)


def old_table(folder: Path, entries: list[int]) -> None:
    head = "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 500000\n"
    head += f"kw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max {len(entries)}\n"
    lines = [f"kw.ssfk.table[{k}].pos {value}\n" for k, value in enumerate(entries)]
    (folder / "old.lis").write_text(head + "".join(lines))


def beside_old(folder: Path, there: np.ndarray, keys: str, active: str) -> Path:
    nodes = f"start = 0.0\ninterval = 50.0\npoints = 9\n{keys}"
    job = one_way(folder, np.tile(there, 5), 0.1 * np.tile(there, 5) / 4000.0, nodes)
    text = job.read_text().replace("number = 1", 'number = 1\nlist = "old.lis"')
    job.write_text(text.replace("active = []", f"active = {active}"))
    return job


def test_an_old_table_that_was_off_shapes_nothing(tmp_path: Path) -> None:
    old_table(tmp_path, [0, 20, 50, 60, 60, 100, -60, 170, 200])
    job = beside_old(tmp_path, np.arange(0.0, 251.0, 12.5), "", "[]")
    (fit,) = run_job(job, tmp_path / "out").tables
    said = " ".join(remark.message for remark in fit.remarks)
    assert "X = 300 to 400: there nobody measured, and the table holds its edge" in said
    there = np.concatenate([np.arange(0.0, 16.0, 2.5), np.arange(385.0, 401.0, 2.5)])
    job = beside_old(tmp_path, there, "", "[]")
    with pytest.raises(JobError, match=r"no reading lies between X = 15 and 385"):
        run_job(job, tmp_path / "out")


def test_constraints_hold_the_entries_beside_an_old_table_where_nobody_measured(
    tmp_path: Path,
) -> None:
    # A bump where nothing was read now, which a list that turns back nowhere cannot keep.
    old_table(tmp_path, [20, 150, 30, 60, 80, 100, 120, 140, 160])
    keys = 'solver = "ipopt"\nconstraints = ["monotone"]'
    job = beside_old(tmp_path, np.arange(100.0, 401.0, 12.5), keys, '["leadscrew"]')
    (fit,) = run_job(job, tmp_path / "out").tables
    left = fit.error["from_file"].sound.rms
    assert left < 1.5 * fit.error["predicted"].sound.rms
    assert np.ptp(fit.table["pos"][:3]) == 0.0
