"""Errors over the volume of a machine: accuracy at unseen points beside the time of the fit."""

from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import axcomp
from axcomp.models import GeometricErrors

NOISE = 1e-3  # mm
START, INTERVAL, POINTS = (0.0, 0.0, 0.0), (100.0, 80.0, 60.0), (9, 8, 7)
EFFECTS: dict[str, Any] = {
    "21 errors": axcomp.Geometry(START, INTERVAL, POINTS),
    "grid": axcomp.Volumetric(START, (160.0, 140.0, 90.0), (6, 5, 5)),
}


def truth(seed: int) -> GeometricErrors:
    """Functions of some 10 µm and 10 µrad: offset, slope and a curve each."""
    rng, machine = np.random.default_rng(seed), EFFECTS["21 errors"]
    errors: dict[str, Any] = dict(
        zip(("EA0Z", "EB0Z", "EC0Y"), 2e-5 * rng.normal(size=3), strict=True)
    )
    for axis, count in zip("XYZ", POINTS, strict=True):
        along = np.linspace(0.0, 1.0, count)
        for direction in "XYZABC":
            offset, slope, curve, phase = rng.normal(size=4)
            size = 1e-2 if direction in "XYZ" else 1e-5
            shape = offset + slope * along + curve * np.sin(3 * along + phase)
            errors[f"E{direction}{axis}"] = size * shape
    return GeometricErrors.of(machine.nodes, errors)


@pytest.mark.parametrize("name", EFFECTS)
def test_500_points_with_1_um_noise(benchmark: BenchmarkFixture, name: str) -> None:
    machine, rng = truth(0), np.random.default_rng(1)
    low, high = EFFECTS["21 errors"].volume
    position, unseen = (rng.uniform(low, high, (count, 3)) for count in (500, 2000))
    error = np.asarray(machine.error(position)) + NOISE * rng.normal(size=(500, 3))
    points = axcomp.Points(position, error)
    fit = benchmark(lambda: axcomp.fit_volumetric(EFFECTS[name], points))
    left = fit.predict(unseen).error - np.asarray(machine.error(unseen))
    rms = float(np.sqrt(np.mean(left**2)))
    benchmark.extra_info |= {"rms_unseen_um": 1e3 * rms, "noise_um": 1e3 * fit.noise}
    assert rms <= 1.5 * NOISE
