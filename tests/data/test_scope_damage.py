"""Damaged TwinCAT Scope text exports: each ends in one clear line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import MeasurementError, read_table

DATA = Path(__file__).parents[3] / "shared" / "data" / "scope"
Export = Callable[..., str]


def refuse(folder: Path, text: str | bytes, match: str) -> None:
    path = folder / "trace.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(MeasurementError, match=match) as caught:
        read_table(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


def line(text: str, number: int) -> str:
    return text.split("\n")[number - 1]


def replaced(text: str, number: int, new: str | None) -> str:
    """Return a text with one line (1-based) replaced or, with None, taken out."""
    lines = text.split("\n")
    lines[number - 1 : number] = [] if new is None else [new]
    return "\n".join(lines)


BODY = 25
"""First line of samples in the exports of these tests: ``0⇥0⇥0⇥…``."""


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_file_cut_in_the_middle_says_so(
    tmp_path: Path, export: Export, share: float
) -> None:
    text = export()
    head = text.index("\n\n0\t")
    cut = text[: head + int(share * (len(text) - head))]
    refuse(tmp_path, cut, r"trace\.csv:\d+: .*(cut off|expected a number)")


def test_file_cut_at_the_end_of_a_line_says_what_is_missing(
    tmp_path: Path, export: Export
) -> None:
    text = "\n".join(export().split("\n")[:100]) + "\n"
    refuse(
        tmp_path,
        text,
        r":100: found the samples of 'current' ending at 37\.5 ms, expected 100 ms "
        r"\('Endtime of export'\): the file is cut off",
    )


def test_file_cut_in_the_header_has_no_samples(tmp_path: Path, export: Export) -> None:
    text = export()
    refuse(tmp_path, text[: text.index("Port")], "found no samples below the header")


@pytest.mark.parametrize("key", ["Name", "File", "Starttime of export"])
def test_missing_line_of_the_preamble_is_named(
    tmp_path: Path, export: Export, key: str
) -> None:
    number = ["Name", "File", "Starttime of export"].index(key) + 1
    text = replaced(export(), number, None)
    refuse(tmp_path, text, rf":{number}: found '.*', expected a line '{key}'")


@pytest.mark.parametrize(
    ("key", "what"),
    [
        ("Name", "the names of the channels"),
        ("SampleTime[ms]", "their sample times"),
        ("Unit", "their units"),
    ],
)
def test_missing_line_of_the_block_is_named(
    tmp_path: Path, export: Export, key: str, what: str
) -> None:
    text = export()
    at = next(
        k
        for k, row in enumerate(text.split("\n"), start=1)
        if k > 4 and row.startswith(key + "\t")
    )
    refuse(tmp_path, replaced(text, at, None), f"with {what}")


def test_line_of_the_block_that_lost_a_cell_is_named(
    tmp_path: Path, export: Export
) -> None:
    text = export()
    short = line(text, 10).rsplit("\t", 1)[0]
    assert short.startswith("SampleTime")
    refuse(
        tmp_path,
        replaced(text, 10, short),
        r":10: found 6 cells in the line 'SampleTime\[ms\]', expected 7 with a tab",
    )


def test_line_of_the_block_that_stands_twice_is_named(
    tmp_path: Path, export: Export
) -> None:
    text = export()
    text = replaced(text, 10, line(text, 10) + "\n" + line(text, 10))
    refuse(tmp_path, text, r":11: found a second line 'SampleTime\[ms\]'.* line 10")


def test_start_that_is_no_number_is_named(tmp_path: Path, export: Export) -> None:
    text = export().replace("132959733843760000", "1329597E8", 1)
    refuse(
        tmp_path, text, ":3: found Starttime of export '1329597E8', expected a whole"
    )


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda row: row.rsplit("\t", 1)[0], "6 cells"),
        (lambda row: row + "\t1\t2", "9 cells"),
        (lambda row: row.replace("\t", ";"), "1 cell"),
        (lambda row: row.replace("\t", ";", 3), "4 cells"),
    ],
)
def test_line_with_a_wrong_number_of_cells_is_named(
    tmp_path: Path, export: Export, change: Callable[[str], str], found: str
) -> None:
    text = export()
    text = replaced(text, 30, change(line(text, 30)))
    expected = f":30: found {found}, expected 7 or 5 or 2 with a tab between"
    refuse(tmp_path, text, expected)


def test_line_that_is_shorter_than_the_next_is_named(
    tmp_path: Path, export: Export
) -> None:
    text = export()
    text = replaced(text, 30, line(text, 30).rsplit("\t", 2)[0])
    refuse(tmp_path, text, ":31: found 7 cells below a line with 5, expected no more")


@pytest.mark.parametrize("word", ["1,2,3", "abc", "0x10", "1 2", "1.5", "#WERT!", "ÿÿ"])
def test_cell_that_is_no_number_is_named(
    tmp_path: Path, export: Export, word: str
) -> None:
    text = export()
    cells = line(text, 40).split("\t")
    cells[3] = word
    refuse(
        tmp_path,
        replaced(text, 40, "\t".join(cells)),
        rf":40: column 'ActPos': found '{word}', expected a number with a decimal comma",
    )


def test_cell_that_is_no_number_is_found_far_down(
    tmp_path: Path, export: Export
) -> None:
    text = export([(1.0, {"x": "mm (Length)"})], duration=120_000.0)
    text = replaced(text, 110_000, "109975\tx1")
    refuse(tmp_path, text, r":110000: column 'x': found 'x1', expected a number")


@pytest.mark.parametrize(
    ("cell", "name"), [(3, "ActPos"), (0, "time of group 1"), (2, "time of group 2")]
)
def test_empty_cell_beside_others_is_named(
    tmp_path: Path, export: Export, cell: int, name: str
) -> None:
    text = export()
    cells = line(text, 40).split("\t")
    cells[cell] = " "
    refuse(
        tmp_path,
        replaced(text, 40, "\t".join(cells)),
        f":40: column '{name}': found an empty cell, expected a number",
    )


def test_group_that_stops_and_goes_on_is_named(tmp_path: Path, export: Export) -> None:
    text = export(blanks=True)
    cells = line(text, 30).split("\t")
    cells[2:5] = [" ", " ", " "]
    refuse(
        tmp_path,
        replaced(text, 30, "\t".join(cells)),
        ":30: column 'time of group 2': found an empty cell, .* a later line",
    )


def test_channel_that_stands_twice_is_named(tmp_path: Path, export: Export) -> None:
    text = export().replace("ActVelo", "ActPos", 1)
    refuse(
        tmp_path,
        text,
        r":7: found channel 'ActPos' twice, as number 2 and 3, expected each name once",
    )


@pytest.mark.parametrize(("time", "match"), [("2,5", "rise"), ("6,5", "rise")])
def test_time_that_jumps_back_is_named(
    tmp_path: Path, export: Export, time: str, match: str
) -> None:
    text = export()
    cells = line(text, 39).split("\t")
    assert cells[0] == "7"
    cells[0] = time
    found = f"time {time.replace(',', '.')} ms of 'current' after 6.5 ms"
    refuse(tmp_path, replaced(text, 39, "\t".join(cells)), f":39: found {found}")


@pytest.mark.parametrize("separator", ["\t", ";", ":", ","])
def test_mixed_separators_in_the_header_are_named(
    tmp_path: Path, export: Export, separator: str
) -> None:
    other = ";" if separator != ";" else "\t"
    text = export(separator=separator, decimal=".")
    text = replaced(text, 7, line(text, 7).replace(separator, other))
    refuse(tmp_path, text, r":\d+: ")


@pytest.mark.parametrize("junk", [b"\x00\x01\xff", b"\x07", b"\xff\xfe\xfd\xfc"])
def test_binary_junk_is_named_with_its_line(
    tmp_path: Path, export: Export, junk: bytes
) -> None:
    raw = export().encode()
    at = raw.index(b"\n7\t") + 1
    refuse(tmp_path, raw[:at] + junk + raw[at:], r":39: ")


def test_name_that_holds_the_separator_asks_for_another(
    tmp_path: Path, export: Export
) -> None:
    groups = [(1.0, {"test space": "(None)", "other": "(None)"})]
    text = export(groups, separator=" ", decimal=".")
    refuse(tmp_path, text, r":7: found names of channels .* export with a tab")


@pytest.mark.parametrize(
    "name",
    ["scope_default.csv", "scope_decimal_mark.csv", "scope_separator_semicolon.csv"],
)
def test_real_export_is_refused_wherever_it_is_cut(tmp_path: Path, name: str) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs ../shared/data/scope/{name}")
    raw = path.read_bytes()
    rng = np.random.default_rng(7)
    # The last line carries the last sample of one channel: 2 % of the file hold more.
    for at in rng.integers(1000, int(0.98 * len(raw)), 25).tolist():
        refuse(tmp_path, raw[:at], "expected")


def test_any_damage_gives_a_table_or_one_clear_line(
    tmp_path: Path, export: Export
) -> None:
    raw = export().encode()
    rng = np.random.default_rng(8)
    path = tmp_path / "trace.csv"
    refused = 0
    for _ in range(150):
        damaged = bytearray(raw)
        at, width = (int(v) for v in rng.integers(0, [len(raw), 60]))
        damaged[at : at + width] = rng.bytes(int(rng.integers(0, 40)))
        path.write_bytes(bytes(damaged))
        try:
            read_table(path)
        except MeasurementError as error:
            refused += "\n" not in str(error)
    # A few land in a comment or an address, which nobody needs.
    assert refused > 120
