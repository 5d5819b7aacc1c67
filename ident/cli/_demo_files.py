"""The files of `axcomp demo`: what the virtual machine leaves for a user to read."""

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...data.errors import AxcompError
from ...data.lists import ListFile
from ..machine import (
    LASER,
    PROBE,
    STRAIGHTEDGE,
    TRAVEL,
    Reading,
    VirtualMachine,
    example_drive,
    measure_length,
    measure_straightness,
    measure_surface,
    record_drive,
    write_drive_trace,
    write_laser_table,
    write_straightness,
    write_surface,
)

_MANIFEST = ".axcomp-demo.json"
_MADE = ("result/", "second/", "work/result/", "work/second/")

README = """\
Made by `axcomp demo`: a portal mill that exists only in the computer.

measurements/  what a laser (X), a straightedge (Y) and a probe (Z) saw,
               all compensations off, and the current of X over a trace
machine/       the list that the machine had before (Y, made when it was new)
job.toml       what to make of it; run it again with
                   axcomp fit job.toml --out result
result/        the new lists, and report.html, which tells how good they are
second/        the same measurements once more with the new lists loaded, at other
               positions, and the job that names them:
                   axcomp fit job.toml --out result --after second/job.toml
work/          the same kind of machine at work, with every fault at once: one log in
               motion, one job that finds all compensations together, their lists and
               report, and the log of a second run with all of them loaded
"""

_TABLES = """\
# The job of `axcomp demo`. Run it again with:  axcomp fit job.toml --out result
# Lengths are in mm; a column may state its own unit.
title = "Portal mill of the demo"

[machine]
id = "demo-mill"

[axes.X]
number = 1
limits = [0.0, 800.0]
[axes.Y]
number = 2
limits = [0.0, 400.0]
list = "machine/achskw2.lis"      # the list that is there now; it is edited
[axes.Z]
number = 3

# --- X: laser, 81 targets, five times up and down, all compensations off ---------
[measurements.laser]
file = "measurements/laser_x.csv"
axis = "X"                        # the columns of a laser table name themselves
active = []
datum = { at = 0.0 }              # the laser's zero is arbitrary

# --- Y over X: straightedge along X, three times ---------------------------------
[measurements.straightness]
file = "measurements/straightness_y.csv"
active = []
remove = "line"                   # its zero and its slope are arbitrary
[measurements.straightness.columns]
run = "run"
"X.position" = { column = "x", unit = "mm" }
"Y.error" = { column = "deviation", unit = "um" }

# --- Z over X and Y: probed surface; a clamp hides one corner --------------------
[measurements.surface]
file = "measurements/surface_z.csv"
active = []
remove = "offset"                 # the probe's zero is arbitrary
[measurements.surface.columns]
"X.position" = { column = "x", unit = "mm" }
"Y.position" = { column = "y", unit = "mm" }
"Z.error" = { column = "dz", unit = "um" }

[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true                  # one table per direction: it has lost motion
start = 0.0
interval = 10.0
points = 81

[[fits]]
compensation = "cross"
axis = "Y"
master = "X"
measurement = "straightness"
start = 0.0
interval = 20.0
points = 41

[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "surface"
start = [0.0, 0.0]
interval = [25.0, 25.0]
points = [33, 17]
"""

_FRICTION = """
# --- X: current of the drive over a trace, forth and back at constant speeds ------
[measurements.drive]
file = "measurements/drive_x.csv"
[measurements.drive.columns]
time = { column = "time_ms", unit = "ms" }
"X.position" = { column = "x", unit = "mm" }
"X.current" = { column = "current", unit = "A" }

[[fits]]
compensation = "friction"
axis = "X"
measurement = "drive"
rated_current = 9.0               # of the drive, in A
torque_unit = 0.001               # share of it that one unit of the list is
level = 1.0                       # all of the friction; 0.15 until the sign is settled, else
"""

JOB = _TABLES + _FRICTION


def second_job() -> str:
    """Return the job that evaluates the second measurement: lists loaded and active."""
    text = _TABLES.replace(_TABLES.splitlines()[0], _SECOND_HEAD)
    text = text.replace("Portal mill of the demo", "Second measurement of the demo")
    text = text.replace("measurements/", "")
    text = re.sub(
        r", (81 targets|three times).*", ", once more with the new list", text
    )
    text = re.sub(r'list = "machine.*\n', "", text)
    for name, number in (("X", 1), ("Y", 2), ("Z", 3)):
        entry = f"[axes.{name}]\nnumber = {number}\n"
        text = text.replace(entry, f'{entry}list = "../result/achskw{number}.lis"\n')
    for kind in ("leadscrew", "cross", "plane"):
        text = text.replace("active = []", f'active = ["{kind}"]', 1)
    return text[: text.index("[[fits]]")]


_SECOND_HEAD = """\
# The second measurement of `axcomp demo`, the new lists active. From the folder above:
#     axcomp fit job.toml --out result --after second/job.toml"""


class FolderError(AxcompError):
    """The demo would overwrite something that is not its own."""

    def __init__(self, folder: str, found: str) -> None:
        super().__init__(folder, found)
        self.folder, self.found = folder, found

    def __str__(self) -> str:
        return (
            f"{self.folder}: found {self.found}, expected an empty folder or an "
            "unchanged one of an earlier demo; move it away, or name another folder "
            "with --out"
        )


@dataclasses.dataclass(frozen=True)
class Measured:
    """The three measurements of the demo, by axis."""

    laser: Reading
    straightness: Reading
    surface: Reading


def claim_folder(out: Path) -> None:
    """Make the folder, or make sure that everything in it is the demo's own.

    Raises:
        FolderError: If it holds files that no demo made, or that were changed since.
    """
    if out.exists() and not out.is_dir():
        raise FolderError(str(out), "a file of that name")
    out.mkdir(parents=True, exist_ok=True)
    if not any(out.iterdir()):
        return
    manifest = out / _MANIFEST
    try:
        hashes = json.loads(manifest.read_text("utf-8"))
    except (OSError, ValueError):
        raise FolderError(str(out), "files that no demo made") from None
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        # What a run makes from the rest may be made again.
        if path.is_dir() or path == manifest or name.startswith(_MADE):
            continue
        if name not in hashes:
            raise FolderError(str(out), f"{name}, which no demo made")
        if _hash(path) != hashes[name]:
            raise FolderError(str(out), f"{name} changed since the demo made it")


def seal_folder(out: Path) -> None:
    """Note what the demo wrote, so that a later one knows its own files."""
    hashes = {
        path.relative_to(out).as_posix(): _hash(path)
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name != _MANIFEST
    }
    text = json.dumps(hashes, indent=1)
    (out / _MANIFEST).write_text(text, encoding="utf-8")


def measure(machine: VirtualMachine, seed: int, *, second: bool = False) -> Measured:
    """Measure the machine; the second time at other positions, and fewer of them."""
    length, width = TRAVEL
    rng = np.random.default_rng(seed)
    # Off the round numbers: equal steps would always meet the same spot of the screw.
    targets = np.linspace(0.0, length, 51 if second else 81)
    targets[1:-1] += np.round(rng.uniform(-2.5, 2.5, targets.size - 2), 3)
    along = np.linspace(0.0, length, 34 if second else 41)
    return Measured(
        measure_length(machine, "X", targets, 3 if second else 5, LASER, seed + 1),
        measure_straightness(
            machine, "Y", "X", along, 2 if second else 3, STRAIGHTEDGE, seed + 2
        ),
        measure_surface(
            machine, "Z", ("X", "Y"), _probe_points(length, width, second, rng), PROBE,
            seed + 3,
        ),
    )  # fmt: skip


def _probe_points(
    length: float, width: float, second: bool, rng: np.random.Generator
) -> Float[np.ndarray, "t 2"]:
    """Return probed points, row by row, to and fro; a clamp hides the far corner."""
    across = np.linspace(0.0, length, 45 if second else 81)
    up = np.linspace(0.0, width, 23 if second else 41)
    rows = [
        np.stack([across[:: 1 - 2 * (k % 2)], np.full(across.size, y)], axis=1)
        for k, y in enumerate(up)
    ]
    points = np.concatenate(rows)
    points += np.round(rng.uniform(-4.0, 4.0, points.shape), 3)
    points = np.clip(points, 0.0, [length, width])
    hidden = (points[:, 0] > 0.8 * length) & (points[:, 1] > 0.7 * width)
    return np.asarray(points[~hidden])


def write_measurements(folder: Path, measured: Measured) -> tuple[Path, ...]:
    """Write the three measurement files and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ("laser_x.csv", "straightness_y.csv", "surface_z.csv")
    laser, straightness, surface = (folder / name for name in names)
    write_laser_table(laser, measured.laser)
    write_straightness(straightness, "X", measured.straightness)
    write_surface(surface, ("X", "Y"), measured.surface)
    return laser, straightness, surface


def write_drive(folder: Path, seed: int) -> Path:
    """Write what the drive of X recorded and return the path."""
    path = folder / "drive_x.csv"
    write_drive_trace(path, record_drive(example_drive(), seed))
    return path


def old_list() -> ListFile:
    """Return the list that the machine came with: the beam has sagged further since."""
    places = np.linspace(0.0, TRAVEL[0], 11)
    # A smaller arc, measured when the machine was new; entries are offsets in 0.1 µm.
    arc = -140 * 4 * (places / TRAVEL[0]) * (1 - places / TRAVEL[0])
    lines = [
        "# Compensation list of the Y axis",
        "# made at acceptance, 11 points along X          (do not lose this line)",
        "kopf.achs_nr                     2",
        "kopf.log_achs_name               Y_AXIS",
        "kw.crosscomp.unit                1        ( 0.1 um )",
        "kw.crosscomp.last_index          10",
        "kw.crosscomp.master_ax_nr        1        # X",
        *(
            f"kw.crosscomp.table[{k}].setpoint   {round(place * 1e4)}"
            for k, place in enumerate(places)
        ),
        *(
            f"kw.crosscomp.table[{k}].correction   {round(value)}"
            for k, value in enumerate(arc)
        ),
        "Ende",
    ]
    text = "\r\n".join(lines) + "\r\n"
    return ListFile.parse(text.encode("latin-1"), "achskw2.lis")


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
