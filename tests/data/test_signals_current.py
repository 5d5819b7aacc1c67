"""What a recorded current is worth: sign, saturation, and what cannot be told."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from axcomp.data.signals import (
    Examination,
    Motion,
    examine,
    filtered_motion,
    find_polarity,
    find_saturation,
    without_spikes,
)

DATA = Path(__file__).parents[3] / "shared" / "data"
STEP = 1e-3
TIME = STEP * np.arange(8000)
PARTS = ("breakaway", "stribeck_velocity", "stribeck_shape")


def wave(shift: float = 0.0) -> np.ndarray:
    """Return positions in mm: back and forth, up to 63 mm/s; all forth with a shift."""
    return 20.0 * np.sin(np.pi * TIME) + shift * TIME


def record(
    position: np.ndarray,
    *,
    friction: float = 1.0,
    inertia: float = 2e-3,
    offset: float = 0.3,
    noise: float = 0.1,
) -> tuple[Motion, np.ndarray]:
    """Return the motion and a current in A that drives it."""
    rng = np.random.default_rng(21)
    seen = position + rng.normal(0.0, 1e-4, position.size)
    motion = filtered_motion(TIME, seen, cutoff=50.0)
    v, a = np.gradient(position, STEP), np.gradient(np.gradient(position, STEP), STEP)
    current = friction * np.sign(v) + 5e-3 * v + inertia * a + offset
    return motion, current + rng.normal(0.0, noise, TIME.size)


def kinds(found: Examination) -> list[str]:
    return [finding.kind for finding in found.findings]


def test_good_record_has_no_finding() -> None:
    motion, current = record(wave())
    found = examine(motion, current)
    assert kinds(found) == []
    assert found.undetermined == ()
    assert found.polarity.sign == 1
    assert found.usable.mean() > 0.95


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("gravity", [0.0, 5.0])
def test_sign_of_the_current_is_told_whatever_the_load(
    sign: int, gravity: float
) -> None:
    motion, current = record(wave(), offset=gravity)
    found = examine(motion, sign * current)
    assert found.polarity.sign == sign
    assert found.polarity.confidence > 0.999
    assert ("current opposes the motion" in kinds(found)) == (sign < 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_inertia_tells_the_sign_where_one_direction_is_recorded(sign: int) -> None:
    motion, current = record(wave(shift=100.0))
    found = examine(motion, sign * current)
    assert found.polarity.sign == sign
    assert "inertia" in found.polarity.statement


def test_sign_of_noise_cannot_be_told() -> None:
    wrong = 0
    motion, _ = record(wave())
    direction = np.sign(motion.velocity).astype(np.int64)
    for seed in range(100):
        noise = np.random.default_rng(seed).normal(size=TIME.size)
        noise = np.convolve(noise, np.ones(50) / 50, "same")
        polarity = find_polarity(noise, direction, motion.acceleration)
        wrong += polarity.sign is not None
        assert "cannot be told" in polarity.statement or polarity.sign is not None
    # Four standard deviations are 6e-5 for normal noise; correlated noise has fat tails.
    assert wrong <= 2


@pytest.mark.parametrize("apart", [0.0, 1e-6])
def test_an_acceleration_that_is_all_but_the_direction_leaves_the_sign_untold(
    apart: float,
) -> None:
    rng = np.random.default_rng(1)
    direction = np.where(np.arange(400) % 40 < 20, 1, -1)
    push = 5.0 * direction + apart * rng.normal(size=400)
    current = 2.0 * direction + 0.01 * rng.normal(size=400)
    polarity = find_polarity(current, direction, push)
    assert polarity.sign is None
    assert "0.0 standard deviations" in polarity.statement
    # Both share what they explain, whoever has it: 2 A in all, but for the noise.
    both = polarity.friction + 5.0 * polarity.inertia
    assert both == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("seed", range(10))
def test_rounding_is_no_sign_of_inertia(seed: int) -> None:
    rng = np.random.default_rng(seed)
    direction = np.ones(2000, dtype=np.int64)
    push = 5.0 + 1e-2 * rng.normal(size=2000)
    polarity = find_polarity(np.full(2000, 3.1), direction, push)
    # The coefficient must be 0 but for a 1e-12 of the current: else up to 3.2 are told.
    assert "its inertia is 0.0 standard deviations" in polarity.statement


def test_friction_and_inertia_that_contradict_each_other_tell_nothing() -> None:
    motion, current = record(wave(), friction=2.0, inertia=-2e-2)
    polarity = examine(motion, current).polarity
    assert polarity.sign is None
    assert "contradict" in polarity.statement


def test_only_one_direction_leaves_offset_and_the_other_direction_open() -> None:
    motion, current = record(wave(shift=100.0))
    found = examine(motion, current)
    assert "one direction" in kinds(found)
    assert {"offset", "coulomb_negative", "viscous_negative"} <= set(found.undetermined)
    assert "coulomb_positive" not in found.undetermined
    assert "Only motion in positive direction" in found.findings[0].sentence


def test_no_slow_sample_leaves_the_drop_open() -> None:
    motion, current = record(wave(shift=100.0))  # never slower than 37 mm/s
    found = examine(motion, current)
    assert "no slow samples" in kinds(found)
    assert set(PARTS) <= set(found.undetermined)
    stated = examine(motion, current, slow=50.0)
    assert "no slow samples" not in kinds(stated)


def test_axis_at_rest_tells_nothing() -> None:
    motion, current = record(np.zeros_like(TIME))
    found = examine(motion, current)
    assert kinds(found)[0] == "no motion"
    assert {"inertia", "offset", "coulomb", "viscous"} <= set(found.undetermined)


def test_amount_of_a_current_is_recognised() -> None:
    motion, current = record(wave(), offset=0.0, noise=0.02)
    found = examine(motion, np.abs(current) + 0.2)
    assert "current keeps its sign" in kinds(found)
    assert {"coulomb", "viscous"} <= set(found.undetermined)


def test_gravity_above_the_friction_takes_nothing_away() -> None:
    motion, current = record(wave(), offset=10.0)
    found = examine(motion, current)
    assert kinds(found) == ["current keeps its sign"]
    assert "constant load is larger" in found.findings[0].sentence
    assert found.undetermined == ()


@pytest.mark.parametrize("limit", [None, 1.2])
def test_saturated_current_is_found_and_left_out(limit: float | None) -> None:
    motion, current = record(wave())
    held = np.clip(current, -1.2, 1.2)
    found = examine(motion, held, limit=limit)
    # Half of the motion in positive direction is at the limit.
    assert kinds(found)[0] == "held at a limit"
    assert found.saturation.upper == pytest.approx(1.2)
    truth = np.abs(current) >= 1.2
    # Held for fewer than five samples at a stretch it looks like a peak.
    assert (found.saturation.rows & truth).sum() > 0.6 * truth.sum()
    # Within a thousandth of the limit counts as at it.
    assert not found.saturation.rows[np.abs(current) < 0.998 * 1.2].any()
    assert not found.usable[found.saturation.rows].any()


def test_current_at_its_limit_now_and_then_leaves_the_law_told() -> None:
    motion, current = record(wave())
    limit = float(np.quantile(current, 0.95))
    found = examine(motion, np.clip(current, -limit, limit), limit=limit)
    assert kinds(found) == ["saturated"]
    assert "coulomb" not in found.undetermined


def test_constant_current_of_a_moving_axis_is_named_as_held() -> None:
    motion, _ = record(wave())
    found = examine(motion, np.full(TIME.size, 0.7), limit=0.7)
    assert kinds(found)[0] == "held at a limit"
    assert "in 100% of the motion" in found.findings[0].sentence
    assert {"coulomb", "viscous"} <= set(found.undetermined)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_current_within_its_limits_is_not_called_saturated(noise: float) -> None:
    _, current = record(wave(), noise=noise)
    saturation = find_saturation(current)
    assert not saturation.rows.any()
    assert saturation.statement == "the current does not reach a limit"
    # The crest of a slow wave on a coarse display stays, and is no limit.
    assert not find_saturation(np.round(1000.0 * np.sin(TIME))).rows.any()
    # Dry friction without noise stays at two levels, of which neither is a limit.
    assert not find_saturation(np.sign(np.sin(TIME))).rows.any()


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_spikes_of_a_current_are_drawn_from_their_neighbours(noise: float) -> None:
    _, current = record(wave(), noise=noise)
    unchanged, count = without_spikes(current)
    assert count == 0
    np.testing.assert_array_equal(unchanged, current)
    rows = np.random.default_rng(4).choice(current.size // 3, 80, replace=False) * 3
    spoiled = current.copy()
    spoiled[rows] += np.where(np.arange(80) % 2, 1.0, -1.0) * 20.0 * np.ptp(current)
    mended, count = without_spikes(spoiled)
    assert count == 80
    others = np.setdiff1d(np.arange(current.size), rows)
    np.testing.assert_array_equal(mended[others], current[others])
    # From the readings beside: a spike at a reversal may come from the other side of it.
    assert np.abs(mended - current).max() <= np.ptp(current)


def test_a_short_push_of_a_motor_is_no_spike() -> None:
    current = 0.1 * np.random.default_rng(5).normal(size=4000)
    # Of three samples, sixty times the noise: rare, but no fault of one reading.
    for start in range(100, 4000, 400):
        current[start : start + 3] += 6.0
    assert without_spikes(current)[1] == 0


def test_jumps_of_the_clock_are_told_and_their_rows_not_used() -> None:
    time = np.concatenate([TIME[:4000], TIME[4000:] + 0.5])
    position = 20.0 * np.sin(np.pi * time)
    motion = filtered_motion(time, position, cutoff=50.0)
    current = np.sign(motion.velocity) + 0.1 * np.sin(np.arange(time.size))
    found = examine(motion, current)
    assert kinds(found) == ["clock jumps"]
    assert "1 gap" in found.findings[0].sentence
    assert not found.usable[3990:4010].any()


def test_emps_record_is_sound() -> None:
    path = DATA / "emps" / "DATA_EMPS.mat"
    if not path.exists():
        pytest.skip("needs ../shared/data/emps/DATA_EMPS.mat")
    data = {k: v.ravel() for k, v in loadmat(path).items() if k[0] != "_"}
    found = examine(filtered_motion(data["t"], 1000.0 * data["qm"]), data["vir"])
    assert kinds(found) == []
    assert found.polarity.sign == 1


def test_motion_slower_than_its_noise_has_no_direction() -> None:
    rng = np.random.default_rng(13)
    position = 0.01 * TIME + rng.normal(0.0, 0.01, TIME.size)
    motion = filtered_motion(TIME, position, cutoff=50.0)
    found = examine(motion, rng.normal(0.0, 0.1, TIME.size))
    assert kinds(found)[0] == "no motion"
    assert not found.usable.any()
