"""The four methods that the controller calls, with what it may do wrong."""

import ctypes
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from .conftest import MODELS, UNITS, Built

OTHERS = [
    pytest.param(name, marks=pytest.mark.heavy) for name in MODELS if name != "tables"
]
pytestmark = pytest.mark.parametrize("built", ["tables", *OTHERS], indirect=True)
"""The layer is the same for every model; that of the tables has four axes."""

FAILED = -2147467259  # E_FAIL
LARGEST = np.iinfo(np.int64).max
INIT, START, OFFSETS = range(3)


class Reply(NamedTuple):
    """What a method leaves behind."""

    result: int
    code: float
    detail: float
    text: str


class Layer:
    """The object of an export, called as the controller calls it."""

    def __init__(self, built: Built) -> None:
        self.built, self._library = built, built.library
        self._library.make.restype = ctypes.c_void_p
        self._object = ctypes.c_void_p(self._library.make())
        self.offset = np.full(built.axes, 7, dtype=np.int64)

    def call(
        self,
        method: int,
        position: np.ndarray | None = None,
        limits: np.ndarray | None = None,
        axes: int | None = None,
    ) -> Reply:
        count = self.built.axes if axes is None else axes
        given = np.zeros(16, dtype=np.int64)
        if position is not None:
            given[: len(position)] = position
        held = np.zeros(1, np.int64) if limits is None else limits.astype(np.int64)
        values, text = np.zeros(2), ctypes.create_string_buffer(24)
        result = self._library.call(
            self._object,
            ctypes.c_int(method),
            given.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_long(-1 if position is None else count),
            self.offset.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_long(count),
            held.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_long(-1 if limits is None else len(held)),
            values.ctypes.data_as(ctypes.c_void_p),
            text,
        )
        return Reply(result, values[0], values[1], text.value.decode("ascii"))

    def command(self, words: str, value: float = 0.0) -> Reply:
        values, text = np.zeros(2), ctypes.create_string_buffer(24)
        given = ctypes.create_string_buffer(words.encode("ascii"), 24)
        result = self._library.command(
            self._object,
            given,
            ctypes.c_double(value),
            values.ctypes.data_as(ctypes.c_void_p),
            text,
        )
        return Reply(result, values[0], values[1], text.value.decode("ascii"))

    def ramp(self, position: np.ndarray, cycles: int = 10) -> np.ndarray:
        """Return the offsets of some cycles."""
        rows = []
        for _ in range(cycles):
            assert self.call(OFFSETS, position).result == 0
            rows.append(self.offset.copy())
        return np.array(rows)

    def drop(self) -> None:
        self._library.drop(self._object)

    def without_structures(self) -> bool:
        return bool(self._library.without_structures(self._object))


@pytest.fixture
def layer(built: Built) -> Iterator[Layer]:
    one = Layer(built)
    yield one
    one.drop()


@pytest.fixture
def ready(layer: Layer) -> Layer:
    assert layer.call(INIT, np.zeros(layer.built.axes)).result == 0
    return layer


@pytest.fixture
def place(built: Built) -> np.ndarray:
    """A position with offsets of several µm."""
    rows = built.positions(1000, seed=8)
    sizes = np.abs(built.offsets(rows)).max(axis=1)
    return rows[np.argmax(sizes)]


def test_calls_before_initialisation_report_an_error_and_add_nothing(
    layer: Layer, place: np.ndarray
) -> None:
    for method in (START, OFFSETS):
        assert layer.call(method, place) == (FAILED, 10, 0, "not initialised")
        assert not layer.offset.any()
    assert layer.command("ON") == (FAILED, 10, 0, "not initialised")


def test_methods_give_the_offsets_of_the_plain_functions(
    ready: Layer, place: np.ndarray
) -> None:
    for method, function in ((OFFSETS, "many"), (START, "many_starts")):
        assert ready.call(method, place) == (0, 0, 0, "")
        expected = ready.built.offsets(place[None], function)[0]
        np.testing.assert_array_equal(ready.offset, expected)


@pytest.mark.parametrize("method", [START, OFFSETS])
@pytest.mark.parametrize("end", [-LARGEST - 1, -(2**53) - 2, LARGEST])
def test_positions_of_no_machine_report_an_error_and_the_last_offsets_stay(
    ready: Layer, place: np.ndarray, method: int, end: int
) -> None:
    ready.call(OFFSETS, place)
    before = ready.offset.copy()
    wrong = place.copy()
    wrong[1] = end
    assert ready.call(method, wrong) == (FAILED, 1, 2, "position out of range")
    np.testing.assert_array_equal(ready.offset, before)


def test_another_number_of_axes_reports_an_error_and_the_last_offsets_stay(
    ready: Layer, place: np.ndarray
) -> None:
    ready.call(OFFSETS, place)
    before = ready.offset.copy()
    axes = ready.built.axes
    wrong = ready.call(OFFSETS, place[:-1], axes=axes - 1)
    assert wrong == (FAILED, 11, axes - 1, "other number of axes")
    np.testing.assert_array_equal(ready.offset, before)
    few = ready.call(OFFSETS, place, np.array([1, 0]))
    assert few == (FAILED, 11, 1, "other number of axes")
    assert ready.call(INIT, place, axes=axes + 1).code == 11
    assert ready.call(OFFSETS, place).code == 10


def test_missing_data_report_an_error(ready: Layer) -> None:
    assert ready.call(OFFSETS) == (FAILED, 12, 0, "data missing")
    assert ready.without_structures()


def test_unknown_commands_report_an_error_and_change_nothing(
    ready: Layer, place: np.ndarray
) -> None:
    before = ready.ramp(place, 1)[0]
    for words in ("NONSENSE", "on", "LEVELS", 24 * "O"):
        assert ready.command(words) == (FAILED, 20, 0, "unknown command")
    for value in (-0.1, 1.1, math.inf):
        reply = ready.command("LEVEL", value)
        assert reply == (FAILED, 21, value, "value not from 0 to 1")
    reply = ready.command("LEVEL", math.nan)
    assert (reply.result, reply.code) == (FAILED, 21)
    assert ready.command("") == (0, 0, 0, "")
    np.testing.assert_array_equal(ready.ramp(place, 20)[-1], before)


def test_commands_ramp_the_offsets(ready: Layer, place: np.ndarray) -> None:
    full = ready.ramp(place, 1)[0]
    ready.command("OFF")
    # Ten cycles of the export of these tests, and it stays at nothing.
    falling = ready.ramp(place, 12)
    assert not falling[9:].any()
    steps = np.abs(np.diff([full, *falling], axis=0))
    # The steepest tenth of u²(3 − 2u) is 0.1495 of the whole, and a rounding.
    assert np.all(steps <= 0.15 * np.abs(full) + 1)
    assert np.all(np.sign(falling[4]) == np.sign(full))
    ready.command("LEVEL", 0.25)
    np.testing.assert_allclose(ready.ramp(place)[-1], 0.25 * full, rtol=0, atol=0.5)
    ready.command("ON")
    np.testing.assert_array_equal(ready.ramp(place)[-1], full)


def test_a_command_during_a_ramp_continues_from_there(
    ready: Layer, place: np.ndarray
) -> None:
    ready.command("OFF")
    half = ready.ramp(place, 5)[-1]
    ready.command("ON")
    after = ready.ramp(place, 1)[0]
    full = ready.built.offsets(place[None])[0]
    assert np.all(np.abs(after - half) <= 0.03 * np.abs(full) + 1)


def test_start_offsets_see_the_level(ready: Layer, place: np.ndarray) -> None:
    ready.command("LEVEL", 0.5)
    ready.ramp(place)
    ready.call(START, place)
    start = ready.offset.copy()
    there = place - start
    ready.call(OFFSETS, there)
    # As without a level: two roundings, and half of one.
    np.testing.assert_allclose(there + ready.offset, place, rtol=0, atol=2)


def test_a_command_before_it_is_switched_on_counts_from_the_start(
    ready: Layer, place: np.ndarray
) -> None:
    ready.command("LEVEL", 0.5)
    ready.call(START, place)
    there = place - ready.offset
    # The first cycles already: no ramp from the whole to half of it, which would move.
    cycles = ready.ramp(there, 3)
    np.testing.assert_allclose(there + cycles, np.tile(place, (3, 1)), rtol=0, atol=2)


def test_offsets_never_lead_past_a_software_limit(ready: Layer) -> None:
    built = ready.built
    rng = np.random.default_rng(9)
    limits = np.rint(built.box[:, ::-1] * UNITS).astype(np.int64)
    for row in built.positions(300, seed=10):
        near = rng.choice([-1, 1], built.axes) * rng.integers(0, 10**8, built.axes)
        edge = limits[np.arange(built.axes), rng.integers(0, 2, built.axes)]
        position = np.where(rng.random(built.axes) < 0.5, edge + near, row)
        assert ready.call(OFFSETS, position, limits.ravel()).result == 0
        there = position + ready.offset
        # Where the position is inside, what is added stays inside; where it is outside,
        # nothing leads further out.
        assert np.all(there <= np.maximum(limits[:, 0], position))
        assert np.all(there >= np.minimum(limits[:, 1], position))


def test_offsets_away_from_limits_are_whole(ready: Layer) -> None:
    built = ready.built
    inside = np.rint(built.box.mean(axis=1) * UNITS)
    limits = np.rint(built.box[:, ::-1] * UNITS)
    expected = built.offsets(inside[None])[0]
    # The same where no limits are set: positive not above negative.
    for given in (limits, np.zeros_like(limits)):
        ready.call(OFFSETS, inside, given.ravel())
        np.testing.assert_array_equal(ready.offset, expected)


def test_nothing_moves_at_a_software_limit_either(ready: Layer) -> None:
    built = ready.built
    limits = np.rint(built.box[:, ::-1] * UNITS).astype(np.int64)
    position = limits[:, 0] - 5 * 10**5  # 5 µm inside of the zone's end
    ready.call(START, position, limits.ravel())
    there = position - ready.offset
    ready.call(OFFSETS, there, limits.ravel())
    np.testing.assert_allclose(there + ready.offset, position, rtol=0, atol=2)


def test_object_registers_as_type_6(built: Built) -> None:
    found = (ctypes.c_int32 * 4)()
    built.library.registered(found)
    assert list(found) == [6, 0, 0, 0]
