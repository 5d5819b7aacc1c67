"""Models, exported and compiled once a session."""

import ctypes
import dataclasses
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.ident.external import (
    ExternalFiles,
    OffsetLaw,
    Placed,
    export_external,
)
from axcomp.models import (
    Cross,
    EquidistantNodes,
    ExternalCompensation,
    GeometricErrors,
    Leadscrew,
    OffsetPart,
    OffsetStack,
    Plane,
    Setpoints,
    VolumetricGrid,
)
from axcomp.models._geometric import FUNCTIONS

UNITS = 10**8
SHIM = Path(__file__).with_name("shim.cpp")
C_FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror")
CPP_FLAGS = ("-std=c++11", "-Wall", "-Wextra", "-Werror")


def compiled(folder: Path, target: str, *flags: str) -> Path:
    """Compile an export with the shim of the tests, without a warning."""
    for source, compiler, own in (
        (folder / "axcomp_external.c", "cc", C_FLAGS),
        (folder / "axcomp_external_layer.cpp", "g++", CPP_FLAGS),
        (SHIM, "g++", CPP_FLAGS),
    ):
        include = ("-I", str(folder), "-o", str(folder / f"{target}-{source.stem}.o"))
        subprocess.run(
            [compiler, *own, *flags, "-c", str(source), *include], check=True
        )
    objects = sorted(folder.glob(f"{target}-*.o"))
    link = ["g++", *flags, *map(str, objects), "-lm", "-o", str(folder / target)]
    subprocess.run(link, check=True)
    return folder / target


@dataclasses.dataclass(frozen=True)
class Built:
    """An exported model and its code as a library."""

    law: OffsetLaw
    axes: int
    box: np.ndarray
    """Workspace in mm."""
    nodes: tuple[np.ndarray, ...]
    """Nodes of the tables per axis, in mm."""
    files: ExternalFiles
    folder: Path
    library: ctypes.CDLL

    @property
    def model(self) -> ExternalCompensation:
        return ExternalCompensation(self.law)

    def offsets(self, positions: np.ndarray, function: str = "many") -> np.ndarray:
        """Return the offsets that the code gives, in units of the interface."""
        rows = np.ascontiguousarray(positions, dtype=np.int64)
        found = np.empty_like(rows)
        getattr(self.library, function)(_at(rows), _at(found), ctypes.c_long(len(rows)))
        return found

    def positions(self, count: int, seed: int) -> np.ndarray:
        """Return positions in units, half of them up to a workspace outside of it."""
        rng = np.random.default_rng(seed)
        reach = np.where(rng.random((count, self.axes)) < 0.5, 0.0, 1.0)
        low, width = self.box[:, 0], np.ptp(self.box, axis=1)
        share = rng.uniform(-reach, 1.0 + reach)
        return np.rint((low + share * width) * UNITS).astype(np.int64)


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _tables() -> tuple[OffsetLaw, np.ndarray, tuple[np.ndarray, ...]]:
    """Return a stack of all kinds of nodes on 4 axes, the last of which turns."""
    rng = np.random.default_rng(1)
    plane = Plane.rectangular(
        (-40.0, -70.0), (10.0, 7.5), 0.02 * rng.normal(size=(31, 41))
    )
    sag = np.cumsum(rng.uniform(3.0, 30.0, 30))
    cross = Cross(Setpoints(sag), 0.01 * rng.normal(size=30), sign=-1.0)
    few = Cross(Setpoints(np.array([0.0, 90.0, 200.0])), np.array([0.0, 0.01, -0.02]))
    # Nothing is added outside, and the table ends at 0: no jump at its edges.
    hill = np.concatenate([[0.0], 0.01 * rng.normal(size=18), [0.0]])
    gone = Cross(EquidistantNodes(-5.0, 12.5, 20), hill, held=False)
    screw = Leadscrew(EquidistantNodes(-10.0, 13.0, 33), 0.02 * rng.normal(size=33))
    turn = 0.01 * rng.normal(size=37)
    turn[-1] = turn[0]
    table = Leadscrew(EquidistantNodes(0.0, 10.0, 37), turn, modulo=(0.0, 360.0))
    law = OffsetStack(
        (
            OffsetPart(cross, 0, (2,)),
            OffsetPart(few, 1, (0,)),
            OffsetPart(gone, 1, (2,)),
            OffsetPart(plane, 2, (0, 1)),
            OffsetPart(screw, 0, (0,), compensated=True),
            OffsetPart(table, 3, (3,)),
        ),
        axes=4,
    )
    box = np.array([[-40.0, 406.0], [-70.0, 155.0], [-5.0, 500.0], [0.0, 360.0]])
    first, second, third, last = (
        np.concatenate([np.asarray(nodes.positions) for nodes in each])
        for each in (
            (screw.nodes, plane.nodes1, few.nodes),
            (plane.nodes2,),
            (cross.nodes, gone.nodes),
            (table.nodes,),
        )
    )
    return law, box, (first, second, third, last)


def _plane() -> tuple[OffsetLaw, np.ndarray, tuple[np.ndarray, ...]]:
    rng = np.random.default_rng(2)
    values = 0.02 * rng.normal(size=(101, 101))
    plane = Plane.quadratic((-40.0, -70.0), 10.0, values)
    law = OffsetStack((OffsetPart(plane, 2, (0, 1)),), axes=3)
    box = np.array([[-40.0, 960.0], [-70.0, 930.0], [0.0, 100.0]])
    nodes = (np.asarray(plane.nodes1.positions), np.asarray(plane.nodes2.positions))
    return law, box, (*nodes, np.array([50.0]))


def _geometric() -> tuple[OffsetLaw, np.ndarray, tuple[np.ndarray, ...]]:
    """Return the 21 errors of X, Y, Z in a machine of 6 axes."""
    rng = np.random.default_rng(3)
    nodes = (
        EquidistantNodes(-100.0, 25.0, 33),
        Setpoints(np.cumsum(rng.uniform(5.0, 40.0, 25))),
        EquidistantNodes(-300.0, 20.0, 21),
    )
    errors = {
        name: (1e-5 if name[1] in "ABC" else 0.005) * rng.normal(size=own.count)
        for names, own in zip(FUNCTIONS, nodes, strict=True)
        for name in names
    }
    angles = {"EA0Z": 3e-5, "EB0Z": -2e-5, "EC0Y": 5e-5}
    model = GeometricErrors.of(nodes, errors | angles, "YXZ", (10.0, 20.0, -30.0))
    x, y, z = (np.asarray(own.positions) for own in nodes)
    box = np.array([[own[0], own[-1]] for own in (x, y, z)] + 3 * [[-180.0, 180.0]])
    turn = np.array([0.0])
    return Placed(model.offset, (0, 1, 2)), box, (x, y, z, turn, turn, turn)


def _grid() -> tuple[OffsetLaw, np.ndarray, tuple[np.ndarray, ...]]:
    """Return a grid that adds to X and Z, with axes in another order and one more."""
    rng = np.random.default_rng(4)
    values = 0.02 * rng.normal(size=(2, 6, 7, 9))
    grid = VolumetricGrid.regular(
        (-50.0, 0.0, 10.0), (40.0, 30.0, 25.0), values, axes=(0, 2)
    )
    x, y, z = (np.asarray(nodes.positions) for nodes in grid.nodes)
    box = np.array([[z[0], z[-1]], [0.0, 0.0], [x[0], x[-1]], [y[0], y[-1]]])
    return Placed(grid.offset, (2, 3, 0)), box, (z, np.array([5.0]), x, y)


MODELS: dict[
    str, Callable[[], tuple[OffsetLaw, np.ndarray, tuple[np.ndarray, ...]]]
] = {
    "tables": _tables,
    "plane": _plane,
    "geometric": _geometric,
    "grid": _grid,
}


@pytest.fixture(scope="session")
def compiler() -> None:
    missing = [name for name in ("cc", "g++") if shutil.which(name) is None]
    if missing and not os.environ.get("CI"):
        pytest.skip(f"no {' and no '.join(missing)} on this computer")


@pytest.fixture(scope="session", params=MODELS)
def built(
    request: pytest.FixtureRequest,
    compiler: None,
    tmp_path_factory: pytest.TempPathFactory,
) -> Built:
    law, box, nodes = MODELS[request.param]()
    folder = tmp_path_factory.mktemp(request.param)
    axes = len(box)
    files = export_external(
        law,
        folder,
        axes=range(1, axes + 1),
        workspace={k + 1: (low, high) for k, (low, high) in enumerate(box)},
        ramp=0.01,
    )
    library = ctypes.CDLL(str(compiled(folder, "code.so", "-O2", "-fPIC", "-shared")))
    return Built(law, axes, box, nodes, files, folder, library)


@pytest.fixture(scope="session")
def expected() -> Callable[[OffsetLaw, np.ndarray], np.ndarray]:
    """Return the offsets of a model in units of the interface."""

    def offsets(law: OffsetLaw, positions: np.ndarray) -> np.ndarray:
        return np.rint(np.asarray(law(jnp.asarray(positions / UNITS))) * UNITS)

    return offsets
