"""Delay between channels, to a fraction of a sample."""

import numpy as np
import pytest

from axcomp.data.signals import SignalError, estimate_delay

STEP = 1e-3
TIME = STEP * np.arange(4000)


def motion(time: np.ndarray) -> np.ndarray:
    """Return positions in mm of two slow waves that do not repeat within 4 s."""
    return 100.0 * np.sin(2.0 * np.pi * 0.37 * time) + 20.0 * np.sin(11.9 * time + 0.3)


@pytest.mark.parametrize("delay", [0.0, 0.25e-3, 0.5e-3, 3.3e-3, -2.71e-3])
def test_delay_is_exact_without_noise(delay: float) -> None:
    found = estimate_delay(
        motion(TIME), 2.0 - 3.0 * motion(TIME - delay), STEP, longest=0.02
    )
    assert found.determined
    # What the filter leaves of the ends of the record: a hundredth of a microsecond.
    assert found.seconds == pytest.approx(delay, abs=1e-8)
    assert found.gain == pytest.approx(-3.0, rel=1e-5)


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 0.5e-3, 4.1e-3])
def test_delay_lies_within_its_deviation_and_is_not_drawn_anywhere(
    delay: float,
) -> None:
    rng = np.random.default_rng(4)
    scores = []
    for _ in range(60):
        first = motion(TIME) + rng.normal(0.0, 0.05, TIME.size)
        second = 2.0 * motion(TIME - delay) + rng.normal(0.0, 0.1, TIME.size)
        found = estimate_delay(first, second, STEP, longest=0.02)
        assert found.determined
        assert found.standard_deviation < 1e-5
        scores.append((found.seconds - delay) / found.standard_deviation)
    # 60 draws: the mean is known to 0.13, the spread to 9 %; three times that.
    assert abs(np.mean(scores)) < 0.4
    assert np.std(scores) == pytest.approx(1.0, abs=0.3)


def test_deviation_holds_for_noise_that_is_correlated() -> None:
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(60):
        slow = np.convolve(
            rng.normal(0.0, 0.2, TIME.size + 19), np.ones(20) / 20, "valid"
        )
        found = estimate_delay(
            motion(TIME), motion(TIME - 1.7e-3) + slow, STEP, longest=0.02
        )
        scores.append((found.seconds - 1.7e-3) / found.standard_deviation)
    # The window of the deviation ends at 30 samples: it may lack a quarter.
    assert np.std(scores) < 1.5


@pytest.mark.parametrize(
    ("second", "match"),
    [
        (np.zeros_like(TIME), "does not change"),
        (np.random.default_rng(6).normal(size=TIME.size), "alike to"),
        (motion(TIME - 0.05), "longer than the 20 ms"),
    ],
)
def test_what_cannot_be_told_is_said(second: np.ndarray, match: str) -> None:
    found = estimate_delay(motion(TIME), second, STEP, longest=0.02)
    assert not found.determined
    assert found.statement.startswith("the delay cannot be told")
    assert match in found.statement


def test_motion_that_repeats_leaves_the_delay_open() -> None:
    wave = np.sin(2.0 * np.pi * 50.0 * TIME)
    late = np.sin(2.0 * np.pi * 50.0 * (TIME - 0.002))
    found = estimate_delay(wave, late, STEP, longest=0.1)
    assert not found.determined
    assert "repeats" in found.statement


def test_short_record_is_refused() -> None:
    with pytest.raises(SignalError, match="delay: found 40 samples"):
        estimate_delay(TIME[:40], TIME[:40], STEP, longest=0.01)


def test_samples_that_a_recorder_repeats_are_no_second_delay() -> None:
    rng, time = np.random.default_rng(1), STEP * np.arange(17000)
    place = 200.0 * np.sin(0.4 * time) + 20.0 * np.sin(3.1 * time + 0.3)
    rows = np.arange(len(time))
    for start in rng.choice(len(time) - 20, 10, replace=False):
        rows[start : start + 8] = rows[start]
    late = np.roll(place, 3)
    found = estimate_delay(place[rows], late[rows], STEP, longest=0.02)
    assert found.determined
    # A tenth of a sample.
    assert found.seconds == pytest.approx(3e-3, abs=1e-4)
