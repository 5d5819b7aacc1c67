"""Velocity and acceleration from positions, filters, and the clock they run on."""

import time as stopwatch
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from axcomp.data.signals import (
    SignalError,
    bandwidth,
    central_differences,
    decimate,
    filtered_motion,
    noise_of,
    read_clock,
    resolution,
    signs_at_one_place,
    smoothed_motion,
    standing,
    zero_phase,
)

DATA = Path(__file__).parents[3] / "shared" / "data"
STEP = 1e-3
TIME = STEP * np.arange(4000)


def emps() -> dict[str, np.ndarray]:
    path = DATA / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        pytest.skip("needs ../shared/data/emps/DATA_EMPS.mat")
    return {key: value.ravel() for key, value in loadmat(path).items() if key[0] != "_"}


@pytest.mark.parametrize(("by_direction", "published"), [(False, 4.12), (True, 3.17)])
def test_emps_evaluation_is_expressed_exactly(
    by_direction: bool, published: float
) -> None:
    record = emps()
    motion = filtered_motion(record["t"], record["qm"], cutoff=100.0, order=4)
    force = record["gtau"] * record["vir"]
    v, a = motion.velocity, motion.acceleration
    columns = [a, v, np.sign(v), np.ones_like(v)]
    if by_direction:
        ahead, back = v > 0.0, v < 0.0
        columns = [a, v * ahead, v * back, 1.0 * ahead, -1.0 * back]
    regressors, target = decimate(np.column_stack(columns), 10), decimate(force, 10)
    found = np.linalg.lstsq(regressors, target, rcond=None)[0]
    error = np.linalg.norm(target - regressors @ found) / np.linalg.norm(target)
    # Field notes give two decimals (3.17: computed by hand with SciPy, same steps).
    assert round(100.0 * float(error), 2) == published
    if not by_direction:
        # Published values with one published standard deviation.
        assert found[0] == pytest.approx(95.1089, abs=0.1085)
        assert found[1] == pytest.approx(203.5034, abs=1.1460)
        assert found[2] == pytest.approx(20.3935, abs=0.1012)
        assert found[3] == pytest.approx(-3.1648, abs=0.0444)


@pytest.mark.parametrize("cutoff", [20.0, 100.0])
@pytest.mark.parametrize("order", [2, 4])
def test_zero_phase_leaves_what_its_bandwidth_says_and_shifts_nothing(
    cutoff: float, order: int
) -> None:
    middle = slice(1000, 3000)
    for frequency, left in ((bandwidth(cutoff, order), 2.0**-0.5), (cutoff, 0.5)):
        wave = 2.0 * np.pi * frequency * TIME
        smooth = zero_phase(np.sin(wave), STEP, cutoff=cutoff, order=order)
        waves = np.column_stack([np.sin(wave), np.cos(wave)])[middle]
        in_phase, out_of_phase = np.linalg.lstsq(waves, smooth[middle], rcond=None)[0]
        # The bilinear transform bends frequencies: 3 % at a tenth of the sample rate.
        assert in_phase == pytest.approx(left, abs=0.03)
        assert abs(out_of_phase) < 1e-6


def test_filters_take_columns_like_single_signals() -> None:
    rng = np.random.default_rng(1)
    both = rng.normal(size=(2000, 2))
    for act in (
        lambda x: zero_phase(x, STEP, cutoff=50.0),
        lambda x: central_differences(x, STEP),
        lambda x: decimate(x, 10),
    ):
        # The same sums in another memory order: rounding only.
        assert np.allclose(act(both)[:, 1], act(both[:, 1]), rtol=0, atol=1e-11)


def parabola(time: np.ndarray) -> np.ndarray:
    return 3.0 + 20.0 * time - 7.0 * time**2


@pytest.mark.parametrize("by", ["filter", "spline"])
def test_motion_of_constant_acceleration_is_exact_where_settled(by: str) -> None:
    if by == "filter":
        motion = filtered_motion(TIME, parabola(TIME), cutoff=50.0)
    else:
        motion = smoothed_motion(TIME, parabola(TIME), bandwidth=50.0)
    use = motion.settled
    assert use.sum() > 3800
    # Neither changes a parabola inside; 1e-4 of the speed is left of the ends.
    assert np.allclose(motion.velocity[use], (20.0 - 14.0 * TIME)[use], atol=4e-3)
    assert np.median(np.abs(motion.acceleration[use] + 14.0)) < 1e-3


@pytest.mark.parametrize("by", ["filter", "spline"])
def test_stated_noise_is_that_of_the_result(by: str) -> None:
    rng = np.random.default_rng(2)
    clean = 50.0 * np.sin(2.0 * np.pi * 0.5 * TIME)
    noisy = clean + rng.normal(0.0, 1e-3, TIME.size)
    runs = []
    for position in (clean, noisy):
        if by == "filter":
            runs.append(filtered_motion(TIME, position, cutoff=60.0))
        else:
            runs.append(smoothed_motion(TIME, position, bandwidth=60.0))
    use = runs[1].settled
    # 4000 samples, correlated over 10: the standard deviation is known to 4 %.
    assert runs[1].position_noise == pytest.approx(1e-3, rel=0.1)
    velocity = np.std((runs[1].velocity - runs[0].velocity)[use])
    acceleration = np.std((runs[1].acceleration - runs[0].acceleration)[use])
    assert runs[1].velocity_noise == pytest.approx(velocity, rel=0.15)
    assert runs[1].acceleration_noise == pytest.approx(acceleration, rel=0.15)


def test_spline_leaves_what_its_bandwidth_says() -> None:
    frequency = 40.0
    wave = 2.0 * np.pi * frequency * TIME
    motion = smoothed_motion(TIME, np.sin(wave), bandwidth=frequency)
    middle = slice(1000, 3000)
    sine = np.sin(wave)[middle]
    share = motion.position[middle] @ sine / (sine @ sine)
    # The formula is of continuous time; at 25 samples a period it is good to 1 %.
    assert share == pytest.approx(2.0**-0.5, rel=0.01)


def test_spline_takes_unequal_steps_which_the_filter_refuses() -> None:
    steps = np.where(np.arange(3000) % 3 == 0, 0.012, 0.010)
    time = np.concatenate([[0.0], np.cumsum(steps)])
    with pytest.raises(SignalError, match="equal steps, or `smoothed_motion`"):
        filtered_motion(time, np.sin(time), cutoff=5.0)
    motion = smoothed_motion(time, 100.0 * np.sin(time), bandwidth=5.0)
    use = motion.settled
    # A slow wave of 0.16 Hz is left as it is to (0.16/5)^4.
    assert np.allclose(motion.velocity[use], 100.0 * np.cos(time)[use], atol=1e-3)


def test_jump_of_the_clock_splits_the_motion() -> None:
    time = np.concatenate([TIME[:2000], TIME[2000:] + 1.0])
    motion = filtered_motion(time, 10.0 * time, cutoff=50.0)
    assert not motion.settled[1990:2010].any()
    # Through the jump the speed would be a hundred times the true one.
    assert np.abs(motion.velocity).max() < 20.0
    assert np.allclose(motion.velocity[motion.settled], 10.0, atol=1e-3)


def test_segment_too_short_to_filter_has_no_settled_sample() -> None:
    time = np.concatenate([TIME[:2000], [5.0, 5.001, 5.002], TIME[2000:] + 9.0])
    motion = filtered_motion(time, 10.0 * time, cutoff=50.0)
    assert not motion.settled[1995:2008].any()
    assert np.allclose(motion.velocity[2000:2003], 10.0)


@pytest.mark.parametrize(
    ("times", "kinds", "rows"),
    [
        ([0, 1, 2, 3, 14, 15, 16, 17], ["gap"], [4]),
        ([0, 1, 2, 3, 2, 3, 4, 5], ["back"], [4]),
        ([0, 1, 2, 3, 3, 4, 5, 6], ["repeat"], [4]),
        ([0, 1, 2, 3, 3.2, 4.2, 5.2, 6.2], ["short"], [4]),
        ([0, 1, 2, 9, 10, 11, 3, 4, 5], ["gap", "back"], [3, 6]),
    ],
)
def test_clock_names_each_jump_and_splits_there(
    times: list[float], kinds: list[str], rows: list[int]
) -> None:
    clock = read_clock(np.array(times, dtype=float) * 1e-3)
    assert clock.sample_time == pytest.approx(1e-3)
    assert [jump.kind for jump in clock.jumps] == kinds
    assert [jump.row for jump in clock.jumps] == rows
    ends = [segment.stop for segment in clock.segments]
    assert ends == [*rows, len(times)]
    assert "sample" in clock.statement


def test_clock_that_alternates_between_two_steps_does_not_jump() -> None:
    steps = np.where(np.arange(500) % 2 == 0, 0.012, 0.010)
    clock = read_clock(np.cumsum(steps))
    assert not clock.jumps
    assert not clock.uniform
    assert clock.jitter == pytest.approx(1e-3, rel=0.01)


def test_noise_is_found_under_any_motion() -> None:
    rng = np.random.default_rng(3)
    motion = np.where(TIME < 2.0, 100.0 * TIME, 400.0 - 100.0 * TIME)
    noisy = motion + rng.normal(0.0, 2e-3, TIME.size)
    assert noise_of(noisy) == pytest.approx(2e-3, rel=0.06)  # of 4000 samples: 2 %
    assert noise_of(noisy, TIME) == pytest.approx(2e-3, rel=0.06)


def test_display_of_few_digits_counts_as_noise() -> None:
    shown = np.round(np.sin(TIME), 3)
    assert resolution(shown) == pytest.approx(1e-3)
    assert noise_of(shown) >= 1e-3 / 12.0**0.5


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: zero_phase(TIME, STEP, cutoff=500.0), "less than 500 Hz"),
        (lambda: zero_phase(TIME[:10], STEP, cutoff=50.0), "found 10 samples"),
        (lambda: decimate(TIME[:100], 10), "found 100 samples, expected at least 201"),
        (lambda: smoothed_motion(TIME, TIME, bandwidth=300.0), "at most 250 Hz"),
        (lambda: read_clock(np.zeros(5)), "rising steps of the clock"),
        (lambda: read_clock(np.array([3.0, 1, 2, 0, 4])), "2 of 4 steps that go back"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(call, match: str) -> None:
    with pytest.raises(SignalError, match=match) as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_long_record_takes_seconds() -> None:
    time = STEP * np.arange(300_000)
    position = 100.0 * np.sin(time)
    begun = stopwatch.perf_counter()
    filtered_motion(time, position, cutoff=100.0)
    # Some 0.2 s; a loop over samples in Python would take minutes.
    assert stopwatch.perf_counter() - begun < 10.0


@pytest.mark.parametrize(("starts", "ends", "signs"), [(0, 0, 2), (0, 1, 1), (1, 1, 0)])
def test_signs_of_an_acceleration_at_one_place_are_counted(
    starts: int, ends: int, signs: int
) -> None:
    rng = np.random.default_rng(19)
    step, parts, place = 0.004, [], 0.0
    for k in range(40):
        middle, free = ((200.0, ends), (0.0, starts))[k % 2]
        end = middle + free * rng.uniform(-100.0, 100.0)
        count = 120
        phase = (np.arange(count) + 0.5) / count
        parts.append(place + (end - place) * (0.5 - 0.5 * np.cos(np.pi * phase)))
        parts.append(np.full(30, end))
        place = end
    x = np.concatenate(parts)
    # Hard near the ends of its strokes: cubes of what the cosine does.
    a = np.gradient(np.gradient(x, step), step) ** 3
    assert signs_at_one_place(a, x) == signs


def test_a_digit_that_flickers_at_rest_is_no_motion_and_a_creep_is() -> None:
    time = 0.01 * np.arange(1200)
    ramp = np.interp(time, [2.0, 4.0, 8.0, 12.0], [0.0, 100.0, 100.0, 100.4])
    rng = np.random.default_rng(2)
    # An encoder of 1 µm; one sample in eight at rest shows the digit above.
    shown = np.rint(1e3 * ramp) / 1e3
    shown += np.where((time < 8.0) & (rng.random(1200) < 0.12), 1e-3, 0.0)
    found = standing(time, shown)
    # The first 0.3 s of each rest are where a loop may still settle, and the last 0.1 s before
    # a motion lie within what tells a digit from it.
    assert found[(time > 0.35) & (time < 1.85)].all()
    assert found[(time > 4.45) & (time < 7.85)].all()
    assert not found[(time > 2.0) & (time < 4.25)].any()
    # 0.1 mm/s, a digit a sample.
    assert not found[time > 8.05].any()
