"""Recordings as drives make them: steps of an encoder, times in whole ms, slow speeds held."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import FrictionResult, run_job

from ..friction_job import friction_job

INERTIA, LOAD, NOISE, STEP = 2e-3, 0.2, 0.05, 1e-3
"""A per mm/s²; A; A; mm of the encoder."""
Law = Callable[[np.ndarray], np.ndarray]


def coulomb(velocity: np.ndarray) -> np.ndarray:
    return np.sign(velocity)


def stribeck(slowest: float) -> Law:
    def law(velocity: np.ndarray) -> np.ndarray:
        speed = np.abs(velocity)
        drop = 0.6 * np.exp(-np.square(speed / slowest))
        return np.sign(velocity) * (1.0 + drop + 0.003 * speed)

    return law


def programme(rate: float, seconds: float, speeds: tuple[float, ...]) -> np.ndarray:
    """To and fro at speeds in mm/s that are held for about 1.5 s, a stop behind each."""
    legs, samples, number = list[np.ndarray](), 0, 0
    while samples < seconds * rate:
        speed = speeds[number % len(speeds)]
        number += 1
        way = min(100.0, 1.5 * speed)
        speed = min(speed, np.sqrt(1000.0 * way))
        ramp = np.linspace(0.0, speed, max(int(speed / 1000.0 * rate), 1), False)
        held = np.full(int((way / speed - speed / 1000.0) * rate), speed)
        leg = np.concatenate([ramp, held, ramp[::-1], np.zeros(int(0.3 * rate))])
        legs += [leg, -leg]
        samples += 2 * len(leg)
    smooth = np.ones(int(0.02 * rate)) / int(0.02 * rate)
    velocity = np.concatenate(legs)[: int(seconds * rate)]
    for _ in range(2):
        velocity = np.convolve(velocity, smooth, "same")
    return np.where(np.abs(velocity) < 1e-9, 0.0, velocity)


def found(
    folder: Path,
    law: Law,
    velocity: np.ndarray,
    rate: float,
    *,
    digits: int = 6,
    own: str = "",
) -> FrictionResult:
    """Fit a recording with times of so many digits."""
    rng = np.random.default_rng(1)
    place = (
        np.concatenate([[0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))]) / rate
    )
    push = INERTIA * np.gradient(velocity) * rate
    current = push + law(velocity) + LOAD + NOISE * rng.standard_normal(len(place))
    time = np.round(np.arange(len(place)) / rate, digits)
    rows = np.column_stack([time, np.round(place / STEP) * STEP, current])
    np.savetxt(folder / "trace.csv", rows, "%.6f", ",", header="t,x,i", comments="")
    keys = f"rated_current = 10.0\ntorque_unit = 0.001\nlevel = 1.0\n{own}"
    (folder / "job.toml").write_text(friction_job(keys))
    (fit,) = run_job(folder / "job.toml", folder / "out").fits
    assert isinstance(fit, FrictionResult)
    return fit


def off(fit: FrictionResult, law: Law, speeds: tuple[float, ...]) -> np.ndarray:
    """Return by which share the list is off at some speeds."""
    assert fit.view.curve is not None
    told = np.interp(
        speeds, fit.view.curve.speed, fit.view.curve.currents[:2].mean(axis=0)
    )
    return told / law(np.array(speeds)) - 1.0


@pytest.mark.usefixtures("no_drawing")
def test_speeds_that_are_held_for_long_get_the_friction_that_was_measured(
    tmp_path: Path,
) -> None:
    speeds = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
    fit = found(tmp_path, coulomb, programme(1000.0, 50.0, speeds), 1000.0)
    # 700 samples a speed of 5 % noise: knots that crowd there made 12 % of it.
    assert np.abs(off(fit, coulomb, speeds)).max() < 0.02


@pytest.mark.usefixtures("no_drawing")
def test_speeds_below_the_steps_of_the_encoder_are_used(tmp_path: Path) -> None:
    speeds = (0.05, 0.1, 0.2, 0.4, 1.0, 5.0, 50.0)
    law = stribeck(0.3)
    fit = found(tmp_path, law, programme(1000.0, 80.0, speeds), 1000.0)
    # At 0.05 mm/s the encoder steps 50 times a second; left out, it was 27 %.
    assert np.abs(off(fit, law, speeds)).max() < 0.02


@pytest.mark.usefixtures("no_drawing")
def test_times_in_whole_milliseconds_are_those_of_an_even_clock(tmp_path: Path) -> None:
    speeds = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
    law = stribeck(8.0)
    fit = found(tmp_path, law, programme(400.0, 60.0, speeds), 400.0, digits=3)
    said = " ".join(remark.message for remark in fit.remarks)
    assert "samples every 2.5 ms: taken as these" in said
    assert np.abs(off(fit, law, speeds)).max() < 0.02
    assert fit.view.found.fit.parameters["inertia"] == pytest.approx(INERTIA, rel=0.01)


@pytest.mark.usefixtures("no_drawing")
def test_an_inertia_is_not_taken_for_a_spring(tmp_path: Path) -> None:
    time = np.arange(0.0, 40.0, 1e-3)
    sine = 50.0 * np.pi * np.cos(np.pi * time)
    fit = found(tmp_path, stribeck(8.0), sine, 1000.0)
    said = " ".join(remark.message for remark in fit.remarks)
    assert "The load changes" not in said
    # Where it cannot be told it is said.
    assert "what a spring or a cable does is in the inertia" in said
    speeds = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
    fit = found(tmp_path, coulomb, programme(1000.0, 50.0, speeds), 1000.0)
    said = " ".join(remark.message for remark in fit.remarks)
    assert "The load changes" not in said
    assert "a single sine" not in said


@pytest.mark.usefixtures("no_drawing")
def test_a_stated_inertia_that_the_recording_contradicts_is_named(
    tmp_path: Path,
) -> None:
    velocity = programme(1000.0, 50.0, (2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0))
    words = "The recording shows an inertia of about 0.002 A per mm/s²"
    for stated, wrong in ((0.004, True), (0.002, False)):
        own = f"inertia = {stated}"
        fit = found(tmp_path, coulomb, velocity, 1000.0, own=own)
        said = " ".join(remark.message for remark in fit.remarks)
        assert (words in said) == wrong
        assert "The load changes" not in said
