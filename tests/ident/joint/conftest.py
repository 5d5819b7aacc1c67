"""Synthetic readings with several effects at once, for the tests of the joint fit."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from axcomp.ident._recording import lagged
from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    Crosstalk,
    JointData,
    Leadscrew,
    Plane,
    Temperature,
)

NOISE = 5e-4
"""Standard deviation of one reading in mm."""
LAG = 120.0
"""Time constant of the structure behind its sensor in s."""

X = np.linspace(0.0, 1000.0, 21)
Y = np.linspace(0.0, 500.0, 11)


@dataclasses.dataclass(frozen=True)
class Mixed:
    """Readings of X and what went into them, effect by effect (mm)."""

    data: JointData
    parts: dict[str, np.ndarray]

    @property
    def total(self) -> np.ndarray:
        """Error without noise in mm."""
        return np.sum(list(self.parts.values()), axis=0)


def _effects(lag: float | str = LAG) -> list[AbstractEffect]:
    """Return one effect of each kind on X that no other can stand for entirely."""
    return [
        Leadscrew("X", X),
        Cross("X", master="Z", setpoints=np.linspace(0.0, 300.0, 13)),
        Plane("X", ("X", "Y"), (X[::2], Y)),
        Backlash("X"),
        Temperature("X", {"offset": "T", "coefficient": "T"}, 200.0, lag=lag),
        Crosstalk("X", "Y", 1500.0, -1500.0),
    ]


def _mixed(seed: int, count: int = 4000, outliers: float = 0.01) -> Mixed:
    """Return half an hour of readings in which everything varies by itself."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 1800.0, count)
    x, y, z = (rng.uniform(0.0, high, count) for high in (1000.0, 500.0, 300.0))
    way = rng.choice([-1.0, 1.0], count)
    speed = rng.choice([-1.0, 1.0], count) * rng.uniform(10.0, 300.0, count)
    pull = rng.uniform(-1800.0, 1800.0, count) * (rng.random(count) < 0.4)
    sensor = 21.0 + 3.0 * np.sin(time / 250.0) + time / 600.0
    warm = lagged(time, sensor, LAG) - 20.0
    share = np.clip(pull / 1500.0, -1.0, 1.0)
    parts = {
        "leadscrew": 0.004 * np.interp(x, X, np.sin(X / 160.0)),
        "cross": 0.003 * np.cos(z / 60.0),
        "plane": 0.003 * np.sin(x / 200.0) * np.cos(y / 90.0),
        "backlash": -0.5 * 0.006 * (way - 1.0),
        "temperature": (1e-3 + 8e-6 * (x - 200.0)) * warm,
        "crosstalk": np.where(share > 0, 0.002 * share, 0.0012 * share),
    }
    error = np.sum(list(parts.values()), axis=0) + rng.normal(0.0, NOISE, count)
    wild = rng.random(count) < outliers
    error[wild] += rng.choice([-1.0, 1.0], int(wild.sum())) * 0.05
    data = JointData(
        position={"X": x, "Y": y, "Z": z},
        error={"X": error},
        direction={"X": way},
        velocity={"Y": speed},
        acceleration={"Y": pull},
        temperature={"T": sensor},
        time=time,
    )
    return Mixed(data, parts)


@pytest.fixture(scope="session")
def effects() -> Callable[..., list[AbstractEffect]]:
    """Return what makes the effects of the mix, with any lag."""
    return _effects


@pytest.fixture(scope="session")
def mixed() -> Callable[..., Mixed]:
    """Return what makes the mix from a seed."""
    return _mixed
