"""The command ``axcomp iso230`` and its chart."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import iso230
from axcomp.ident.cli import main
from axcomp.ident.report._iso_chart import (
    draw_iso_chart,
    iso_chart_sentence,
    write_chart,
)

TARGETS = [0.0, 25.0, 50.0, 75.0, 100.0]


def laser(folder: Path, name: str = "before.csv", size: float = 1.0) -> Path:
    """Write five runs both ways: slope 0.2 µm/mm, reversal 8 µm, scatter 1 µm."""
    rng = np.random.default_rng(7)
    lines = ["target,error,run,direction"]
    for run in range(1, 6):
        for direction in (1, -1):
            for target in TARGETS[::direction]:
                error = size * (2e-4 * target - 4e-3 * direction) + rng.normal(0, 1e-3)
                lines.append(f"{target},{error:.6f},{run},{direction}")
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def figures(name: str, size: float = 1.0):
    target = np.tile([*TARGETS, *TARGETS], 5)
    direction = np.tile(np.repeat([1, -1], 5), 5)
    noise = np.random.default_rng(len(name)).normal(0, 1e-3, target.size)
    error = size * (2e-4 * target - 4e-3 * direction) + noise
    return iso230(target, error, np.repeat(np.arange(5), 10), direction)


def test_iso230_prints_figures_in_mm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["iso230", str(laser(tmp_path)), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    keys = ["A", "R", "B", "B_mean", "E", "M", "R_up", "R_down"]
    keys += ["A_up", "A_down", "E_up", "E_down", "positions"]
    assert list(found)[: len(keys)] == keys
    # True values 8, −8 and 20 µm; five runs with 1 µm leave 1 to 2 µm on an extreme.
    assert found["B"] == pytest.approx(0.008, abs=0.002)
    assert found["B_mean"] == pytest.approx(-0.008, abs=0.001)
    assert found["M"] == pytest.approx(0.020, abs=0.002)
    assert len(found["positions"]) == 5


def test_iso230_compares_before_and_after_and_judges_the_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(laser(tmp_path)), str(laser(tmp_path, "after.csv", 0.05))]
    assert main(["iso230", *files, "--tolerance", "0.01", "--json"]) == 0
    shown = capsys.readouterr()
    found = json.loads(shown.out)
    assert found["after"]["A"] < 0.01 < found["A"]
    assert found["verdict"]["figure"] == "A"
    assert found["verdict"]["value"] == found["after"]["A"]
    assert "PASS: A = " in shown.err


@pytest.mark.parametrize("tolerance", ["0.01", "10um", "10 µm", "0,01"])
def test_iso230_fails_a_test_beyond_its_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tolerance: str
) -> None:
    assert main(["iso230", str(laser(tmp_path)), "--tolerance", tolerance]) == 1
    shown = capsys.readouterr().out
    assert "FAIL: A = " in shown
    assert "> tolerance 10.0 µm (before.csv)" in shown


@pytest.mark.parametrize("tolerance", ["tight", "0", "3 s"])
def test_iso230_tolerance_that_is_no_length_is_bad_usage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tolerance: str
) -> None:
    assert main(["iso230", str(laser(tmp_path)), "--tolerance", tolerance]) == 2
    assert "--tolerance: found" in capsys.readouterr().err


def test_iso230_tolerance_that_looks_like_micrometres_must_state_its_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(laser(tmp_path))
    assert main(["iso230", path, "--tolerance", "20"]) == 2
    assert "without a unit, expected 20um or 20mm" in capsys.readouterr().err
    assert main(["iso230", path, "--tolerance", "20um"]) == 1
    assert main(["iso230", path, "--tolerance", "20mm"]) == 0


def test_iso230_passes_no_truncated_run_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["UNIT=mm", "CYCLES=5", "POSITIONS=3"]
    lines += [f"TGT_DATA[{at}]={10 * at}" for at in (1, 2, 3)]
    for run in range(1, 6):
        for side in ("FWD", "BWD"):
            for at in (1, 2, 3):
                far = 0.02 if at == 3 and run > 3 else 0.0
                read = 10 * at + 1e-3 * run + far
                lines.append(f"REF_DATA_{side}[{at},{run}]={read:.4f}")
    path = tmp_path / "runs.dat"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    command = ["iso230", str(path), "--tolerance", "10um"]
    assert main(command) == 1
    assert "FAIL: A = " in capsys.readouterr().out
    # Three whole cycles of five: equal numbers of runs, and all of them good.
    path.write_text("\n".join(lines[: 6 + 18]) + "\n", encoding="utf-8")
    assert main(command) == 1
    shown = capsys.readouterr().out
    assert "NOT JUDGED: A = 4.0 µm ≤ tolerance 10.0 µm" in shown
    assert "12 readings that the file announces are missing" in shown


def test_iso230_passes_no_test_that_ends_within_its_second_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = laser(tmp_path).read_text(encoding="utf-8").splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join(lines[: 1 + 10 + 7]) + "\n", encoding="utf-8")
    assert main(["iso230", str(short), "--tolerance", "0.5"]) == 1
    shown = capsys.readouterr().out
    assert "NOT JUDGED: A = " in shown
    assert "it leaves out targets with a single approach: 0, 25, 50" in shown


@pytest.mark.parametrize("lost", [1, 2])
def test_iso230_passes_no_target_with_fewer_approaches_than_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], lost: int
) -> None:
    head, *rows = laser(tmp_path).read_text(encoding="utf-8").splitlines()
    far = max(float(row.split(",")[0]) for row in rows)
    last = [k for k, row in enumerate(rows) if float(row.split(",")[0]) == far]
    kept = [row for k, row in enumerate(rows) if k not in last[:lost]]
    short = tmp_path / "short.csv"
    short.write_text("\n".join([head, *kept]) + "\n", encoding="utf-8")
    assert main(["iso230", str(short), "--tolerance", "0.5"]) == 1
    shown = " ".join(capsys.readouterr().out.split())
    assert "NOT JUDGED: A = " in shown
    assert f"targets {far:g} have fewer approaches than others" in shown


def test_iso230_writes_the_chart_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(laser(tmp_path)), str(laser(tmp_path, "after.csv", 0.05))]
    out = tmp_path / "charts"
    assert main(["iso230", *files, "--out", str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "iso230_before.png",
        "iso230_before.svg",
    ]
    svg = (out / "iso230_before.svg").read_text(encoding="utf-8")
    for word in (
        "Position [mm]",
        "[µm]",
        "A before",
        "E after",
        "Thin lines are single runs",
    ):
        assert word in svg


def test_iso230_out_that_is_a_file_ends_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = laser(tmp_path)
    assert main(["iso230", str(path), "--out", str(path)]) == 1
    assert "before.csv: File exists" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("x,y,z\n1,2,3\n4,5,6\n", "expected target, error (or actual)"),
        (
            "X.position,X.error,Y.position,Y.error\n1,2,3,4\n5,6,7,8\n",
            "expected --axis",
        ),
        ("target,error,run\n5,0.1,1\n5,0.2,1\n", "direction of axis cannot be derived"),
        ("target,error,run,direction\n0,0.1,1,1\n9,nan,1,1\n", ":3: column 'error'"),
    ],
)
def test_iso230_refuses_what_is_no_test(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, match: str
) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["iso230", str(path)]) == 1
    assert match in capsys.readouterr().err


@pytest.mark.parametrize(
    ("factor", "said"), [(-1.0, "the other way"), (1.1, "the unit")]
)
def test_iso230_refuses_readings_of_another_sign_or_unit(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    factor: float,
    said: str,
) -> None:
    rows = [
        f"{place},{factor * (place + 0.002)},{run},{way}"
        for run in (1, 2)
        for way, places in (("+", (0, 100, 200)), ("-", (200, 100, 0)))
        for place in places
    ]
    path = tmp_path / "laser.csv"
    path.write_text("\n".join(["target,actual,run,direction", *rows]) + "\n")
    assert main(["iso230", str(path)]) == 1
    assert said in capsys.readouterr().err


def test_single_run_cannot_be_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.csv"
    path.write_text(
        "target,error,run,direction\n0,0.1,1,1\n9,0.2,1,1\n", encoding="utf-8"
    )
    assert main(["iso230", str(path), "--tolerance", "0.5"]) == 1
    assert "expected at least two: no accuracy A to judge" in capsys.readouterr().err


def test_direction_is_derived_from_the_order_of_targets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full = laser(tmp_path)
    lines = [line.rsplit(",", 1)[0] for line in full.read_text().splitlines()]
    bare = tmp_path / "bare.csv"
    bare.write_text("\n".join(lines) + "\n", encoding="utf-8")
    main(["iso230", str(full), "--json"])
    stated = json.loads(capsys.readouterr().out)
    main(["iso230", str(bare), "--json"])
    derived = json.loads(capsys.readouterr().out)
    assert derived["positions"] == stated["positions"]
    assert any("first target of each run" in remark for remark in derived["remarks"])


def test_chart_draws_every_run_mean_and_band() -> None:
    test = figures("one")
    figure = draw_iso_chart({"before": test}, axis="X", tolerance=0.02)
    axes = figure.axes[0]
    assert len(test.runs) == 10
    curves = [line for line in axes.get_lines() if np.size(line.get_xdata()) == 5]
    assert len(curves) == 12  # ten runs and two means
    assert len(axes.collections) == 2  # bands
    low, high = axes.get_ylim()
    assert low < -4.0
    assert high > 24.0  # the ends of slope and reversal in µm
    labels = [text.get_text() for text in axes.texts]
    assert any(label.startswith("A = ") for label in labels)
    assert any(label.startswith("E = ") for label in labels)
    assert "Axis X" in axes.get_title(loc="left")


def test_chart_overlays_before_predicted_and_verified(tmp_path: Path) -> None:
    tests = {
        "before": figures("a"),
        "predicted": figures("bb", 0.1),
        "verified": figures("c", 0),
    }
    figure = draw_iso_chart(tests, caption=False)
    (legend,) = figure.legends
    shown = [text.get_text() for text in legend.get_texts()]
    assert [label for label in shown if "↑" in label] == [
        "before ↑",
        "predicted ↑",
        "verified ↑",
    ]
    svg, png = write_chart(figure, tmp_path, "chart")
    first = svg.read_bytes()
    write_chart(draw_iso_chart(tests, caption=False), tmp_path, "chart")
    assert svg.read_bytes() == first  # equal input, equal bytes
    assert png.stat().st_size > 10_000
    assert "From 'before' to 'verified': A " in iso_chart_sentence(tests)
    figure.draw_without_rendering()
    for text in figure.axes[0].texts:  # nothing is cut off
        assert text.get_window_extent().x1 <= figure.bbox.x1, text.get_text()


def test_figures_of_a_rotary_axis_are_in_thousandths_of_a_degree() -> None:
    words = iso_chart_sentence({"": figures("before")}, unit="deg")
    # E is 28 m° where 0.2 m° per ° and a reversal of 8 m° were planted.
    assert re.search(r"the means alone span 2\d\.\d m°", words)


def test_a_wild_reading_is_named_beside_the_figures_that_hold_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = laser(tmp_path)
    assert main(["iso230", str(path), "--json"]) == 0
    assert "All figures hold it" not in capsys.readouterr().out
    rows = path.read_text().splitlines()
    cells = rows[12].split(",")
    rows[12] = ",".join([cells[0], "9.999", *cells[2:]])
    path.write_text("\n".join(rows) + "\n")
    assert main(["iso230", str(path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(rf"At {float(cells[0]):g} a reading lies up to 999\d µm", said)


def test_chart_of_one_direction_marks_what_exists() -> None:
    target = np.tile(TARGETS, 3)
    error = np.tile([0.0, 0.001, 0.002, 0.001, 0.0], 3) + np.repeat([0, 1e-4, 2e-4], 5)
    figure = draw_iso_chart({"": iso230(target, error, np.repeat([1, 2, 3], 5), None)})
    labels = [text.get_text() for text in figure.axes[0].texts]
    assert [label.split(" ")[0] for label in labels] == ["A↑", "E↑"]


@pytest.mark.parametrize("head", ["X target [mm],X error [mm]", "X.position,X.error"])
def test_iso230_takes_a_direction_without_axis_beside_columns_of_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], head: str
) -> None:
    path = laser(tmp_path)
    rows = path.read_text().splitlines()[1:]
    # Towards + in each row: without its directions it would be a test of one.
    ordered = sorted(
        rows, key=lambda row: (row.split(",")[2:], float(row.split(",")[0]))
    )
    path.write_text("\n".join([f"{head},run,direction", *ordered]) + "\n")
    assert main(["iso230", str(path), "--tolerance", "20um", "--axis", "X"]) == 1
    assert "FAIL: A = " in capsys.readouterr().out


def test_iso230_of_an_axis_that_goes_round_is_that_of_its_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = []
    for name, turn in (("on", 1e9), ("round", 360.0)):
        rng, rows = np.random.default_rng(3), []
        for run in (1, 2, 3):
            for place in (*range(270, 451, 30), *range(450, 269, -30)):
                error = 2.0 * np.sin(place / 60.0) + 0.2 * rng.normal()
                rows.append(f"{place % turn},{error:.5f},{run}")
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(["C target [deg],C error [mdeg],run", *rows]) + "\n")
        assert main(["iso230", str(path), "--json"]) == (turn < 1e3)
        assert ("--modulo 0:360" in capsys.readouterr().err) == (turn < 1e3)
        assert main(["iso230", str(path), "--json", "--modulo", "0:360"]) == 0
        printed.append(json.loads(capsys.readouterr().out))
    assert printed[0]["B_mean"] is not None
    assert printed[0]["A"] == pytest.approx(printed[1]["A"], abs=1e-9)
    assert printed[0]["B_mean"] == pytest.approx(printed[1]["B_mean"], abs=1e-9)


def test_iso230_takes_columns_that_do_not_name_themselves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = laser(tmp_path)
    assert main(["iso230", str(plain), "--json"]) == 0
    expected = json.loads(capsys.readouterr().out)
    head, *rows = plain.read_text().splitlines()
    del head
    cells = [row.split(",") for row in rows]
    lines = ["soll,dx,lauf,hin"]
    lines += [f"{t},{1e3 * float(e):.3f},{r},{d}" for t, e, r, d in cells]
    other = tmp_path / "own.csv"
    other.write_text("\n".join(lines) + "\n")
    named = ["target=soll", "error=dx:um", "run=lauf", "direction=hin"]
    options = [word for one in named for word in ("--column", one)]
    assert main(["iso230", str(other), "--json", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    # The file has whole nanometres.
    assert found["A"] == pytest.approx(expected["A"], abs=2e-6)
    assert main(["iso230", str(other)]) == 1
    assert "--column ROLE=COLUMN" in capsys.readouterr().err
    assert main(["iso230", str(other), "--column", "eror=dx"]) == 2
    assert "found 'eror=dx', expected ROLE=COLUMN" in capsys.readouterr().err


def test_a_table_with_a_column_per_run_is_evaluated_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(
        "Achse: X\nSoll [mm];hin 1 [µm];rück 1 [µm];hin 2 [µm];rück 2 [µm]\n"
        "0;0;4;2;6\n100;1;5;3;7\n",
        encoding="utf-8",
    )
    assert main(["iso230", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    # Backward lies 4 µm above forward everywhere: to the bit of a µm in mm.
    assert found["B"] == pytest.approx(0.004, abs=1e-12)
    assert found["E"] == pytest.approx(0.005, abs=1e-12)


@pytest.mark.parametrize(("apart", "judged"), [(0.006, False), (0.0, True)])
def test_iso230_passes_no_targets_that_were_read_twice_and_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], apart: float, judged: bool
) -> None:
    rng = np.random.default_rng(5)
    rows = [
        f"{run},{target},{0.001 * rng.normal() - apart * second:.5f}"
        for run in range(1, 6)
        for target in range(0, 201, 25)
        for second in (0, 1)
    ]
    path = tmp_path / "dial.csv"
    path.write_text("\n".join(["run,target [mm],error [mm]", *rows]) + "\n")
    assert main(["iso230", str(path), "--tolerance", "50um"]) == (not judged)
    said = capsys.readouterr().out
    assert ("PASS" in said) == judged
    assert ("if they were approached from both sides, state the direction" in said) == (
        not judged
    )
