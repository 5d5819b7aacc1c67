"""Probed surfaces of printers: Klipper bed mesh and RepRapFirmware height map."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ._dialect import NUMBER
from ._errors import CellError, LineError, MeasurementError
from ._table import Skipped, Table, number_columns

PROBED_HEIGHTS = (
    "Heights that the machine's own probe reads on a flat reference are the negative of the"
    " error: sign = -1 in the columns of a job."
)
_KLIPPER = re.compile(r"(?m)^\s*(?:#\*#)?\s*\[bed_mesh\b[^\]]*\]")
_RRF = re.compile(r"\s*RepRapFirmware height map", re.IGNORECASE)
_ABSENT = re.compile(r"|[+-]?nan", re.IGNORECASE)
_ABSENT_OR_ZERO = re.compile(r"|0|[+-]?nan", re.IGNORECASE)


def is_bed_mesh(text: str) -> bool:
    """Whether a text holds a Klipper ``[bed_mesh …]`` section with points."""
    # One letter is found faster than several; most texts hold no bracket.
    words = "[" in text and "[bed_mesh" in text and "points" in text
    return words and _KLIPPER.search(text) is not None


def is_height_map(text: str) -> bool:
    """Whether a text is a RepRapFirmware height map."""
    return _RRF.match(text) is not None


@dataclasses.dataclass
class _Profile:
    """One ``[bed_mesh NAME]`` section: settings and points, each with its line."""

    name: str
    line: int
    settings: dict[str, tuple[str, int]]
    points: list[tuple[int, list[str]]]


def read_bed_mesh(path: Path, text: str, profile: str | None) -> Table:
    """Return columns x, y, z in mm of one profile of a Klipper configuration.

    Args:
        path: The file.
        text: Its content.
        profile: Which profile; left out: ``default`` where there is one, else the
            first, and a remark names it.

    Raises:
        CellError: If a point is no number.
        LineError: If the points do not match ``x_count`` and ``y_count``.
        MeasurementError: If there is no such profile, or a setting is missing.
    """
    profiles = [item for item in _profiles(text) if item.points]
    names = [item.name for item in profiles]
    if not profiles:
        reason = "found [bed_mesh] without points, expected a saved profile"
        raise MeasurementError(str(path), reason)
    chosen = profile or ("default" if "default" in names else names[0])
    if chosen not in names:
        reason = f"found profiles {', '.join(names)}, expected '{chosen}'"
        raise MeasurementError(str(path), reason)
    if names.count(chosen) > 1:
        reason = (
            f"found {names.count(chosen)} profiles '{chosen}', expected each name once"
        )
        raise MeasurementError(str(path), reason)
    mesh = profiles[names.index(chosen)]
    remarks = []
    if len(profiles) > 1:
        others = ", ".join(name for name in names if name != chosen)
        remarks.append(f"Profile '{chosen}' was taken; the file also holds {others}.")
    axes = []
    for a in "xy":
        low, high = (_setting(path, mesh, f"{end}_{a}") for end in ("min", "max"))
        count = int(_setting(path, mesh, f"{a}_count"))
        if count > 1 and not low < high:
            reason = f"found min_{a} {low:g} and max_{a} {high:g}, expected it below"
            raise MeasurementError(str(path), reason)
        axes.append(np.linspace(low, high, count))
    return surface(
        path, "Klipper bed mesh", ("x", "y"), axes, mesh.points, remarks, _ABSENT
    )


def _profiles(text: str) -> list[_Profile]:
    profiles: list[_Profile] = []
    current: _Profile | None = None
    in_points = saved = False
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if line.startswith("#*#") != saved:  # the saved block begins, or ends
            saved, current = not saved, None
        line = line.removeprefix("#*#").strip()
        if line.startswith("["):
            match = re.fullmatch(r"\[bed_mesh\s*([^\]]*)\]", line)
            current, in_points = None, False
            if match:
                current = _Profile(match[1].strip() or "bed_mesh", number, {}, [])
                profiles.append(current)
            continue
        if current is None or not line or line.startswith(("#", ";")):
            continue
        key, equals, value = line.partition("=")
        if not equals and re.match(r"[A-Za-z_]\w*\s*:", line):
            key, equals, value = line.partition(":")
        if equals:
            in_points = key.strip() == "points"
            line = value.strip()
            if not in_points:
                current.settings[key.strip()] = (line, number)
        if in_points and line:
            current.points.append((number, [cell.strip() for cell in line.split(",")]))
    return profiles


def _setting(path: Path, profile: _Profile, key: str) -> float:
    if key not in profile.settings:
        found = f"[bed_mesh {profile.name}] without {key}"
        raise LineError(str(path), profile.line, found, f"{key} = a number")
    value, line = profile.settings[key]
    if not NUMBER.fullmatch(value):
        raise CellError(str(path), line, key, value, "a number")
    return float(value)


def read_height_map(path: Path, text: str) -> Table:
    """Return columns x, y, z in mm of a RepRapFirmware height map, versions 1 and 2.

    The firmware writes a point that it did not probe as a bare ``0`` (a probed zero has
    decimals); newer ones write ``nan``. Both are listed as skipped.

    Raises:
        CellError: If a height is no number.
        LineError: If the grid line is not understood or the rows do not match it.
    """
    lines = [(at, line.strip()) for at, line in enumerate(text.split("\n"), start=1)]
    lines = [(at, line) for at, line in lines[1:] if line]
    if len(lines) < 2:
        reason = "found a height map without its grid line, expected axis0,axis1,min0,…"
        raise MeasurementError(str(path), reason)
    keys = [key.strip().casefold() for key in lines[0][1].split(",")]
    cells = [cell.strip() for cell in lines[1][1].split(",")]
    if len(keys) != len(cells):
        found = f"{len(cells)} grid values"
        raise LineError(
            str(path), lines[1][0], found, f"{len(keys)} as in the line above"
        )
    grid = dict(zip(keys, cells, strict=True))
    names = (grid.get("axis0", "X"), grid.get("axis1", "Y"))
    spellings = (
        (
            ("min0", "xmin"),
            ("max0", "xmax"),
            ("spacing0", "xspacing", "spacing"),
            ("num0", "xnum"),
        ),
        (
            ("min1", "ymin"),
            ("max1", "ymax"),
            ("spacing1", "yspacing", "spacing"),
            ("num1", "ynum"),
        ),
    )
    axes, strays = [], list[str]()
    for spelling in spellings:
        low, high, spacing, count = (
            _grid_value(path, lines[0][0], grid, choices) for choices in spelling
        )
        number = round(count)
        if number < 1 or number != count:
            raise CellError(
                str(path), lines[1][0], spelling[3][0], f"{count}", "a count"
            )
        # The spacing is printed with two decimals; where the far end confirms it, the
        # ends count. A grid may end before its area does, never beyond it.
        beyond, printed = (
            low + spacing * (number - 1) - high,
            0.005 * (number - 1) + 0.0051,
        )
        ends_agree = abs(beyond) <= printed
        if beyond > printed:
            reason = (
                f"found {number} points every {spacing:g} from {low:g}, expected them to end"
                f" by {spelling[1][0]} {high:g}"
            )
            strays.append(reason)
        steps = np.arange(number, dtype=np.float64)
        axes.append(
            np.linspace(low, high, number) if ends_agree else low + spacing * steps
        )
    points = []
    for at, line in lines[2:]:
        row = [cell.strip() for cell in line.split(",")]
        if len(row) == axes[0].size + 1 and row[-1] == "":
            row.pop()
        points.append((at, row))
    table = surface(
        path, "RepRapFirmware height map", names, axes, points, [], _ABSENT_OR_ZERO
    )
    if strays:
        raise MeasurementError(str(path), strays[0])
    return table


def _grid_value(
    path: Path, line: int, grid: dict[str, str], keys: Sequence[str]
) -> float:
    for key in keys:
        if key in grid:
            if not NUMBER.fullmatch(grid[key]):
                raise CellError(str(path), line + 1, key, grid[key], "a number")
            return float(grid[key])
    found = f"a grid line with {', '.join(grid)}"
    raise LineError(str(path), line, found, f"{' or '.join(keys)} in it")


def surface(
    path: Path,
    form: str,
    names: tuple[str, str],
    axes: Sequence[Float[np.ndarray, " _"]],
    points: Sequence[tuple[int, list[str]]],
    remarks: Sequence[str],
    absent: re.Pattern[str],
) -> Table:
    """Return the rows of a grid, y by y; cells without a reading are skipped.

    Args:
        path: The file.
        form: Its format.
        names: Of the two axes.
        axes: Their positions.
        points: Line and cells of each row.
        remarks: On the file.
        absent: What a cell holds that was not probed.
    """
    xs, ys = axes
    skipped: list[Skipped] = []
    rows: list[tuple[float, float, float, int]] = []
    for at, (line, cells) in enumerate(points):
        if at >= ys.size:
            raise LineError(
                str(path), line, f"row {at + 1} of points", f"{ys.size} rows"
            )
        if len(cells) != xs.size:
            found = f"{len(cells)} points in row {at + 1}"
            raise LineError(str(path), line, found, f"{xs.size}")
        for x, cell in zip(xs.tolist(), cells, strict=True):
            if absent.fullmatch(cell):
                reason = f"not probed: {names[0]} {x:g}, {names[1]} {float(ys[at]):g}"
                skipped.append(Skipped(line, reason))
            elif NUMBER.fullmatch(cell):
                rows.append((x, float(ys[at]), float(cell), line))
            else:
                name = f"z at {names[0]} {x:g}"
                raise CellError(str(path), line, name, cell, "a finite number")
    if len(points) < ys.size:
        line = points[-1][0] if points else 1
        raise LineError(str(path), line, f"{len(points)} rows of points", f"{ys.size}")
    if not rows:
        raise MeasurementError(
            str(path), "found no probed point, expected at least one"
        )
    taken = (
        "Heights are taken as errors as they stand, + where the axis stands too high."
    )
    body = np.array(rows, dtype=np.float64)
    roles = (*(f"{name.upper()}.position" for name in names), "Z.error")
    return Table(
        path=path,
        format=form,
        columns=number_columns(body, zip("xyz", roles, ("mm",) * 3, strict=True)),
        rows=len(rows),
        lines=body[:, 3].astype(np.int64),
        skipped=tuple(skipped),
        remarks=(*remarks, f"{taken} {PROBED_HEIGHTS}"),
    )
