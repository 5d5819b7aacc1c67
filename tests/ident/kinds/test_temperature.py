"""Planted thermal lines come back, within the deviations that the fit states."""

import dataclasses

import numpy as np
import pytest

from axcomp.ident._recording import lagged
from axcomp.ident.core import FitError
from axcomp.ident.fit.joint import JointData, Temperature
from axcomp.ident.kinds.temperature._line import TemperatureFit

from ..thermal_line import fitted, readings

TARGETS = np.linspace(0.0, 1000.0, 6)  # mm
MINUTE = 60.0
NOISE = 5e-4  # mm


def warm_up(
    seed: int,
    *,
    hours: float = 5.0,
    lag: float = 0.0,
    drift: float = 0.0,
    crossing: float | None = -200.0,
    growth: float = 1.1e-5,
) -> JointData:
    """A machine that warms up and cools down, measured at six targets over and over.

    Args:
        seed: Of noise and drift.
        hours: Length of the log.
        lag: Time constant of the structure behind the sensor in s.
        drift: Standard deviation in mm of a drift that forgets in 20 minutes.
        crossing: Where the lines meet in mm; None = nowhere.
        growth: Coefficient per K.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, hours * 3600.0, MINUTE)
    warm = 1.0 - np.exp(-time / 3000.0)
    cool = np.where(time > 0.6 * time[-1], 1.0, 0.0)
    since = np.maximum(time - 0.6 * time[-1], 0.0)
    warm = warm * np.where(cool > 0, np.exp(-since / 3500.0), 1.0)
    sensor = 20.0 + 18.0 * warm
    theta = lagged(time, sensor, lag)
    position = TARGETS[np.arange(len(time)) % len(TARGETS)]
    slow, kept = np.zeros(len(time)), np.exp(-MINUTE / 1200.0)
    state = rng.normal()
    for row in range(len(time)):
        slow[row] = state
        state = kept * state + np.sqrt(1.0 - kept**2) * rng.normal()
    error = 0.004 + growth * (theta - 20.0) * (
        position - (0.0 if crossing is None else crossing)
    )
    if crossing is None:
        error += 1e-4 * (theta - 20.0) ** 2
    error += drift * slow + NOISE * rng.normal(size=len(time))
    shown = sensor + 0.05 * rng.normal(size=len(time))
    return readings(error, shown, position=position, time=time)


@pytest.fixture(scope="module")
def plain() -> TemperatureFit:
    """A warm-up with all left open: law, lag and intersection."""
    return fitted(warm_up(1))


@pytest.fixture(scope="module")
def behind() -> TemperatureFit:
    """A structure that follows its sensor with 900 s, all left open."""
    return fitted(warm_up(6, lag=900.0))


def test_lines_that_meet_are_found_with_their_intersection(
    plain: TemperatureFit,
) -> None:
    fit = plain
    assert fit.meeting == "met"
    assert fit.coefficient is not None
    assert fit.reference_deviation is not None
    # Three stated deviations: a fair fit misses that once in 370 seeds.
    assert abs(fit.reference + 200.0) < 3.0 * fit.reference_deviation
    assert fit.offset.kind == "constant"
    assert fit.coefficient.kind == "linear"
    # The noise of 0.05 K on the sensor is 0.6 µm at the far end, beside 0.5 µm.
    np.testing.assert_allclose(fit.coefficient.slope[0], 1.1e-5, rtol=0.01)


def test_lines_meet_where_the_coefficient_bends_over_the_temperature_too() -> None:
    data = warm_up(2)
    warm, away = data.temperature["1"] - 20.0, data.position["X"] + 200.0
    # At the node in the middle, else a law of three nodes would be another one.
    more = np.maximum(warm - 0.5 * (warm.min() + warm.max()), 0.0)
    bent = data.error["X"] + 1.1e-5 * more * away
    fit = fitted(
        dataclasses.replace(data, error={"X": bent}), law=("constant", 3), lag="none"
    )
    assert fit.meeting == "met"
    assert fit.offset.kind == "constant"
    assert fit.reference_deviation is not None
    # Three stated deviations: a fair fit misses that once in 370 seeds.
    assert abs(fit.reference + 200.0) < 3.0 * fit.reference_deviation < 6.0
    # Each half of the coefficient by itself: 2 %.
    slopes = np.diff(fit.laws["coefficient"].value) / np.diff(
        fit.laws["coefficient"].temperature
    )
    np.testing.assert_allclose(slopes, [1.1e-5, 2.2e-5], rtol=0.02)


def test_lines_that_meet_nowhere_are_told_from_the_middle_of_the_positions() -> None:
    fit = fitted(warm_up(2, crossing=None), law=(3, "linear"), lag="none")
    assert fit.meeting == "not one point"
    assert fit.reference == 500.0
    assert fit.reference_deviation is None
    assert len(fit.offset.value) == 3


def test_a_reference_in_mm_is_taken_as_it_is() -> None:
    fit = fitted(warm_up(3), reference=250.0, lag="none")
    assert fit.reference == 250.0
    # At 250 mm the planted line moves by 450 mm · 11 µm/m/K; 1 % as above.
    np.testing.assert_allclose(fit.offset.slope[0], 450.0 * 1.1e-5, rtol=0.02)


@pytest.mark.heavy
@pytest.mark.parametrize("drift", [0.0, 0.003])
def test_planted_values_lie_within_the_stated_deviations_at_the_right_rate(
    drift: float,
) -> None:
    distances = []
    for seed in range(40):
        fit = fitted(
            warm_up(seed, drift=drift),
            law=("linear", "linear"),
            reference=0.0,
            lag="none",
        )
        slope, deviation = fit.offset.slope
        assert fit.coefficient is not None
        span = np.ptp(fit.coefficient.temperature)
        variance = fit.covariance[2:, 2:]
        rise = variance[0, 0] + variance[1, 1] - 2 * variance[0, 1]
        distances.append((slope - 200.0 * 1.1e-5) / deviation)
        distances.append(
            (fit.coefficient.slope[0] - 1.1e-5) / (np.sqrt(max(rise, 0.0)) / span)
        )
    within = np.abs(distances)
    # 95 % of 80 within two deviations; 10 misses and more have a chance below 1 %. The
    # sensor noise attenuates slopes by 0.01 %, which is nothing here.
    assert (within < 2.0).mean() > 0.88
    # Deviations that are twice too large would hide a bad estimate: then 95 % lie within 1. For
    # how long a drift remembers is hardly known from one log: they are up to 1.6 times too large.
    assert (within < 1.0).mean() < (0.9 if drift else 0.82)


def test_drift_makes_deviations_larger_than_independent_readings_would() -> None:
    calm, drifting = (
        fitted(
            warm_up(5, drift=drift), law=("linear", "linear"), reference=0.0, lag="none"
        )
        for drift in (0.0, 0.003)
    )
    assert calm.noise.drift < 0.5e-3
    # A drift of 3 µm; how slow it is, five hours hardly tell.
    assert 0.001 < drifting.noise.drift
    assert drifting.independent < 0.2 * calm.independent


def test_a_lag_is_estimated_with_its_uncertainty(behind: TemperatureFit) -> None:
    (lag,) = behind.lags
    assert lag.applied
    low, high = lag.interval
    assert low < 900.0 < high
    # An interval that is wider than a factor of 1.5 would be of no use to anybody.
    assert high / low < 1.5
    np.testing.assert_allclose(behind.reference, -200.0, atol=10.0)


def test_no_lag_is_reported_where_there_is_none() -> None:
    (lag,) = fitted(warm_up(7)).lags
    # The grid starts at a reading's distance: less cannot be seen and does no harm.
    assert not lag.applied or lag.time_constant < 2 * MINUTE


def two_sensors(seed: int) -> JointData:
    """Spindle for the offset (sensor 1), scale for the coefficient (sensor 2)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 4 * 3600.0, MINUTE)
    spindle = 20.0 + 15.0 * np.abs(np.sin(time / 3000.0))
    scale = 20.0 + 6.0 * time / time[-1]
    position = TARGETS[rng.integers(0, len(TARGETS), len(time))]
    error = 2e-3 * (spindle - 20.0) + 1.0e-5 * (scale - 20.0) * (position - 500.0)
    error += NOISE * rng.normal(size=len(time))
    return readings(error, spindle, scale, position=position, time=time)


def test_one_sensor_moves_the_offset_and_another_the_coefficient() -> None:
    fit = fitted(two_sensors(1), offset="1", coefficient="2", lag="none")
    assert fit.coefficient is not None
    assert (fit.offset.sensor, fit.coefficient.sensor) == ("1", "2")
    # 240 readings of 0.5 µm over 15 K and ±500 mm: 0.05 % and 0.5 %; three times that.
    np.testing.assert_allclose(fit.offset.slope[0], 2e-3, rtol=0.002)
    np.testing.assert_allclose(fit.coefficient.slope[0], 1e-5, rtol=0.015)
    assert fit.meeting == "two sensors"


def test_the_order_in_which_sensors_are_named_does_not_matter() -> None:
    one, other = (
        Temperature("X", sensors, reference=500.0)
        for sensors in (
            {"offset": "1", "coefficient": "2"},
            {"coefficient": "2", "offset": "1"},
        )
    )
    assert one.sensor_names == other.sensor_names == ("1", "2")


def test_the_wrong_way_round_two_sensors_leave_more_unpredicted() -> None:
    right, wrong = (
        fitted(
            two_sensors(1),
            offset=first,
            coefficient=second,
            law=("linear", "linear"),
            lag="none",
        )
        for first, second in (("1", "2"), ("2", "1"))
    )
    assert np.std(wrong.predicted) > 5 * np.std(right.predicted)


def test_at_one_position_only_the_offset_is_fitted() -> None:
    data = two_sensors(2)
    single = data.take(data.position["X"] == 400.0)
    fit = fitted(dataclasses.replace(single, position={}), coefficient=None)
    assert fit.coefficient is None
    assert fit.offset.kind == "linear"
    # The scale's share at 400 mm moves against the spindle by 6 µm over the log.
    np.testing.assert_allclose(fit.offset.slope[0], 2e-3, rtol=0.1)


@pytest.mark.parametrize(
    ("bend", "kind"), [(0.0, "linear"), (4e-4, "piecewise linear")]
)
def test_readings_left_out_choose_the_law(bend: float, kind: str) -> None:
    rng = np.random.default_rng(3)
    temperature = 20.0 + 20.0 * np.abs(np.sin(np.arange(400) / 60.0))
    error = 1e-3 * temperature + bend * np.maximum(temperature - 30.0, 0.0) * 5
    error += NOISE * rng.normal(size=400)
    fit = fitted(readings(error, temperature), coefficient=None)
    assert fit.offset.kind == kind


def test_a_few_readings_at_three_temperatures_show_what_they_show() -> None:
    rng = np.random.default_rng(1)
    warm = np.repeat([20.0, 24.0, 30.0], 3) + 0.01 * rng.normal(size=9)
    place = np.tile(TARGETS[:3], 3)
    error = 1.1e-5 * (warm - 20.0) * (place + 200.0) + NOISE * rng.normal(size=9)
    fit = fitted(readings(error, warm, position=place, time=MINUTE * np.arange(9)))
    assert fit.coefficient is not None
    # 9 readings of 0.5 µm over 400 mm and 10 K: 0.1e-6 per K; four of them.
    assert fit.coefficient.slope[0] == pytest.approx(1.1e-5, abs=4e-7)


def test_a_temperature_without_effect_gives_a_constant() -> None:
    rng = np.random.default_rng(4)
    temperature = 20.0 + 10.0 * rng.random(300)
    error = 0.01 + NOISE * rng.normal(size=300)
    fit = fitted(readings(error, temperature), coefficient=None)
    assert fit.offset.kind == "constant"
    assert fit.offset.slope == (0.0, 0.0)


def test_errors_of_zero_follow_no_temperature() -> None:
    warm = 20.0 + 5.0 * np.sin(np.linspace(0.0, 9.0, 100)) ** 2
    place = np.tile(np.linspace(0.0, 400.0, 5), 20)
    fit = fitted(readings(np.zeros(100), warm, position=place), lag="none")
    assert fit.moving == ()
    np.testing.assert_array_equal(fit.values, 0.0)


def test_missed_readings_glitches_and_missed_steps_change_nothing() -> None:
    clean = warm_up(9)
    rng = np.random.default_rng(0)
    error, temperature = clean.error["X"].copy(), clean.temperature["1"].copy()
    error[rng.choice(len(error), 8, replace=False)] = np.nan
    steps = rng.choice(len(error), 8, replace=False)
    error[steps] += 4.3
    temperature[rng.choice(len(error), 8, replace=False)] = -180.0
    fit = fitted(
        dataclasses.replace(clean, error={"X": error}, temperature={"1": temperature}),
        law=("linear", "linear"),
        lag="none",
    )
    whole = fitted(clean, law=("linear", "linear"), lag="none")
    assert fit.coefficient is not None
    assert whole.coefficient is not None
    # 24 of 300 readings fewer: the value moves by a fraction of its deviation.
    assert abs(fit.reference - whole.reference) < 3 * (whole.reference_deviation or 0)
    complete = np.intersect1d(steps, fit.rows)
    assert set(fit.rows[fit.wild]) == set(complete)


def test_nothing_is_corrected_at_the_reference_temperature() -> None:
    fit = fitted(warm_up(1), law=("linear", "linear"), reference=0.0)
    place = np.array([0.0, 1000.0])
    there = fit.predict({"1": np.full(2, 20.0)}, place)
    np.testing.assert_allclose(there, 0.0, atol=1e-12)  # exact but for rounding


def test_shuffled_rows_give_the_same_fit() -> None:
    data = warm_up(4)
    order = np.random.default_rng(0).permutation(len(data))
    one, other = (
        fitted(each, law=("linear", "linear"), lag="none")
        for each in (data, data.take(order))
    )
    assert one.reference == pytest.approx(other.reference, rel=1e-9)
    back = np.argsort(order[other.rows])
    np.testing.assert_array_equal(order[other.rows][back], one.rows)
    np.testing.assert_allclose(one.predicted, other.predicted[back], atol=1e-12)


def test_a_single_given_lag_is_applied_and_not_fitted() -> None:
    fit = fitted(
        warm_up(6, lag=900.0), lag=900.0, law=("linear", "linear"), reference=0.0
    )
    (lag,) = fit.lags
    assert lag.time_constant == 900.0
    assert lag.interval == (900.0, 900.0)


def test_a_node_that_only_wild_readings_show_is_refused() -> None:
    rng = np.random.default_rng(0)
    temperature = 20.0 + 5.0 * np.abs(np.sin(np.arange(200) / 20.0))
    error = 1e-3 * temperature + NOISE * rng.normal(size=200)
    # Four readings far above all others, which contradict each other.
    temperature[100:104] = 30.0
    error[100:104] = [3.0, -3.0, 2.0, -2.0]
    with pytest.raises(FitError, match="readings do not determine"):
        fitted(
            readings(error, temperature),
            coefficient=None,
            law=(3, "constant"),
            lag="none",
        )
