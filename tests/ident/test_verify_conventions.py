"""Verify settles the conventions that a log can tell: axes that lag behind commands."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from axcomp.data.lists import ListFile
from axcomp.data.measurements import read_log
from axcomp.ident.exchange import ExchangeError, Motion, Reading, simulate
from axcomp.ident.proof import Verification, verify_log
from axcomp.models import Conventions

ROWS, CYCLE = 6_000, 1e-3
TIME = np.arange(ROWS) * CYCLE
# Both axes reverse several times; what is driven follows 2 to 14 ms later: no delay.
FOLLOWING = TIME - 0.008 - 0.006 * np.sin(0.9 * TIME)
COMMAND = {
    1: 150.0 + 140.0 * np.sin(2.1 * TIME),
    2: 150.0 + 120.0 * np.sin(1.3 * TIME + 1.0),
}
ACTUAL = {
    1: 150.0 + 140.0 * np.sin(2.1 * FOLLOWING),
    2: 150.0 + 120.0 * np.sin(1.3 * FOLLOWING + 1.0),
}


def listing(source: str, *lines: str) -> ListFile:
    return ListFile.parse(("\n".join(lines) + "\n").encode(), source)


BACKLASH = listing(
    "achsmds1.lis", "kopf.achs_nr 1", "lr_param.anwahl_losekomp 1",
    "getriebe[0].lose 250",
)  # fmt: skip
PLANE = listing(
    "achskw1.lis", "kopf.achs_nr 1", "kw.crosscomp2.unit 1",
    "kw.crosscomp2.interval 1500000", "kw.crosscomp2.last_index_master1 2",
    "kw.crosscomp2.last_index_master2 2", "kw.crosscomp2.start_position_master1 0",
    "kw.crosscomp2.start_position_master2 0", "kw.crosscomp2.master1_ax_nr 1",
    "kw.crosscomp2.master2_ax_nr 2",
    *(
        f"kw.crosscomp2.table[{j}][{i}].correction {value}"
        for (j, i), value in np.ndenumerate(
            np.array([[0, 300, -200], [250, -400, 100], [-150, 200, 350]])
        )
    ),
)  # fmt: skip
SHAKE = listing(
    "achskw1.lis", "kopf.achs_nr 1", "kw.crosstalk.mode 1",
    "kw.crosstalk.master_dyn_ax_nr 2", "kw.crosstalk.velocity_dependent 1",
    "kw.crosstalk.acceleration 300", "kw.crosstalk.deceleration -300",
    "kw.crosstalk.position[0].correction_accelerate_dir_pos 300",
    "kw.crosstalk.position[0].correction_decelerate_dir_pos 200",
    "kw.crosstalk.position[0].correction_accelerate_dir_neg -250",
    "kw.crosstalk.position[0].correction_decelerate_dir_neg 100",
)  # fmt: skip
CROSS = listing(
    "achskw1.lis", "kopf.achs_nr 1", "kw.crosscomp.unit 1",
    "kw.crosscomp.master_ax_nr 2", "kw.crosscomp.last_index 5",
    *(
        line
        for k, value in enumerate([0, 300, -200, 250, -100, 150])
        for line in (
            f"kw.crosscomp.table[{k}].setpoint {600000 * k}",
            f"kw.crosscomp.table[{k}].correction {value}",
        )
    ),
)  # fmt: skip


def logged(folder: Path, used: ListFile, **conventions: object) -> Verification:
    """Return what is found in the log of a controller with these conventions."""
    rules = Conventions.from_dict(conventions)
    motion = Motion(COMMAND, {}, TIME, actuals=ACTUAL)
    columns = {"time": TIME}
    columns |= {f"A{axis}.position": place for axis, place in COMMAND.items()}
    columns |= {f"A{axis}.actual": place for axis, place in ACTUAL.items()}
    rng = np.random.default_rng(3)
    for one in simulate((used,), motion, Reading(rules)):
        for name, values in one.parts.items():
            columns[f"A{one.axis}.{name}"] = values + 1e-4 * rng.normal(size=ROWS)
        if one.current is not None:
            columns[f"A{one.axis}.friction"] = one.current
    file = folder / "log.csv"
    np.savetxt(
        file, np.stack(list(columns.values()), axis=1), fmt="%.9f", delimiter=",",
        header=",".join(columns), comments="",
    )  # fmt: skip
    return verify_log((used,), read_log(file), Reading(Conventions()))


@pytest.mark.parametrize(
    ("used", "name", "value"),
    [
        (BACKLASH, "direction_source", "actual"),
        (PLANE, "plane_input", "actual"),
        (SHAKE, "crosstalk_input", "actual"),
        (SHAKE, "crosstalk_velocity", "slave"),
        (CROSS, "cross_list", "master"),
    ],
)
def test_a_convention_that_the_log_tells_is_settled(
    tmp_path: Path, used: ListFile, name: str, value: str
) -> None:
    found = logged(tmp_path, used, **{name: value})
    assert found.agrees
    assert getattr(found.conventions, name) == value
    assert name in found.settled


def test_accelerations_of_rounded_positions_make_up_no_filter(tmp_path: Path) -> None:
    motion = Motion(COMMAND, {}, TIME)
    (one,) = simulate((SHAKE,), motion, Reading(Conventions()))
    # 0.1 µm in 1 ms are 100 mm/s², a third of the full acceleration.
    place = np.round(COMMAND[2], 4)
    rows = np.column_stack([TIME, COMMAND[1], place, one.parts["crosstalk"]])
    file, head = tmp_path / "log.csv", "time,A1.position,A2.position,A1.crosstalk"
    np.savetxt(file, rows, fmt="%.9f", delimiter=",", header=head, comments="")
    (found,) = verify_log((SHAKE,), read_log(file), Reading(Conventions())).verdicts
    assert not {"lag", "filter"} & {*found.verdict}
    assert "Log A2.velocity and A2.acceleration as well" in found.sentence
    assert "filter_delay" not in found.settled


def test_what_is_assumed_is_settled_as_well(tmp_path: Path) -> None:
    found = logged(tmp_path, CROSS)
    assert found.agrees
    assert found.conventions.cross_list == "slave"
    assert "cross_list" in found.settled


def test_without_actual_positions_a_convention_that_takes_them_is_refused() -> None:
    motion = Motion(COMMAND, {}, TIME)
    with pytest.raises(ExchangeError, match="as the convention crosstalk_input takes"):
        simulate((SHAKE,), motion, Reading(Conventions(crosstalk_input="actual")))


def plateau(step: float) -> ListFile:
    """Return 10 µm at node 4 of 7 along A1, 50 mm apart, and 2 of 7 along A2."""
    values = [f"[{j}][{i}].correction {100 * (i == 4) * (j == 2)}"
              for j in range(7) for i in range(7)]  # fmt: skip
    return listing(
        "achskw3.lis", "kopf.achs_nr 3", "kw.crosscomp2.unit 1",
        "kw.crosscomp2.grid RECTANGULAR", "kw.crosscomp2.interval1 500000",
        f"kw.crosscomp2.interval2 {round(1e4 * step)}",
        "kw.crosscomp2.last_index_master1 6", "kw.crosscomp2.last_index_master2 6",
        "kw.crosscomp2.start_position_master1 0",
        "kw.crosscomp2.start_position_master2 0", "kw.crosscomp2.master1_ax_nr 1",
        "kw.crosscomp2.master2_ax_nr 2",
        *(f"kw.crosscomp2.table{value}" for value in values),
    )  # fmt: skip


@pytest.mark.parametrize("step", [pytest.param(40.0, marks=pytest.mark.heavy), 50.0])
def test_a_plateau_is_not_taken_for_one_elsewhere_where_the_indices_are_exchanged(
    tmp_path: Path, step: float
) -> None:
    goals = [(0, 0), (300, 0), (300, 300), (0, 300), (0, 0), (300, 300), (0, 80), (300, 80),
             (0, 180), (300, 180), (0, 0)]  # fmt: skip
    place = np.concatenate(
        [np.linspace(a, b, 401)[1:] for a, b in itertools.pairwise(goals)]
    )
    # It is at node 2 along A1 and 4 along A2, behind a filter of the drive.
    distance = np.abs(place / [50.0, step] - [2.0, 4.0])
    added = 0.01 * np.prod(np.clip(1.0 - distance, 0.0, 1.0), axis=1)
    share = 1.0 - np.exp(-1.0 / 4.0)
    filtered = lfilter([share], [1.0, share - 1.0], added)
    noise = 5e-5 * np.random.default_rng(2).normal(size=len(added))
    rows = np.column_stack([1e-3 * np.arange(len(added)), place, filtered + noise])
    file, head = tmp_path / "log.csv", "time,A1.position,A2.position,A3.plane"
    np.savetxt(file, rows, fmt="%.9f", delimiter=",", header=head, comments="")
    found = verify_log((plateau(step),), read_log(file), Reading(Conventions()))
    assert "swapped" in found.verdicts[0].verdict
    # Where both intervals are the same it may as well be the masters that are exchanged.
    assert ("plane_index" in found.settled) == (step == 40.0)
    assert step == 50.0 or found.conventions.plane_index == "ij"


FRICTION = listing(
    "achskw1.lis", "kopf.achs_nr 1", "frict_comp.mode 3", "frict_comp.table_entries 2",
    "frict_comp.scaling_factor 1000", "frict_comp.table[0].in 1",
    "frict_comp.table[0].out 34", "frict_comp.table[1].in 200000",
    "frict_comp.table[1].out 40",
)  # fmt: skip


def listed(axis: int) -> ListFile:
    """Return a leadscrew table of an axis."""
    return listing(
        f"achskw{axis}.lis", f"kopf.achs_nr {axis}", "kw.ssfk.unit 1",
        "kw.ssfk.interval 600000", "kw.ssfk.kw_startpos 0", "kw.ssfk.kw_nr_max 6",
        *(f"kw.ssfk.table[{k}].pos {value}"
          for k, value in enumerate([0, 300, -200, 250, -100, 150])),
    )  # fmt: skip


def driven(folder: Path, lists: Sequence[ListFile], *signs: int) -> Verification:
    """Return what is found where the axes add their tables with a sign each."""
    motion = Motion(COMMAND, {}, TIME)
    columns = {"time": TIME}
    for axis, place in COMMAND.items():
        columns[f"A{axis}.position"] = columns[f"A{axis}.drive_position"] = place
    for one, sign in zip(
        simulate(lists, motion, Reading(Conventions())), signs, strict=True
    ):
        added = sign * sum(one.parts.values())
        columns[f"A{one.axis}.drive_position"] = COMMAND[one.axis] + added
    file = folder / "log.csv"
    np.savetxt(
        file, np.stack(list(columns.values()), axis=1), fmt="%.9f", delimiter=",",
        header=",".join(columns), comments="",
    )  # fmt: skip
    return verify_log(lists, read_log(file), Reading(Conventions()))


def test_a_sign_in_which_the_axes_contradict_each_other_is_not_settled(
    tmp_path: Path,
) -> None:
    found = driven(tmp_path, (listed(1), listed(2)), 1, -1)
    assert "leadscrew_sign" not in found.settled
    assert found.conventions.leadscrew_sign == Conventions().leadscrew_sign
    (words,) = (each for each in found.remarks if "contradict each other" in each)
    assert "leadscrew_sign = -1 on A1 but 1 on A2" in words
    alike = driven(tmp_path, (listed(1), listed(2)), -1, -1)
    assert alike.conventions.leadscrew_sign == 1
    assert "leadscrew_sign" in alike.settled


def test_a_friction_list_is_no_part_of_the_position_at_the_drive(
    tmp_path: Path,
) -> None:
    found = driven(tmp_path, (FRICTION, listed(2)), 1, 1)
    assert {(each.axis, each.agrees) for each in found.verdicts} == {(2, True)}


def test_a_log_of_a_current_says_what_tells_its_sign(tmp_path: Path) -> None:
    remarks = " ".join(logged(tmp_path, FRICTION).remarks)
    assert "write friction_sign with its present value under [verified]" in remarks
    assert "drive_position" not in remarks


def test_a_current_logged_in_another_unit_is_no_list_that_does_not_act(
    tmp_path: Path,
) -> None:
    motion = Motion(COMMAND, {}, TIME)
    (one,) = simulate((FRICTION,), motion, Reading(Conventions()))
    assert one.current is not None
    columns = {
        "time": TIME,
        "A1.position": COMMAND[1],
        "A1.friction": 0.012 * one.current,
    }
    file = tmp_path / "log.csv"
    np.savetxt(
        file, np.stack(list(columns.values()), axis=1), fmt="%.9f", delimiter=",",
        header=",".join(columns), comments="",
    )  # fmt: skip
    found = verify_log((FRICTION,), read_log(file), Reading(Conventions()))
    assert found.verdicts[0].verdict == ("unit",)
    assert found.verdicts[0].value[0] == pytest.approx(0.012, rel=1e-3)
