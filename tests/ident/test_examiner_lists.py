"""Lists and measurements that nobody plans for: one thing wrong, and only that said."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from axcomp.data.lists import Finding, ListFile, check, compare
from axcomp.ident.cli import main

CROSS = (
    "kopf.achs_nr 3\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 3\n"
    "kw.crosscomp.master_ax_nr 1\n"
) + "".join(
    f"kw.crosscomp.table[{k}].setpoint {1000 * k}\n"
    f"kw.crosscomp.table[{k}].correction {k}\n"
    for k in range(4)
)
SCREW = (
    "kopf.achs_nr 2\nkw.ssfk.unit 1\nkw.ssfk.interval 0\nkw.ssfk.kw_nr_max 3\n"
    "kw.ssfk.bilateral 1\nkw.ssfk.set_pos_without_comp 1\n"
) + "".join(
    f"kw.ssfk.table[{k}].setpoint {1000 * k}\nkw.ssfk.table[{k}].pos {k}\n"
    f"kw.ssfk.table[{k}].neg {k + 5}\n"
    for k in range(3)
)
PLANE = (
    "kopf.achs_nr 1\nkw.crosscomp2.unit 1\nkw.crosscomp2.grid RECTANGULAR\n"
    "kw.crosscomp2.interval1 1000\nkw.crosscomp2.interval2 2000\n"
    "kw.crosscomp2.last_index_master1 2\nkw.crosscomp2.last_index_master2 1\n"
    "kw.crosscomp2.start_position_master1 0\nkw.crosscomp2.start_position_master2 0\n"
    "kw.crosscomp2.master1_ax_nr 2\nkw.crosscomp2.master2_ax_nr 3\n"
) + "".join(
    f"kw.crosscomp2.table[{j}][{i}].correction {i - j}\n"
    for j in range(2)
    for i in range(3)
)
CROSSTALK = (
    "kopf.achs_nr 3\nkw.crosstalk.mode 1\nkw.crosstalk.master_dyn_ax_nr 1\n"
    "kw.crosstalk.velocity_dependent 1\nkw.crosstalk.acceleration 1000\n"
    "kw.crosstalk.deceleration -1000\n"
) + "".join(
    f"kw.crosstalk.position[0].correction_{change}_dir_{way} 5\n"
    for change in ("accelerate", "decelerate")
    for way in ("pos", "neg")
)
START_UP = "zahl_kw 2\n" + "".join(
    f"achs_kw_log_ax_nr[{k}] {axis}\nachs_kw[{k}] ..\\listen\\achskw{axis}.lis\n"
    for k, axis in enumerate((1, 3))
)


def parse(text: str | bytes, source: str = "x.lis") -> ListFile:
    return ListFile.parse(text.encode() if isinstance(text, str) else text, source)


def serious(*files: ListFile) -> list[Finding]:
    """Return the errors and warnings of a set of lists."""
    return [finding for finding in check(files) if finding.level != "info"]


@pytest.mark.parametrize("text", [CROSS, SCREW, PLANE, CROSSTALK, START_UP])
def test_lists_of_this_module_are_sound(text: str) -> None:
    assert serious(parse(text)) == []


# Each row: a list, what is changed in it, and the one thing that `check` must say.
@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [
        pytest.param(
            CROSS,
            "table[2].setpoint 2000",
            "table[2].setpoint 2e3",
            r":9:\d+: error: .*table\[2\].setpoint cannot be read: '2e3' "
            r"\(P-COMP-00006, controller error 70245\)",
            id="unreadable setpoint is not blamed on the order",
        ),
        pytest.param(
            CROSS,
            "kw.crosscomp.table[0].setpoint 0\n",
            "",
            r"warning: .*setpoint lacks 1 of 4 entries.*index 0 \(P-COMP-00006\)",
            id="missing setpoint that 0 stands in for",
        ),
        pytest.param(
            SCREW,
            "kw.ssfk.table[0].setpoint 0\n",
            "",
            r"warning: .*setpoint lacks 1 of 3 entries.*index 0 \(P-COMP-00025\)",
            id="missing leadscrew setpoint that 0 stands in for",
        ),
        pytest.param(
            CROSS,
            "last_index 3",
            "last_index 99999999999",
            r":3:\d+: error: .*last_index = 99999999999 does not fit SGN32",
            id="size beyond its type is not compared with other sizes",
        ),
        pytest.param(
            CROSS,
            "kopf.achs_nr 3\n",
            "kopf.achs_nr 3\nkw.crosscomp.max_points -5\n",
            r":2:\d+: error: .*max_points = -5 does not fit UNS32 \(P-COMP-00060\)",
            id="negative max_points is not blamed on last_index",
        ),
        pytest.param(
            PLANE,
            "grid RECTANGULAR",
            "grid SQUARE",
            r":3:\d+: error: .*grid = 'SQUARE' is not allowed .*70478",
            id="unknown grid does not ask for an interval",
        ),
        pytest.param(
            SCREW,
            "interval 0",
            "interval -1",
            r":3:\d+: error: .*interval = -1 is not allowed.*110479",
            id="negative interval",
        ),
        pytest.param(
            CROSSTALK,
            "mode 1",
            "mode 4",
            r":2:\d+: error: .*mode = 4 is not allowed.*\(P-COMP-00082\)",
            id="unknown mode does not ask for adaptation axes",
        ),
        pytest.param(
            PLANE,
            "table[1][2].correction 1\n",
            "table[1][2].correction 2147483648\n",
            r":17:\d+: error: kw.crosscomp2.table\[1\]\[2\].correction = 2147483648 "
            r"does not fit SGN32 \(P-COMP-00016\)",
            id="value is named with its indices",
        ),
        pytest.param(
            PLANE,
            "kw.crosscomp2.table[1][1].correction 0\n",
            "",
            r"warning: .*lacks 1 of 6 entries, which count as 0: \[1\]\[1\] ",
            id="missing plane entry is named as a list names it",
        ),
        pytest.param(
            START_UP,
            "achs_kw_log_ax_nr[1] 3\n",
            "",
            r"warning: achs_kw\[1\] stands without achs_kw_log_ax_nr\[1\]",
            id="start-up list names a file without its axis",
        ),
        pytest.param(
            START_UP,
            "achs_kw_log_ax_nr[1] 3\nachs_kw[1] ",
            "achs_kw_log_ax_nr[0] 1\nachs_kw[0] ",
            None,
            id="start-up list with one entry twice",
        ),
    ],
)
def test_one_fault_is_found_and_nothing_else_is_blamed(
    text: str, old: str, new: str, said: str | None
) -> None:
    assert text.count(old) == 1
    found = [str(finding) for finding in serious(parse(text.replace(old, new)))]
    if said is None:
        assert found
    else:
        assert len(found) == 1, found
        assert re.search(said, found[0])


def test_start_up_index_beyond_the_count_is_found() -> None:
    found = serious(parse(START_UP.replace("[1]", "[5]")))
    assert [finding.found for finding in found] == ["index 5", "index 5"]


def test_empty_leadscrew_table_with_entries_has_no_index_below_zero() -> None:
    found = serious(parse(SCREW.replace("kw_nr_max 3", "kw_nr_max 0")))
    assert {(f.level, f.expected) for f in found} == {("error", "no entry")}


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_one_error(encoding: str) -> None:
    raw = CROSS.encode(encoding)
    (finding,) = check([parse(raw)])
    assert (finding.level, finding.found) == ("error", "UTF-16")
    assert parse(raw).dumps() == raw


def test_byte_order_mark_is_read_over_with_a_warning() -> None:
    file = parse("\ufeff" + CROSS)
    (finding,) = serious(file)
    assert (finding.line, finding.column, finding.found) == (1, 1, "U+FEFF")
    assert file.integer("kopf.achs_nr") == 3


def test_control_characters_do_not_reach_the_terminal() -> None:
    (finding,) = serious(parse(CROSS + "\x1b[2J\x00\u2028 nonsense\n", "a\nb.lis"))
    assert str(finding).isprintable()
    assert r"a\nb.lis" in str(finding)
    assert r"\x1b[2J\x00\u2028 nonsense" in str(finding)


def test_activation_that_is_no_boolean_is_not_called_off() -> None:
    axis = parse("kopf.achs_nr 3\nlr_param.crosscomp 2\n", "achsmds3.lis")
    (finding,) = serious(parse(CROSS, "achskw3.lis"), axis)
    assert (finding.id, finding.message) == (
        "P-AXIS-00047",
        "lr_param.crosscomp = 2 does not fit BOOLEAN",
    )


def test_backlash_of_unknown_size_beside_a_bilateral_table_is_found() -> None:
    axis = parse(
        "kopf.achs_nr 2\nlr_param.ssfk 1\nlr_param.anwahl_losekomp 1\n", "achsmds2.lis"
    )
    found = serious(parse(SCREW, "achskw2.lis"), axis)
    twice = [f for f in found if "compensated twice" in f.message]
    assert [(f.line, f.id) for f in twice] == [(3, "P-AXIS-00021")]
    assert twice[0].found == "1, lose not in the list"


def test_monitoring_bits_that_do_not_read_name_those_that_do() -> None:
    text = "lr_param.prog_movement_requires_compensations LEAD | FRICT\n"
    found = [f for f in check([parse(text)]) if f.level == "error"]
    assert [f.expected for f in found] == [
        "BACKLASH, LEAD, TEMP, CROSS, PLANE joined by |, or a number"
    ]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "lr_param.temp_comp_coefficient 1.50\n",
            "lr_param.temp_comp_coefficient 15e-1\n",
        ),
        (
            "lr_param.prog_movement_requires_compensations LEAD | CROSS\n",
            "lr_param.prog_movement_requires_compensations 0xA\n",
        ),
        (PLANE, PLANE.replace("RECTANGULAR", "rectangular")),
    ],
)
def test_another_spelling_of_a_value_is_no_change(old: str, new: str) -> None:
    found = compare(parse(old), parse(new))
    assert (found.changed, found.action) == ((), "none")


@pytest.mark.parametrize("increment", ["0", "-1", "nan", "inf"])
def test_increment_that_is_none_is_bad_usage(
    increment: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.lis"
    path.write_text(CROSS, encoding="ascii")
    assert main(["check", str(path), "--increment", increment]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert f"'--increment': found {increment}, expected more than 0" in said


def test_file_that_is_named_twice_is_one_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "achskw3.lis"
    path.write_text(CROSS, encoding="ascii")
    assert main(["check", "--strict", str(path), str(path)]) == 0
    assert "1 list checked" in capsys.readouterr().out


@pytest.mark.parametrize("columns", [60, 120])
def test_show_tells_the_crosstalk_columns_apart(columns: int, tmp_path: Path) -> None:
    path = tmp_path / "x.lis"
    path.write_text(CROSSTALK, encoding="ascii")
    code = (
        "import rich.console, sys\n"
        "from pathlib import Path\n"
        "from axcomp.data.lists import ListFile\n"
        "from axcomp.ident.cli._show_tables import list_views\n"
        f"console = rich.console.Console(file=sys.stderr, width={columns})\n"
        f"for view in list_views(ListFile.read(Path({str(path)!r}))):\n"
        "    console.print(view)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, encoding="utf-8"
    )
    assert "…" not in run.stderr  # nothing is cut short, no id and no heading
    assert run.stderr.count("dir_pos") == 2
    assert run.stderr.count("dir_neg") == 2


def test_show_knows_no_negative_zero(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.lis"
    path.write_text(SCREW, encoding="ascii")
    assert main(["show", str(path)]) == 0
    assert "It adds from -0.7 to 0 µm (of a rotary axis 0.001°)." in " ".join(
        capsys.readouterr().out.split()
    )


@pytest.mark.parametrize("raw", [b"", b"# only a comment\n", CROSS.encode("utf-16")])
def test_file_without_entries_is_not_compared(
    raw: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    there, empty = tmp_path / "a.lis", tmp_path / "b.lis"
    there.write_text(CROSS, encoding="ascii")
    empty.write_bytes(raw)
    assert main(["diff", str(there), str(empty)]) == 1
    assert main(["show", str(empty)]) == 1
    for line in capsys.readouterr().err.splitlines():
        assert re.search(r"b\.lis: found .*, expected entries of a list", line)


MOTION = "A1.position,A2.position,A3.position\n0.05,0.05,0.05\n0.2,0.2,0.2\n"


def simulate(tmp_path: Path, *texts: str) -> int:
    (tmp_path / "m.csv").write_text(MOTION, encoding="ascii")
    files = []
    for k, text in enumerate(texts):
        path = tmp_path / f"list{k}.lis"
        path.write_text(text, encoding="ascii")
        files.append(str(path))
    return main(["simulate", *files, "--motion", str(tmp_path / "m.csv")])


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [
        (CROSS, "correction 3", "correction 3e0", r":12: .*\[3\].*: found '3e0'"),
        (CROSS, "unit 1", "unit 7", r":2: kw.crosscomp.unit: found '7', expected 0 or"),
        (SCREW, "interval 0", "interval 1,5", r":3: kw.ssfk.interval: found '1,5'"),
        (PLANE, "grid RECTANGULAR", "grid 1", r"grid: found '1', expected QUADRATIC"),
        (PLANE, "correction 2", "correction two", r":14: .*\[0\]\[2\].*: found 'two'"),
        (
            PLANE,
            "start_position_master1 0",
            "start_position_master1 zero",
            r":8: .*start_position_master1: found 'zero'",
        ),
    ],
)
def test_simulate_takes_no_unreadable_entry_for_zero(
    text: str,
    old: str,
    new: str,
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert text.count(old) == 1
    assert simulate(tmp_path, text.replace(old, new)) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert re.search(said, err)


def test_simulate_names_every_compensation_that_it_leaves_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = CROSS + CROSSTALK.replace("kopf.achs_nr 3\n", "")
    axis = (
        "kopf.achs_nr 3\nlr_param.crosscomp 1\nlr_param.crosstalk 1\n"
        "lr_param.anwahl_losekomp 1\nlr_param.temp_comp 1\n"
    )
    assert simulate(tmp_path, table, axis) == 0
    out, err = capsys.readouterr()
    # By hand: 0.5 list units of 0.1 µm at 0.05 mm; 2 units at 0.2 mm.
    assert out.splitlines() == [
        "A3.cross,A3.temperature,A3.backlash,A3.offset",
        "0.00005,0,0,0.00005",
        "0.0002,0,0,0.0002",
    ]
    assert (
        "A3: crosstalk stands in the list and is not computed: there is neither" in err
    )


RUNS = "target,error,run,direction\n" + "".join(
    f"{target},{0.001 * run + 1e-4 * target},{run},{way}\n"
    for run in (1, 2)
    for way in (1, -1)
    for target in (0, 10, 20)[::way]
)


def test_tolerance_in_degrees_does_not_judge_millimetres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.csv"
    path.write_text(RUNS, encoding="ascii")
    assert main(["iso230", str(path), "--tolerance", "1deg"]) == 2
    assert "found '1deg', expected mm as in" in capsys.readouterr().err


def test_second_test_at_other_targets_is_remarked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = tmp_path / "a.csv", tmp_path / "b.csv"
    files[0].write_text(RUNS, encoding="ascii")
    files[1].write_text(RUNS.replace("20,", "30,"), encoding="ascii")
    assert main(["iso230", *map(str, files), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert any("targets are not those" in text for text in found["after"]["remarks"])


def test_equal_runs_have_not_drifted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.csv"
    path.write_text(
        re.sub(
            r"^(\d+),[^,]*,",
            lambda row: f"{row[1]},{0.001 * int(row[1])},",
            RUNS,
            flags=re.MULTILINE,
        ),
        encoding="ascii",
    )
    assert main(["iso230", str(path)]) == 0
    assert "apart" not in capsys.readouterr().out


def test_number_of_a_million_digits_is_refused_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Converting it takes minutes; the time limit of the test run is the judge.
    path = tmp_path / "x.csv"
    cell = "9" * 1_000_000
    path.write_text(f"X.position,X.error\n0,1\n1,2\n{cell},1\n", encoding="ascii")
    assert main(["read", str(path)]) == 1
    assert "x.csv:4: column 'X.position': found '9999" in capsys.readouterr().err
    text = f"lr_param.temp_comp_coefficient {'1' * 1_000_000}\n"
    assert any(f.id == "P-AXIS-00274" for f in serious(parse(text)))


@pytest.mark.parametrize("command", ["read", "iso230"])
def test_command_loads_no_jax(command: str, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(RUNS, encoding="ascii")
    arguments = [command, str(path)]
    if command == "iso230":
        arguments += ["--out", str(tmp_path / "charts")]
    code = (
        "import sys; from axcomp.ident.cli import main; "
        f"status = main({arguments!r}); print(status, 'jax' in sys.modules)"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, encoding="utf-8"
    )
    assert run.stdout.splitlines()[-1].split() == ["0", "False"]
