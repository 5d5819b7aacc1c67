"""Verify settles the conventions that a log can tell: axes that lag behind commands."""

from pathlib import Path

import numpy as np
import pytest

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


def test_what_is_assumed_is_settled_as_well(tmp_path: Path) -> None:
    found = logged(tmp_path, CROSS)
    assert found.agrees
    assert found.conventions.cross_list == "slave"
    assert "cross_list" in found.settled


def test_without_actual_positions_a_convention_that_takes_them_is_refused() -> None:
    motion = Motion(COMMAND, {}, TIME)
    with pytest.raises(ExchangeError, match="as the convention crosstalk_input takes"):
        simulate((SHAKE,), motion, Reading(Conventions(crosstalk_input="actual")))
