"""Lags: how the structure begins, and that a small fit leads where the whole one goes."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident._recording import clocked, lagged
from axcomp.ident.core import Loss, Readings, sums_of
from axcomp.ident.fit.joint import (
    JointData,
    Leadscrew,
    Plane,
    Temperature,
    fit_joint,
)
from axcomp.ident.fit.joint._lag import find_lags, lag_variances, lagging

LAG = 90.0


def test_first_reading_of_a_noisy_sensor_does_not_last_for_a_lag() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 600.0, 0.02)
    true = 20.0 + 6.0 * (1.0 - np.exp(-np.maximum(time - 20.0, 0.0) / 200.0))
    inside = lagged(time, true, LAG)
    shown = true + 0.02 * rng.standard_normal(len(time))
    shown[0] = true[0] + 0.05
    found = clocked(time, shown).structure(LAG)
    # 150 readings of 0.02 K tell a line's end to 0.003 K.
    assert np.abs(found - inside).max() < 0.01
    assert np.abs(lagged(time, shown, LAG) - inside).max() > 0.04


def test_sensor_that_jumps_at_once_is_taken_at_its_word() -> None:
    time = np.arange(0.0, 600.0, 0.5)
    true = np.where(time < 1.0, 20.0, 26.0)
    found = clocked(time, true).structure(LAG)
    assert found == pytest.approx(lagged(time, true, LAG), abs=1e-12)


def test_rows_need_not_be_in_order_nor_all_there() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 600.0, 1.0)
    true = 20.0 + time / 100.0
    mixed = rng.permutation(len(time))
    shown = true[mixed].copy()
    shown[:40] = np.nan
    found = clocked(time[mixed], shown).structure(LAG)
    assert np.isnan(found[:40]).all()
    # A ramp between readings is the same ramp where some are missed.
    expected = lagged(time, true, LAG)[mixed]
    assert found[40:] == pytest.approx(expected[40:], abs=1e-6)


def test_a_law_of_many_nodes_takes_no_lag_where_there_is_none() -> None:
    rng = np.random.default_rng(1)
    time = 60.0 * np.arange(240.0)
    heat = 20.0 + 18.0 * np.sin(time / 4600.0)
    place = np.linspace(0.0, 1000.0, 6)[np.arange(240) % 6]
    error = 1.1e-5 * (heat - 20.0) * (place + 200.0) + rng.normal(0.0, 5e-4, 240)
    data = JointData({"X": place}, {"X": error}, temperature={"T": heat}, time=time)
    laws = {"offset": 5, "coefficient": 4}
    warm = Temperature("X", sensor="T", law=laws, lag="fit")
    fit = fit_joint(data, [warm, Leadscrew("X", np.array([0.0, 1000.0]))])
    # A lag as long as the log leaves a constant: 66 µm instead of the noise of 0.5.
    assert fit.noise["X"] < 6e-4
    assert fit.parts[0].lags["T"][0] < 60.0


def test_a_reading_without_a_time_does_not_hide_a_lag() -> None:
    rng = np.random.default_rng(3)
    time = 60.0 * np.arange(240.0)
    heat = 20.0 + 18.0 * np.sin(time / 4600.0)
    inside = lagged(time, heat, 900.0)
    place = np.linspace(0.0, 1000.0, 6)[np.arange(240) % 6]
    error = 1.1e-5 * (inside - 20.0) * (place + 200.0) + rng.normal(0.0, 5e-4, 240)
    clock = time.copy()
    clock[37] = np.nan
    data = JointData({"X": place}, {"X": error}, temperature={"T": heat}, time=clock)
    warm = Temperature("X", sensor="T", lag="fit")
    fit = fit_joint(data, [warm, Leadscrew("X", np.array([0.0, 1000.0]))])
    lag, deviation = fit.parts[0].lags["T"]
    # 3 standard deviations, one seeded draw; it was found as none.
    assert abs(lag - 900.0) < 3.0 * deviation < 60.0
    assert np.flatnonzero(np.isnan(fit.residual["X"])).tolist() == [37]


def test_a_few_readings_that_changed_sides_do_not_hide_a_lag() -> None:
    rng = np.random.default_rng(2)
    time = 10.0 * np.arange(2000.0)
    heat = 20.0 + 6.0 * np.sin(time / 900.0)
    place = rng.uniform(0.0, 1000.0, 2000)
    # A screw a thousand times the noise, whose few readings weigh more than the lag.
    error = 0.5 * np.sin(place / 90.0) + 1.1e-5 * place * lagged(time, heat - 20.0, LAG)
    error += rng.normal(0.0, 5e-4, 2000)
    data = JointData({"X": place}, {"X": error}, temperature={"T": heat}, time=time)
    nodes = np.linspace(0.0, 1000.0, 201)
    warm = Temperature("X", {"coefficient": "T"}, lag="fit")
    own = fit_joint(data, [Leadscrew("X", nodes), warm]).fits["X"]
    design, found = own.design, own.estimate
    old = np.arange(2000) % 400 > 0
    readings = Readings(error * old, {})
    design = lagging(design, {"T": 0.0})
    sums, _ = sums_of(
        design.stack,
        readings,
        found.centre,
        Loss(),
        design=design.columns.toarray() * old[:, None],
    )
    problem = dataclasses.replace(found.posterior.problem, sums=sums, gain=1.0)
    post = problem.at(found.posterior.weights)
    assert post is not None
    before = dataclasses.replace(found, posterior=post, loss=Loss())
    lag = find_lags(design, before, {"T": 0.0})["T"]
    assert lag.value == pytest.approx(LAG, abs=5.0 * lag.deviation)


def _warm(seed: int, count: int) -> tuple[JointData, list[Any]]:
    """Return a large plane, a screw and a spindle that grows late."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1500.0, count)
    x, y, z = (rng.uniform(0.0, most, count) for most in (800.0, 400.0, 200.0))
    near = 20.0 + 8.0 * (1.0 - np.cos(time / 150.0))
    error = 0.004 * np.sin(x / 120.0) * np.cos(y / 90.0) + 0.003 * np.sin(z / 60.0)
    error += 0.002 * (lagged(time, near, LAG) - 20.0)
    error += rng.normal(0.0, 5e-4, count)
    error[rng.random(count) < 0.005] += 0.02
    data = JointData(
        position={"X": x, "Y": y, "Z": z},
        error={"Z": error},
        temperature={"T": near},
        time=time,
    )
    nodes = (np.linspace(0.0, 800.0, 49), np.linspace(0.0, 400.0, 49))
    return data, [
        Plane("Z", ("X", "Y"), nodes),
        Leadscrew("Z", np.linspace(0.0, 200.0, 21)),
        Temperature("Z", {"offset": "T"}, lag="fit"),
    ]


def test_lag_that_is_not_there_is_none() -> None:
    data, stack = _warm(4, 4000)
    assert data.time is not None
    rng = np.random.default_rng(4)
    plain = 0.002 * (data.temperature["T"] - 20.0) + rng.normal(0.0, 5e-4, len(data))
    still = dataclasses.replace(data, error={"Z": plain})
    lag, deviation = fit_joint(still, stack[1:]).parts[1].lags["T"]
    assert lag == 0.0
    assert deviation == 0.0


def test_lag_that_rough_tables_do_all_of_has_a_deviation_beyond_any_lag() -> None:
    # Seen on the machine with everything: wild rows that are gone leave less than nothing.
    seen = np.array([[1e-3, 0.0], [0.0, 2e-3]])
    left = seen * np.array([-1e-5, 1.0])
    hidden, alone = np.sqrt(lag_variances(seen, left))
    assert hidden > 1e7
    assert alone == pytest.approx(500.0)


@pytest.mark.parametrize("each", [1, 10])
def test_lag_knows_of_the_noise_of_its_sensor(each: int) -> None:
    found, time = [], np.linspace(0.0, 1800.0, 500)
    heat = 21.0 + 3.0 * np.sin(time / 250.0) + time / 600.0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        place = rng.uniform(0.0, 1000.0, 500)
        error = 8e-6 * place * (lagged(time, heat, LAG) - 20.0)
        error += rng.normal(0.0, 2e-4, 500)
        read = heat[::each] + rng.normal(0.0, 0.2 / np.sqrt(each), len(heat[::each]))
        shown = {"T": np.interp(time, time[::each], read)}
        data = JointData({"X": place}, {"X": error}, temperature=shown, time=time)
        warm = Temperature("X", {"coefficient": "T"}, lag="fit")
        found.append(fit_joint(data, [warm], loss="gauss").parts[0].lags["T"])
    lags, deviations = np.transpose(found)
    scatter = np.sqrt(np.mean(np.square(lags - LAG)))
    # Eight scatter by a quarter; some deviations were half as large.
    assert deviations.min() > 0.75 * scatter
    assert np.median(deviations) < 1.5 * scatter


@pytest.mark.parametrize("lag", [300.0, 900.0, 2400.0])
@pytest.mark.parametrize("wild", [0, 10])
def test_what_follows_a_step_of_temperature_is_a_lag_and_not_wild(
    lag: float, wild: int
) -> None:
    rng = np.random.default_rng(2)
    time = 30.0 * np.arange(960.0)
    heat = np.where((time > 7200.0) & (time < 10800.0), 25.0, 20.0)
    heat = lagged(time, heat, 60.0)
    place = 200.0 - 200.0 * np.cos(2.0 * np.pi * time / 700.0)
    warm = lagged(time, heat, lag) - 20.0
    error = (1.1e-5 * place + 2e-3) * warm + rng.normal(0.0, 5e-4, 960)
    error[rng.choice(960, wild, replace=False)] += 0.5
    shown = heat + rng.normal(0.0, 0.01, 960)
    data = JointData({"X": place}, {"X": error}, temperature={"T": shown}, time=time)
    sensors = {"offset": "T", "coefficient": "T"}
    fit = fit_joint(data, [Temperature("X", sensors, lag="fit")])
    value, deviation = fit.parts[0].lags["T"]
    # A search that began without a lag came to 0 or 420 s, or to no end.
    assert fit.fits["X"].estimate.converged
    assert value == pytest.approx(lag, abs=4.0 * deviation)
    assert deviation < 0.02 * lag
    assert fit.wild["X"].sum() == wild
