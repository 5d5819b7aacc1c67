"""Long logs: rounding is no freedom of the sum, and noise with a memory is no lag."""

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from axcomp.ident.fit.joint import (
    Backlash,
    Delay,
    JointData,
    Leadscrew,
    Temperature,
    fit_joint,
)
from axcomp.ident.fit.joint._design import design_of
from axcomp.ident.fit.joint._gauge import Rules, ideal_shapes

WIDTH, GROWTH = 0.005, 1.1e-5


def drifting_log(rows: int) -> JointData:
    """Return a long log of an axis that swings at several speeds while it warms up."""
    rng = np.random.default_rng(61)
    step = 244.0 / rows
    time = step * np.arange(rows)
    speed = np.repeat(rng.uniform(60.0, 200.0, 60), -(-rows // 60))[:rows]
    phase = np.cumsum(speed) * step / 800.0
    place = 800.0 * np.abs(2.0 * (phase / 2.0 - np.floor(phase / 2.0 + 0.5)))
    velocity = np.gradient(place, step)
    warmth = 20.0 + 2.0 * (1.0 - np.cos(2.0 * np.pi * time / 106.0))
    direction = np.sign(velocity)
    error = 0.006 * np.sin(place / 120.0) - 0.5 * WIDTH * (direction - 1.0)
    error += GROWTH * (warmth - 20.0) * place + 5e-4 * time / time[-1]
    error += 5e-4 * rng.standard_normal(rows)
    return JointData(
        position={"X": place},
        error={"X": error},
        direction={"X": direction},
        velocity={"X": velocity},
        temperature={"scale": warmth},
        time=time,
    )


EFFECTS = (
    Leadscrew("X", np.arange(0.0, 801.0, 25.0)),
    Backlash("X"),
    Temperature("X", {"coefficient": "scale"}, 0.0),
    Delay("X"),
)


def test_a_drift_beside_a_backlash_is_no_freedom() -> None:
    fit = fit_joint(drifting_log(24_000), EFFECTS, drift=6)
    width = fit.part("backlash of X")
    assert width.values[0] == pytest.approx(WIDTH, abs=5 * width.standard_deviation[0])
    assert width.standard_deviation[0] < 1e-4


@pytest.mark.parametrize(("size", "freedoms"), [(3e-7, 3), (1.0, 4)])
def test_what_rounding_adds_to_an_open_direction_is_none(
    size: float, freedoms: int
) -> None:
    data = drifting_log(4_000)
    design = design_of("X", [effect.placed(data) for effect in EFFECTS], data, 6)
    # Constants of leadscrew and drift against the datum, and the slope of both.
    rules = Rules.of(design, ideal_shapes(design))
    assert rules.null.shape[1] == 3
    open_ = rules.null.copy()
    place = design.places_of("backlash of X")
    open_[place, 0] += size * np.linalg.norm(open_[:, 0])
    vars(design)["unheld"] = open_
    assert rules.beside(design).null.shape[1] == freedoms


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.heavy) for k in (3, 4))]
)
def test_noise_with_a_memory_is_no_lag(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = drifting_log(5_000)
    air = lfilter([1.5e-3 * np.sqrt(0.1)], [1.0, -0.95], rng.standard_normal(5_000))
    sensor = data.temperature["scale"] + 0.02 * rng.standard_normal(5_000)
    data = dataclasses.replace(
        data, error={"X": data.error["X"] + air}, temperature={"scale": sensor}
    )
    growth = Temperature("X", {"coefficient": "scale"}, 0.0, lag="fit")
    fit = fit_joint(data, [*EFFECTS[:2], growth])
    assert fit.part(growth.name).lags == {"scale": (0.0, 0.0)}
