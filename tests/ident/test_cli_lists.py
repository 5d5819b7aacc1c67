"""The commands that read lists: exit status, messages, JSON, plots."""

import json
import pathlib
import subprocess
import sys

import pytest

from axcomp.data.lists import new_list
from axcomp.ident.cli import main

PLANE: dict[str, str | int | float | bool] = {
    "kopf.achs_nr": 3,
    "kopf.log_achs_name": "Z",
    "kw.crosscomp2.unit": 1,
    "kw.crosscomp2.grid": "QUADRATIC",
    "kw.crosscomp2.interval": 100_000,
    "kw.crosscomp2.last_index_master1": 3,
    "kw.crosscomp2.last_index_master2": 2,
    "kw.crosscomp2.start_position_master1": -400_000,
    "kw.crosscomp2.start_position_master2": -700_000,
    "kw.crosscomp2.master1_ax_nr": 1,
    "kw.crosscomp2.master2_ax_nr": 2,
    "kw.crosscomp2.n_cycles": 10,
    **{
        f"kw.crosscomp2.table[{j}][{i}].correction": 10 * i - 7 * j
        for j in range(3)
        for i in range(4)
    },
}
SCREW = """\
kopf.achs_nr 2
kw.ssfk.unit 1
kw.ssfk.interval 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 1
kw.ssfk.table[0].setpoint -10000
kw.ssfk.table[1].setpoint 0
kw.ssfk.table[2].setpoint 15000
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos -102
kw.ssfk.table[2].pos 7
kw.ssfk.table[0].neg 5
kw.ssfk.table[1].neg 80
kw.ssfk.table[2].neg 9
"""


@pytest.fixture
def plane(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "achskw3.lis"
    path.write_bytes(new_list(PLANE).dumps())
    return path


def changed(path: pathlib.Path, old: str, new: str) -> pathlib.Path:
    """Write a copy of the list with one piece of text replaced."""
    text = path.read_text(encoding="ascii")
    assert text.count(old) == 1
    copy = path.with_name("new.lis")
    copy.write_text(text.replace(old, new), encoding="ascii")
    return copy


def test_check_of_a_sound_list_ends_well(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(plane)]) == 0
    err, out = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1].startswith("1 list checked: ")
    assert main(["check", "--strict", str(plane)]) == 0


def test_check_names_file_line_column_and_expectation(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    old = "kw.crosscomp2.table[1][2].correction  13"
    broken = changed(plane, old, old.replace(" 13", " 1e3"))
    line = broken.read_text().splitlines().index(old.replace(" 13", " 1e3")) + 1
    assert main(["check", str(broken)]) == 1
    err = capsys.readouterr().out
    column = old.index(" 13") + 2
    assert f"{broken}:{line}:{column}: error: " in err
    assert "1e3" in err
    assert "expected" in err
    assert "1 error" in err.splitlines()[-1]


def test_warning_fails_only_a_strict_check(plane: pathlib.Path) -> None:
    odd = changed(plane, "# Ende\n", "Ende\n")
    assert main(["check", "--strict", str(odd)]) == 0  # real lists end so
    with odd.open("a") as file:
        file.write("kw.ssfk.kw_nr_max 0\n")
    assert main(["check", str(odd)]) == 0
    assert main(["check", "--strict", str(odd)]) == 1


def test_check_prints_its_findings_as_json(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "--json", str(changed(plane, "# Ende\n", "Ende\n"))]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found) == ["findings"]
    finding = next(f for f in found["findings"] if f["found"] == "Ende")
    assert list(finding) == [
        "file",
        "line",
        "column",
        "level",
        "id",
        "number",
        "message",
        "found",
        "expected",
    ]
    assert finding["level"] == "info"


def test_check_judges_lists_as_a_set(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    axis = plane.with_name("achsmds3.lis")
    axis.write_text("kopf.achs_nr 3\nlr_param.crosscomp2 0\n", encoding="ascii")
    assert main(["check", str(plane), str(axis)]) in (0, 1)
    err = capsys.readouterr().out
    assert err.splitlines()[-1].startswith("2 lists checked: ")
    assert "lr_param.crosscomp2" in err


def test_build_that_is_none_is_one_line(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "--build", "newest", str(plane)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize(
    "command",
    [["check", "{}"], ["show", "{}"], ["diff", "{}", "{}"], ["check", "--json", "{}"]],
)
def test_file_that_cannot_be_read_is_one_line_and_status_1(
    command: list[str], tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checks = "check" in command
    for path, reason in (
        (tmp_path / "missing.lis", "No such file"),
        (tmp_path, "a folder without lists" if checks else "is a folder, expected a"),
    ):
        assert main([part.format(path) for part in command]) == 1
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
        assert str(path) in err
        assert reason in err


def test_a_folder_stands_for_all_lists_in_it(
    plane: pathlib.Path, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ACHSMDS3.LIS").write_text("kopf.achs_nr 3\nlr_param.ssfk 1\n")
    # What is to be added to another list needs no number of its own.
    (tmp_path / "achsmds3.add.lis").write_text("lr_param.crosscomp 1\n")
    (tmp_path / "report.txt").write_text("no list")
    main(["check", str(tmp_path)])
    of_folder = capsys.readouterr().out
    main(["check", *map(str, sorted(tmp_path.glob("*.[lL]*")))])
    assert of_folder == capsys.readouterr().out
    assert "3 lists checked" in of_folder
    assert "achs_nr is missing" not in of_folder
    assert plane.name in of_folder


@pytest.mark.parametrize("raw", [b"", b"\x00\xff\xfe\n", b"\r\r\r", b"garbage"])
def test_rubbish_is_checked_and_shown_without_a_traceback(
    raw: bytes, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.lis"
    path.write_bytes(raw)
    status = 0 if raw == b"garbage" else 1  # a name without a value is an entry
    assert main(["check", str(path)]) == status
    assert main(["show", str(path)]) == status
    assert main(["diff", str(path), str(path)]) == status
    assert "Traceback" not in capsys.readouterr().err


def test_usage_error_has_status_2() -> None:
    assert main(["check"]) == 2
    assert main(["diff", "one.lis"]) == 2
    assert main(["check", "--no-such-option", "x.lis"]) == 2


def test_what_is_no_text_is_neither_shown_nor_compared(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "achskw2.lis"
    file.write_bytes(b"\x7fELF\2\1\1" + bytes(60) + b"\nthe rest\nof it all\n")
    for command in (["show", str(file)], ["diff", str(file), str(file)]):
        assert main(command) == 1
        assert "no text, expected entries of a list" in capsys.readouterr().err


def test_show_names_parameters_with_unit_and_meaning(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["show", str(plane)]) == 0
    err = capsys.readouterr().out
    assert "axis 3 (Z)" in err
    row = next(x for x in err.splitlines() if x.startswith("kw.crosscomp2.interval"))
    assert row.split()[1:4] == ["100000", "10", "mm"]
    assert "P-COMP-00009" in err
    assert "The controller adds the entry" in err
    assert "It adds from -1.4 to 3 µm (of a rotary axis 0.001°)." in " ".join(
        err.split()
    )


def test_show_of_a_leadscrew_says_that_the_sign_turns(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "achskw2.lis"
    path.write_text(SCREW, encoding="ascii")
    assert main(["show", str(path), "--out", str(tmp_path / "plots")]) == 0
    err = capsys.readouterr().out
    assert "adds its negative" in err
    assert "10.2" in err
    drawn = sorted(path.name for path in (tmp_path / "plots").iterdir())
    assert drawn == ["leadscrew.png", "leadscrew.svg"]


def test_show_prints_friction_and_crosstalk_tables(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "achskw1.lis"
    path.write_text(
        "frict_comp.mode 3\nfrict_comp.table[0].in 316\nfrict_comp.table[0].out 3722\n"
        "kw.crosstalk.mode 1\n"
        "Kw.crosstalk.position[0].correction_decelerate_dir_pos 25 (0.1 um)\n",
        encoding="ascii",
    )
    assert main(["show", str(path)]) == 0
    err = capsys.readouterr().out
    assert "Friction table, 1 entry." in err
    assert "3722" in err
    assert "Crosstalk table, 1 entry." in err


def test_show_says_how_many_rows_and_columns_it_leaves_out(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wide = PLANE | {
        "kw.crosscomp2.last_index_master1": 29,
        "kw.crosscomp2.last_index_master2": 25,
    }
    wide |= {
        f"kw.crosscomp2.table[{j}][{i}].correction": i
        for j in range(26)
        for i in range(30)
    }
    path = tmp_path / "achskw3.lis"
    path.write_bytes(new_list(wide).dumps())
    assert main(["show", str(path)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "9 of 30 columns are shown; 24 of 26 rows are shown" in shown


def test_show_marks_where_a_friction_table_leaves_out_rows(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = ["kopf.achs_nr 2", "frict_comp.table_entries 30"]
    rows += [f"frict_comp.table[{k}].in {10 * k}" for k in range(30)]
    rows += [f"frict_comp.table[{k}].out {k}" for k in range(30)]
    path = tmp_path / "achskw2.lis"
    path.write_text("\n".join(rows) + "\n", encoding="ascii")
    assert main(["show", str(path)]) == 0
    assert "rows are shown" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["discover", "doctor"])
def test_help_names_the_table_of_fits(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0
    shown = capsys.readouterr().out
    assert "[[fits]]" in shown
    assert "needs no []" not in shown


@pytest.mark.parametrize(
    ("table", "word"), [("verified", "verified"), ("assumed", "assumed")]
)
def test_show_reads_a_plane_by_the_conventions_given_and_says_so(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str], table: str, word: str
) -> None:
    head = "kopf.achs_nr 3\nkw.crosscomp2.unit 1\nkw.crosscomp2.interval 100000\n"
    ends = "kw.crosscomp2.last_index_master1 2\nkw.crosscomp2.last_index_master2 1\n"
    masters = "kw.crosscomp2.master1_ax_nr 1\nkw.crosscomp2.master2_ax_nr 2\n"
    path, rules = tmp_path / "achskw3.lis", tmp_path / "mill.toml"
    entry = "kw.crosscomp2.table[2][0].correction 30\n"
    path.write_text(head + ends + masters + entry)
    rules.write_text(f'[{table}]\nplane_index = "ij"\n')
    assert main(["show", str(path), "--conventions", str(rules)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"plane_index = ij, {word}" in shown
    # Three nodes along master 1, the entry at the last of them; mm 0 10 20, then the rows.
    assert "mm 0 10 20 0 - - 3 10 - - -" in shown
    assert main(["show", str(path)]) == 0
    assert "plane_index = ji, assumed" in " ".join(capsys.readouterr().out.split())


def test_show_and_diff_turn_signs_and_owners_as_the_conventions_say(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cross = (
        "kw.crosscomp.unit 1\nkw.crosscomp.last_index 1\nkw.crosscomp.master_ax_nr 3\n"
        "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 40\n"
        "kw.crosscomp.table[1].setpoint 10000\nkw.crosscomp.table[1].correction 70\n"
    )
    old, new, rules = (tmp_path / name for name in ("old.lis", "new.lis", "mill.toml"))
    old.write_text(SCREW + cross)
    new.write_text(SCREW + cross.replace("70", "90"))
    rules.write_text(
        '[verified]\nleadscrew_sign = 1\ncross_sign = -1\ncross_list = "master"\n'
    )
    assert main(["show", str(old), "--conventions", str(rules)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "By leadscrew_sign = 1 the controller adds the entry to" in shown
    assert "Cross table of axis 3, 2 nodes over the position of axis 2. By" in shown
    assert "cross_sign = -1 the controller adds the negative of the entry" in shown
    assert "It adds from -7 to -4 µm" in shown
    assert main(["diff", str(old), str(new), "--conventions", str(rules)]) == 0
    assert "changes by at most -2 µm, at 1 mm" in capsys.readouterr().out


def test_show_draws_a_plane(plane: pathlib.Path, tmp_path: pathlib.Path) -> None:
    assert main(["show", str(plane), "--out", str(tmp_path / "a" / "b")]) == 0
    assert (tmp_path / "a" / "b" / "plane.png").read_bytes()[1:4] == b"PNG"


def test_a_chart_keeps_the_file_that_lay_in_its_place(
    plane: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    assert main(["show", str(plane), "--out", str(tmp_path / "charts")]) == 0
    (chart,) = (tmp_path / "charts").glob("*.svg")
    chart.write_text("of mine")
    assert main(["show", str(plane), "--out", str(tmp_path / "charts")]) == 0
    assert chart.read_text() != "of mine"
    assert (tmp_path / "charts" / "kept" / chart.name).read_text() == "of mine"


def test_output_folder_that_cannot_be_made_is_one_line(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", str(plane), str(plane), "--out", str(plane)]) in (0, 1)
    capsys.readouterr()
    assert main(["show", str(plane), "--out", str(plane)]) == 1
    assert "File exists" in capsys.readouterr().err.splitlines()[-1]


def test_diff_says_what_changed_and_that_a_reload_is_enough(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = changed(plane, "table[1][2].correction  13", "table[1][2].correction  -13")
    assert main(["diff", str(plane), str(new)]) == 0
    err, out = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "~ kw.crosscomp2.table[1][2].correction: 13 -> -13",
        "plane: the offset changes by at most -2.6 µm, at -20, -60 mm",
        "A reload of the list is enough.",
    ]


def test_diff_names_the_lines_that_it_leaves_out(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    glued = changed(plane, "table[1][2].correction  13", "table[1][2]correction 77")
    assert main(["diff", str(glued), str(plane)]) == 0
    line = glued.read_text().split("correction 77")[0].count("\n") + 1
    shown = capsys.readouterr().err
    assert f"{glued}:{line}: left out, neither an entry nor a comment" in shown
    assert "table[1][2]correction 77" in shown


def test_diff_as_json_has_the_agreed_shape(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    new = changed(plane, "# Ende\n", "kw.crosscomp2.max_points 20000\n")
    assert main(["diff", "--json", str(plane), str(new)]) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert err == ""
    name = "kw.crosscomp2.max_points"
    assert found["changed"] == [{"name": name, "old": None, "new": 20000}]
    assert found["action"] == "restart"


def test_diff_of_equal_lists_needs_nothing(
    plane: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diff", str(plane), str(plane)]) == 0
    assert capsys.readouterr().out == "No entry changed: nothing to load.\n"


def test_diff_draws_old_new_and_change(
    plane: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    new = changed(plane, "table[1][2].correction  13", "table[1][2].correction  -13")
    assert main(["diff", str(plane), str(new), "--out", str(tmp_path / "d")]) == 0
    drawn = sorted(path.name for path in (tmp_path / "d").iterdir())
    assert drawn == ["diff_plane.png", "diff_plane.svg"]


@pytest.mark.parametrize("command", [["check", "{}"], ["diff", "{}", "{}"]])
def test_commands_for_lists_load_no_numerical_library(
    command: list[str], plane: pathlib.Path
) -> None:
    # Start-up stays below 0.3 s only without them. Here they are loaded already.
    code = (
        "import sys; from axcomp.ident.cli import main; "
        f"assert main({[part.format(plane) for part in command]!r}) == 0; "
        "print(*{'jax', 'numpy', 'matplotlib', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1].strip() == ""


@pytest.mark.parametrize("equidistant", [True, False])
def test_check_names_an_open_table_over_the_whole_turn(
    equidistant: bool, tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "achskw4.lis"
    entries: dict[str, str | int | float | bool] = {
        "kopf.achs_nr": 4,
        "kw.ssfk.unit": 1,
        "kw.ssfk.interval": 900_000 if equidistant else 0,
        "kw.ssfk.kw_startpos": 0,
        "kw.ssfk.kw_nr_max": 5,
        "kw.ssfk.bilateral": 0,
    }
    entries |= {f"kw.ssfk.table[{i}].pos": 7 * i for i in range(5)}
    if not equidistant:
        entries |= {f"kw.ssfk.table[{i}].setpoint": 900_000 * i for i in range(5)}
    path.write_bytes(new_list(entries).dumps())
    assert main(["check", str(path), "--strict"]) == 0
    said = capsys.readouterr().out
    assert "info" in said
    assert "where the axis goes round" in said
    assert main(["check", str(path), "--strict", "--modulo", "A4=0:360"]) == 1
    said = capsys.readouterr().out
    assert "warning" in said
    assert "[0] = 0, [4] = 28" in said
    assert "kw.ssfk.modulo 1" in said
    # Part of a turn is held at its ends, and another axis is the one that goes round.
    for turn in ("A4=0:720", "A5=0:360"):
        assert main(["check", str(path), "--strict", "--modulo", turn]) == 0
        assert "ends" not in capsys.readouterr().out


def test_check_names_nodes_that_no_position_of_a_turning_axis_reaches(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "achskw4.lis"
    entries: dict[str, str | int | float | bool] = {
        "kopf.achs_nr": 4,
        "kw.ssfk.unit": 1,
        "kw.ssfk.interval": 900_000,
        "kw.ssfk.kw_startpos": -1_800_000,
        "kw.ssfk.kw_nr_max": 5,
        "kw.ssfk.bilateral": 0,
    }
    entries |= {f"kw.ssfk.table[{i}].pos": 7 for i in range(5)}
    path.write_bytes(new_list(entries).dumps())
    assert main(["check", str(path), "--strict", "--modulo", "A4=-180:180"]) == 0
    capsys.readouterr()
    assert main(["check", str(path), "--strict", "--modulo", "A4=0:360"]) == 1
    said = capsys.readouterr().out
    assert "nodes from -180 to 180" in said
    assert "nodes within 0 to 360" in said
