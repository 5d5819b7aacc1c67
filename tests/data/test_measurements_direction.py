"""The direction of approach from the order of targets, from time, or not at all."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    ColumnSpec,
    DirectionUnknown,
    Measurement,
    MeasurementError,
    derive_direction,
    explain_direction,
    measurement,
    read_table,
    restart_of,
    with_error,
    without_motion,
)


def data_of(folder: Path, **columns: Sequence[float]) -> Measurement:
    names = {"position": "X.position", "direction": "X.direction"}
    lines = [
        ",".join(columns),
        *(",".join(map(str, r)) for r in zip(*columns.values(), strict=True)),
    ]
    path = folder / "m.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    mapping = {names.get(name, name): ColumnSpec(name) for name in columns}
    return measurement(read_table(path), mapping)


def directions(
    folder: Path, position: Sequence[float], **columns: Sequence[float]
) -> list[int]:
    return derive_direction(data_of(folder, position=position, **columns), "X").tolist()


def test_direction_column_counts(tmp_path: Path) -> None:
    found = directions(tmp_path, [0, 1, 2], direction=[-1, 1, -1])
    assert found == [-1, 1, -1]


DOWN = [0, -50, -100, -150, -200]
"""Targets of an axis that is homed at the end of its travel."""


def cycle(folder: Path, words: tuple[str, str], places: Sequence[float]) -> Path:
    path = folder / "cycle.csv"
    there = [f"{words[0]},{x},{k}" for k, x in enumerate(places)]
    back = [f"{words[1]},{x},{k}" for k, x in enumerate(places[::-1])]
    lines = ["Richtung,Soll [mm],Abweichung [um]", *(there + back) * 2]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "words", [("hin", "her"), ("vorwärts", "rückwärts"), ("fwd", "rev")]
)
def test_the_way_there_is_towards_where_the_targets_go(
    tmp_path: Path, words: tuple[str, str]
) -> None:
    for places, way in ((DOWN, -1), (DOWN[::-1], 1)):
        table = read_table(cycle(tmp_path, words, places))
        read = measurement(table, axis="X")
        assert derive_direction(read, "X").tolist() == [*[way] * 5, *[-way] * 5] * 2
        said = any("is motion in + direction" in remark for remark in read.remarks)
        assert said == (way < 0)
        # What a job states goes before.
        own = {
            "X.position": ColumnSpec("Soll"),
            "X.direction": ColumnSpec("Richtung", positive=words[way < 0]),
        }
        stated = derive_direction(measurement(table, own), "X")
        assert stated.tolist() == [*[way] * 5, *[-way] * 5] * 2


@pytest.mark.parametrize("words", [("+", "-"), ("up", "down"), ("1", "-1")])
def test_signs_against_the_order_of_the_targets_are_refused(
    tmp_path: Path, words: tuple[str, str]
) -> None:
    read = measurement(read_table(cycle(tmp_path, words, DOWN)), axis="X")
    with pytest.raises(MeasurementError, match=r"state sign = -1 of the column"):
        derive_direction(read, "X")
    columns = {
        "X.position": ColumnSpec("Soll"),
        "X.direction": ColumnSpec("Richtung", sign=-1),
    }
    turned = measurement(read_table(cycle(tmp_path, words, DOWN)), columns)
    assert derive_direction(turned, "X").tolist() == [*[-1] * 5, *[1] * 5] * 2


@pytest.mark.parametrize("words", [("+", "-"), ("hin", "her")])
def test_rows_with_the_newest_one_first_are_taken_by_their_time(
    tmp_path: Path, words: tuple[str, str]
) -> None:
    lines = cycle(tmp_path, words, DOWN[::-1]).read_text(encoding="utf-8").splitlines()
    rows = [f"{row},{4 * k}" for k, row in enumerate(lines[1:])]
    head = f"{lines[0]},time [s]"
    path = tmp_path / "newest.csv"
    path.write_text("\n".join([head, *rows[::-1]]) + "\n", encoding="utf-8")
    read = measurement(read_table(path), axis="X")
    # The last row is the first reading.
    assert derive_direction(read, "X").tolist()[::-1] == [*[1] * 5, *[-1] * 5] * 2


@pytest.mark.parametrize(("first", "way"), [(-200, 1), (0, -1)])
def test_the_way_there_of_columns_per_run_goes_as_the_targets_are_listed(
    tmp_path: Path, first: int, way: int
) -> None:
    path = tmp_path / "wide.csv"
    rows = [f"{first + 50 * way * k},{k},{k + 1},{k},{k + 1}" for k in range(5)]
    heads = "Soll [mm],1 hin [um],1 rück [um],2 hin [um],2 rück [um]"
    path.write_text("\n".join([heads, *rows]) + "\n", encoding="utf-8")
    sides = [c.direction for c in read_table(path).columns if c.direction]
    assert sides == [way, -way, way, -way]


def test_standard_cycle_reads_the_end_target_from_both_sides(tmp_path: Path) -> None:
    position = [0, 10, 20, 20, 10, 0]
    assert directions(tmp_path, position) == [1, 1, 1, -1, -1, -1]


@pytest.mark.parametrize("motion", [False, True])
def test_rows_without_a_position_go_on_as_before(motion: bool, tmp_path: Path) -> None:
    ways = [1] * 20 + [-1] * 20
    position = np.concatenate([np.arange(20.0), 18.3 - np.arange(20.0)])
    if not motion:
        position = np.concatenate([np.arange(20.0), np.arange(20.0)[::-1]])
    position[[2, 5, 6, 30, 39]] = np.nan
    other = {"time": [*range(40)]} if motion else {"run": [1] * 40}
    read = data_of(tmp_path, position=position.tolist(), **other).with_gaps()
    assert derive_direction(read, "X").tolist() == ways


def test_cycles_in_a_row_turn_at_both_ends(tmp_path: Path) -> None:
    position = [0, 10, 20, 20, 10, 0] * 3
    assert directions(tmp_path, position) == [1, 1, 1, -1, -1, -1] * 3


def test_pendulum_without_overrun_reads_the_end_once(tmp_path: Path) -> None:
    assert directions(tmp_path, [0, 10, 20, 10, 0]) == [1, 1, 1, -1, -1]


def test_several_readings_per_target_are_split_where_the_run_turns(
    tmp_path: Path,
) -> None:
    position = [0, 0, 10, 10, 20, 20, 20, 20, 10, 10, 0, 0]
    assert directions(tmp_path, position) == [1] * 6 + [-1] * 6


def test_downward_runs_begin_downward(tmp_path: Path) -> None:
    data = data_of(tmp_path, position=[20, 10, 0, 0, 10, 20], run=[1] * 6)
    found = explain_direction(data, "X")
    assert found.values.tolist() == [-1, -1, -1, 1, 1, 1]
    assert found.source == "order of the targets"
    assert "The first target of each run" in found.remarks[0]


def test_unidirectional_runs_are_all_one_direction(tmp_path: Path) -> None:
    position, run = [0, 10, 20] * 3, [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert directions(tmp_path, position, run=run) == [1] * 9


def test_sawtooth_without_runs_is_one_direction_and_says_so(tmp_path: Path) -> None:
    found = explain_direction(data_of(tmp_path, position=[0, 10, 20, 30] * 3), "X")
    assert found.values.tolist() == [1] * 12
    assert "taken as returns without a reading" in found.remarks[1]
    assert directions(tmp_path, [30, 20, 10, 0] * 2) == [-1] * 8


def test_random_order_follows_the_last_change(tmp_path: Path) -> None:
    assert directions(tmp_path, [0, 30, 10, 20, 0, 20]) == [1, 1, -1, 1, -1, 1]


def test_runs_that_are_mixed_are_ordered_by_time(tmp_path: Path) -> None:
    position = [0, 0, 10, 10, 10, 10, 0, 0]
    run = [1, 2, 1, 2, 1, 2, 1, 2]
    time = [0, 10, 1, 11, 2, 12, 3, 13]
    assert directions(tmp_path, position, run=run, time=time) == [
        1,
        1,
        1,
        1,
        -1,
        -1,
        -1,
        -1,
    ]
    with pytest.raises(DirectionUnknown, match=r"rows of run 1 stand between"):
        directions(tmp_path, position, run=run)


def test_recorded_motion_has_the_direction_of_motion(tmp_path: Path) -> None:
    up = np.linspace(0, 10, 21).tolist()
    position = [0.0, *up, 10.0, 10.0, *[v - 0.1 for v in reversed(up)]]
    time = list(range(len(position)))
    found = directions(tmp_path, position, time=time)
    assert found == [1] * 24 + [-1] * 21


@pytest.mark.parametrize(
    ("position", "match"),
    [
        ([5, 5, 5], "all positions are equal"),
        (
            [0, 10, 20, 20, 20, 10, 0],
            r"line 4: target 20, where the run turns, is read 3",
        ),
        (
            [0, 0, 10, 20, 20, 10, 0],
            r"line 2: target 0, at an end of the run, is read 2",
        ),
    ],
)
def test_direction_that_cannot_be_told_is_refused_with_advice(
    tmp_path: Path, position: Sequence[float], match: str
) -> None:
    with pytest.raises(DirectionUnknown, match=match) as caught:
        directions(tmp_path, position)
    assert "give 'X.direction' (+1 or -1 per row)" in str(caught.value)


def test_a_log_with_pauses_of_any_length_has_its_direction_by_time(
    tmp_path: Path,
) -> None:
    pauses = zip([0.0, 30.0, 60.0, 30.0, 0.0], [33, 35, 31, 36, 34], strict=True)
    place = np.concatenate([np.full(count, at) for at, count in pauses])
    time = (0.05 * np.arange(len(place))).tolist()
    found = directions(tmp_path, place.tolist(), time=time)
    assert found == [1] * (33 + 35 + 31) + [-1] * (36 + 34)


def test_two_recordings_on_one_clock_are_not_mixed(tmp_path: Path) -> None:
    place = np.concatenate([np.linspace(0, 50, 200), np.linspace(50, 0, 200)]).tolist()
    time = (0.05 * np.arange(200)).tolist()
    with pytest.raises(DirectionUnknown, match="time goes back in line 202"):
        directions(tmp_path, place, time=time + time)
    # The later part of a recording may stand first.
    later = (0.05 * np.arange(200, 400)).tolist()
    found = directions(tmp_path, place, time=later + time)
    assert found == [-1] + [1] * 199 + [-1] * 200


def test_where_a_clock_begins_anew() -> None:
    first, second = np.arange(5.0), np.arange(5.0, 10.0)
    assert restart_of(np.concatenate([first, first])) == 5
    assert restart_of(np.concatenate([[0.0, np.nan], first])) is None
    assert restart_of(np.concatenate([second, first])) is None
    runs = np.tile(first, 3)
    assert restart_of(runs) is None  # rows without an order
    assert restart_of(runs, np.repeat([1, 2, 3], 5)) == 5
    assert restart_of(np.array([0.0, 2.0, 1.0, 4.0, 3.0]), np.ones(5, int)) is None


def test_run_of_one_target_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DirectionUnknown, match="a run has only one target"):
        directions(tmp_path, [0, 0, 10, 10], run=[1, 1, 2, 2])


@pytest.mark.parametrize("rows", [3, 4, 20, 1000])
@pytest.mark.parametrize(
    "cycle", [["+", "-"], ["+", "+", "-"], ["-", "-", "+"], ["-"], ["+"]]
)
def test_signs_alone_are_directions(
    tmp_path: Path, rows: int, cycle: list[str]
) -> None:
    signs = [cycle[k % len(cycle)] for k in range(rows)]
    path = tmp_path / "m.csv"
    body = "".join(f"{k},0.1,{sign}\n" for k, sign in enumerate(signs))
    path.write_text("X.position,X.error,X.direction\n" + body)
    found = measurement(read_table(path)).require("X.direction")
    assert found.tolist() == [1 if sign == "+" else -1 for sign in signs]


def test_signs_against_the_motion_in_some_runs_are_refused(tmp_path: Path) -> None:
    targets = [0, 20, 40, 60, 80, 80, 60, 40, 20, 0]
    lines = ["run,X.position,X.error,X.direction"]
    for run in range(5):
        sign = -1 if run in (2, 4) else 1
        ways = [sign] * 5 + [-sign] * 5
        lines += [
            f"{run},{x},0.001,{way}" for x, way in zip(targets, ways, strict=True)
        ]
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    mixed = measurement(read_table(tmp_path / "m.csv"))
    with pytest.raises(MeasurementError, match=r"found in run 2, 4 'X\.direction'"):
        derive_direction(mixed, "X")


def test_all_runs_forward_above_all_runs_back_have_their_directions(
    tmp_path: Path,
) -> None:
    there = [0, 50, 100]
    position = [*there, *there, *there[::-1], *there[::-1]]
    run = np.repeat([1, 2, 1, 2], 3)
    assert directions(tmp_path, position, run=run.tolist()) == [1] * 6 + [-1] * 6
    with pytest.raises(DirectionUnknown):  # pieces of a run, by which no order is told
        directions(tmp_path, [0, 50, 100] * 4, run=run.tolist())


@pytest.mark.parametrize("name", ["approach from", "coming from", "Anfahrt aus"])
def test_where_an_axis_came_from_is_no_direction_of_its_motion(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / "dial.csv"
    rows = [f"{way},{x},{x}" for way in "+-" for x in (0, 50, 100)]
    path.write_text("\n".join([f"{name},target [mm],error [um]", *rows]) + "\n")
    with pytest.raises(MeasurementError, match="state sign = -1 of the column"):
        measurement(read_table(path), axis="X").require("X.direction")
    columns = {
        "X.position": ColumnSpec("target [mm]"),
        "X.error": ColumnSpec("error [um]"),
        "X.direction": ColumnSpec(name, sign=-1),
    }
    found = measurement(read_table(path), columns).require("X.direction")
    assert found.tolist() == [-1, -1, -1, 1, 1, 1]


@pytest.mark.parametrize("there", [1, -1])
def test_runs_in_rows_go_as_their_targets_are_listed(
    tmp_path: Path, there: int
) -> None:
    targets = [50 * k for k in range(8)][::there]
    rows = [
        f"{run} {way};" + ";".join(f"{size}.{k}" for k in range(8))
        for run in (1, 2)
        for way, size in (("hin", 1), ("rück", 5))
    ]
    head = ["X axis deviation um", ";".join(["run/target mm", *map(str, targets)])]
    path = tmp_path / "runs.csv"
    path.write_text("\n".join([*head, *rows]) + "\n")
    data = measurement(read_table(path), axis="X")
    sides, error = data.require("X.direction"), data.require("X.error")
    assert {*sides[error < 4e-3]} == {there}
    assert {*sides[error > 4e-3]} == {-there}


def test_the_other_word_of_a_leg_is_the_other_way(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    rows = [f"{x};{x}.1;{x}.2;{x}.3;{x}.4" for x in (150, 100, 50, 0)]
    head = "Target [mm];1 Hub [um];1 back [um];2 Hub [um];2 back [um]"
    path.write_text("\n".join([head, *rows]) + "\n")
    sides = measurement(read_table(path), axis="X").require("X.direction")
    # Downwards as listed: the way there goes towards -.
    assert sides.tolist() == [-1] * 4 + [1] * 4 + [-1] * 4 + [1] * 4


@pytest.mark.parametrize(("back", "told"), [([100, 50, 0], 0), ([0, 50, 100], 1)])
def test_legs_whose_rows_stand_in_the_order_of_the_places_are_told(
    tmp_path: Path, back: list[int], told: int
) -> None:
    path = tmp_path / "legs.csv"
    rows = [f"hin;{x};1" for x in (0, 50, 100)] + [f"rück;{x};2" for x in back]
    path.write_text("\n".join(["Richtung;Soll [mm];Fehler [um]", *rows]) + "\n")
    remarks = measurement(read_table(path), axis="X").remarks
    assert len([one for one in remarks if 'positive = "rück"' in one]) == told


def test_a_letter_before_the_number_of_a_run_beside_a_sign_is_one_of_runs(
    tmp_path: Path,
) -> None:
    path = tmp_path / "runs.csv"
    rows = [f"{x};1;2;3;4" for x in (0, 50, 100, 150)]
    head = "Soll [mm];R1 - [µm];R1 + [µm];R2 - [µm];R2 + [µm]"
    path.write_text("\n".join([head, *rows]) + "\n")
    data = measurement(read_table(path), axis="X")
    error, side = data.require("X.error"), data.require("X.direction")
    assert {*error[side > 0].round(6)} == {0.002, 0.004}


@pytest.mark.parametrize("letters", ["FB", "FR"])
def test_letters_of_forward_and_back_are_directions_of_runs(
    tmp_path: Path, letters: str
) -> None:
    path = tmp_path / "runs.csv"
    rows = [f"{x},1,2,3,4" for x in (0, 50, 100, 150)]
    there, back = letters
    head = f"target,{there}1,{back}1,{there}2,{back}2"
    path.write_text("\n".join(["X axis, deviations in um", head, *rows]) + "\n")
    data = measurement(read_table(path), axis="X")
    error, side = data.require("X.error"), data.require("X.direction")
    assert {*error[side > 0].round(6)} == {0.001, 0.003}


@pytest.mark.parametrize(
    ("there", "back"),
    [
        ("Pos {}", "Neg {}"),
        ("Anzeige vor {}", "Anzeige zurück {}"),
        ("Ist-Soll {}+", "Ist-Soll {}-"),
        ("error_pos_{}", "error_neg_{}"),
        ("Passage {} aller", "Passage {} retour"),
        ("V{}", "R{}"),
        ("+{}", "–{}"),
        ("Abw {} vor", "Abw {} rü"),
        ("Deviation {} out", "Deviation {} home"),
        ("Abw {}", "Abw {} R"),
        ("Error_{}_P", "Error_{}_N"),
        ("Lauf {} pos.", "Lauf {} neg."),
    ],
)
def test_columns_that_differ_in_their_direction_only_are_those_of_the_runs(
    tmp_path: Path, there: str, back: str
) -> None:
    heads = [f"{word.format(run)} [µm]" for run in (1, 2) for word in (there, back)]
    path = tmp_path / "runs.csv"
    rows = [f"{x};1.0;5.0;1.5;5.5" for x in (0, 50, 100, 150, 200)]
    path.write_text("\n".join([";".join(["Position X [mm]", *heads]), *rows]) + "\n")
    data = measurement(read_table(path), axis="X")
    error, side = data.require("X.error"), data.require("X.direction")
    np.testing.assert_array_equal(error > 0.003, side < 0)
    assert {*data.require("run")} == {1, 2}


def test_corrections_in_two_directions_are_not_taken_for_errors(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    rows = [f"{x};1.0;5.0;1.5;5.5" for x in (0, 50, 100, 150, 200)]
    heads = "Position X [mm];Soll-Ist 1+;Soll-Ist 1-;Soll-Ist 2+;Soll-Ist 2-"
    path.write_text("\n".join([heads, *rows]) + "\n")
    with pytest.raises(MeasurementError, match="Soll-Ist"):
        measurement(read_table(path), axis="X")


def test_columns_that_stand_beside_those_of_runs_are_named(tmp_path: Path) -> None:
    path = tmp_path / "runs.csv"
    rows = [f"{x};1.0;1.5;5.0;5.5" for x in (0, 50, 100, 150, 200)]
    heads = "Position X [mm];Lauf 1;Lauf 2;Sonst 1;Sonst 2"
    path.write_text("\n".join([heads, *rows]) + "\n")
    (remark,) = (each for each in read_table(path).remarks if "Not used" in each)
    assert "Sonst 1, Sonst 2" in remark


def rest_and_go(*stops: float, rate: float = 100.0) -> tuple[np.ndarray, np.ndarray]:
    """Return time and place of an axis that stops for 2 s at each place, at 20 mm/s between."""
    parts = [np.full(200, stops[0])]
    for here, there in pairwise(stops):
        count = int(abs(there - here) / 20.0 * rate)
        parts += [np.linspace(here, there, count), np.full(200, there)]
    place = np.concatenate(parts)
    return np.arange(len(place)) / rate, place


def test_the_last_digit_at_rest_turns_no_axis(tmp_path: Path) -> None:
    time, place = rest_and_go(0.0, 20.0, 40.0, 20.0, 0.0)
    flicker = np.random.default_rng(1).integers(0, 2, len(place)) * 1e-3
    found = directions(
        tmp_path, (place + flicker).round(3).tolist(), time=time.tolist()
    )
    turned = int(np.flatnonzero(place == 40.0)[-1])
    way = np.array(found)
    assert (way[:turned] == 1).all()
    # Where it turns a digit is not told from the first row of the way back.
    assert (way[turned + 5 :] == -1).all()


def test_an_overrun_in_motion_tells_from_which_side_a_target_came(
    tmp_path: Path,
) -> None:
    time, place = rest_and_go(0.0, 10.0, 20.0, 22.0, 20.0, 10.0, 0.0)
    # Nobody rests at the overrun.
    beyond = np.flatnonzero(place == 22.0)[1:-1]
    time, place = (np.delete(each, beyond) for each in (time, place))
    time = np.arange(len(time)) / 100.0
    rows = np.column_stack([time, place, place + 0.003])
    path = tmp_path / "m.csv"
    np.savetxt(path, rows, "%.4f", ",", header="t,x,a", comments="")
    mapping = {"time": "t", "X.position": "x", "X.actual": "a"}
    log = measurement(
        read_table(path), {role: ColumnSpec(name) for role, name in mapping.items()}
    )
    still = with_error(without_motion(log, ["X"]), "X")
    way, where = derive_direction(still, "X"), np.asarray(still.values["X.position"])
    at_end = way[np.abs(where - 20.0) < 1e-3]
    assert {*at_end.tolist()} == {1, -1}
    assert (np.diff(at_end) <= 0).all()
