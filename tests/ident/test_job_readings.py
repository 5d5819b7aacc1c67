"""From measurements to readings: runs, directions, zero and line, temperature, units."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.ident.job import Code, JobError, JobResult, Verdict, run_job
from axcomp.ident.readings import (
    cycles_of,
    place_in_run,
    runs_overlap,
    without_zero,
)
from axcomp.ident.readings._readings import ranked
from axcomp.ident.report._scale import scale_of
from axcomp.ident.report.table._fitted import readings_of
from axcomp.ident.report.table._residuals import views_of

NODES = np.arange(0.0, 401.0, 100.0)


def test_runs_of_one_direction_are_paired_to_cycles() -> None:
    run = np.array([1, 1, 2, 2, 3, 3, 4, 4])
    direction = np.array([1, 1, -1, -1, 1, 1, -1, -1])
    np.testing.assert_array_equal(cycles_of(run, direction), [1, 1, 1, 1, 2, 2, 2, 2])


def test_runs_of_both_directions_stay_as_they_are() -> None:
    run = np.array([5, 5, 9, 9])
    np.testing.assert_array_equal(cycles_of(run, np.array([1, -1, 1, -1])), run)
    np.testing.assert_array_equal(cycles_of(run, np.array([1, 1, 1, 1])), run)


@pytest.mark.parametrize(
    "run", [[3], [7, 5, 9, 5], [-2, 4, 4, -2], [1, 10**12, 1], [2**62, -(2**62)], []]
)
def test_runs_are_counted_in_the_order_of_their_numbers(run: list[int]) -> None:
    labels, index = np.unique(np.array(run, dtype=np.int64), return_inverse=True)
    count, found = ranked(np.array(run, dtype=np.int64))
    assert count == len(labels)
    np.testing.assert_array_equal(found, index)


def test_place_runs_from_start_to_end_of_each_run() -> None:
    run = np.array([1, 1, 1, 2, 2, 7])
    order = np.array([10.0, 15.0, 20.0, 1.0, 2.0, 5.0])
    np.testing.assert_allclose(place_in_run(run, order), [0, 0.5, 1, 0, 1, 0])


@pytest.mark.parametrize(
    ("second", "expected"),
    [(0.0, True), (1000.0, False)],  # the same stretch again, or another one
)
def test_runs_repeat_each_other_only_over_the_same_places(
    second: float, expected: bool
) -> None:
    nodes = np.arange(0.0, 1501.0, 100.0)
    place = np.concatenate([NODES, NODES + second])[:, None]
    run = np.repeat([1, 2], 5)
    assert runs_overlap(place, run, (nodes,), None) is expected


def test_directions_of_a_bilateral_table_are_different_places() -> None:
    place = np.concatenate([NODES, NODES])[:, None]
    run, direction = np.repeat([1, 2], 5), np.repeat([1, -1], 5)
    assert runs_overlap(place, run, (NODES,), None)
    assert not runs_overlap(place, run, (NODES,), direction)


def test_lines_of_a_surface_that_are_passed_twice_each_are_no_repeated_runs() -> None:
    x, y = np.tile(NODES, 6), np.repeat([0.0, 0.0, 50.0, 50.0, 100.0, 100.0], 5)
    nodes = NODES, np.array([0.0, 50.0, 100.0])
    each, place = np.repeat(np.arange(6), 5), np.stack([x, y], axis=1)
    assert not runs_overlap(place, each, nodes, None)
    # Passed there as a whole, and once more.
    assert runs_overlap(place, each % 2, nodes, None)


def test_runs_of_one_reading_have_no_offset_of_their_own() -> None:
    assert not runs_overlap(np.zeros((6, 1)), np.arange(6), (NODES,), None)


@pytest.mark.parametrize(("kind", "columns"), [("offset", 1), ("line", 3)])
def test_zero_and_line_are_taken_off_whatever_a_wild_reading_says(
    kind: str, columns: int
) -> None:
    rng = np.random.default_rng(29)
    place = rng.uniform(0.0, 100.0, (300, 2))
    tilt = np.array([0.3, 2e-3, -1e-3])[:columns]
    design = np.column_stack([np.ones(300), place])[:, :columns]
    noise = 1e-4 * rng.standard_normal(300)
    wild = np.zeros(300)
    wild[::50] = 1.0
    left = without_zero(design @ tilt + noise + wild, [*place.T], kind)  # type: ignore[arg-type]
    # 6 wild readings of 300 pull Huber's mean by about 0.03 of its scale of 0.1 µm.
    np.testing.assert_allclose(left - wild, noise, atol=5e-5)


JOB = """
[axes.X]
number = 1
[measurements.a]
file = "a.csv"
columns = {{ "X.position" = "x", "X.error" = "e" {columns} }}
{measurement}
[[fits]]
compensation = "leadscrew"
axis = "X"
{source}
smoothness = 0
loss = "gauss"
start = 0.0
interval = 100.0
points = 5
"""


def run(
    folder: Path,
    *columns: np.ndarray,
    header: str = "x,e",
    more: str = "",
    measurement: str = "",
    source: str = 'measurement = "a"',
) -> JobResult:
    rows = zip(*(column.tolist() for column in columns), strict=True)
    text = "\n".join([header, *(",".join(map(repr, row)) for row in rows)])
    (folder / "a.csv").write_text(text + "\n")
    if "remove" not in measurement.partition("[")[0]:
        measurement = f'remove = "none"\n{measurement}'
    job = JOB.format(columns=more, measurement=measurement, source=source)
    (folder / "job.toml").write_text(job)
    return run_job(folder / "job.toml", folder / "out")


PLACE = np.arange(0.0, 401.0, 25.0)
BOW = 1e-7 * (PLACE - 200.0) ** 2


def test_length_is_reduced_to_twenty_degrees(tmp_path: Path) -> None:
    warm = BOW + 11.5e-6 * 3.0 * PLACE  # steel, 23 °C
    plain = run(tmp_path, PLACE, BOW)
    keys = "expansion = 11.5\nmaterial_temperature = 23.0"
    reduced = run(tmp_path, PLACE, warm, measurement=keys)
    np.testing.assert_array_equal(
        reduced.tables[0].table["pos"], plain.tables[0].table["pos"]
    )
    assert any("reduced to 20 °C" in r.message for r in reduced.tables[0].remarks)
    keys = "expansion = 11.5\nalready_compensated = true\nreference_temperature = 22.0"
    stated = run(tmp_path, PLACE, BOW, measurement=keys)
    assert any("refers to 22 °C" in r.message for r in stated.tables[0].remarks)


def test_temperature_of_the_material_may_be_a_column(tmp_path: Path) -> None:
    temperature = np.linspace(20.0, 25.0, len(PLACE))
    warm = BOW + 11.5e-6 * (temperature - 20.0) * PLACE
    plain = run(tmp_path, PLACE, BOW)
    reduced = run(
        tmp_path, PLACE, warm, temperature, header="x,e,t",
        more=', "temperature.bed" = "t"',
        measurement='expansion = 11.5\nmaterial_temperature = "temperature.bed"',
    )  # fmt: skip
    np.testing.assert_array_equal(
        reduced.tables[0].table["pos"], plain.tables[0].table["pos"]
    )


def test_temperature_of_the_material_that_no_shop_has_is_refused(
    tmp_path: Path,
) -> None:
    fahrenheit = np.linspace(75.0, 79.0, len(PLACE))
    keys = 'expansion = 11.5\nmaterial_temperature = "bed"'
    role = ', "temperature.bed" = "t"'
    with pytest.raises(JobError, match=r"material_temperature: found 77 °C .*degF"):
        run(
            tmp_path,
            PLACE,
            BOW,
            fahrenheit,
            header="x,e,t",
            more=role,
            measurement=keys,
        )
    # A sensor that was not there for a while is no reason: these readings are wild.
    celsius = np.where(np.arange(len(PLACE)) == 5, -180.0, 23.0)
    run(tmp_path, PLACE, BOW, celsius, header="x,e,t", more=role, measurement=keys)


def test_readings_smaller_than_any_machine_errs_doubt_their_unit(
    tmp_path: Path,
) -> None:
    for scale in (1e-3, 1.0):  # mm that the file calls µm, and what they are
        (found,) = run(tmp_path, PLACE, scale * BOW).tables
        said = " ".join(remark.message for remark in found.remarks)
        assert ("mm or inch for µm" in said) == (scale < 1.0)


def test_line_of_the_instrument_is_removed(tmp_path: Path) -> None:
    tilted = run(
        tmp_path, PLACE, BOW + 0.3 + 2e-5 * PLACE, measurement='remove = "line"'
    )
    level = run(tmp_path, PLACE, BOW, measurement='remove = "line"')
    # Rounding of each to 0.1 µm.
    np.testing.assert_allclose(
        tilted.tables[0].table["pos"], level.tables[0].table["pos"], atol=1.01e-4
    )
    assert np.ptp(tilted.tables[0].table["pos"]) > 2e-3  # the bow is still there


@pytest.mark.parametrize(
    ("more", "label"),
    [(', "time" = "t"', "time in s"), ("", "row, in the order of measuring")],
)
def test_readings_at_whole_seconds_are_shown_over_time(
    tmp_path: Path, more: str, label: str
) -> None:
    clock = 10.0 * np.arange(PLACE.size)
    found = run(tmp_path, PLACE, BOW, clock, header="x,e,t", more=more).tables[0]
    scale = scale_of(found.unit)
    views = views_of(found, readings_of(found, scale))
    labels = [words for words, _ in views.values()]
    assert labels[-1] == label


def test_joined_measurements_keep_their_runs_apart(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text(
        "x,e\n" + "\n".join(f"{x},{e + 0.02}" for x, e in zip(PLACE, BOW, strict=True))
    )
    second = """[measurements.b]
file = "b.csv"
remove = "none"
columns = { "X.position" = "x", "X.error" = "e" }
"""
    rng = np.random.default_rng(31)
    result = run(
        tmp_path, PLACE, BOW + 1e-5 * rng.standard_normal(len(PLACE)),
        measurement=second, source='measurements = ["a", "b"]',
    )  # fmt: skip
    found = result.tables[0]
    assert len(found.fit.runs) == 2
    # ± 10 µm about the mean of the two, which the table keeps.
    assert found.fit.runs[1].offset == pytest.approx(0.01, abs=1e-4)
    at = np.interp(NODES, PLACE, BOW) + 0.01
    # Between nodes 100 mm apart the bow sags by at most 0.25 µm.
    np.testing.assert_allclose(found.table["pos"], at, atol=5e-4)
    assert found.held_out == "run"


def test_angle_of_a_linear_axis_is_refused(tmp_path: Path) -> None:
    text = JOB.format(
        columns="", measurement='remove = "none"', source='measurement = "a"'
    )
    both = '"X.position" = { column = "x", unit = "deg" }, "X.error" = { column = "e", '
    text = text.replace('"X.position" = "x", "X.error" = "e"', both + 'unit = "deg" }')
    rows = [f"{x},{e}" for x, e in zip(PLACE, BOW, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["x,e", *rows]))
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(AxcompError, match="found unit 'deg', expected mm"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("group", [False, True])
def test_measurements_of_an_axis_that_grew_are_told_by_their_slopes(
    tmp_path: Path, group: bool, stated: bool
) -> None:
    rng, way = np.random.default_rng(5), np.repeat([1.0, -1.0], len(PLACE))

    def readings(warm: float) -> np.ndarray:
        error = np.tile(BOW + 11e-6 * (warm - 20.0) * PLACE, 2) - 0.005 * way
        return np.asarray(error + 3e-4 * rng.normal(size=len(way)))

    def keys(warm: float) -> str:
        known = f"expansion = 11.0\nmaterial_temperature = {warm}\n" if stated else ""
        return f'remove = "none"\nactive = []\n{known}'

    place, columns = np.tile(PLACE, 2), ', "X.direction" = "d"'
    table = np.column_stack([place, readings(29.0), way])
    np.savetxt(tmp_path / "b.csv", table, "%.6f", ",", header="x,e,d", comments="")
    source = 'measurements = ["a", "b"]\n' + 'group = "g"\n' * group
    backlash = (
        f'[[fits]]\ncompensation = "backlash"\naxis = "X"\nloss = "gauss"\n{source}'
        * group
    )
    second = f"""[measurements.b]
file = "b.csv"
columns = {{ "X.position" = "x", "X.error" = "e" {columns} }}
"""
    result = run(
        tmp_path, place, readings(20.0), way, header="x,e,d", more=columns,
        measurement=keys(20.0) + second + keys(29.0) + backlash, source=source,
    )  # fmt: skip
    every = [*result.fits, *result.groups, result]
    said = " ".join(remark.message for one in every for remark in one.remarks)
    assert ("'b' shows the axis longer than 'a' does, by 99 µm/m" in said) != stated
    assert "correct the same error" not in said


def test_different_datums_are_refused(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("x,e\n0,0\n100,0\n")
    second = """datum = { at = 0.0 }
[measurements.b]
file = "b.csv"
datum = { at = 100.0 }
columns = { "X.position" = "x", "X.error" = "e" }
"""
    with pytest.raises(JobError, match="found measurements with different datums"):
        run(
            tmp_path, PLACE, BOW, measurement=second,
            source='measurements = ["a", "b"]',
        )  # fmt: skip


def test_datum_outside_the_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        JobError, match=r"datum.at: found 500, expected a position within"
    ):
        run(tmp_path, PLACE, BOW, measurement="datum = { at = 500.0 }")


def test_unmeasured_nodes_are_marked_and_named(tmp_path: Path) -> None:
    keep = PLACE < 250
    place, error = np.tile(PLACE[keep], 2), np.tile(BOW[keep], 2)
    result = run(tmp_path, place, error)
    support = result.tables[0].support["pos"]
    assert support[4] == 0
    assert support[0] > 0
    assert any("not measured" in r.message and r.level == "warning"
               for r in result.tables[0].remarks)  # fmt: skip


def test_readings_beyond_the_table_are_counted(tmp_path: Path) -> None:
    place = np.concatenate([PLACE, [450.0, -20.0]])
    result = run(tmp_path, place, np.zeros(len(place)) + 1e-3 * (place > 200))
    words = f"2 of {len(place)} readings lie outside"
    assert any(words in r.message for r in result.tables[0].remarks)


def test_readings_in_a_small_part_of_the_table_ask_for_their_unit(
    tmp_path: Path,
) -> None:
    for unit in (25.4, 1000.0):  # inches and metres that are taken as mm
        with pytest.raises(JobError, match=r"is the unit of X\.position right"):
            run(tmp_path, np.tile(PLACE, 2) / unit, np.tile(BOW, 2))


def test_readings_that_stand_there_twice_are_named(tmp_path: Path) -> None:
    noise = 1e-3 * np.random.default_rng(36).standard_normal((2, len(PLACE)))
    words = f"Each of {len(PLACE)} readings stands there 2 times"
    pasted = run(tmp_path, np.tile(PLACE, 2), np.tile(BOW + noise[0], 2))
    assert any(words in r.message for r in pasted.tables[0].remarks)
    again = run(tmp_path, np.tile(PLACE, 2), (BOW + noise).ravel())
    dial = run(tmp_path, np.tile(PLACE, 2), np.tile((BOW + noise[0]).round(2), 2))
    for result in (again, dial):  # a dial of 10 µm shows few values, and these again
        assert not any("stands there" in r.message for r in result.tables[0].remarks)


def test_list_that_would_not_help_is_rejected(tmp_path: Path) -> None:
    rng = np.random.default_rng(37)
    cycle = np.repeat([1, 2, 3], len(NODES))
    place = np.tile(NODES, 3)
    scatter = 1e-3 * rng.standard_normal(len(place))
    result = run(tmp_path, place, scatter, cycle, header="x,e,r", more=', "run" = "r"')
    # Five means of pure noise: they predict the third run worse than nothing does.
    judgement = result.tables[0].judgement
    assert judgement.verdict is Verdict.REJECTED
    assert judgement.has(Code.NO_GAIN)
    assert [c.name for c in result.tables[0].gate if not c.passed] == ["gain"]
    assert not result.passed
    assert (tmp_path / "out/rejected/achskw1.lis").exists()


@pytest.mark.parametrize("rate", [2e-3, 0.0])
def test_steady_drift_is_told_from_lost_motion_by_what_it_adds_from_run_to_run(
    tmp_path: Path, rate: float
) -> None:
    rng = np.random.default_rng(41)
    there_and_back = np.concatenate([NODES, NODES[::-1]])
    place = np.tile(there_and_back, 5)
    cycle = np.repeat(np.arange(5), 2 * len(NODES))
    passes = np.arange(len(place)) / len(NODES)
    error = 1e-5 * place + rate * passes + 3e-4 * rng.standard_normal(len(place))
    result = run(
        tmp_path, place, error, cycle,
        header="x,e,r", more=', "run" = "r"',
        source='measurement = "a"\nbilateral = true',
    )  # fmt: skip
    words = [
        r.message for r in result.tables[0].remarks if "Run after run" in r.message
    ]
    if rate:
        assert "+4.0 µm" in words[0]
        assert "lost motion of X" in words[0]
    else:
        assert words == []


def test_no_dial_is_asked_for_what_it_cannot_show(tmp_path: Path) -> None:
    rng = np.random.default_rng(43)
    place, cycle = np.tile(NODES, 6), np.repeat(np.arange(6), len(NODES))
    error = 3.5e-4 * np.sin(place / 60.0) + 5e-5 * rng.standard_normal(len(place))
    result = run(
        tmp_path, place, error, cycle, header="x,e,r", more=', "run" = "r"'
    )  # fmt: skip
    first = result.load_sheet[0]
    assert "Settle the sign" in first.action
    assert "set a dial" not in first.detail
