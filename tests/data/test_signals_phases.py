"""Rest, constant speed and reversals in a recording."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from axcomp.data.signals import Motion, filtered_motion, find_phases, smoothed_motion

DATA = Path(__file__).parents[3] / "shared" / "data"
STEP = 1e-3
SPEEDS = (5.0, 20.0, 100.0)
"""mm/s, each driven there and back."""


def drive(rest: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, position, velocity: there and back at each speed, rests between.

    Ramps of 1000 mm/s², 1 s at speed.
    """
    velocity = [np.zeros(round(rest / STEP))]
    for speed in SPEEDS:
        ramp = np.linspace(0.0, speed, max(2, round(speed / 1000.0 / STEP)))
        for sign in (1.0, -1.0):
            leg = np.concatenate([ramp, np.full(1000, speed), ramp[::-1]])
            velocity += [sign * leg, np.zeros(round(rest / STEP))]
    v = np.concatenate(velocity)
    return STEP * np.arange(v.size), np.cumsum(v) * STEP, v


def noisy(noise: float, quantum: float, rest: float = 0.3) -> tuple[Motion, np.ndarray]:
    rng = np.random.default_rng(11)
    time, position, velocity = drive(rest)
    seen = position + rng.normal(0.0, noise, time.size) if noise else position
    if quantum:
        seen = np.round(seen / quantum) * quantum
    return filtered_motion(time, seen, cutoff=50.0), velocity


WAYS = [(0.0, 1e-4), (1e-3, 0.0), (5e-4, 1e-3), (0.0, 0.0)]
"""Standard deviation of noise and step of the display, both in mm."""


@pytest.mark.parametrize(("noise", "quantum"), WAYS)
@pytest.mark.parametrize("rest", [0.3, 0.0])
def test_every_constant_speed_is_found_once_with_its_speed(
    noise: float, quantum: float, rest: float
) -> None:
    motion, velocity = noisy(noise, quantum, rest)
    found = find_phases(motion)
    wanted = [sign * speed for speed in SPEEDS for sign in (1.0, -1.0)]
    assert len(found.plateaus) == len(wanted)
    for plateau, speed in zip(found.plateaus, wanted, strict=True):
        # 1 s at speed, less what the filter smears; nothing of the ramps.
        assert plateau.stop - plateau.start > 850
        assert np.all(velocity[plateau.rows] == speed)
        assert plateau.direction == np.sign(speed)
        bound = 5.0 * plateau.velocity_deviation + 1e-4 * abs(speed)
        assert plateau.velocity == pytest.approx(speed, abs=bound)


@pytest.mark.parametrize(("noise", "quantum"), WAYS)
def test_rest_is_masked_and_motion_is_not(noise: float, quantum: float) -> None:
    motion, velocity = noisy(noise, quantum)
    found = find_phases(motion)
    still = velocity == 0.0
    # The filter of 50 Hz sees a ramp 20 ms ahead.
    away = np.convolve(~still, np.ones(81), "same") < 0.5
    assert found.rest[away & motion.settled].mean() > 0.99
    assert not found.rest[np.abs(velocity) > 2.0 * found.slowest + 0.5].any()
    assert np.all(found.direction[found.rest] == 0)


@pytest.mark.parametrize(("noise", "quantum"), WAYS)
@pytest.mark.parametrize("rest", [0.3, 0.0])
def test_every_reversal_is_found_once_at_its_place(
    noise: float, quantum: float, rest: float
) -> None:
    motion, velocity = noisy(noise, quantum, rest)
    found = find_phases(motion)
    moving = np.flatnonzero(velocity)
    turns = np.flatnonzero(np.diff(np.sign(velocity[moving])))
    assert len(found.reversals) == turns.size == 5
    _, position, _ = drive(rest)
    for reversal, turn in zip(found.reversals, turns, strict=True):
        last, first = moving[turn], moving[turn + 1]
        assert last - 40 <= reversal.row <= first + 40  # within reach of the filter
        assert reversal.before == np.sign(velocity[last])
        # A filter of 50 Hz rounds the tip of a ramp of 1000 mm/s² by some µm.
        assert reversal.position == pytest.approx(position[last], abs=0.1)
        assert reversal.dwell >= rest - 0.02


def test_noise_at_rest_makes_no_reversal() -> None:
    rng = np.random.default_rng(12)
    time = STEP * np.arange(20_000)
    motion = filtered_motion(time, rng.normal(0.0, 1e-3, time.size), cutoff=50.0)
    found = find_phases(motion)
    assert not found.reversals
    assert not found.plateaus
    assert found.rest[motion.settled].mean() > 0.999


def test_ramp_is_no_plateau() -> None:
    time = STEP * np.arange(4000)
    motion = filtered_motion(time, 50.0 * time**2, cutoff=50.0)
    for plateau in find_phases(motion).plateaus:
        # Slow enough that the speed changes by 2 % over 0.1 s only from 500 mm/s on.
        assert plateau.velocity > 300.0


def test_slow_motion_within_noise_has_no_direction() -> None:
    rng = np.random.default_rng(13)
    time = STEP * np.arange(4000)
    motion = filtered_motion(
        time, 0.01 * time + rng.normal(0.0, 0.01, 4000), cutoff=50.0
    )
    found = find_phases(motion)
    assert found.slowest > 0.01
    assert not found.direction.any()


def test_plateaus_of_the_emps_record() -> None:
    path = DATA / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        pytest.skip("needs ../shared/data/emps/DATA_EMPS.mat")
    record = {k: v.ravel() for k, v in loadmat(path).items() if k[0] != "_"}
    motion = filtered_motion(record["t"], 1000.0 * record["qm"])
    found = find_phases(motion)
    # Eight legs between 0 and 246 mm, each with 42, 83, 125 and 42 mm/s.
    assert len(found.reversals) == 7
    assert len(found.plateaus) == 32
    ends = [round(reversal.position) for reversal in found.reversals]
    assert ends == [246, 0, 246, 0, 246, 0, 246]
    speeds = sorted({round(abs(plateau.velocity)) for plateau in found.plateaus})
    assert speeds == [42, 83, 125]


def test_reversals_of_a_robot_joint_with_an_uneven_clock() -> None:
    path = DATA / "friction" / "ur10e_jointwise_joint_1.csv.gz"
    if not path.exists():
        pytest.skip("needs ../shared/data/friction/ur10e_jointwise_joint_1.csv.gz")
    with gzip.open(path) as file:
        body = np.loadtxt(file, delimiter=",", usecols=(0, 1, 7))
    motion = smoothed_motion(body[:, 0], np.degrees(body[:, 1]), bandwidth=10.0)
    logged = np.degrees(body[:, 2])
    # The controller's own velocity differs by its filter; 0.2 °/s of 56 °/s.
    gap = (motion.velocity - logged)[motion.settled]
    assert np.std(gap) < 0.25
    found = find_phases(motion)
    signs = np.sign(logged[np.abs(logged) > 1.0])
    assert len(found.reversals) == np.count_nonzero(np.diff(signs))
