"""`axcomp simulate` with what happens at the controller: COMP, homing, program end, reload."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.exchange import (
    ControllerEvent,
    ExchangeError,
    Motion,
    Reading,
    parse_action,
    simulate,
)
from axcomp.models import Conventions, TemperatureLine

CYCLES = 4
HALF = np.sqrt(0.5)
RAMP = np.array([(1 - HALF) / 2, 0.5, (1 + HALF) / 2, 1.0])
"""sin² over four cycles, from the first cycle on (S-06)."""
ROWS = 24
TIME = 1e-3 * np.arange(ROWS)
ROUNDING = 1e-12
"""mm: sums of a few numbers near 1."""


def cross(value: int, more: str = "") -> str:
    """Return a list of axis 3 that adds one value wherever axis 1 is."""
    return (
        "kopf.achs_nr 3\nkw.crosscomp.unit 1\nkw.crosscomp.master_ax_nr 1\n"
        f"kw.crosscomp.last_index 1\nkw.crosscomp.n_cycles {CYCLES}\n"
        f"kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction {value}\n"
        f"kw.crosscomp.table[1].setpoint 10\nkw.crosscomp.table[1].correction {value}\n{more}"
    )


SCREW = (
    "kw.ssfk.unit 1\nkw.ssfk.interval 1000000\nkw.ssfk.kw_nr_max 2\n"
    "kw.ssfk.table[0].pos -200\nkw.ssfk.table[1].pos -200\nkw.ssfk.manual_activation 1\n"
)
STILL = Motion({1: np.zeros(ROWS), 3: np.zeros(ROWS)}, {}, TIME)


def parse(text: str, name: str = "achskw3.lis") -> ListFile:
    return ListFile.parse(text.encode(), name)


def offsets(
    *events: ControllerEvent, text: str = cross(1000, SCREW)
) -> dict[str, np.ndarray]:
    (found,) = simulate([parse(text)], STILL, Reading(Conventions()), events=events)
    assert found.remarks == ()
    np.testing.assert_allclose(found.total, sum(found.parts.values()), atol=ROUNDING)
    return dict(found.parts)


def test_what_is_switched_comes_and_goes_over_its_cycles() -> None:
    found = offsets(
        ControllerEvent(3, "off", 3, ("cross",)),
        ControllerEvent(10, "on", 3, ("cross",)),
    )["cross"]
    np.testing.assert_allclose(found[:3], 0.1, atol=ROUNDING)
    np.testing.assert_allclose(found[3:7], 0.1 * (1 - RAMP), atol=ROUNDING)
    np.testing.assert_allclose(found[10:14], 0.1 * RAMP, atol=ROUNDING)
    np.testing.assert_allclose(found[14:], 0.1, atol=ROUNDING)


def test_what_waits_for_a_command_acts_from_it_to_the_end_of_the_program() -> None:
    found = offsets(
        ControllerEvent(5, "on", 3, ("leadscrew",)), ControllerEvent(9, "end")
    )
    # Entries are errors: −20 µm of error are +20 µm of offset, at once (no cycles).
    expected = np.where((np.arange(ROWS) >= 5) & (np.arange(ROWS) < 9), 0.02, 0.0)
    np.testing.assert_allclose(found["leadscrew"], expected, atol=ROUNDING)
    np.testing.assert_allclose(found["cross"], 0.1, atol=ROUNDING)


def test_homing_of_the_master_brings_the_table() -> None:
    found = offsets(ControllerEvent(6, "homed", 1))["cross"]
    np.testing.assert_allclose(found[:6], 0.0, atol=ROUNDING)
    np.testing.assert_allclose(found[6:10], 0.1 * RAMP, atol=ROUNDING)
    lost = offsets(ControllerEvent(6, "not homed", 1), ControllerEvent(12, "homed", 1))[
        "cross"
    ]
    np.testing.assert_allclose(lost[:6], 0.1, atol=ROUNDING)
    np.testing.assert_allclose(lost[[10, 11]], 0.0, atol=ROUNDING)


def test_reload_leads_from_the_old_table_to_the_new_one() -> None:
    later, back = parse(cross(3000)), parse(cross(1000))
    found = offsets(
        ControllerEvent(4, "reload", listing=later),
        ControllerEvent(12, "reload", listing=back),
        text=cross(1000),
    )["cross"]
    np.testing.assert_allclose(found[:4], 0.1, atol=ROUNDING)
    np.testing.assert_allclose(found[4:8], 0.1 + 0.2 * RAMP, atol=ROUNDING)
    np.testing.assert_allclose(found[8:12], 0.3, atol=ROUNDING)
    np.testing.assert_allclose(found[12:16], 0.3 - 0.2 * RAMP, atol=ROUNDING)
    np.testing.assert_allclose(found[16:], 0.1, atol=ROUNDING)


def test_reload_leaves_what_the_list_does_not_hold() -> None:
    line = TemperatureLine(0.0, 0.01, 0.0)
    (found,) = simulate(
        [parse(cross(1000))],
        STILL,
        Reading(Conventions(), lines={3: line}),
        events=[ControllerEvent(4, "reload", listing=parse(cross(3000)))],
    )
    np.testing.assert_allclose(found.parts["temperature"], 0.01, atol=ROUNDING)
    assert found.total[-1] == pytest.approx(0.31, abs=ROUNDING)


def test_command_before_a_reload_holds_behind_it() -> None:
    found = offsets(
        ControllerEvent(2, "off", 3, ("cross",)),
        ControllerEvent(9, "reload", listing=parse(cross(3000))),
        text=cross(1000),
    )["cross"]
    np.testing.assert_allclose(found[6:], 0.0, atol=ROUNDING)


def test_without_events_everything_is_on_for_long() -> None:
    lists = [parse(cross(1000, SCREW))]
    (plain,) = simulate(lists, STILL, Reading(Conventions()))
    (same,) = simulate(lists, STILL, Reading(Conventions()))
    np.testing.assert_array_equal(plain.total, same.total)
    np.testing.assert_allclose(plain.total, 0.12, atol=ROUNDING)


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (
            ControllerEvent(1, "off", 7, ("cross",)),
            "found axis 7, expected one of those",
        ),
        (
            ControllerEvent(
                1, "reload", listing=parse("kopf.achs_nr 5\nkw.ssfk.unit 1\n")
            ),
            "expected a compensation list of an axis that has one",
        ),
    ],
)
def test_event_for_what_is_not_there_is_refused(
    event: ControllerEvent, expected: str
) -> None:
    with pytest.raises(ExchangeError, match=expected):
        offsets(event)


@pytest.mark.parametrize(
    "text", ["COMP", "COMP ON SCREW", "COMP OFF_ALL CROSS", "STOP"]
)
def test_text_that_is_no_event_is_refused(text: str) -> None:
    with pytest.raises(ExchangeError, match="expected COMP ON CROSS"):
        parse_action(text, "e.csv:2")


def test_text_is_read_as_an_nc_program_has_it() -> None:
    assert parse_action("[COMP OFF CROSS PLANE]", "") == ("off", ("cross", "plane"))
    assert parse_action("comp off_all", "") == ("off", ())
    assert parse_action("M30", "") == ("end", ())


@pytest.mark.parametrize("underway", [0.05, 0.2])
def test_motion_that_is_under_way_from_its_first_row_shakes_nothing(
    underway: float,
) -> None:
    place = underway * np.arange(ROWS)
    motion = Motion({1: place}, {}, TIME)
    found = motion.rates(1)[1]
    assert found is not None
    # 0.2 mm in a cycle of 1 ms: a start from rest would be 200 m/s²; digits of the place.
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


def test_acceleration_from_the_first_row_on_is_held_back_to_it() -> None:
    speeding = Motion({1: 10.0 * TIME + 250.0 * TIME**2}, {}, TIME)
    found = speeding.rates(1)[1]
    assert found is not None
    np.testing.assert_allclose(found, 500.0, rtol=1e-6)  # digits of the place
    starting = Motion({1: np.array([0.0, 0.0, 1e-3, 3e-3])}, {}, TIME[:4])
    found = starting.rates(1)[1]
    assert found is not None
    np.testing.assert_allclose(found, [0.0, 0.0, 1000.0, 1000.0], rtol=1e-9)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw3.lis").write_text(cross(1000))
    (tmp_path / "new.lis").write_text(cross(3000))
    rows = [f"{t:.3f},0,0" for t in TIME]
    (tmp_path / "m.csv").write_text(
        "\n".join(["time,A1.position,A3.position", *rows, ""])
    )
    return tmp_path


COMMAND = ["simulate", "achskw3.lis", "--motion", "m.csv", "--out", "o.csv"]


def written(folder: Path) -> np.ndarray:
    lines = (folder / "o.csv").read_text().splitlines()
    at = lines[0].split(",").index("A3.cross")
    return np.array([float(line.split(",")[at]) for line in lines[1:]])


def test_command_takes_a_file_of_events(folder: Path) -> None:
    (folder / "e.csv").write_text(
        "time,axis,event\n0.012,3,RELOAD new.lis\n0.003,A3,COMP OFF CROSS\n"
        "0.0075,A3,COMP ON CROSS\n"
    )
    assert main([*COMMAND, "--events", "e.csv"]) == 0
    found = written(folder)
    # Written with 9 digits. 7.5 ms lies between two rows: the later one.
    np.testing.assert_allclose(found[3:7], 0.1 * (1 - RAMP), atol=1e-9)
    np.testing.assert_allclose(found[8:12], 0.1 * RAMP, atol=1e-9)
    np.testing.assert_allclose(found[12:16], 0.1 + 0.2 * RAMP, atol=1e-9)


def test_an_event_behind_the_motion_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "e.csv").write_text("time,axis,event\n0.023,3,HOMED\n0.024,3,HOMED\n")
    assert main([*COMMAND, "--events", "e.csv"]) == 0
    shown = capsys.readouterr().err
    words = "the event at 0.024 s does not act: the motion ends at 0.023 s"
    assert shown.count("does not act") == 1
    assert f"e.csv:3: {words}" in shown


def test_command_takes_a_column_of_the_motion(folder: Path) -> None:
    texts = dict.fromkeys(range(ROWS), "") | {0: "NOT HOMED", 5: "HOMED; COMP ON CROSS"}
    rows = [f"{t:.3f},0,0,{texts[k]}" for k, t in enumerate(TIME)]
    head = "time,A1.position,A3.position,event"
    (folder / "m.csv").write_text("\n".join([head, *rows, ""]))
    assert main(COMMAND) == 0
    np.testing.assert_allclose(
        written(folder)[:9], [*np.zeros(5), *(0.1 * RAMP)], atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "time,event\n0.001,COMP ON SCREW\n",
            "e.csv:2: found 'COMP ON SCREW', expected COMP",
        ),
        (
            "time,event\nsoon,HOMED\n",
            "e.csv:2: column 'time': found 'soon', expected a number",
        ),
        ("time,axis,event\n0,Q,HOMED\n", "e.csv:2: found axis 'Q', expected A1, A2"),
        ("time,axis\n0,3\n", "found columns time, axis, expected event"),
        ("time,event\n0,RELOAD none.lis\n", "none.lis: No such file"),
        ("time,axis,event\n0,A1,RELOAD new.lis\n", "expected one of axis 1"),
    ],
)
def test_bad_events_end_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, expected: str
) -> None:
    (folder / "e.csv").write_text(text)
    assert main([*COMMAND, "--events", "e.csv"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
