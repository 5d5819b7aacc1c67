"""`axcomp simulate` on whole machines: its options, its columns, its one-line errors."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main

LIST = (
    "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 1000000\nkw.ssfk.kw_startpos 0\n"
    "kw.ssfk.kw_nr_max 2\nkw.ssfk.table[0].pos 0\nkw.ssfk.table[1].pos 1000\n"
    "frict_comp.mode 3\nfrict_comp.table_entries 1\nfrict_comp.table[0].in 1\n"
    "frict_comp.table[0].out 50\n"
)
AXIS = (
    "kopf.achs_nr 1\nlr_param.ssfk 1\nlr_param.frict_comp 1\nlr_param.temp_comp 1\n"
    "lr_param.temp_comp_position_0 0\n"
)
MOTION = (
    "time,A1.position,temperature.frame,temperature.air\n"
    "0,50,20,0\n0.001,50,25,0\n0.002,50,30,0\n0.003,51,40,0\n"
)
TABLE = "temperature,offset_0,coefficient\n20,0,0\n30,0.004,10\n"

TWO = (
    "temperature,offset_0,coefficient,offset_0_sensor,coefficient_sensor\n"
    "20,0,0,frame,air\n30,0.004,10,frame,air\n"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in (
        ("achskw1.lis", LIST), ("achsmds1.lis", AXIS), ("m.csv", MOTION),
        ("t.csv", TABLE), ("two.csv", TWO),
    ):  # fmt: skip
        (tmp_path / name).write_text(text)
    return tmp_path


def run(*options: str) -> int:
    return main(
        ["simulate", "achskw1.lis", "achsmds1.lis", "--motion", "m.csv", *options]
    )


def columns(folder: Path) -> dict[str, np.ndarray]:
    lines = (folder / "o.csv").read_text().splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    return dict(zip(lines[0].split(","), rows.T, strict=True))


def test_temperature_table_friction_and_sum_have_their_columns(folder: Path) -> None:
    assert run("--out", "o.csv", "--temperature", "A1=t.csv:frame") == 0
    found = columns(folder)
    assert list(found) == [
        "time", "A1.leadscrew", "A1.temperature", "A1.offset", "A1.friction",
    ]  # fmt: skip
    # 20 °C: nothing; 25 °C: 2 µm and 5 µm/m over 50 mm; 30 °C and above, held: 4 µm and
    # 10 µm/m.
    warm = [0.0, 2e-3 + 2.5e-4, 4e-3 + 5e-4, 4e-3 + 5.1e-4]
    np.testing.assert_allclose(found["A1.temperature"], warm, rtol=0, atol=1e-12)
    # The leadscrew looks up the position with the temperature: −1000 units per 100 mm;
    # the file has nine decimals of a mm.
    screw = -1e-3 * (np.array([50.0, 50.0, 50.0, 51.0]) + warm)
    np.testing.assert_allclose(found["A1.leadscrew"], screw, rtol=0, atol=5e-10)
    total = found["A1.leadscrew"] + found["A1.temperature"]
    np.testing.assert_allclose(found["A1.offset"], total, rtol=0, atol=2e-9)
    np.testing.assert_array_equal(found["A1.friction"], [0.0, 0.0, 0.0, 50.0])


def test_offset_and_coefficient_of_a_table_follow_a_sensor_each(folder: Path) -> None:
    (folder / "m.csv").write_text(
        "A1.position,temperature.frame,temperature.air\n50,30,20\n50,20,30\n"
    )
    one_each = [0.004, 0.0005]
    assert run("--out", "o.csv", "--temperature", "A1=t.csv:frame,air") == 0
    assert columns(folder)["A1.temperature"] == pytest.approx(one_each)
    again = ("--force", "--out", "o.csv")
    assert run(*again, "--temperature", "A1=two.csv") == 0
    assert columns(folder)["A1.temperature"] == pytest.approx(one_each)
    assert run(*again, "--temperature", "A1=two.csv:air,frame") == 0
    assert columns(folder)["A1.temperature"] == pytest.approx(one_each[::-1])


def test_conventions_of_the_machine_are_taken(folder: Path) -> None:
    (folder / "c.toml").write_text(
        "[verified]\nleadscrew_sign = 1\nfriction_sign = -1\n"
    )
    assert run("--out", "o.csv", "--conventions", "c.toml") == 0
    found = columns(folder)
    assert found["A1.leadscrew"][0] == 0.05
    assert found["A1.friction"][3] == -50.0


@pytest.mark.parametrize(
    ("options", "text", "status"),
    [
        (
            ["--cycle-time", "0.002"],
            "time step of 1 ms, expected the cycle time of the",
            1,
        ),
        (["--cycle-time", "0"], "found 0, expected more than 0", 2),
        (
            ["--temperature", "A1=t.csv"],
            "temperature.air in the motion, expected one",
            1,
        ),
        (
            ["--temperature", "A1=two.csv:air"],
            "found a law whose offset follows frame and whose coefficient air, expected a"
            " sensor for each, as in :frame,air",
            1,
        ),
        (["--temperature", "A1=t.csv:frame,oil"], "in the motion, expected oil", 1),
        (["--temperature", "A1=t.csv:oil"], "in the motion, expected oil", 1),
        (["--temperature", "A1=m.csv:air"], "expected temperature, offset_0, coeff", 1),
        (["--temperature", "t.csv"], "expected an axis and its file as in A1=T.csv", 2),
        (["--modulo", "A1=0"], "expected an axis and its range as in A4=0:360", 2),
        (["--modulo", "A1=0:360"], "of the rotary axis 1, expected a linear axis", 1),
        (["--conventions", "t.csv"], "t.csv:1: not TOML", 1),
    ],
)
def test_bad_options_are_one_line(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    text: str,
    status: int,
) -> None:
    assert run(*options) == status
    shown = capsys.readouterr().err
    # Usage errors are drawn in a box, whose lines are as wide as the terminal.
    words = " ".join(shown.replace("│", " ").split())
    assert text in words
    if status == 1:
        assert shown.count("\n") == 1


def test_a_temperature_table_is_never_written_onto(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / "t.csv").read_bytes()
    assert run("--temperature", "A1=t.csv", "--out", "t.csv") == 2
    assert "which is an input, expected another file" in capsys.readouterr().err
    assert (folder / "t.csv").read_bytes() == before


def test_nan_in_a_motion_is_named_with_its_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "m.csv").write_text(MOTION.replace("0.002,50", "0.002,nan"))
    assert run() == 1
    assert "m.csv:4: column 'A1.position': found 'nan'" in capsys.readouterr().err


def test_remarks_are_part_of_the_json(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "m.csv").write_text("A1.position\n50\n")
    assert run("--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert "there is neither A1.velocity nor time" in found["remarks"][0]
    assert found["largest"]["A1.offset"] == 0.05


def test_friction_of_independent_rows_needs_their_velocity(folder: Path) -> None:
    (folder / "m.csv").write_text("A1.position,A1.velocity\n50,-3\n")
    assert run("--out", "o.csv") == 0
    assert columns(folder)["A1.friction"] == [-50.0]


@pytest.mark.parametrize("name", [".", "/", "x" * 251, "x" * 300])
def test_target_that_cannot_be_written_is_named_itself(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    status = run("--out", name, "--force")
    shown = capsys.readouterr().err
    assert ".part" not in shown
    if len(name) == 251:
        assert status == 0
        assert (folder / name).is_file()
    else:
        assert status == 1
        assert name in shown
