"""Files as instruments write them: read at the first try, damaged ones refused in a line."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import (
    Measurement,
    Table,
    derive_error,
    explain_direction,
    measurement,
    problems_of,
    read_table,
)

from .instrument_files import FILES, LASER, InstrumentFile, error

SHARED = Path(__file__).parents[3] / "shared" / "data"


def put(folder: Path, content: bytes) -> Path:
    path = folder / "file.txt"
    path.write_bytes(content)
    return path


def read(folder: Path, name: str) -> Measurement:
    return measurement(read_table(put(folder, FILES[name].content)), axis="X")


@pytest.mark.parametrize("name", FILES)
def test_every_file_reads_at_the_first_try(tmp_path: Path, name: str) -> None:
    file = FILES[name]
    table = read_table(put(tmp_path, file.content))
    if not file.roles:  # they state no roles: the job says which column is which
        assert table.rows == file.rows
        assert all(column.role in (None, "time") for column in table.columns)
        return
    found = measurement(table, axis=file.axis or None)
    assert found.rows == file.rows
    for role in file.roles:
        qualified = role if "." in role or role in ("run", "time") else f"X.{role}"
        assert qualified in found.values, found.values.keys()
        assert np.isfinite(found.require(qualified)).all()


@pytest.mark.parametrize("name", [n for n, f in FILES.items() if f.bidirectional])
def test_errors_runs_and_directions_are_those_of_the_file(
    tmp_path: Path, name: str
) -> None:
    found = read(tmp_path, name)
    target, run = found.require("X.position"), found.require("run")
    side = explain_direction(found, "X").values
    told = [
        1e-3 * error(t, s, r)
        for t, s, r in zip(target.tolist(), side.tolist(), run.tolist(), strict=True)
    ]
    # The files hold hundredths of a µm; actual positions to 500 mm lose their last bit.
    np.testing.assert_allclose(derive_error(found, "X"), told, atol=1e-12)
    assert sorted(set(run.tolist())) == [1, 2, 3]
    assert np.count_nonzero(side > 0) == 33


@pytest.mark.parametrize(
    "name", [n for n, f in FILES.items() if f.bidirectional and f.roles == LASER]
)
def test_a_recognised_table_needs_no_words_of_the_job(
    tmp_path: Path, name: str
) -> None:
    found = read(tmp_path, name)
    assert found.format != "CSV"
    if found.form is not None:
        assert found.form.header
        assert found.form.first > max(found.form.header)


def test_an_upper_header_may_end_before_its_empty_cells(tmp_path: Path) -> None:
    file = FILES["wide, two header rows and a row of units"]
    text = file.content.decode().replace("Lauf 3;", "Lauf 3")
    found = measurement(read_table(put(tmp_path, text.encode())), axis="X")
    assert sorted(set(found.require("run").tolist())) == [1, 2, 3]


def body_of(content: bytes) -> tuple[list[str], int, str]:
    """Return the lines of a text file, the index of a row in its middle, and its encoding."""
    encoding = "utf-8"
    if content.startswith(b"\xff\xfe"):
        encoding = "utf-16"
    elif b"\xe4" in content and b"\xc3" not in content:
        encoding = "cp1252"
    lines = content.decode(encoding).replace("\r\n", "\n").rstrip("\n").split("\n")
    longest = [at for at, line in enumerate(lines) if re.search(r"\d.*\d", line)]
    return lines, longest[2 * len(longest) // 3], encoding


def truncated(content: bytes) -> bytes:
    """Cut a file in the middle of a row, behind a separator."""
    lines, at, encoding = body_of(content)
    cut = re.match(r".*?[\d\w][;,\t ]+(?=\S)", lines[at])
    kept = lines[at][: cut.end() - 1].rstrip() if cut else ""
    return "\n".join([*lines[:at], kept]).encode(encoding)


def wrong_header(content: bytes) -> bytes:
    """Take the last name out of the line above the first row, or what a format has there."""
    lines, _, encoding = body_of(content)
    if "DEVIATIONS::" in lines:
        return "\n".join(line for line in lines if "Target D" not in line).encode()
    if lines[0].startswith("{"):
        return lines[0].replace('"Name": "CYCLE", ', "").encode()
    first = next(
        at for at, line in enumerate(lines) if re.match(r"\W*[PN\d]?\d+[-,. ;\t]", line)
    )
    if first == 0:
        return "\n".join(["1 2 3 4 5 6", *lines]).encode(encoding)
    top = re.sub(r"[;,\t]\s*[^;,\t]*$|\s\s\w[^ ]*$", "", lines[first - 1])
    return "\n".join([*lines[: first - 1], top, *lines[first:]]).encode(encoding)


def mixed_separators(content: bytes) -> bytes:
    """Separate the cells of one row by another mark."""
    lines, at, encoding = body_of(content)
    swap = {";": "|", "\t": ";", ",": ";", " ": "|"}
    mark = next((m for m in (";", "\t", ",", " ") if m in lines[at].strip()), "")
    row = lines[at].strip().replace(mark, swap[mark]) if mark else f"{lines[at]};0"
    return "\n".join([*lines[:at], row, *lines[at + 1 :]]).encode(encoding)


def nan_text(content: bytes) -> bytes:
    """Write NaN in place of the last number of a row."""
    lines, at, encoding = body_of(content)
    row = re.sub(r"([+-]?\d+([.,]\d\d+)?)(\D*)$", r"NaN\3", lines[at].rstrip())
    return "\n".join([*lines[:at], row, *lines[at + 1 :]]).encode(encoding)


def duplicated_stamps(content: bytes) -> bytes:
    """Write a row a second time, below itself."""
    lines, at, encoding = body_of(content)
    return "\n".join([*lines[: at + 1], *lines[at:]]).encode(encoding)


DAMAGES = (truncated, wrong_header, mixed_separators, nan_text, duplicated_stamps)
NO_STAMPS = ("straightness", "run above", "Heidenhain", "Siemens", "FARO")
"""Neither times nor runs: that a probe is read twice at a place is no damage."""


@pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_ends_in_one_clear_line(
    tmp_path: Path, name: str, damage: Callable[[bytes], bytes]
) -> None:
    file = FILES[name]
    path = put(tmp_path, damage(file.content))
    said = complaint(path, file)
    print(f"{damage.__name__} | {name} | {said}")
    if damage is duplicated_stamps and name.startswith(NO_STAMPS):
        assert not said
        return
    assert str(path) in said
    assert "\n" not in said


def complaint(path: Path, file: InstrumentFile) -> str:
    """Return the first thing that reading a file and using it complains of."""
    try:
        table = read_table(path)
        if problems := problems_of(table):
            return str(problems[0])
        for wanted in file.columns:
            table.column(wanted)
        found = measurement(table, axis=file.axis or "X") if file.roles else None
        for role in file.roles:
            text = role if "." in role or role in ("run", "time") else f"X.{role}"
            assert found is not None
            found.require(text)
    except AxcompError as error:
        return str(error)
    return ""


@pytest.mark.skipif(not SHARED.is_dir(), reason="the folder of real data is not here")
def test_every_real_file_reads_at_the_first_try() -> None:
    files = [path for path in SHARED.rglob("*") if path.is_file()]
    files = [path for path in files if path.suffix != ".md"]
    formats = {path.name: read_table(path).format for path in files}
    assert len(formats) > 15
    assert formats["axis_capture_500Hz.json.gz"] == "JSON capture"
    assert formats["linuxcnc_sim_screwcompX.dat"] == "LinuxCNC triplets"
    assert formats["centroid_cnc7_v1_real_lasercomp.tab"] == "Centroid table"


def renishaw(folder: Path, axis: str, title: str) -> Table:
    """Return the Renishaw file of an axis with a title."""
    lines = f"Axis: {axis}\r\nTitle: {title}".encode("cp1252")
    return read_table(put(folder, FILES["Renishaw"].content.replace(b"Axis: X", lines)))


@pytest.mark.parametrize(
    ("axis", "title", "units"),
    [
        ("X", "X leadscrew pitch error", "mm um"),
        ("C", "XR20", "deg None"),
        ("4", "Rundtisch", "deg None"),
        ("B", "B axis [arcsec]", "deg arcsec"),
        ("X", "X pitch", "mm arcsec"),
        ("X", "deviations [urad]", "mm urad"),
    ],
)
def test_axis_and_title_of_a_renishaw_file_say_what_is_an_angle(
    tmp_path: Path, axis: str, title: str, units: str
) -> None:
    table = renishaw(tmp_path, axis, title)
    assert " ".join(str(column.unit) for column in table.columns[:2]) == units
    # Without its unit a deviation is no error, and the job is asked for it.
    known = table.column("error").unit is not None
    assert (table.column("error").role == "error") == known


def test_a_straightness_in_a_renishaw_file_is_of_the_axis_across(
    tmp_path: Path,
) -> None:
    found = measurement(renishaw(tmp_path, "X", "X straightness in Y direction"))
    assert {"X.position", "Y.error", "run", "X.direction"} == {*found.values}
