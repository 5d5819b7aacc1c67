"""`axcomp verify`: sentences, JSON, stored conventions, and one line for bad input."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main

NODES = np.arange(0.0, 201.0, 20.0)
VALUES = np.array([0, 12, 25, 31, 22, 8, -9, -20, -14, 2, 6]) * 1e-3
X = np.concatenate([np.linspace(-20, 220, 1500), np.linspace(220, -20, 1500)])
CROSS = (
    "kopf.achs_nr 3\nkopf.log_achs_name Z\nkw.crosscomp.unit 1\n"
    "kw.crosscomp.last_index 10\nkw.crosscomp.master_ax_nr 1\n"
    + "".join(
        f"kw.crosscomp.table[{k}].setpoint {round(1e4 * place)}\n"
        f"kw.crosscomp.table[{k}].correction {round(1e4 * value)}\n"
        for k, (place, value) in enumerate(zip(NODES, VALUES, strict=True))
    )
)


def write_log(
    file: Path,
    values: np.ndarray,
    name: str = "A3.cross",
    place: float | np.ndarray = 50.0,
    way: int = 1,
) -> None:
    noise = 1e-3 * np.random.default_rng(1).normal(size=X.size)
    drive = name.endswith("drive_position")
    place = np.full(X.size, place)
    shown = way * (values + noise + place * drive)
    rows = np.stack([np.arange(X.size) * 1e-3, X, place, shown], axis=1)
    head = f"time,A1.position,A3.position,{name}"
    np.savetxt(file, rows, fmt="%.9f", delimiter=",", header=head, comments="")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw3.lis").write_text(CROSS)
    return tmp_path


def offset() -> np.ndarray:
    return np.interp(X, NODES, VALUES)


COMMAND = ["verify", "achskw3.lis", "--log", "log.csv"]


def test_an_agreeing_log_ends_with_status_0_and_a_sentence(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(folder / "log.csv", offset())
    assert main(COMMAND) == 0
    printed = capsys.readouterr()
    assert printed.out == "A3 cross: agrees within 0.1 µm\n"
    assert "A3: a log of offsets cannot tell with which sign" in printed.err


def test_json_has_the_shape_of_the_interface(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(folder / "log.csv", -offset())
    assert main([*COMMAND, "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == [
        {
            "axis": "A3",
            "compensation": "cross",
            "verdict": ["sign"],
            "value": -1.0,
            "sentence": "added with opposite sign",
        }
    ]


def test_what_a_drive_log_settles_is_stored_and_then_assumed(folder: Path) -> None:
    beyond = (X < 0) | (X > 200)
    turned = -np.where(beyond, 0.0, offset())
    write_log(folder / "log.csv", turned, "A3.drive_position")
    save = [*COMMAND, "--save", "machine.toml"]
    assert main(save) == 1
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert stored["verified"] == {"cross_sign": -1, "cross_edge": "zero"}
    # With these rules assumed, the same log agrees.
    assert main(save) == 0


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("place", "shows"),
    [(0.0, False), (50.0, True), (np.clip(0.01 * (X - 150.0), 0.0, 5.0), False),
     (np.clip(0.1 * (X - 150.0), 0.0, 5.0), True)],
)  # fmt: skip
def test_a_drive_settles_a_sign_only_where_it_shows_which_way_it_counts(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    place: float | np.ndarray,
    shows: bool,
    way: int,
) -> None:
    write_log(folder / "log.csv", offset(), "A3.drive_position", place, way)
    status = main([*COMMAND, "--save", "machine.toml"])
    printed = capsys.readouterr()
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert stored.get("verified", {}).get("cross_sign") == (1 if shows else None)
    assert ("settled: move A3 by a few mm" in printed.err) != shows
    assert ("counts the other way round" in printed.err) == (shows and way < 0)
    assert ("or the drive counts the other way" in printed.out) == (status == 1)
    assert status == (not shows and way < 0)


def two_columns(
    folder: Path, logged: np.ndarray, drive: np.ndarray, place: float = 50.0
) -> None:
    """Write a log of what is added beside a position on the drive bus."""
    write_log(folder / "log.csv", drive, "A3.drive_position", place)
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    head = "time,A1.position,A3.position,A3.drive_position,A3.cross"
    whole = np.column_stack([rows, logged])
    np.savetxt(folder / "log.csv", whole, "%.9f", ",", header=head, comments="")


def test_a_displayed_position_beside_the_offsets_settles_no_sign(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    two_columns(folder, offset(), 0.0 * X)
    assert main([*COMMAND, "--save", "machine.toml"]) == 1
    assert "the drive_position shows nothing of it" in capsys.readouterr().out
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert "cross_sign" not in stored["verified"]


@pytest.mark.parametrize(("place", "shows"), [(50.0, True), (0.0, False)])
def test_the_sign_at_the_drive_counts_where_that_of_the_offsets_differs(
    folder: Path, capsys: pytest.CaptureFixture[str], place: float, shows: bool
) -> None:
    two_columns(folder, -offset(), offset(), place)
    assert main([*COMMAND, "--save", "machine.toml"]) == (not shows)
    assert ("but at the drive agrees" in capsys.readouterr().out) == shows
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert stored["verified"].get("cross_sign") == (1 if shows else None)


def test_a_factor_that_no_rule_explains_settles_nothing(folder: Path) -> None:
    write_log(folder / "log.csv", -3.3 * offset(), "A3.drive_position")
    assert main([*COMMAND, "--save", "machine.toml"]) == 1
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert not stored.get("verified")


def test_a_sign_that_only_offsets_show_is_not_stored(folder: Path) -> None:
    write_log(folder / "log.csv", -offset())
    assert main([*COMMAND, "--save", "machine.toml"]) == 1
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert "assumed" not in stored
    assert "cross_sign" not in stored["verified"]


def test_a_sign_that_the_drive_has_settled_stays_stored(folder: Path) -> None:
    save = [*COMMAND, "--save", "machine.toml"]
    write_log(folder / "log.csv", -offset(), "A3.drive_position")
    main(save)
    write_log(folder / "log.csv", offset())
    main(save)
    stored = tomllib.loads((folder / "machine.toml").read_text())
    assert stored["verified"]["cross_sign"] == -1


def test_the_log_may_use_names_of_axes_and_objects(folder: Path) -> None:
    write_log(folder / "log.csv", offset(), "V.A.CROSS_COMP_CURR.Z")
    assert main(COMMAND) == 0
    write_log(folder / "log.csv", offset() / 2e-4, "CROSSC::actual_offset")
    assert main([*COMMAND, "--increment", "0.0002"]) == 0


def test_cycles_that_the_recorder_dropped_change_no_verdict(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(folder / "log.csv", offset())
    head, *rows = (folder / "log.csv").read_text().splitlines()
    for start in range(100, 2900, 90):
        rows[start : start + 8] = [""] * 8
    text = "\n".join([head, *filter(None, rows)])
    (folder / "log.csv").write_text(text)
    assert main(COMMAND) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("A3 cross: agrees within 0.")
    assert (
        "256 cycles that the recorder dropped, of 3000, were filled in" in printed.err
    )
    # More than a moment: nobody knows how the axes got there.
    del rows[400:500]
    (folder / "log.csv").write_text("\n".join([head, *filter(None, rows)]))
    assert main(COMMAND) == 1
    assert "or those from it on, as a file of their own" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("A1.position", "A2.position"), "expected A1.position for the cross table"),
        (("A3.cross", "A3.power"), "found none of the values that the lists add"),
        (("A3.cross", "Q.cross"), "found axis 'Q', expected A1, A2"),
        (("\n0.001000000,", "\n0.0015,"), "a cycle of 1 ms after the row before"),
    ],
)
def test_bad_logs_end_in_one_line(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    change: tuple[str, str],
    expected: str,
) -> None:
    write_log(folder / "log.csv", offset())
    text = (folder / "log.csv").read_text().replace(*change, 1)
    (folder / "log.csv").write_text(text)
    assert main(COMMAND) == 1
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_two_lists_of_one_axis_end_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(folder / "log.csv", offset())
    (folder / "other.lis").write_text(CROSS)
    assert main([*COMMAND, "other.lis"]) == 1
    error = capsys.readouterr().err
    assert "a second compensation list of axis 3 beside achskw3.lis" in error
    assert error.count("\n") == 1


def test_a_cycle_time_that_disagrees_ends_in_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(folder / "log.csv", offset())
    assert main([*COMMAND, "--cycle-time", "0.002"]) == 1
    error = capsys.readouterr().err
    assert "found a cycle time of 1 ms, expected 2 ms" in error
    assert error.count("\n") == 1


def test_a_display_that_begins_anew_is_read_where_modulo_says_that_the_axis_goes_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    nodes = np.arange(0.0, 361.0, 30.0)
    bent = np.round(0.02 * np.sin(np.radians(nodes)), 4)
    table = "".join(
        f"kw.crosscomp.table[{k}].setpoint {round(1e4 * place)}\n"
        f"kw.crosscomp.table[{k}].correction {round(1e4 * value)}\n"
        for k, (place, value) in enumerate(zip(nodes, bent, strict=True))
    )
    head = "kopf.achs_nr 3\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 12\n"
    (tmp_path / "achskw3.lis").write_text(f"{head}kw.crosscomp.master_ax_nr 1\n{table}")
    shown = np.concatenate([np.arange(0, 800, 0.25), np.arange(800, 0, -0.25)]) % 360.0
    rows = [
        1e-3 * np.arange(shown.size),
        shown,
        0 * shown,
        np.interp(shown, nodes, bent),
    ]
    heading = "time [s],A1.position [deg],A3.position [mm],A3.cross [mm]"
    np.savetxt("log.csv", np.stack(rows, 1), "%.7f", ",", header=heading, comments="")
    np.savetxt(
        "motion.csv",
        np.stack(rows[:3], 1),
        "%.7f",
        ",",
        header=",".join(heading.split(",")[:3]),
        comments="",
    )
    modulo = ["--modulo", "A1=0:360"]
    assert main(["verify", "achskw3.lis", "--log", "log.csv", *modulo]) == 0
    assert "A3 cross: agrees" in capsys.readouterr().out
    assert main(["simulate", "achskw3.lis", "--motion", "motion.csv", *modulo]) == 0
    printed = np.loadtxt(capsys.readouterr().out.splitlines()[1:], delimiter=",")
    # Corrections are whole increments of 0.1 µm.
    np.testing.assert_allclose(printed[:, 1], rows[3], atol=1e-4)
