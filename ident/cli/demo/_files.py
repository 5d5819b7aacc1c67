"""The files of `axcomp demo`: what the virtual machine leaves for a user to read.

The jobs and the text for the user stand in the folder ``demo``.
"""

import json
from importlib import resources
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ....data.errors import FoundError
from ....data.files import sha256
from ...machine import (
    LASER,
    PROBE,
    STRAIGHTEDGE,
    TRAVEL,
    VirtualMachine,
    measure,
    write_reading,
)

_MANIFEST = ".axcomp-demo.json"
_OWN = (
    "an empty folder or an unchanged one of an earlier demo; move it away, or name another"
    " folder with --out"
)
_MADE = ("result/", "second/", "work/result/", "work/second/")


def text_of(name: str) -> bytes:
    """Return one of the files in the folder ``demo`` beside this module."""
    return resources.files("axcomp.ident.cli").joinpath("demo", name).read_bytes()


def claim_folder(out: Path) -> None:
    """Make the folder; refuse one with files that no demo made, or that were changed since."""
    if out.exists() and not out.is_dir():
        raise FoundError(str(out), "a file of that name", _OWN)
    out.mkdir(parents=True, exist_ok=True)
    if not any(out.iterdir()):
        return
    try:
        hashes = json.loads((out / _MANIFEST).read_text("utf-8"))
    except (OSError, ValueError):
        raise FoundError(str(out), "files that no demo made", _OWN) from None
    for name, digest in _hashes(out).items():
        if name not in hashes:
            raise FoundError(str(out), f"{name}, which no demo made", _OWN)
        if digest != hashes[name]:
            found = f"{name} changed since the demo made it"
            raise FoundError(str(out), found, _OWN)


def seal_folder(out: Path) -> None:
    """Note what the demo wrote, so that a later one knows its own files."""
    text = json.dumps(_hashes(out), indent=1)
    (out / _MANIFEST).write_text(text, encoding="utf-8")


def _hashes(out: Path) -> dict[str, str]:
    """Return the hash of each file by name, but of those that a run makes from the rest."""
    names = {path.relative_to(out).as_posix(): path for path in sorted(out.rglob("*"))}
    return {
        name: sha256(path)
        for name, path in names.items()
        if path.is_file() and name != _MANIFEST and not name.startswith(_MADE)
    }


def write_measurements(folder: Path, machine: VirtualMachine, seed: int) -> None:
    """Measure the machine, with another seed at other positions, and write three files."""
    length, width = TRAVEL
    rng = np.random.default_rng(seed)
    # Off the round numbers: equal steps would always meet the same spot of the screw.
    targets = np.linspace(0.0, length, 81)
    targets[1:-1] += np.round(rng.uniform(-2.5, 2.5, targets.size - 2), 3)
    along = np.linspace(0.0, length, 41)
    points = _probe_points(length, width, rng)
    ascending, lengths = np.sort(targets)[:, None], along[:, None]
    laser = measure(
        machine, "X", ("X",), ascending, LASER, seed + 1, runs=5, ways=(1, -1)
    )
    beam = measure(machine, "Y", ("X",), lengths, STRAIGHTEDGE, seed + 2, runs=3)
    surface = measure(machine, "Z", ("X", "Y"), points, PROBE, seed + 3)
    folder.mkdir(parents=True, exist_ok=True)
    for name, header, reading in (
        ("laser_x", "run,direction,target [mm],error [um]", laser),
        ("straightness_y", "run,x [mm],deviation [um]", beam),
        ("surface_z", "x [mm],y [mm],dz [um]", surface),
    ):
        write_reading(folder / f"{name}.csv", header, reading)


def _probe_points(
    length: float, width: float, rng: np.random.Generator
) -> Float[np.ndarray, "t 2"]:
    """Return probed points, row by row, to and fro; a clamp hides the far corner."""
    across = np.linspace(0.0, length, 81)
    rows = [
        np.stack([across[:: 1 - 2 * (k % 2)], np.full(across.size, y)], axis=1)
        for k, y in enumerate(np.linspace(0.0, width, 41))
    ]
    points = np.concatenate(rows)
    points += np.round(rng.uniform(-4.0, 4.0, points.shape), 3)
    points = np.clip(points, 0.0, [length, width])
    hidden = (points[:, 0] > 0.8 * length) & (points[:, 1] > 0.7 * width)
    return np.asarray(points[~hidden])
