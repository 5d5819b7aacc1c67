"""The generated code, compiled without a warning, beside the model that it was made of.

And the files that go with it: every export of `built` is made in the process of this file.
"""

import ctypes
import os
import re
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.external import EXTERNAL, OffsetLaw, entries_of_external_axis

from .conftest import C_FLAGS, CPP_FLAGS, UNITS, Built, compiled


@pytest.mark.parametrize(
    "count", [50_000, pytest.param(1_000_000, marks=pytest.mark.heavy)]
)
def test_code_gives_the_offsets_of_the_model(
    built: Built, count: int, expected: Callable[[OffsetLaw, np.ndarray], np.ndarray]
) -> None:
    positions = built.positions(count, seed=3)
    found = built.offsets(positions)
    assert np.any(found != 0)
    # One unit of 1e-8 mm: sums of other order differ by 1e-17, which may turn a rounding.
    np.testing.assert_allclose(found, expected(built.law, positions), rtol=0, atol=1)


def test_nothing_moves_when_it_is_switched_on(built: Built) -> None:
    given = built.positions(50_000, seed=4)
    start = built.offsets(given, "many_starts")
    place = given - start
    # Both offsets are rounded to a unit, and the place between them by half of one.
    np.testing.assert_allclose(place + built.offsets(place), given, rtol=0, atol=2)


@pytest.mark.heavy
def test_start_offsets_are_those_of_the_model(built: Built) -> None:
    given = built.positions(1000, seed=11)
    expected = np.asarray(built.model.start_offsets(given / UNITS)) * UNITS
    # The model solves to 1e-10 mm, the code rounds to a unit.
    found = built.offsets(given, "many_starts")
    np.testing.assert_allclose(found, expected, rtol=0, atol=2)


def test_offsets_are_continuous_over_cells_and_edges(built: Built) -> None:
    at = built.positions(20_000, seed=5)
    rng = np.random.default_rng(6)
    for axis, nodes in enumerate(built.nodes):
        at[:, axis] = np.rint(rng.choice(nodes, len(at)) * UNITS)
    here = built.offsets(at)
    for axis in range(built.axes):
        for step in (-1, 1):
            beside = at.copy()
            beside[:, axis] += step
            # No table is as steep as 1, so that a step of 1 may only turn the rounding.
            np.testing.assert_allclose(built.offsets(beside), here, rtol=0, atol=1)


def test_code_needs_nothing_but_mathematics(built: Built) -> None:
    text = (built.folder / "axcomp_external.c").read_text(encoding="ascii")
    assert "malloc" not in text
    assert [line for line in text.splitlines() if line.startswith("#include <")] == [
        "#include <stddef.h>",
        "#include <math.h>",
    ]
    assert str(built.folder) not in text


@pytest.mark.parametrize("language", ["c", "c++"])
def test_code_compiles_with_the_shapes_of_the_sdk(built: Built, language: str) -> None:
    folder, sdk = built.folder, Path(__file__).with_name("sdk")
    macro = ("-DAXCOMP_TWINCAT", "-I", str(sdk), "-I", str(folder), "-O2", "-fPIC")
    own = C_FLAGS if language == "c" else CPP_FLAGS
    text = (folder / "axcomp_external.c").read_text(encoding="ascii")
    code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    assert not re.search(
        r"\b(rint|fmin|fmax|isnan)\(", code
    )  # the SDK has none of these
    arithmetic, library = folder / "sdk.o", folder / f"sdk-{language}.so"
    one = ["-x", language, str(folder / "axcomp_external.c"), "-o", str(arithmetic)]
    subprocess.run(["g++", *own, *macro, "-c", *one], check=True)
    rest = [str(sdk / "module.cpp"), str(folder / "axcomp_external_layer.cpp")]
    out = ["-shared", "-o", str(library)]
    command = ["g++", *CPP_FLAGS, *macro, *rest, str(arithmetic), *out]
    subprocess.run(command, check=True)
    positions = built.positions(20_000, seed=12)
    found = np.empty_like(positions)
    places = [ctypes.c_void_p(each.ctypes.data) for each in (positions, found)]
    code = ctypes.CDLL(str(library)).cycles(*places, ctypes.c_long(len(positions)))
    assert code == 6
    np.testing.assert_array_equal(found, built.offsets(positions))


def test_positions_far_outside_saturate(built: Built) -> None:
    ends = np.array([np.iinfo(np.int64).min, -1, 0, 1, np.iinfo(np.int64).max])
    rows = np.stack([np.roll(np.resize(ends, built.axes), k) for k in range(5)])
    for function in ("many", "many_starts"):
        found = built.offsets(rows, function)
        # Python's integers do not overflow: the sum fits into 64 bits.
        for position, offset in zip(rows.ravel(), found.ravel(), strict=True):
            assert ends[0] <= int(position) + int(offset) <= ends[-1]


@pytest.mark.slow
def test_code_is_clean_under_the_sanitizers(built: Built) -> None:
    flags = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    program = compiled(built.folder, "checked", *flags, "-DAXCOMP_MAIN")
    options = {
        "ASAN_OPTIONS": "detect_leaks=0"
    }  # it asks for rights that few sandboxes give
    run = subprocess.run(
        [str(program)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **options},
    )
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > 1000  # of the calls that must fail


def test_limits_let_the_model_through_and_little_else(built: Built) -> None:
    largest = built.files.extremes.offset
    for axis, limit in enumerate(built.files.limits):
        name = f"achsmds{axis + 1}.add.lis"
        listing = ListFile.read(built.folder / name)
        for entry, value in entries_of_external_axis(limit).items():
            assert listing.integer(entry) == value
        assert largest[axis] < limit.warning <= 1.1 * largest[axis] + 2.1e-4
        assert limit.warning < limit.error <= 1.5 * largest[axis] + 1.2e-3
    assert ListFile.read(built.folder / "hochlauf.add.lis").boolean(EXTERNAL)


def test_accelerations_of_a_motion_stay_below_the_limit(built: Built) -> None:
    # Diagonal at the feed of the export, cycle by cycle.
    rng = np.random.default_rng(1)
    low, width = built.box[:, 0], np.ptp(built.box, axis=1)
    rows = (low + rng.random((3000, built.axes)) * width) * 1e8
    step = np.where(width > 0.0, 0.5e8, 0.0)
    cycles = [np.rint(rows + k * step).astype(np.int64) for k in (-1, 0, 1)]
    before, now, after = (built.offsets(row) for row in cycles)
    found = np.abs(before - 2 * now + after).max(axis=0) / 1e8 / 1e-3**2
    allowed = [limit.acceleration for limit in built.files.limits]
    assert np.all(found <= np.array(allowed, dtype=float))


def test_description_asks_for_type_6(built: Built) -> None:
    tree = ET.parse(built.folder / "AxcompExternal.tmc")
    values = {
        item.findtext("Name"): item.findtext("Value")
        for item in tree.iterfind(".//Parameter/Default/SubItem")
    }
    assert values == {".type": "6", ".group": "0", ".index": "0"}
    interfaces = [one.findtext("Type") for one in tree.iterfind(".//Interface")]
    assert "IITcMcComExtComp" in interfaces


def test_instructions_name_every_axis_in_its_order(built: Built) -> None:
    text = (built.folder / "README.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ")]
    axes = [row.split("|")[2].strip() for row in rows[1 : built.axes + 1]]
    assert axes == [f"A{number}" for number in range(1, built.axes + 1)]
    program = (built.folder / "axcomp_external.nc").read_text()
    assert "#EXTCOMP ON [ID0]" in program
    assert "#EXTCOMP OFF [ID0]" in program
