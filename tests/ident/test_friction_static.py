"""Friction from constant speeds, and the choice between kinds of law."""

import numpy as np
import pytest

from axcomp.ident.fit import FitError
from axcomp.ident.fit.friction import (
    CoulombViscous,
    DriveSamples,
    KnotTable,
    Plateaus,
    Stribeck,
    average_plateaus,
    choose_law,
    default_knots,
    find_plateaus,
    fit_static,
)

SPEEDS = np.geomspace(1.0, 300.0, 12)
VELOCITY = np.concatenate([SPEEDS, -SPEEDS])


def friction(velocity: np.ndarray) -> np.ndarray:
    level = 2.0 + 1.5 * np.exp(-((velocity / 15.0) ** 2)) + 0.004 * np.abs(velocity)
    return np.asarray(np.sign(velocity) * level + 0.3)


def plateaus(seed: int, noise: float = 0.03) -> Plateaus:
    rng = np.random.default_rng(seed)
    spread = np.full(len(VELOCITY), noise)
    current = friction(VELOCITY) + spread * rng.normal(size=len(VELOCITY))
    return Plateaus(VELOCITY, current, spread, np.full(len(VELOCITY), 100))


def test_static_fit_finds_the_law_within_its_errors() -> None:
    truth = {
        "coulomb": 2.0,
        "breakaway": 3.5,
        "stribeck_velocity": 15.0,
        "viscous": 0.004,
        "offset": 0.3,
    }
    ratios = []
    for seed in range(40):
        fit = fit_static(plateaus(seed))
        ratios.append(
            [
                (fit.parameters[name] - value) / fit.standard_deviations[name]
                for name, value in truth.items()
            ]
        )
    # 200 numbers; 24 plateaus for 5 parameters make σ itself uncertain by 15 %.
    assert (np.abs(ratios) < 3).mean() > 0.97


def test_static_errors_never_fall_below_those_of_the_plateaus() -> None:
    exact = Plateaus(VELOCITY, friction(VELOCITY), np.full(24, 0.03), np.full(24, 100))
    fit = fit_static(exact)
    # 24 plateaus of 0.03 each: the mean cannot be known better than 0.03 / √24.
    assert fit.standard_deviations["offset"] > 0.99 * 0.03 / np.sqrt(24)


def test_plateaus_weigh_by_their_errors() -> None:
    found = plateaus(1)
    spread = np.where(np.abs(VELOCITY) > 250.0, 3.0, 0.03)
    off = found.current + np.where(np.abs(VELOCITY) > 250.0, 2.0, 0.0)
    fit = fit_static(Plateaus(VELOCITY, off, spread, found.count))
    assert abs(fit.parameters["offset"] - 0.3) < 4 * fit.standard_deviations["offset"]


def test_static_table_follows_the_plateaus() -> None:
    found = plateaus(2)
    fit = fit_static(found, KnotTable(False, default_knots(SPEEDS, 8)))
    value, _ = fit.band(SPEEDS)
    # Noise of two plateaus per speed, and the line between 8 knots over a bent curve.
    assert np.abs(value - (friction(SPEEDS) - 0.3)).max() < 0.15


def test_plateaus_are_found_and_averaged() -> None:
    rng = np.random.default_rng(0)
    pieces, speeds = [], (20.0, -50.0, 100.0)
    for speed in speeds:
        pieces += [np.linspace(0.0, speed, 20), np.full(200, speed)]
    velocity = np.concatenate(pieces)
    current = friction(velocity) + 0.1 * rng.normal(size=len(velocity))
    current[100] += 50.0
    time = 0.01 * np.arange(len(velocity))
    samples = DriveSamples(time, velocity, current)
    found = average_plateaus(samples, find_plateaus(samples))
    np.testing.assert_allclose(found.velocity, speeds, rtol=1e-3)
    off = np.abs(found.current - friction(found.velocity))
    assert (off < 4 * found.standard_deviation).all()
    # 200 independent samples of 0.1: σ of the mean is 0.0071, known to some 20 %.
    np.testing.assert_allclose(found.standard_deviation, 0.0071, rtol=0.5)


def test_recording_without_constant_speed_is_refused() -> None:
    velocity = np.linspace(-100.0, 100.0, 500)
    samples = DriveSamples(0.01 * np.arange(500), velocity, friction(velocity))
    with pytest.raises(FitError, match="no stretch of constant speed"):
        average_plateaus(samples, np.full(500, -1))


def test_simplest_law_that_predicts_is_chosen() -> None:
    rng = np.random.default_rng(0)
    time = 0.01 * np.arange(4000)
    velocity = 200.0 * np.sin(2 * np.pi * time / 3.1) * np.sin(0.3 * time)
    plain = np.sign(velocity) * (2.0 + 0.004 * np.abs(velocity)) + 0.3
    noise = 0.1 * rng.normal(size=4000)
    acceleration = np.gradient(velocity, 0.01)
    kinds = [
        CoulombViscous(),
        CoulombViscous(True),
        Stribeck(),
        KnotTable(False, default_knots(np.abs(velocity), 20)),
    ]
    samples = DriveSamples(time, velocity, plain + noise, acceleration)
    choice = choose_law(samples, kinds, decimate=1, windows=5)
    assert choice.chosen == 0
    assert "Coulomb + viscous" in choice.sentence
    bent = friction(velocity) + noise
    samples = DriveSamples(time, velocity, bent, acceleration)
    assert choose_law(samples, kinds, decimate=1, windows=5).chosen == 2


def test_too_short_a_recording_cannot_be_held_out() -> None:
    velocity = 100.0 * np.sin(np.linspace(0.0, 20.0, 100))
    samples = DriveSamples(0.01 * np.arange(100), velocity, friction(velocity))
    with pytest.raises(FitError, match="expected at least 3 windows"):
        choose_law(samples, decimate=1)
