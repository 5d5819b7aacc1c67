"""`axcomp convert`: tables between lists and neighbouring formats."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile, check
from axcomp.data.measurements import read_table
from axcomp.ident.cli import main
from axcomp.ident.exchange import (
    ExchangedTable,
    ExchangeError,
    list_with,
    table_in,
    table_of_file,
    text_of,
)

rng = np.random.default_rng(5)
EVEN = 12.5 * np.arange(9) - 20.0
UNEVEN = np.cumsum(rng.integers(10_000, 90_000, 9)) / 1e4
TABLES = {
    "leadscrew": ExchangedTable(
        "leadscrew", 3, (), (EVEN,), rng.integers(-500, 500, (2, 9)) / 1e4
    ),
    "one direction": ExchangedTable(
        "leadscrew", 3, (), (UNEVEN,), rng.integers(-500, 500, (1, 9)) / 1e4
    ),
    "cross": ExchangedTable(
        "cross", 3, (1,), (EVEN,), rng.integers(-500, 500, (1, 9)) / 1e4
    ),
    "plane": ExchangedTable(
        "plane", 3, (1, 2), (EVEN, EVEN[:4] + 7), rng.integers(-500, 500, (4, 9)) / 1e4
    ),
}


def written(folder: Path, table: ExchangedTable) -> Path:
    path = folder / "achskw3.lis"
    path.write_bytes(list_with(table)[0].dumps())
    return path


def convert(source: Path, target: Path, *options: str) -> Path:
    assert main(["convert", str(source), str(target), *options]) == 0
    return target


@pytest.mark.parametrize("name", TABLES)
def test_a_list_comes_back_from_a_csv_byte_for_byte(tmp_path: Path, name: str) -> None:
    listing = written(tmp_path, TABLES[name])
    table = convert(listing, tmp_path / "table.csv")
    assert convert(table, tmp_path / "back.lis").read_bytes() == listing.read_bytes()
    assert not [
        each for each in check([ListFile.read(listing)]) if each.level == "error"
    ]


@pytest.mark.parametrize("name", ["leadscrew", "one direction"])
@pytest.mark.parametrize("trim", [[], ["--trim"]])
def test_a_screw_comes_back_from_linuxcnc_byte_for_byte(
    tmp_path: Path, name: str, trim: list[str]
) -> None:
    listing = written(tmp_path, TABLES[name])
    triplets = convert(listing, tmp_path / "screw.comp", *trim)
    back = convert(triplets, tmp_path / "back.lis", "--axis", "3", *trim)
    assert back.read_bytes() == listing.read_bytes()


def test_a_screw_without_an_axis_comes_back_from_a_csv(tmp_path: Path) -> None:
    listing = written(tmp_path, TABLES["leadscrew"])
    triplets = convert(listing, tmp_path / "screw.comp")
    table = convert(triplets, tmp_path / "screw.csv")
    assert table.read_text().splitlines()[0] == "# leadscrew"
    back = convert(table, tmp_path / "back.lis", "--axis", "3")
    assert back.read_bytes() == listing.read_bytes()


def test_trims_and_positions_that_are_taken_for_each_other_are_named(
    tmp_path: Path,
) -> None:
    listing = written(tmp_path, TABLES["leadscrew"])
    trims = convert(listing, tmp_path / "screw.comp", "--trim")
    with pytest.raises(ExchangeError, match=r"COMP_FILE_TYPE = 1\): --trim"):
        table_of_file(trims)
    places = convert(listing, tmp_path / "places.comp")
    with pytest.raises(ExchangeError, match="found values near the positions"):
        table_of_file(places, trim=True)


@pytest.mark.parametrize("comma", [",", ";"])
def test_the_head_of_a_csv_counts_as_a_spreadsheet_saves_it(
    tmp_path: Path, comma: str
) -> None:
    turn = ExchangedTable(
        "leadscrew",
        4,
        (),
        (90.0 * np.arange(5),),
        np.array([[0, 2, 3, 1, 0]]) / 1e3,
        True,
    )
    for table in (turn, TABLES["plane"]):
        text = text_of(table, "csv").replace(",", comma)
        path = tmp_path / "saved.csv"
        path.write_text(text, encoding="utf-8-sig")
        again = table_of_file(path)
        assert again.modulo == table.modulo
        assert (again.axis, again.masters) == (table.axis, table.masters)


def test_what_a_table_does_not_hold_of_its_list_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, more, words in (
        ("cross", "kw.crosscomp.n_cycles 8\nkw.crosscomp.manual_activation TRUE\n",
         "out: kw.crosscomp.n_cycles, kw.crosscomp.manual_activation."),
        ("one direction", "kw.ssfk.set_pos_without_comp 1\n", "out: kw.ssfk.set_pos"),
    ):  # fmt: skip
        listing = written(tmp_path, TABLES[name])
        listing.write_bytes(listing.read_bytes() + more.encode())
        convert(listing, tmp_path / f"{name}.csv")
        assert words in capsys.readouterr().err
    convert(written(tmp_path, TABLES["leadscrew"]), tmp_path / "both.csv")
    assert "left out" not in capsys.readouterr().err


def test_a_list_in_increments_is_converted_by_their_worth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = written(tmp_path, TABLES["leadscrew"])
    listing.write_bytes(listing.read_bytes() + b"kw.ssfk.unit 0\n")
    assert main(["convert", str(listing), str(tmp_path / "no.csv")]) == 1
    assert "(--increment, or" in capsys.readouterr().err
    convert(listing, tmp_path / "a.csv", "--increment", "0.0001")
    np.testing.assert_allclose(
        table_of_file(tmp_path / "a.csv").entries, TABLES["leadscrew"].entries
    )


@pytest.mark.parametrize("names", [("y", "x"), ("1", "2")])
def test_which_columns_count_as_the_masters_of_a_plane_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], names: tuple[str, str]
) -> None:
    head = f"{','.join(names)},z\n" if "x" in names else ""
    path = tmp_path / "t.csv"
    path.write_text(f"{head}0,0,1\n0,10,2\n5,0,3\n5,10,4\n")
    convert(path, tmp_path / "a.lis", *stated("plane", 2, 3))
    words = f"Column '{names[0]}' is taken for master 1, '{names[1]}' for master 2."
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("form", ["bed-mesh", "height-map"])
def test_a_plane_comes_back_from_a_mesh_byte_for_byte(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str
) -> None:
    listing = written(tmp_path, TABLES["plane"])
    mesh = convert(listing, tmp_path / "mesh.cfg", "--to", form)
    options = ["--axis", "3", "--master", "1", "--master", "2"]
    assert "entries of a plane are their negative" in capsys.readouterr().err
    back = convert(mesh, tmp_path / "back.lis", *options)
    assert back.read_bytes() == listing.read_bytes()
    told = capsys.readouterr().err
    assert "entries of a plane are their negative" in told
    assert "sign = -1" not in told


def test_linuxcnc_is_told_where_the_joint_really_was() -> None:
    # A screw that is 20 µm too far at 100 mm, 30 µm on the way back: its list takes the
    # error, LinuxCNC (type 0) the place, or (type 1) what is to be added.
    table = ExchangedTable(
        "leadscrew",
        1,
        (),
        (np.array([0.0, 100.0]),),
        np.array([[0.0, 0.02], [0.0, 0.03]]),
    )
    assert text_of(table, "linuxcnc").splitlines()[1] == "100.0000 100.0200 100.0300"
    assert (
        text_of(table, "linuxcnc", trim=True).splitlines()[1]
        == "100.0000 -0.0200 -0.0300"
    )
    listing = list_with(table)[0]
    assert listing.integer("kw.ssfk.table[1].pos") == 200  # 0.1 µm, error


def test_a_plane_takes_the_negative_height(tmp_path: Path) -> None:
    height = np.array([[0.01, 0.02], [0.03, -0.04]])
    table = ExchangedTable(
        "plane", 3, (1, 2), (np.array([0.0, 10.0]), np.array([0.0, 20.0])), -height
    )
    path = tmp_path / "mesh.cfg"
    path.write_text(text_of(table, "bed-mesh"))
    seen = read_table(path)
    assert seen.format == "Klipper bed mesh"
    assert seen.columns[2].values.tolist() == height.ravel().tolist()
    assert np.array_equal(table_of_file(path).entries, -height)


def test_a_profile_that_was_taken_for_granted_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = "points =\n\t0.1, 0.2\n\t0.3, 0.4\nx_count = 2\ny_count = 2\n"
    mesh += "min_x = 0\nmax_x = 10\nmin_y = 0\nmax_y = 10\n"
    path = tmp_path / "mesh.cfg"
    path.write_text(f"[bed_mesh cold]\n{mesh}[bed_mesh warm]\n{mesh}")
    convert(path, tmp_path / "a.csv")
    assert (
        "Profile 'cold' was taken; the file also holds warm" in capsys.readouterr().err
    )


def test_a_spreadsheet_needs_to_be_told_what_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = tmp_path / "sheet.csv"
    sheet.write_text("pos [mm];offset [um]\n0,0;0,0\n50,0;12,3\n100,0;-4,5\n")
    assert main(["convert", str(sheet), str(tmp_path / "a.lis")]) == 1
    assert "compensation: found ''" in capsys.readouterr().err
    stated = ["--compensation", "cross", "--axis", "2", "--master", "1"]
    listing = convert(sheet, tmp_path / "a.lis", *stated)
    assert "To set in the axis list: lr_param.crosscomp 1" in capsys.readouterr().err
    assert table_in(ListFile.read(listing)).entries.tolist() == [[0.0, 0.0123, -0.0045]]


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("0 0 0\n10 10.1\n", "a.comp", ":2: found '10 10.1', expected three numbers"),
        ("0 0 0\n0 0 0\n", "a.comp", "points that do not ascend"),
        (
            "# plane of axis 3 over 1, 2\na,b,c\n0,0,1\n5,0,1\n5,5,1\n",
            "a.csv",
            "1 of 4",
        ),
    ],
)
def test_what_is_no_table_is_refused_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    name: str,
    words: str,
) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert main(["convert", str(path), str(tmp_path / "out.csv")]) == 1
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1


def test_the_target_is_a_new_file_of_a_known_ending(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = written(tmp_path, TABLES["leadscrew"])
    command = ["convert", str(listing), str(listing), "--to", "csv"]
    assert main(command) == 2
    assert "which is an input, expected another file" in capsys.readouterr().err
    (tmp_path / "a.csv").write_text("")
    assert main(["convert", str(listing), str(tmp_path / "a.csv")]) == 2
    assert "expected a new file or --force" in capsys.readouterr().err
    assert main(["convert", str(listing), str(tmp_path / "a.xyz")]) == 1
    assert "found the ending '.xyz'" in capsys.readouterr().err


def stated(name: str | int, *masters: str | int) -> list[str]:
    """What a file does not say of its table of axis 1."""
    options = ["--compensation", str(name), "--axis", "1"]
    return options + [part for each in masters for part in ("--master", str(each))]


@pytest.mark.parametrize(
    ("text", "options", "entries"),
    [
        ("position,neg,pos\n0,3,1\n10,3,2\n", ["leadscrew"], [[1, 2], [3, 3]]),
        ("error,position\n3,10\n2,0\n", ["leadscrew"], [[2, 3]]),
        ("position,down,up\n0,3,1\n10,3,2\n", ["leadscrew"], [[1, 2], [3, 3]]),
        ("x,ab,auf\n0,3,1\n10,3,2\n", ["leadscrew"], [[1, 2], [3, 3]]),
        ("x,e\n20,3\n10,2\n0,1\n", ["leadscrew"], [[1, 2, 3]]),
        ("x,y,z\n0,0,1\n5,0,2\n0,5,3\n5,5,4\n", ["plane", 2, 3], [[1, 2], [3, 4]]),
        (
            "master 2,master 1,correction\n0,0,1\n0,5,2\n5,0,3\n5,5,4\n",
            ["plane", 2, 3],
            [[1, 2], [3, 4]],
        ),
    ],
)
def test_columns_of_a_csv_are_told_by_their_names_where_they_have_some(
    tmp_path: Path, text: str, options: list[str | int], entries: list[list[int]]
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    listing = convert(path, tmp_path / "a.lis", *stated(*options))
    np.testing.assert_allclose(table_in(ListFile.read(listing)).entries, entries)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("position,neg\n0,5\n10,6\n", ["leadscrew"], "found neg alone"),
        ("position,pos,e\n0,5,1\n9,6,1\n", ["leadscrew"], "found the columns pos, e"),
        ("x,e\n0,1\n10,2\n10,3\n", ["leadscrew"], "found the position 10 twice"),
        ("x,e\n0,1\n10,2\n10.00001,3\n", ["leadscrew"], "each 0.1 µm or more above"),
        ("x,error\n0,1\n10,2\n", ["cross", 2], "found errors by their name, expected"),
        ("x,offset\n0,1\n10,2\n", ["leadscrew"], "found offsets by their name"),
        ("x,correction\n0,1\n10,2\n", ["leadscrew"], "found offsets by their name"),
        ("x,Korrektur\n0,1\n10,2\n", ["leadscrew"], "found offsets by their name"),
        ("x [mm],e [rad]\n0,1\n9,2\n", ["leadscrew"], "units: found angle and length"),
        ("x,e1,e2\n0,5,1\n9,6,1\n", ["leadscrew"], "their names: pos and neg"),
        ("x,f,r\n0,0.01,0\n9,9.01,9\n", ["leadscrew"], "that follow the positions"),
        ("position,pos,neg\n0,1,2\n9,1,2\n", ["cross", 2], "a cross has no directions"),
        ("x,y,z\n0,0,1\n5,0,2\n0,0,3\n", ["plane", 2, 3], "found 1 places twice"),
    ],
)
def test_a_csv_that_contradicts_its_table_is_refused_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    options: list[str | int],
    words: str,
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    command = ["convert", str(path), str(tmp_path / "a.lis"), *stated(*options)]
    assert main(command) == 1
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1


@pytest.mark.parametrize("masters", [[1], [2, 1]])
def test_an_axis_is_never_its_own_master(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], masters: list[int]
) -> None:
    text = [
        "position,correction\n0,0\n10,0.001\n",
        "x,y,z\n0,0,1\n5,0,2\n0,5,3\n5,5,3\n",
    ]
    (tmp_path / "t.csv").write_text(text[len(masters) - 1])
    kind = ["cross", "plane"][len(masters) - 1]
    target = tmp_path / "a.lis"
    command = [
        "convert",
        str(tmp_path / "t.csv"),
        str(target),
        *stated(kind, *masters),
    ]
    assert main(command) == 1
    words = "found axis 1, which the table compensates, expected another axis"
    assert words in capsys.readouterr().err
    assert not target.exists()


def test_a_list_with_two_tables_needs_one_to_be_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = (
        written(tmp_path, TABLES[n]).read_bytes() for n in ("cross", "plane")
    )
    both = tmp_path / "achskw3.lis"
    both.write_bytes(first + second)
    assert main(["convert", str(both), str(tmp_path / "a.csv")]) == 1
    assert "--compensation leadscrew|cross|plane" in capsys.readouterr().err
    convert(both, tmp_path / "a.csv", "--compensation", "plane")
