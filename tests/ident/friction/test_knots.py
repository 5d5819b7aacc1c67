"""The knots of a friction list: few, whole, and as good as any placement."""

import itertools

import numpy as np
import pytest
from scipy.optimize import least_squares

from axcomp.ident.core import FitError
from axcomp.ident.friction import place_knots

SPEED = np.geomspace(0.05, 300.0, 240)
EVEN = np.ones_like(SPEED)


def stribeck(velocity: np.ndarray) -> np.ndarray:
    """A curve as of a ball screw, in A: falling at first, then rising slowly."""
    return 2.0 + 1.5 * np.exp(-velocity / 2.0) + 0.005 * velocity


def brute_force(inner: int, places: np.ndarray) -> float:
    """Best rms of any ``inner`` knots of these places, ends pinned, heights free."""
    best = np.inf
    target = stribeck(SPEED)
    for between in itertools.combinations(places, inner - 2):
        at = np.array([SPEED[0], *between, SPEED[-1]])
        hats = np.stack([np.interp(SPEED, at, hat) for hat in np.eye(inner)], axis=1)
        heights = np.linalg.lstsq(hats, target, rcond=None)[0]
        best = min(best, float(np.sqrt(np.mean((hats @ heights - target) ** 2))))
    return best


@pytest.mark.parametrize("inner", [3, 4, 5])
def test_knots_are_as_good_as_any_placement_found_by_brute_force(inner: int) -> None:
    places = np.geomspace(0.1, 150.0, {3: 300, 4: 60, 5: 28}[inner])
    best = brute_force(inner, places)
    # Two more entries make the level ends, at 1 µm/s and beyond the fastest speed.
    knots = place_knots(SPEED, stribeck(SPEED), EVEN, entries=inner + 2, unit=1e-4)
    # 5 %: what is asked; the lattice of the brute force is a coarse one as well.
    assert knots.rms <= 1.05 * best


@pytest.mark.parametrize("entries", [8, 12, 20])
def test_knots_are_as_good_as_the_best_of_many_starts(entries: int) -> None:
    curve, inner = stribeck(SPEED), entries - 2
    # The peer knows where knots belong: as densely as the bend to the power of 2/5.
    bend = np.abs(np.gradient(np.gradient(curve, SPEED), SPEED)) ** 0.4
    dense = np.append(0.0, np.cumsum((bend[1:] + bend[:-1]) * np.diff(SPEED)))

    def missed(between: np.ndarray) -> np.ndarray:
        steps = np.append(0.0, np.cumsum(np.exp(between - between.max())))
        at = np.interp(steps / steps[-1], dense / dense[-1], SPEED)
        hats = np.stack([np.interp(SPEED, at, hat) for hat in np.eye(inner)], axis=1)
        return np.asarray(hats @ np.linalg.lstsq(hats, curve, rcond=None)[0] - curve)

    starts = np.random.default_rng(4).normal(0.0, 0.3, (8, inner - 1))
    best = min(2.0 * least_squares(missed, s, max_nfev=40).cost for s in starts)
    knots = place_knots(SPEED, curve, EVEN, entries=entries, unit=1e-6)
    # 1 %: what is asked.
    assert knots.rms <= 1.01 * np.sqrt(best / len(SPEED))


def test_a_table_that_was_fitted_is_found_again() -> None:
    at = np.geomspace(SPEED[0], SPEED[-1], 12)
    heights = stribeck(at) + 0.05 * np.random.default_rng(1).normal(size=12)
    curve = np.interp(SPEED, at, heights)
    knots = place_knots(SPEED, curve, EVEN, entries=14, unit=1e-4)
    # A list unit: the whole µm/s cost less than that too.
    assert knots.rms <= 1e-4


def test_velocities_ascend_from_one_step_to_beyond_the_fastest_speed() -> None:
    knots = place_knots(SPEED, stribeck(SPEED), EVEN, entries=20, unit=1e-3)
    assert len(knots.velocity) <= 20
    assert knots.velocity[0] == 1
    assert np.all(np.diff(knots.velocity) > 0)
    assert knots.velocity[-1] > 300_000


def test_both_ends_are_level_since_nobody_measured_there() -> None:
    knots = place_knots(SPEED, stribeck(SPEED), EVEN, entries=12, unit=1e-3)
    assert knots.out[0] == knots.out[1]
    assert knots.out[-1] == knots.out[-2]


def test_rounding_to_whole_currents_costs_no_more_than_rounding_does() -> None:
    rms = [
        place_knots(SPEED, stribeck(SPEED), EVEN, entries=20, unit=unit).rms
        for unit in (0.01, 1e-6)
    ]
    # A value off by up to half a unit, evenly, is off by unit/sqrt(12) rms.
    assert rms[0] <= rms[1] + 0.01 / np.sqrt(12)


def test_knots_go_where_whole_currents_are_on_the_curve() -> None:
    knots = place_knots(SPEED, stribeck(SPEED), EVEN, entries=20, unit=0.05)
    # Rounding each height alone costs unit/sqrt(12) at the knots and 0.8 of it, sqrt(2/3),
    # between them. What is left is less than a quarter of that.
    assert knots.rms <= 0.25 * np.sqrt(2 / 3) * 0.05 / np.sqrt(12)


@pytest.mark.parametrize("unit", [0.5, 0.1, 0.01, 0.001])
def test_entries_are_roundings_of_a_law_that_lines_can_follow(unit: float) -> None:
    time = np.arange(0.0, 40.0, 1e-3)
    motion = 50.0 * np.sin(2.0 * np.pi * time / 6.0) * np.sin(2.0 * np.pi * time / 37.0)
    driven = np.abs(np.gradient(motion, time))
    speed = np.linspace(0.5, 80.0, 240)  # few are as fast as 52 mm/s, none is faster
    weight = np.histogram(driven, np.append(speed, 81.0))[0].astype(float)
    curve = 0.15 + 0.0015 * speed
    knots = place_knots(speed, curve, weight, entries=20, unit=unit)
    law = np.interp(knots.velocity / 1000.0, speed, curve) / unit
    assert np.abs(knots.out - law).max() < 1.0
    # It is held beyond, so the nearest; half a unit and the rounding of the arithmetic.
    assert abs(knots.out[-1] - law[-1]) <= 0.5 + 1e-9


def test_knots_of_a_narrow_range_have_velocities_of_their_own() -> None:
    speed = np.linspace(0.010, 0.030, 60)  # 20 list units for 18 knots
    curve = 2.0 + 0.5 * np.sin(speed * 900.0)
    knots = place_knots(speed, curve, np.ones(60), entries=20, unit=1e-3)
    assert len(knots.velocity) <= 20
    assert np.all(np.diff(knots.velocity) > 0)
    assert knots.rms <= 0.1 * np.std(curve)


def test_speeds_that_nobody_drove_have_no_say() -> None:
    odd = stribeck(SPEED)
    fast = SPEED > 100.0
    odd[fast] += 50.0
    weight = np.where(fast, 0.0, 1.0)
    knots = place_knots(SPEED, odd, weight, entries=8, unit=1e-3)
    clean = place_knots(SPEED[~fast], odd[~fast], EVEN[~fast], entries=8, unit=1e-3)
    slow = SPEED[~fast]
    error = knots.current(slow) - stribeck(slow)
    # The knots may also serve the way up to the last, unmeasured one: one knot fewer.
    assert np.sqrt(np.mean(error**2)) <= 2.0 * clean.rms


def test_lines_through_speeds_that_were_driven_once_stay_at_the_law() -> None:
    speed = np.geomspace(
        0.05, 300.0004, 240
    )  # the last entry is at the next whole µm/s
    weight = np.where(speed > 10.0, 1e-6, 1.0)
    knots = place_knots(speed, stribeck(speed), weight, entries=8, unit=0.1)
    # Half a unit of rounding, and a law that bends by as much there; an entry at a whole
    # µm/s is off by 0.005 A/(mm/s) times less than that.
    assert np.abs(knots.current(speed) - stribeck(speed)).max() <= 0.1 + 5e-6


def test_more_entries_never_follow_the_curve_worse() -> None:
    found = [
        place_knots(SPEED, stribeck(SPEED), EVEN, entries=n, unit=1e-6).rms
        for n in (4, 6, 9, 14, 20)
    ]
    assert found == sorted(found, reverse=True)


def test_a_straight_line_is_written_by_its_ends() -> None:
    speed = np.linspace(1.0, 100.0, 50)
    knots = place_knots(speed, 0.01 * speed, np.ones(50), entries=4, unit=1e-2)
    # 1 µm/s, the slowest, the fastest, and beyond: all on two lines.
    assert list(knots.velocity) == [1, 1000, 100_000, 105_000]
    assert list(knots.out) == [1, 1, 100, 100]


def test_too_few_entries_or_speeds_are_refused() -> None:
    with pytest.raises(FitError, match="found 2 entries and 240 speeds"):
        place_knots(SPEED, stribeck(SPEED), EVEN, entries=2, unit=1e-3)
    with pytest.raises(FitError, match="found 20 entries and 1 speeds"):
        place_knots(SPEED[:1], stribeck(SPEED[:1]), EVEN[:1], unit=1e-3)
