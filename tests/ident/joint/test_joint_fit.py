"""All effects of an axis fitted together."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident._recording import lagged
from axcomp.ident.fit import FitError
from axcomp.ident.fit.joint import (
    Backlash,
    Cross,
    JointData,
    JointFit,
    Leadscrew,
    Plane,
    Temperature,
    fit_joint,
    held_out_errors,
)

NOISE = 5e-4  # of the mix, in mm
LAG = 120.0  # of the mix, in s


@pytest.fixture(scope="module")
def case(mixed: Any) -> Any:
    return mixed(1)


@pytest.fixture(scope="module")
def fit(case: Any, effects: Any) -> JointFit:
    return fit_joint(case.data, effects())


def test_every_effect_of_a_mix_is_recovered(case: Any, fit: JointFit) -> None:
    for part in fit.parts:
        truth = case.parts[part.effect.compensation]
        left = part.contribution - truth
        # Constants, the slope of the leadscrew and curves of the plane may be moved: the sum
        # is compared below, here what is left of each after its own constant and line.
        columns = [np.ones(len(left)), case.data.position["X"]]
        if part.effect.compensation in ("leadscrew", "plane"):
            continue
        left = (
            left
            - np.column_stack(columns)
            @ np.linalg.lstsq(np.column_stack(columns), left, rcond=None)[0]
        )
        # 4000 readings, at most 30 values each: noise·√(30/4000) = 0.09, and as much bias.
        assert np.std(left) < 0.2 * NOISE, part.name


def test_the_sum_is_that_of_the_machine(case: Any, fit: JointFit) -> None:
    predicted = fit.predict(case.data)["X"]
    # About 100 effective parameters in 4000 readings: noise·√(100/4000) = 0.16, and the
    # bending between nodes (50 mm: 0.004·(50/160)²/8 = 0.05 µm).
    assert np.std(predicted - case.total) < 0.25 * NOISE
    assert abs(np.mean(predicted - case.total)) < 0.05 * NOISE


def test_noise_is_that_of_one_reading(fit: JointFit) -> None:
    # 4000 readings: relative standard deviation 1/√8000 = 1.1 %.
    assert fit.noise["X"] == pytest.approx(NOISE, rel=0.05)


def test_wild_readings_are_found_and_change_nothing(
    case: Any, effects: Any, fit: JointFit
) -> None:
    far = np.abs(case.data.error["X"] - case.total) > 0.03
    assert np.array_equal(fit.wild["X"], far)
    clean = fit_joint(case.data.take(~far), effects())
    for one, other in zip(fit.parts, clean.parts, strict=True):
        # Rejected readings have no weight at all; smoothness is chosen on the same readings.
        assert np.allclose(
            one.values, other.values, atol=0.3 * one.standard_deviation.max()
        )


def test_a_wrong_start_of_the_lag_is_left(case: Any, effects: Any) -> None:
    found = fit_joint(case.data, effects("fit"))
    lag, deviation = found.part("temperature of X (T)").lags["T"]
    assert abs(lag - LAG) < 4.0 * deviation
    # The phase of 3 K over 250 s is read to a few milliradians.
    assert deviation < 3.0
    wrong = fit_joint(case.data, effects(0.0))
    assert found.noise["X"] < 0.8 * wrong.noise["X"]


def test_no_lag_is_reported_as_none(case: Any) -> None:
    rng = np.random.default_rng(3)
    warm = case.data.temperature["T"]
    error = 1e-3 * (warm - 20.0) + rng.normal(0.0, NOISE, len(warm))
    data = dataclasses.replace(case.data, error={"X": error})
    effect = Temperature("X", {"offset": "T"}, lag="fit")
    lag, _ = fit_joint(data, [effect]).parts[0].lags["T"]
    # Below the distance of the readings (0.45 s) no lag can be told from none.
    assert lag < 10.0


def test_two_sensors_have_a_lag_each(case: Any) -> None:
    rng = np.random.default_rng(4)
    time, x = case.data.time, case.data.position["X"]
    assert time is not None
    spindle = 22.0 + 4.0 * np.sin(time / 150.0)
    scale = case.data.temperature["T"]
    error = 2e-3 * (lagged(time, spindle, 40.0) - 20.0)
    error = error + 1e-5 * (lagged(time, scale, 200.0) - 20.0) * x
    error = error + rng.normal(0.0, NOISE, len(x))
    data = dataclasses.replace(
        case.data, error={"X": error}, temperature={"spindle": spindle, "scale": scale}
    )
    effect = Temperature("X", {"offset": "spindle", "coefficient": "scale"}, lag="fit")
    lags = fit_joint(data, [effect, Leadscrew("X", np.linspace(0, 1000, 5))])
    for sensor, truth in (("spindle", 40.0), ("scale", 200.0)):
        value, deviation = lags.parts[0].lags[sensor]
        assert abs(value - truth) < 4.0 * deviation
        assert deviation < 0.1 * truth


def test_axes_are_fitted_as_if_alone(case: Any, effects: Any) -> None:
    rng = np.random.default_rng(5)
    y = case.data.position["Y"]
    error = dict(case.data.error)
    error["Y"] = 0.01 * np.sin(y / 90.0) + rng.normal(0.0, NOISE, len(y))
    # Every third row has no reading of Y.
    error["Y"][::3] = np.nan
    data = dataclasses.replace(case.data, error=error)
    own = Leadscrew("Y", np.linspace(0.0, 500.0, 26))
    both = fit_joint(data, [*effects(), own])
    alone = fit_joint(data, [own])
    assert np.array_equal(both.parts[-1].values, alone.parts[0].values)
    assert np.isnan(both.residual["Y"][::3]).all()
    assert tuple(both.fits) == ("X", "Y")


def test_runs_and_their_drift_are_taken_off(case: Any) -> None:
    rng = np.random.default_rng(6)
    count = len(case.data)
    run = np.repeat(np.arange(4), count // 4)
    time = case.data.time
    assert time is not None
    place = np.tile(np.linspace(0.0, 1.0, count // 4), 4)
    offset, drift = np.array([0.0, 0.02, -0.01, 0.03]), np.array([0.0, 0.01, -0.004, 0])
    x = case.data.position["X"]
    truth = 0.01 * np.sin(x / 160.0)
    error = truth + offset[run] + drift[run] * place + rng.normal(0.0, NOISE, count)
    data = JointData(position={"X": x}, error={"X": error}, time=time, run=run)
    fit = fit_joint(data, [Leadscrew("X", np.linspace(0, 1000, 41))], drift=1)
    found = fit.runs["X"]
    for k, effect in enumerate(found):
        mean = offset + 0.5 * drift
        assert abs(effect.offset - (mean[k] - mean.mean())) < 4.0 * effect.offset_sd
        assert abs(effect.drift - drift[k]) < 4.0 * effect.drift_sd
        # 1000 readings per run: noise/√1000 and √12 times that.
        assert effect.offset_sd < 2.0 * NOISE / np.sqrt(1000.0)
    assert np.std(fit.parts[0].contribution - truth) < 0.2 * NOISE


def test_rows_left_out_serve_as_history_and_are_predicted(
    case: Any, effects: Any
) -> None:
    use = np.ones(len(case.data), bool)
    use[1000:2000] = False
    fit = fit_joint(case.data, effects(), use=use)
    assert np.isnan(fit.residual["X"][1000:2000]).all()
    left = (fit.predict(case.data)["X"] - case.total)[1000:2000]
    assert np.sqrt(np.mean(left**2)) < 0.4 * NOISE


def test_held_out_readings_scatter_by_their_noise(case: Any, fit: JointFit) -> None:
    left = held_out_errors(fit, np.arange(len(case.data)) % 5)["X"]
    inner = np.abs(left) < 0.01
    # Held out: noise and the uncertainty of the fit, sqrt(1 + 100/3200).
    assert np.std(left[inner]) == pytest.approx(NOISE, rel=0.08)


def test_a_missing_input_is_named(case: Any) -> None:
    with pytest.raises(FitError, match="cross of X over W: needs the position of W"):
        fit_joint(case.data, [Cross("X", master="W", setpoints=np.linspace(0, 1, 3))])


def test_the_same_effect_twice_is_refused(case: Any) -> None:
    with pytest.raises(FitError, match="found the backlash of X twice"):
        fit_joint(case.data, [Backlash("X"), Backlash("X")])


def test_rows_without_any_complete_reading_are_refused(case: Any) -> None:
    error = {"X": np.full(len(case.data), np.nan)}
    data = dataclasses.replace(case.data, error=error)
    with pytest.raises(FitError, match="axis X: no reading has all that"):
        fit_joint(data, [Backlash("X")])


def test_a_plane_beside_a_table_of_many_nodes_is_fitted() -> None:
    rng = np.random.default_rng(21)
    x, y, z = (rng.uniform(0.0, high, 4000) for high in (1000.0, 500.0, 300.0))
    true = 0.004 * np.sin(x / 200.0) * np.cos(y / 90.0) + 0.003 * np.sin(z / 60.0)
    data = JointData(
        position={"X": x, "Y": y, "Z": z},
        error={"Z": true + rng.normal(0.0, 5e-4, 4000)},
    )
    # More nodes beside the plane than a thinner plane could make up for.
    nodes = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 500.0, 21)
    stack = [
        Plane("Z", ("X", "Y"), nodes),
        Leadscrew("Z", np.linspace(0.0, 300.0, 301)),
    ]
    fit = fit_joint(data, stack)
    # Smooth truths of which the tables leave next to nothing.
    assert np.std(fit.predict(data)["Z"] - true) < 0.4 * 5e-4
