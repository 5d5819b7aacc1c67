"""The virtual machine: its errors are the stated ones, and lists act on them."""

import csv
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.errors import FoundError
from axcomp.data.lists import ListFile
from axcomp.data.measurements import derive_error, measurement, read_table
from axcomp.ident.exchange import ExchangeError
from axcomp.ident.machine import (
    Instrument,
    Reading,
    State,
    VirtualMachine,
    beam_bow,
    example_machine,
    measure,
    reversal,
    screw_pitch,
    table_flatness,
    write_reading,
)

PERFECT = Instrument(noise=0.0, resolution=1e-9)
UP = np.ones(3, dtype=np.int64)


def parse(text: str, name: str) -> ListFile:
    return ListFile.parse(text.encode(), name)


CROSS_OF_Y = parse(
    "kopf.achs_nr 2\nkw.crosscomp.unit 1\nkw.crosscomp.last_index 1\n"
    "kw.crosscomp.master_ax_nr 1\n"
    "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 0\n"
    "kw.crosscomp.table[1].setpoint 8000000\nkw.crosscomp.table[1].correction 400\n",
    "achskw2.lis",
)


def test_screw_error_has_slope_bow_and_a_wave_per_turn() -> None:
    screw = screw_pitch("X", 1e-5, 0.01, 800.0, 0.002, 40.0)
    at = {"X": np.array([0.0, 10.0, 400.0])}
    wave = 0.002 * np.array([0.0, 1.0, 0.0])
    bow = 0.01 * np.sin(np.pi * at["X"] / 800)
    # Sines of whole turns are exact to rounding.
    np.testing.assert_allclose(
        screw.error(State(at, {"X": UP})), 1e-5 * at["X"] + bow + wave, atol=1e-15
    )


def test_reversal_is_the_difference_of_the_directions_and_leaves_the_mean() -> None:
    lost = reversal("X", 0.004, 0.008, 100.0)
    at = {"X": np.array([0.0, 50.0, 100.0])}
    up, down = (lost.error(State(at, {"X": way})) for way in (UP, -UP))
    np.testing.assert_allclose(down - up, [0.004, 0.006, 0.008])
    np.testing.assert_allclose(down + up, 0.0, atol=1e-18)


def test_beam_is_straight_at_its_ends_and_highest_in_the_middle() -> None:
    beam = beam_bow("Y", "X", 0.02, 800.0, 0.0, 1.0)
    at = {"X": np.array([0.0, 400.0, 800.0])}
    np.testing.assert_allclose(beam.error(State(at, {})), [0.0, 0.02, 0.0], atol=1e-18)


def test_table_is_twisted_at_its_corners() -> None:
    table = table_flatness("Z", ("X", "Y"), (800.0, 400.0), 0.01, 0.0, 0.0)
    at = {"X": np.array([0.0, 800.0, 800.0]), "Y": np.array([0.0, 0.0, 400.0])}
    np.testing.assert_allclose(table.error(State(at, {})), [0.01, -0.01, 0.01])


def test_errors_of_one_axis_add_up_and_others_stay_out() -> None:
    first = beam_bow("Y", "X", 0.02, 800.0, 0.0, 1.0)
    machine = VirtualMachine(
        {"X": 1, "Y": 2}, (first, first, reversal("X", 1.0, 1.0, 1.0))
    )
    at = {"X": np.array([400.0, 400.0, 0.0])}
    np.testing.assert_allclose(machine.error("Y", at, UP), [0.04, 0.04, 0.0])


def test_loaded_list_is_added_to_the_error_of_its_axis_alone() -> None:
    bare = example_machine()
    loaded = bare.with_lists([CROSS_OF_Y])
    at = {"X": np.array([0.0, 200.0, 900.0])}
    change = loaded.error("Y", at, UP) - bare.error("Y", at, UP)
    # 0.04 mm over 800 mm, held beyond its end.
    np.testing.assert_allclose(change, [0.0, 0.01, 0.04], atol=1e-15)
    np.testing.assert_array_equal(loaded.error("X", at, UP), bare.error("X", at, UP))
    state = State(at, {"Y": UP})
    np.testing.assert_array_equal(
        loaded.true_error("Y", state), bare.true_error("Y", state)
    )


def test_lists_replace_each_other_when_loaded_again() -> None:
    loaded = example_machine().with_lists([CROSS_OF_Y])
    assert loaded.with_lists([]).controller is None


def test_list_for_an_unknown_axis_is_refused() -> None:
    other = CROSS_OF_Y.replace({"kopf.achs_nr": 7})
    with pytest.raises(ExchangeError, match="found axis 7, which the machine lacks"):
        example_machine().with_lists([other])


def test_unknown_axis_is_refused() -> None:
    with pytest.raises(FoundError, match="found axis Q, expected one of X, Y, Z"):
        example_machine().error("Q", {}, UP)


def laser(targets: np.ndarray) -> Reading:
    """Return two runs over targets and back, read by a perfect instrument."""
    machine, places = example_machine(), targets[:, None]
    return measure(machine, "X", ("X",), places, PERFECT, 1, runs=2, ways=(1, -1))


def test_perfect_instrument_reads_the_truth() -> None:
    targets = np.array([0.0, 100.0, 333.0, 800.0])
    found = laser(targets)
    # Half of the instrument's resolution.
    np.testing.assert_allclose(found.reading, found.truth, atol=5e-10)
    np.testing.assert_array_equal(found.run, np.repeat([1, 2], 8))
    np.testing.assert_array_equal(
        found.positions[:8, 0], [*targets, *reversed(targets.tolist())]
    )
    np.testing.assert_array_equal(found.direction[:8], [1] * 4 + [-1] * 4)


def test_instrument_scatters_drifts_rounds_and_has_a_zero_of_its_own() -> None:
    size, runs = 20_000, 4
    run = np.repeat(np.arange(runs), size // runs)
    along = np.zeros(size)
    rng = np.random.default_rng(3)
    tool = Instrument(0.002, 0.001, drift=0.05, run_offset=0.03, zero=1.0, wild=0.01)
    reading, wild = tool.read(np.zeros(size), along, run, rng)
    np.testing.assert_allclose(reading * 1000, np.rint(reading * 1000), atol=1e-9)
    assert wild.mean() == pytest.approx(0.01, abs=0.003)  # four standard deviations
    progress = np.tile(np.linspace(-0.5, 0.5, size // runs), runs)
    offsets, drifts, rest = [], [], []
    for k in range(runs):
        rows = (run == k) & ~wild
        drift, offset = np.polyfit(progress[rows], reading[rows], 1)
        offsets.append(offset)
        drifts.append(drift)
        rest.append(reading[rows] - offset - drift * progress[rows])
    # Noise and rounding add in squares; 5 000 readings per run give 1 %.
    expected = np.hypot(0.002, 0.001 / np.sqrt(12))
    assert np.std(np.concatenate(rest)) == pytest.approx(expected, rel=0.03)
    # Four draws each: within a factor of three of what they are drawn from.
    assert 0.01 < np.std(offsets) < 0.09
    assert 0.017 < np.std(drifts) < 0.15
    assert np.mean(offsets) == pytest.approx(1.0, abs=0.06)


def test_same_seed_gives_the_same_measurement() -> None:
    tool = Instrument(0.001, 1e-4, wild=0.1)
    targets = np.linspace(0.0, 800.0, 9)
    first, again, other = (
        measure(example_machine(), "Y", ("X",), targets[:, None], tool, seed, runs=2)
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.reading, again.reading)
    assert not np.array_equal(first.reading, other.reading)


def test_laser_table_reads_back_by_its_own_column_names(tmp_path: Path) -> None:
    targets = np.array([0.0, 250.125, 800.0])
    found = laser(targets)
    path = tmp_path / "laser.csv"
    write_reading(path, "run,direction,target [mm],error [um]", found)
    data = measurement(read_table(path), axis="X")
    np.testing.assert_array_equal(
        data.require("X.position", "test"), found.positions[:, 0]
    )
    # Written with 0.001 µm.
    np.testing.assert_allclose(derive_error(data, "X"), found.reading, atol=5.1e-7)
    np.testing.assert_array_equal(data.require("run", "test"), found.run)
    np.testing.assert_array_equal(data.require("X.direction", "test"), found.direction)


def test_surface_and_straightness_files_state_their_units(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0], [12.5, 30.25]])
    machine = example_machine()
    surface = measure(machine, "Z", ("X", "Y"), points, PERFECT, seed=1)
    line = measure(machine, "Y", ("X",), points[:, :1], PERFECT, seed=1)
    write_reading(tmp_path / "s.csv", "x [mm],y [mm],dz [um]", surface)
    write_reading(tmp_path / "l.csv", "run,x [mm],deviation [um]", line)
    with (tmp_path / "s.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["x [mm]", "y [mm]", "dz [um]"]
    assert rows[2][:2] == ["12.500", "30.250"]
    assert float(rows[2][2]) == pytest.approx(1000 * surface.reading[1], abs=6e-4)
    with (tmp_path / "l.csv").open(newline="") as file:
        assert next(csv.reader(file)) == ["run", "x [mm]", "deviation [um]"]
