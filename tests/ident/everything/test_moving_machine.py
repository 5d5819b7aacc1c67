"""The machine in motion: its loop lags, its instruments are late, its truth is exact."""

import dataclasses

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.machine import (
    CYCLE,
    AxisLoop,
    HeatedPart,
    Instrument,
    MotionLog,
    Path,
    State,
    WorkingMachine,
    machine_with_everything,
    record,
    work_programme,
)

LOOP = AxisLoop(50.0, 0.0, 0.002, 0.003, 0.01)


def stroke() -> Path:
    path = Path({"X": 100.0, "Y": 100.0, "Z": 50.0}, 1500.0)
    path.rest(0.5)
    path.line(100.0, X=200.0)
    path.rest(0.3)
    path.line(100.0, X=100.0, Y=150.0)
    path.circle("X", "Y", 40.0, 60.0, 1.0)
    path.rest(0.5)
    return path


def test_velocity_and_acceleration_are_derivatives_of_the_programme() -> None:
    run = stroke().programme()
    for axis in ("X", "Y"):
        place, speed = run.position[axis], run.velocity[axis]
        # Central differences over 1 ms: the jerk of 4e4 mm/s³ makes 0.01 mm/s.
        np.testing.assert_allclose(np.gradient(place, CYCLE), speed, atol=0.06)
        inner = np.gradient(speed, CYCLE)
        assert np.percentile(np.abs(inner - run.acceleration[axis]), 99) < 40.0
    assert np.abs(run.acceleration["X"]).max() < 1501.0


def test_circle_ends_where_it_began_and_keeps_its_radius() -> None:
    path = Path({"X": 100.0, "Y": 0.0}, 1000.0)
    path.circle("X", "Y", 30.0, 50.0, -1.0)
    run = path.programme()
    away = np.hypot(run.position["X"] - 70.0, run.position["Y"])
    np.testing.assert_allclose(away, 30.0, atol=1e-9)
    np.testing.assert_allclose(path.place, [100.0, 0.0], atol=1e-9)


def test_axis_stays_behind_by_speed_over_gain_and_arrives() -> None:
    run = stroke().programme()
    found = LOOP.follow(run.position["X"])
    late = run.position["X"] - found
    cruise = run.velocity["X"] > 99.9
    # The trapezoidal rule of the loop is exact for a steady motion.
    assert np.max(late[cruise]) == pytest.approx(
        run.velocity["X"].max() / 50.0, rel=0.01
    )
    assert abs(late[-1]) < 1e-6


def test_friction_marks_the_quadrants_in_encoder_and_reference_alike() -> None:
    step = np.where(np.arange(2000) < 1000, -1.6, 1.6)
    mark = LOOP.yielding(step)
    assert np.abs(mark[:1000]).max() < 1e-12
    # About half of 3 µm/A × 3.2 A; the integrator takes it back.
    assert 0.002 < np.abs(mark).max() < 0.01
    assert abs(mark[-1]) < 1e-5


def test_part_follows_its_sensor_with_the_stated_lag() -> None:
    part = HeatedPart("scale", 6.0, 200.0, 90.0, noise=0.0, resolution=1e-9)
    time = np.arange(0.0, 1800.0, 1.0)
    sensor, inside = part.warm(time, np.random.default_rng(1))
    slope = np.gradient(inside, time)
    # T' = (sensor − T) / lag, to the grid of a second.
    np.testing.assert_allclose(90.0 * slope[2:-2], (sensor - inside)[2:-2], atol=0.02)


def test_tracker_shows_where_the_axis_was_and_its_clock_is_slow() -> None:
    time = CYCLE * np.arange(20_000)
    place = 50.0 * np.sin(2.0 * time)
    tool = Instrument(noise=0.0, resolution=1e-9, delay=0.004, rate=1e-4, zero=0.5)
    shown, wrong = tool.follow(place, np.random.default_rng(1))
    at = time - 0.004 - 1e-4 * time
    # Cubics through four samples; the first rows reach back before the record.
    np.testing.assert_allclose(
        shown[10:], 50.0 * np.sin(2.0 * at[10:]) + 0.5, atol=1e-8
    )
    assert not wrong.any()


def causes(machine: WorkingMachine, axis: str, state: State) -> dict[str, np.ndarray]:
    """Return the error of an axis by the compensation that each part of it asks for."""
    found: dict[str, np.ndarray] = {}
    for source in machine.machine.sources:
        if source.axis == axis:
            before = found.get(source.compensation, np.zeros(state.rows))
            found[source.compensation] = before + source.error(state)
    return found


def test_truth_of_a_log_is_the_sum_of_its_causes(
    log: MotionLog, machine: WorkingMachine
) -> None:
    for axis in "XYZ":
        parts = causes(machine, axis, log.state)
        np.testing.assert_allclose(sum(parts.values()), log.truth[axis], atol=1e-15)
    assert set(causes(machine, "Y", log.state)) == {
        "leadscrew", "backlash", "cross", "crosstalk"
    }  # fmt: skip


def test_absent_faults_are_absent_and_a_swapped_beam_bends_over_z() -> None:
    work = machine_with_everything([("backlash", "Z")], swapped=True)
    rows = np.linspace(0.0, 200.0, 50)
    still = {axis: np.full(50, 100.0) for axis in "XYZ"}
    way = {axis: np.ones(50) for axis in "XYZ"}
    moved = causes(work, "Y", State({**still, "Z": rows}, way))["cross"]
    kept = causes(work, "Y", State({**still, "X": rows}, way))["cross"]
    assert np.ptp(moved) > 0.01
    assert np.ptp(kept) == 0.0
    assert "backlash" not in causes(work, "Z", State(still, way))


def test_loaded_list_moves_the_axis_and_the_display_does_not_show_it() -> None:
    bare = machine_with_everything()
    rows = [
        "kopf.achs_nr 2", "kw.crosscomp.unit 1", "kw.crosscomp.last_index 1",
        "kw.crosscomp.master_ax_nr 1",
        "kw.crosscomp.table[0].setpoint 0", "kw.crosscomp.table[0].correction 0",
        "kw.crosscomp.table[1].setpoint 8000000",
        "kw.crosscomp.table[1].correction 800",
    ]  # fmt: skip
    listing = ListFile.parse("\n".join(rows).encode(), "achskw2.lis")
    loaded = dataclasses.replace(bare, machine=bare.machine.with_lists([listing]))
    run = stroke().programme()
    before, after = record(bare, run, 1), record(loaded, run, 1)
    change = after.truth["Y"] - before.truth["Y"]
    # Y stands up to 0.02 mm elsewhere, where its own pitch is another by 1e-6 mm.
    np.testing.assert_allclose(change, 1e-4 * run.position["X"], atol=2e-6)
    np.testing.assert_allclose(after.truth["X"], before.truth["X"], atol=1e-12)
    # The encoder as displayed: what the list adds is taken off again, but for the lag.
    still = np.arange(len(change)) < 400
    np.testing.assert_allclose(
        after.encoder["Y"][still], before.encoder["Y"][still], atol=1e-9
    )


def test_same_seed_gives_the_same_log() -> None:
    work, run = machine_with_everything(), stroke().programme()
    first, again, other = (record(work, run, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.actual["X"], again.actual["X"])
    assert not np.array_equal(first.actual["X"], other.actual["X"])


def test_short_programme_has_the_parts_of_a_long_one() -> None:
    run = work_programme(60.0)
    for axis, most in (("X", 800.0), ("Y", 400.0), ("Z", 200.0)):
        assert run.position[axis].min() >= -1e-9
        assert run.position[axis].max() == pytest.approx(most, abs=1e-6)
    assert run.time[-1] < 250.0
