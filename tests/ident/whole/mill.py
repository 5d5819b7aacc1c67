"""A mill with a sagging ram, measured to files; and what its lists add, by hand."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main

LIST_UNIT = 1e-4
NOISE = 1e-4
X = np.arange(0.0, 401.0, 50.0)
Y = np.arange(0.0, 301.0, 50.0)

AXES = """
[axes.X]
number = 1
limits = [0, 400]
[axes.Y]
number = 2
limits = [0, 300]
[axes.Z]
number = 3
limits = [-500, 0]
"""


def fit(folder: Path, text: str) -> int:
    """Run a job by command line; returns the exit status."""
    (folder / "job.toml").write_text(text)
    return main(["fit", str(folder / "job.toml"), "--out", str(folder / "out")])


def sag(x: np.ndarray, y: np.ndarray, size: float = 0.06) -> np.ndarray:
    """Error of Z in mm: piecewise linear, so that tables of 50 mm can hold it."""
    along = np.interp(y, Y, size * np.sin(np.pi * Y / 300.0))
    return along + 2e-5 * x


def table(path: Path, header: str, *columns: np.ndarray) -> None:
    rows = zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    lines = [header, *(",".join(f"{cell!r}" for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")


def edge(folder: Path, size: float = 0.06, name: str = "edge.csv") -> None:
    """Measure Z along Y at X = 200, three times."""
    rng = np.random.default_rng(11)
    y = np.tile(np.arange(0.0, 301.0, 25.0), 3)
    x = np.full(len(y), 200.0)
    error = sag(x, y, size) + NOISE * rng.standard_normal(len(y))
    table(folder / name, "x,y,dz", x, y, error)


def probe(folder: Path, size: float = 0.06, name: str = "probe.csv") -> None:
    """Measure Z over X and Y, twice."""
    rng = np.random.default_rng(12)
    x, y = (np.tile(each.ravel(), 2) for each in np.meshgrid(X, Y))
    error = sag(x, y, size) + NOISE * rng.standard_normal(len(x))
    table(folder / name, "x,y,dz", x, y, error)


def measured(name: str, more: str = "") -> str:
    return f"""
[measurements.{name}]
file = "{name}.csv"
remove = "none"
{more}
[measurements.{name}.columns]
"X.position" = "x"
"Y.position" = "y"
"Z.error" = "dz"
"""


CROSS = """
[[fits]]
compensation = "cross"
axis = "Z"
master = "Y"
measurement = "edge"
smoothness = 0
start = 0.0
interval = 50.0
points = 7
"""
PLANE = """
[[fits]]
compensation = "plane"
axis = "Z"
masters = ["X", "Y"]
measurement = "probe"
smoothness = 0
start = [0.0, 0.0]
interval = [50.0, 50.0]
points = [9, 7]
"""


def cross_list(number: int = 3, master: int = 2, size: float = 0.06) -> str:
    """Return a list whose cross table takes the sag away."""
    lines = [
        f"kopf.achs_nr {number}",
        "kw.crosscomp.unit 1",
        f"kw.crosscomp.last_index {len(Y) - 1}",
        f"kw.crosscomp.master_ax_nr {master}",
        "kw.crosscomp.n_cycles 20",
    ]
    values = -size * np.sin(np.pi * Y / 300.0)
    for k, (y, value) in enumerate(zip(Y, values, strict=True)):
        lines.append(f"kw.crosscomp.table[{k}].setpoint {round(y / LIST_UNIT)}")
        lines.append(f"kw.crosscomp.table[{k}].correction {round(value / LIST_UNIT)}")
    return "\n".join(lines) + "\n"


def column(listing: ListFile, prefix: str, field: str) -> dict[Any, int]:
    """Return a column of a table by index; that of a plane by `(j, i)`."""
    found: Any = listing.table(prefix, field)
    return dict(found)


def cross_by_hand(listing: ListFile, y: np.ndarray) -> np.ndarray:
    """Return what a cross table adds, from its entries."""
    at = column(listing, "kw.crosscomp", "setpoint")
    value = column(listing, "kw.crosscomp", "correction")
    order = sorted(at)
    return LIST_UNIT * np.interp(
        y, [LIST_UNIT * at[k] for k in order], [value[k] for k in order]
    )


def plane_by_hand(listing: ListFile, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return what a plane on the nodes of `PLANE` adds, from its entries."""
    value = column(listing, "kw.crosscomp2", "correction")
    grid = np.array([[value[j, i] for i in range(len(X))] for j in range(len(Y))])
    law = RegularGridInterpolator((Y, X), LIST_UNIT * grid)
    return np.asarray(law(np.stack([y, x], axis=-1)))


def left_over(listing: ListFile, size: float = 0.06) -> np.ndarray:
    """Return the error of Z over the table with all tables of its list, from entries."""
    x, y = (each.ravel() for each in np.meshgrid(X, Y))
    left = sag(x, y, size)
    if listing.table("kw.crosscomp", "correction"):
        left = left + cross_by_hand(listing, y)
    if listing.table("kw.crosscomp2", "correction"):
        left = left + plane_by_hand(listing, x, y)
    return left
