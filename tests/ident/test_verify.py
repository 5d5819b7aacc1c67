"""Verify finds what a controller does otherwise: its log comes from a NumPy controller
of this file, which shares no code with the models."""

import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from axcomp.data.lists import ListFile
from axcomp.data.measurements import ControllerLog, LoggedOffset, read_log
from axcomp.ident.exchange import Motion, Reading, simulate
from axcomp.ident.proof import Verdict, Verification, verify_log
from axcomp.models import Conventions

CYCLE = 1e-3
NOISE = 1e-3  # mm: 1 µm
NODES = np.arange(0.0, 301.0, 10.0)
RNG = np.random.default_rng(11)
POS = np.round(0.06 * np.sin(NODES / 40) + 0.01 * RNG.normal(size=NODES.size), 4)
NEG = np.round(POS + 0.03 * np.cos(NODES / 70), 4)
GRID1, GRID2 = np.arange(0.0, 401.0, 50.0), np.arange(0.0, 301.0, 50.0)
TABLE = np.round(0.08 * RNG.normal(size=(GRID2.size, GRID1.size)), 4)
WIDTH, CYCLES = 0.025, 10

WORDS = {"x10": "unit", "x0.1": "unit"}
SENTENCES = {
    ("leadscrew", "sign"): "added with opposite sign",
    ("leadscrew", "x10"): "unit is 10 times larger",
    ("leadscrew", "shift"): "table applied 3.0 mm further",
    ("leadscrew", "lag"): "2 cycles later",
    # A filter of n cycles is half of n − 1 cycles late, on a surface without steps.
    ("plane", "lag"): "2 cycles later; on this table it looks the same when filtered"
    " over 5 cycles",
}
# Faults that act on every table alike: the leadscrew shows them.
ALIKE = ("sign", "x10", "x0.1", "twice", "edge")
SCREW = ("sign", "x10", "x0.1", "shift", "lag", "filter", "edge", "twice")
PLANE = ("sign", "x10", "x0.1", "shift", "swapped", "lag", "edge", "twice")
BACKLASH = ("sign", "x10", "x0.1", "lag", "filter", "twice")


def listing(source: str, *lines: str) -> ListFile:
    return ListFile.parse(("\n".join(lines) + "\n").encode(), source)


def units(values: np.ndarray) -> list[int]:
    return np.rint(values * 1e4).astype(int).tolist()


def screw_list() -> ListFile:
    lines = [
        "kopf.achs_nr 3", "kopf.log_achs_name Z", "kw.ssfk.unit 1",
        "kw.ssfk.interval 100000", "kw.ssfk.kw_startpos 0", "kw.ssfk.kw_nr_max 31",
        "kw.ssfk.bilateral 1", "kw.ssfk.set_pos_without_comp 1",
    ]  # fmt: skip
    for k, (pos, neg) in enumerate(zip(units(POS), units(NEG), strict=True)):
        lines += [f"kw.ssfk.table[{k}].pos {pos}", f"kw.ssfk.table[{k}].neg {neg}"]
    return listing("achskw3.lis", *lines)


def plane_list() -> ListFile:
    prefix = "kw.crosscomp2"
    lines = [
        "kopf.achs_nr 3", "kopf.log_achs_name Z", f"{prefix}.unit 1",
        f"{prefix}.interval 500000", f"{prefix}.last_index_master1 8",
        f"{prefix}.last_index_master2 6", f"{prefix}.start_position_master1 0",
        f"{prefix}.start_position_master2 0", f"{prefix}.master1_ax_nr 1",
        f"{prefix}.master2_ax_nr 2",
    ]  # fmt: skip
    for (j, i), value in np.ndenumerate(np.rint(TABLE * 1e4).astype(int)):
        lines.append(f"{prefix}.table[{j}][{i}].correction {value}")
    return listing("achskw3.lis", *lines)


def axis_list() -> ListFile:
    return listing(
        "achsmds3.lis", "kopf.achs_nr 3", "lr_param.ssfk 1", "lr_param.crosscomp2 1",
        "lr_param.anwahl_losekomp 1", f"lr_param.n_backlash_cyc {CYCLES}",
        "getriebe[0].lose 250",
    )  # fmt: skip


def moves(low: float, high: float, rows: int, seed: int) -> np.ndarray:
    """Return positions between random targets, with dwells, at up to 300 mm/s."""
    rng = np.random.default_rng(seed)
    place, found = 0.5 * (low + high), []
    while len(found) < rows:
        goal = rng.uniform(low, high)
        count = max(int(abs(goal - place) / (rng.uniform(0.1, 0.3))), 30)
        share = np.linspace(0.0, 1.0, count + 1)[1:]
        found += (place + (goal - place) * share**2 * (3 - 2 * share)).tolist()
        found += [goal] * int(rng.integers(5, 60))
        place = goal
    # Rounded as in the log: a dwell is one place, to the last digit.
    return np.round(np.array(found[:rows]), 6)


ROWS = 8_000
MOTION = {
    1: moves(-30.0, 430.0, ROWS, 1),
    2: moves(-30.0, 330.0, ROWS, 2),
    3: moves(-20.0, 320.0, ROWS, 3),
}


def sine_squared(values: np.ndarray, cycles: int) -> np.ndarray:
    if cycles <= 1:
        return values
    found = np.full(len(values), values[0])
    done = np.sin(0.5 * np.pi * np.arange(1, cycles + 1) / cycles) ** 2
    for row in np.flatnonzero(np.diff(values)) + 1:
        step = values[row] - values[row - 1]
        found[row : row + cycles] += step * done[: len(found) - row]
        found[row + cycles :] += step
    return found


def back(position: np.ndarray) -> np.ndarray:
    """Return 1 where the last motion was in negative direction, else 0."""
    found, last = np.zeros(len(position)), 0.0
    for row, step in enumerate(np.diff(position, prepend=position[0])):
        last = 1.0 if step < 0 else 0.0 if step > 0 else last
        found[row] = last
    return found


BACK = back(MOTION[3])


def factor(faults: tuple[str, ...]) -> float:
    sizes = {"sign": -1.0, "x10": 10.0, "x0.1": 0.1, "twice": 2.0}
    return float(np.prod([sizes.get(fault, 1.0) for fault in faults]))


def late(values: np.ndarray, faults: tuple[str, ...]) -> np.ndarray:
    cycles = 2 if "lag" in faults else 0
    return np.concatenate([np.full(cycles, values[0]), values])[: len(values)]


def screw(faults: tuple[str, ...] = ()) -> np.ndarray:
    place = MOTION[3] - (3.0 if "shift" in faults else 0.0)
    share = sine_squared(BACK, 5 if "filter" in faults else CYCLES)
    table = (1 - share) * np.interp(place, NODES, POS)
    table += share * np.interp(place, NODES, NEG)
    if "edge" in faults:
        table[(place < 0) | (place > 300)] = 0.0
    return late(-factor(faults) * table, faults)


def plane(faults: tuple[str, ...] = ()) -> np.ndarray:
    first, second = MOTION[1], MOTION[2]
    if "swapped" in faults:
        first, second = second, first
    first = first - (3.0 if "shift" in faults else 0.0)
    held = np.stack([np.clip(second, 0, 300), np.clip(first, 0, 400)], axis=1)
    table = RegularGridInterpolator((GRID2, GRID1), TABLE)(held)
    if "edge" in faults:
        table[(held[:, 1] != first) | (held[:, 0] != second)] = 0.0
    return late(factor(faults) * table, faults)


def backlash(faults: tuple[str, ...] = ()) -> np.ndarray:
    share = sine_squared(BACK, 5 if "filter" in faults else CYCLES)
    return late(-factor(faults) * WIDTH * share, faults)


def log_of(
    folder: Path,
    columns: dict[str, np.ndarray],
    seed: int = 0,
    noise: float = NOISE,
    increment: float | None = None,
) -> ControllerLog:
    """Return the log that a controller wrote with these columns."""
    rng = np.random.default_rng(seed)
    whole = {"time": np.arange(ROWS) * CYCLE}
    whole |= {f"A{axis}.position": place for axis, place in MOTION.items()}
    for name, values in columns.items():
        noisy = values + noise * rng.normal(size=ROWS)
        whole[name] = np.rint(noisy / increment) if increment else noisy
    file = folder / "log.csv"
    np.savetxt(
        file, np.stack(list(whole.values()), axis=1), fmt="%.9f", delimiter=",",
        header=",".join(whole), comments="",
    )  # fmt: skip
    return read_log(file, increment)


def plain_log(folder: Path, columns: dict[str, np.ndarray], seed: int) -> ControllerLog:
    """Return a log without writing its noisy column: the motion is read once."""
    log = log_of(folder, {}) if not (folder / "log.csv").exists() else None
    log = log or read_log(folder / "log.csv")
    rng = np.random.default_rng(seed)
    offsets = []
    for name, values in columns.items():
        axis, compensation = name.split(".")
        noisy = values + NOISE * rng.normal(size=ROWS)
        offsets.append(LoggedOffset(axis, compensation, name, noisy, True, 0.0))
    return ControllerLog(log.source, log.motion, tuple(offsets), log.cycle, ())


def verified(log: ControllerLog, *lists: ListFile) -> Verification:
    return verify_log(lists, log, Reading(Conventions()))


def only(found: Verification) -> Verdict:
    assert len(found.verdicts) == 1
    return found.verdicts[0]


CASES = [("leadscrew", screw, SCREW), ("plane", plane, PLANE),
         ("backlash", backlash, BACKLASH)]  # fmt: skip


def lists_of(compensation: str) -> tuple[ListFile, ...]:
    if compensation == "plane":
        return (plane_list(),)
    if compensation == "leadscrew":
        return (screw_list(), axis_list())
    return (axis_list(),)


def test_without_a_fault_everything_agrees(tmp_path: Path) -> None:
    columns = {"A3.leadscrew": screw(), "A3.backlash": backlash()}
    found = verified(log_of(tmp_path, columns), screw_list(), axis_list())
    assert found.agrees
    for one in found.verdicts:
        # 8 000 rows of 1 µm: what is left is far below the unit of the lists.
        assert one.sentence == "agrees within 0.1 µm"
    assert only(verified(log_of(tmp_path, {"A3.plane": plane()}), plane_list())).agrees


@pytest.mark.parametrize(
    ("compensation", "fault"),
    [
        # Each fault of the backlash is found in the pairs below.
        pytest.param(name, fault, marks=pytest.mark.heavy)
        if name == "backlash" or (name == "plane" and fault in ALIKE)
        else (name, fault)
        for name, _, faults in CASES
        for fault in faults
    ],
)
def test_a_single_fault_is_found(tmp_path: Path, compensation: str, fault: str) -> None:
    make = {name: law for name, law, _ in CASES}[compensation]
    log = plain_log(tmp_path, {f"A3.{compensation}": make((fault,))}, seed=5)
    one = only(verified(log, *lists_of(compensation)))
    assert one.verdict == (WORDS.get(fault, fault),)
    assert one.sentence.startswith(SENTENCES.get((compensation, fault), ""))
    sizes = {"sign": -1.0, "x10": 10.0, "x0.1": 0.1, "twice": 2.0, "lag": 2.0,
             "filter": 5.0}  # fmt: skip
    if fault in sizes:
        assert one.value == (sizes[fault],)
    if fault == "shift":
        # Slopes of 1 to 5 µm/mm, 8 000 rows of 1 µm: 0.01 mm is some deviations.
        assert one.value[0] == pytest.approx(3.0, abs=0.03)


def pairs() -> list[Any]:
    """Pairs of faults of each compensation; three show the behaviour."""
    shown = {("sign", "lag"), ("x10", "filter"), ("x0.1", "twice")}
    return [
        pytest.param(
            name,
            pair,
            marks=() if name == "backlash" and pair in shown else pytest.mark.heavy,
        )
        for name, _, faults in CASES
        for pair in itertools.combinations(faults, 2)
        # No fault, and on a plane as on the leadscrew.
        if set(pair) != {"x10", "x0.1"} and (name != "plane" or "swapped" in pair)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("compensation", "pair"), pairs())
def test_a_pair_of_faults_is_found(
    tmp_path: Path, compensation: str, pair: tuple[str, str]
) -> None:
    make = {name: law for name, law, _ in CASES}[compensation]
    log = plain_log(tmp_path, {f"A3.{compensation}": make(pair)}, seed=7)
    one = only(verified(log, *lists_of(compensation)))
    assert set(one.verdict) == {WORDS.get(fault, fault) for fault in pair}


def test_two_faults_are_joined_in_one_sentence(tmp_path: Path) -> None:
    log = plain_log(tmp_path, {"A3.leadscrew": screw(("sign", "lag"))}, seed=5)
    one = only(verified(log, screw_list(), axis_list()))
    assert one.sentence == "added with opposite sign and 2 cycles later"


def test_the_drive_position_alone_tells_each_part_and_the_final_sign(
    tmp_path: Path,
) -> None:
    drive = MOTION[3] + 12.5 + screw(("shift",)) + backlash(("sign",))
    log = log_of(tmp_path, {"A3.drive_position": drive})
    found = verified(log, screw_list(), axis_list())
    told = {one.compensation: one for one in found.verdicts}
    assert told["leadscrew"].verdict == ("shift",)
    assert told["backlash"].verdict == ("sign",)
    assert "leadscrew_sign" in found.settled
    assert not any("reach the drive" in text for text in found.remarks)


def test_a_drive_bus_that_is_late_by_a_part_of_a_cycle_is_allowed_for(
    tmp_path: Path,
) -> None:
    rows = np.arange(ROWS, dtype=float)
    drive = np.interp(rows - 2.4, rows, MOTION[3] + screw() + backlash())
    found = verified(
        log_of(tmp_path, {"A3.drive_position": drive}), screw_list(), axis_list()
    )
    assert found.agrees


def drive_log(folder: Path, drive: np.ndarray, part: slice) -> ControllerLog:
    """Return a part of the log of a drive position alone."""
    rows, file = np.arange(part.stop - part.start), folder / "log.csv"
    np.savetxt(
        file, np.stack([rows * CYCLE, MOTION[3][part], drive[part]], axis=1), fmt="%.9f",
        delimiter=",", header="time,A3.position,A3.drive_position", comments="",
    )  # fmt: skip
    return read_log(file)


ACTIVE_SCREW = (
    "kopf.achs_nr 3",
    "lr_param.ssfk 1",
    f"lr_param.n_backlash_cyc {CYCLES}",
)


@pytest.mark.parametrize(("start", "rows"), [(3000, 150), (0, 400), (3000, 400)])
def test_a_short_log_of_a_drive_that_is_not_late_shows_the_list_as_it_is(
    start: int, rows: int, tmp_path: Path
) -> None:
    log = drive_log(tmp_path, MOTION[3] + screw(), slice(start, start + rows))
    found = verified(log, screw_list(), listing("achsmds3.lis", *ACTIVE_SCREW))
    assert found.agrees
    assert not any("drive_position comes" in text for text in found.remarks)


@pytest.mark.parametrize("fault", ["sign", "twice"])
def test_a_fault_at_the_drive_is_no_delay_of_its_bus(
    fault: str, tmp_path: Path
) -> None:
    drive = np.interp(
        np.arange(ROWS) - 2.4, np.arange(ROWS), MOTION[3] + screw((fault,))
    )
    drive += 1e-5 * np.random.default_rng(4).normal(size=ROWS)
    log = drive_log(tmp_path, drive, slice(1000, 2500))
    found = verified(log, screw_list(), listing("achsmds3.lis", *ACTIVE_SCREW))
    assert only(found).verdict == (fault,)
    assert any("drive_position comes 2.4 ms" in text for text in found.remarks)


def test_a_log_of_offsets_alone_leaves_the_final_sign_open(tmp_path: Path) -> None:
    found = verified(
        log_of(tmp_path, {"A3.leadscrew": screw()}), screw_list(), axis_list()
    )
    assert any("sign they reach the drive" in text for text in found.remarks)
    assert "leadscrew_sign" not in found.settled
    assert "filter_delay" in found.settled


def test_objects_in_increments_on_another_clock_are_understood(tmp_path: Path) -> None:
    rows = np.arange(ROWS, dtype=float)
    columns = {
        name: np.interp(rows - 3.5, rows, values)
        for name, values in (
            ("LSEC::sum epsilon", screw()),
            ("BC::actual backlash", backlash(("sign",))),
        )
    }
    log = log_of(tmp_path, columns, increment=2e-4)
    found = verified(log, screw_list(), axis_list())
    told = {one.compensation: one.verdict for one in found.verdicts}
    assert told == {"leadscrew": ("agrees",), "backlash": ("sign",)}
    assert any("3.5 ms later than its positions" in text for text in found.remarks)


def test_two_faults_that_a_motion_cannot_tell_apart_are_both_named(
    tmp_path: Path,
) -> None:
    # One way at one speed: 2 cycles later is 0.4 mm further.
    place = np.linspace(20.0, 280.0, 1301)
    text = "time,A3.position,A3.leadscrew\n"
    values = -np.interp(place - 0.4, NODES, POS)
    values += 2e-4 * np.random.default_rng(3).normal(size=values.size)
    for row, (x, y) in enumerate(zip(place, values, strict=True)):
        text += f"{row * CYCLE:.3f},{x:.6f},{y:.9f}\n"
    file = tmp_path / "way.csv"
    file.write_text(text)
    one = only(verified(read_log(file), screw_list()))
    assert set(one.verdict) == {"lag", "shift"}
    assert "or as well" in one.sentence


def test_what_the_motion_does_not_reach_is_said(tmp_path: Path) -> None:
    text = "A3.position,A3.leadscrew\n"
    rng = np.random.default_rng(4)
    for x in rng.uniform(20.0, 280.0, 2000):
        text += f"{x:.6f},{-np.interp(x, NODES, POS) + 1e-3 * rng.normal():.9f}\n"
    file = tmp_path / "inside.csv"
    file.write_text(text)
    one = only(verified(read_log(file), screw_list()))
    assert one.agrees
    assert "this log does not show what happens beyond the table" in one.sentence


def test_every_compensation_of_a_machine_agrees_with_its_simulation(
    tmp_path: Path,
) -> None:
    lists = (
        listing(
            "achskw1.lis", "kopf.achs_nr 1", "kw.crosstalk.mode 1",
            "kw.crosstalk.master_dyn_ax_nr 2", "kw.crosstalk.velocity_dependent 1",
            "kw.crosstalk.acceleration 2000", "kw.crosstalk.deceleration -2000",
            "kw.crosstalk.n_cycles 8",
            "kw.crosstalk.position[0].correction_accelerate_dir_pos 300",
            "kw.crosstalk.position[0].correction_decelerate_dir_pos 200",
            "kw.crosstalk.position[0].correction_accelerate_dir_neg -250",
            "kw.crosstalk.position[0].correction_decelerate_dir_neg 100",
            "frict_comp.mode 3", "frict_comp.table_entries 2",
            "frict_comp.table[0].in 1000", "frict_comp.table[0].out 40",
            "frict_comp.table[1].in 200000", "frict_comp.table[1].out 90",
        ),
        listing(
            "achsmds1.lis", "kopf.achs_nr 1", "lr_param.crosstalk 1",
            "lr_param.frict_comp 1", "lr_param.temp_comp 1",
            "lr_param.temp_comp_offset_0 120", "lr_param.temp_comp_coefficient 80.0",
        ),
    )  # fmt: skip
    time = np.arange(ROWS) * CYCLE
    (one,) = simulate(lists, Motion(MOTION, {}, time), Reading(Conventions()))
    assert one.current is not None
    columns = {f"A1.{name}": values for name, values in one.parts.items()}
    found = verified(log_of(tmp_path, columns | {"A1.friction": one.current}), *lists)
    told = {verdict.compensation: verdict for verdict in found.verdicts}
    assert set(told) == {"crosstalk", "friction", "temperature"}
    assert {verdict.verdict for verdict in told.values()} == {("agrees",)}


def test_an_axis_that_stands_still_settles_nothing(tmp_path: Path) -> None:
    text = "time,A3.position,A3.backlash\n"
    for row in range(400):
        text += f"{row * CYCLE:.3f},100,0\n"
    file = tmp_path / "still.csv"
    file.write_text(text)
    found = verified(read_log(file), axis_list())
    assert only(found).verdict == ()
    assert "the log cannot tell" in only(found).sentence
    assert not found.agrees
    assert not found.settled


def test_a_log_that_is_exact_is_judged_like_any_other(tmp_path: Path) -> None:
    lists = [plane_list(), axis_list()]
    log = log_of(tmp_path, {})
    places = {axis: log.motion.require(f"A{axis}.position") for axis in MOTION}
    motion = Motion(places, {}, log.motion.require("time"))
    (one,) = simulate(lists, motion, Reading(Conventions()))
    offset = LoggedOffset("A3", "plane", "A3.plane", one.parts["plane"], True, 0.0)
    exact = ControllerLog(log.source, log.motion, (offset,), log.cycle, ())
    assert only(verified(exact, *lists)).verdict == ("agrees",)


def test_what_is_added_to_an_axis_that_turns_is_told_in_degrees(tmp_path: Path) -> None:
    log = log_of(tmp_path, {"A3.backlash": backlash()})
    reading = Reading(Conventions(), modulo={3: (0.0, 360.0)})
    found = verify_log([axis_list()], log, reading)
    assert only(found).sentence.startswith("agrees within 0.0001°")


def test_a_compensation_that_adds_nothing_is_called_so(tmp_path: Path) -> None:
    log = plain_log(tmp_path, {"A3.leadscrew": np.zeros(ROWS)}, seed=1)
    one = only(verified(log, screw_list(), axis_list()))
    assert one.verdict == ()
    assert one.sentence.startswith("nothing is added")


@pytest.mark.parametrize("digit", [1e-3, 2.5e-4, 1e-4])
def test_rounding_of_a_position_without_the_list_settles_no_sign(
    tmp_path: Path, digit: float
) -> None:
    # What rounding leaves of a motion follows any table a little, turned and shifted.
    place = MOTION[3]
    rest = np.round(place / digit) * digit - place
    found = verified(
        log_of(tmp_path, {"A3.leadscrew": rest}), screw_list(), axis_list()
    )
    assert only(found).verdict == ()
    assert not found.settled


def test_an_offset_that_no_rule_explains_does_not_agree(tmp_path: Path) -> None:
    other = 0.05 * np.sin(MOTION[3] / 7.0)
    log = plain_log(tmp_path, {"A3.leadscrew": screw() + other}, seed=1)
    one = only(verified(log, screw_list(), axis_list()))
    assert not one.agrees
    # The part never exceeds the whole.
    left, whole = map(float, re.findall(r"([\d.]+) µm", one.sentence)[:2])
    assert "not explained" in one.sentence
    assert 30.0 < left <= whole < 70.0


@pytest.mark.parametrize(
    ("times", "words"),
    [(0.0, "missing between the directions"), (2.0, "as if the backlash")],
)
@pytest.mark.parametrize("timed", [True, False])
def test_difference_of_the_directions_that_is_missing_or_twice_does_not_agree(
    tmp_path: Path, times: float, words: str, timed: bool
) -> None:
    # 2 µm of 20: a small part of what is added, all along the way.
    ahead = 0.03 * np.sin(NODES / 70.0)
    lines = [
        "kopf.achs_nr 3", "kw.ssfk.unit 1", "kw.ssfk.interval 100000", "kw.ssfk.bilateral 1",
        "kw.ssfk.kw_startpos 0", "kw.ssfk.kw_nr_max 31", "kw.ssfk.set_pos_without_comp 1",
    ]  # fmt: skip
    for k, (pos, neg) in enumerate(
        zip(units(ahead), units(ahead - 0.002), strict=True)
    ):
        lines += [f"kw.ssfk.table[{k}].pos {pos}", f"kw.ssfk.table[{k}].neg {neg}"]
    time = 0.01 * np.arange(4000)
    place = 150.0 - 145.0 * np.cos(2 * np.pi * time / 20.0)
    way = np.where(np.gradient(place) >= 0, 1, -1)
    for share in (1.0, times):
        added = -np.interp(place, NODES, ahead) + 0.002 * share * (way < 0)
        first = time if timed else way
        table = np.column_stack([first, place, np.round(added, 5)])
        path = tmp_path / f"log_{share:.0f}.csv"
        name = "time" if timed else "A3.direction"
        head = f"{name},A3.position,A3.leadscrew"
        np.savetxt(path, table, "%.6f", ",", header=head, comments="")
        found = only(verified(read_log(path), listing("achskw3.lis", *lines)))
        assert found.agrees == (share == 1.0), found.sentence
        assert (words in found.sentence) == (share != 1.0)


@pytest.mark.parametrize("rows", [400, 3])
def test_one_entry_that_differs_and_a_log_of_a_few_rows_do_not_agree(
    tmp_path: Path, rows: int
) -> None:
    lines = ["kopf.achs_nr 3", "kw.crosscomp.unit 1", "kw.crosscomp.last_index 40"]
    lines.append("kw.crosscomp.master_ax_nr 1")
    nodes = np.arange(0.0, 401.0, 10.0)
    entries = np.rint(250.0 * np.sin(nodes / 90.0)).astype(int)
    for k, (place, entry) in enumerate(zip(nodes, entries, strict=True)):
        lines.append(f"kw.crosscomp.table[{k}].setpoint {int(1e4 * place)}")
        lines.append(f"kw.crosscomp.table[{k}].correction {entry}")
    x = 200.0 + 195.0 * np.sin(np.arange(rows) / 40.0)
    run = entries * 1e-4
    run[20] += 0.03 * (rows > 3)
    table = np.column_stack([0.01 * np.arange(rows), x, np.interp(x, nodes, run)])
    path = tmp_path / "log.csv"
    head = "time,A1.position,A3.cross"
    np.savetxt(path, table, "%.6f", ",", header=head, comments="")
    reading = Reading(Conventions())
    (found,) = verify_log(
        [listing("achskw3.lis", *lines)], read_log(path), reading
    ).verdicts
    # 30 µm at one of 41 entries: 1 µm over the whole log.
    words = "as if an entry there were another" if rows > 3 else "3 rows, expected 5"
    assert not found.agrees
    assert words in found.sentence
    assert ("A1 = 200," in found.sentence) == (rows > 3)


def test_rows_in_any_order_do_not_hide_what_no_rule_explains(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    place = rng.uniform(0.0, 300.0, 640)
    added = -np.interp(place, NODES, POS) + 0.02 * np.sin(place / 9.0)
    text = "\n".join(
        f"{one:.6f},1,{value:.7f}" for one, value in zip(place, added, strict=True)
    )
    path = tmp_path / "log.csv"
    path.write_text(f"A3.position,A3.direction,A3.leadscrew\n{text}\n")
    found = only(verified(read_log(path), screw_list()))
    # A third of the table, from place to place: neighbouring rows average it away.
    assert not found.agrees
    assert "not explained: 14" in found.sentence
