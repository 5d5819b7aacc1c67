"""A small machine that shows what a test asks for, as a recording of its motion."""

import dataclasses
import sys
from collections.abc import Callable, Mapping
from types import ModuleType

import numpy as np
import pytest

from axcomp.ident.discover import Observed

TRAVEL = 500.0


@pytest.fixture(scope="session")
def virtual() -> ModuleType:
    """Return this module: what machines of the tests are made of."""
    return sys.modules[__name__]


Effect = Callable[["Motion"], np.ndarray]


@dataclasses.dataclass(frozen=True)
class Motion:
    """Axes on their way, thinned; mm, s, °C."""

    time: np.ndarray
    position: Mapping[str, np.ndarray]
    velocity: Mapping[str, np.ndarray]
    acceleration: Mapping[str, np.ndarray]
    direction: Mapping[str, np.ndarray]
    temperature: Mapping[str, np.ndarray]


def stroll(
    rng: np.random.Generator, duration: float, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position, velocity and acceleration of moves between random places."""
    time = np.arange(0.0, duration, step)
    x, v, a = (np.empty_like(time) for _ in range(3))
    now, place = 0.0, TRAVEL * rng.random()
    start = 0
    while start < len(time):
        goal, feed = TRAVEL * rng.random(), rng.uniform(30.0, 400.0)
        hard = rng.uniform(500.0, 2000.0)
        way = goal - place
        feed = min(feed, np.sqrt(hard * abs(way)))
        rise = feed / hard
        whole = abs(way) / feed + rise
        end = int(np.searchsorted(time, now + whole + 0.1))
        t = time[start:end] - now
        up, late = np.clip(t, 0, rise), np.clip(t - (whole - rise), 0, rise)
        flat = np.clip(t - rise, 0, whole - 2 * rise)
        gone = 0.5 * hard * up**2 + feed * flat + feed * late - 0.5 * hard * late**2
        x[start:end] = place + np.sign(way) * gone
        v[start:end] = np.sign(way) * hard * (up - late) * (t < whole)
        a[start:end] = (
            np.sign(way)
            * hard
            * ((t < rise) * 1.0 - ((t > whole - rise) & (t < whole)) * 1.0)
        )
        now, place, start = now + whole + 0.1, goal, end
    return x, v, a


def held_sign(velocity: np.ndarray) -> np.ndarray:
    sign = np.sign(velocity)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    held = sign[last]
    return np.where(held == 0, 1.0, held)


def motion(
    seed: int, axes: str = "XYZ", duration: float = 1800.0, rows: int = 100_000
) -> Motion:
    rng = np.random.default_rng(seed)
    step = duration / rows
    fine = max(1, round(step / 0.004))
    moves = {name: stroll(rng, duration, step / fine) for name in axes}
    time = np.arange(0.0, duration, step / fine)
    keep = slice(None, None, fine)
    frame = 22.0 + 2.5 * np.sin(2 * np.pi * time / 1100.0 + rng.uniform(0, 6))
    spindle = 30.0 + 6.0 * (1 - np.exp(-time / 300.0)) * (time < 900.0)
    spindle += (time >= 900.0) * 6.0 * np.exp(-(time - 900.0) / 200.0)
    return Motion(
        time[keep],
        {name: m[0][keep] for name, m in moves.items()},
        {name: m[1][keep] for name, m in moves.items()},
        {name: m[2][keep] for name, m in moves.items()},
        {name: held_sign(m[1])[keep] for name, m in moves.items()},
        {"frame": frame[keep], "spindle": spindle[keep]},
    )


def nodes(seed: int, count: int, size: float) -> np.ndarray:
    """Return a smooth random table of the given rms, mm."""
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, count)
    waves = [
        rng.normal() / k * np.cos(np.pi * k * u + rng.uniform(0, 6))
        for k in range(1, 7)
    ]
    raw = np.sum(waves, axis=0) + rng.normal() * (u - 0.5)
    return size * (raw - raw.mean()) / raw.std()


def line(axis: str, seed: int, size: float, count: int = 26) -> Effect:
    table, at = nodes(seed, count, size), np.linspace(0.0, TRAVEL, count)
    return lambda m: np.interp(m.position[axis], at, table)


def reversal(axis: str, size: float) -> Effect:
    return lambda m: 0.5 * size * m.direction[axis]


def bilateral(axis: str, seed: int, size: float) -> Effect:
    table, at = nodes(seed, 26, size), np.linspace(0.0, TRAVEL, 26)
    return lambda m: (
        m.direction[axis] * (np.interp(m.position[axis], at, table) + 0.5 * size)
    )


def surface(first: str, second: str, seed: int, size: float, count: int = 13) -> Effect:
    from scipy.interpolate import RegularGridInterpolator

    rng = np.random.default_rng(seed)
    at = np.linspace(0.0, TRAVEL, count)
    u, v = np.meshgrid(at / TRAVEL, at / TRAVEL, indexing="ij")
    raw = np.zeros_like(u)
    for i in range(4):
        for j in range(4):
            wave = np.cos(np.pi * i * u + 1) * np.cos(np.pi * j * v + 2)
            raw += rng.normal() / (1 + i + j) * wave
    raw = size * (raw - raw.mean()) / raw.std()
    look_up = RegularGridInterpolator((at, at), raw)
    return lambda m: look_up(np.stack([m.position[first], m.position[second]], axis=1))


def heat(axis: str, offset: tuple[str, float], slope: tuple[str, float]) -> Effect:
    def error(m: Motion) -> np.ndarray:
        shift = offset[1] * (m.temperature[offset[0]] - 30.0)
        grow = slope[1] * (m.temperature[slope[0]] - 20.0) * (m.position[axis] - 100.0)
        return shift + grow

    return error


def crosstalk(master: str, size: float, place: str | None = None) -> Effect:
    def error(m: Motion) -> np.ndarray:
        a = np.clip(m.acceleration[master] / 1500.0, -1.0, 1.0)
        law = np.where(a > 0, 1.0, 0.7) * a * size
        if place is not None:
            law = law * (0.4 + 1.2 * m.position[place] / TRAVEL)
        return law

    return error


def observe(
    m: Motion,
    effects: Mapping[str, list[Effect]],
    seed: int,
    noise: float = 5e-4,
    drift: float = 1.5e-3,
    wild: float = 0.005,
) -> Observed:
    rng = np.random.default_rng(seed + 1000)
    error = {}
    for axis, parts in effects.items():
        total = np.sum([part(m) for part in parts], axis=0) if parts else 0.0
        total = total + noise * rng.normal(size=len(m.time))
        share = m.time / m.time[-1]
        total = total + drift * (rng.normal() * share + rng.normal() * share**2)
        odd = rng.random(len(m.time)) < wild
        total = total + odd * rng.uniform(-0.05, 0.05, len(m.time))
        error[axis] = total
    zeros = np.zeros(len(m.time), dtype=np.int64)
    return Observed(
        time=m.time,
        run=zeros,
        source=zeros,
        position=m.position,
        error=error,
        direction=m.direction,
        velocity=m.velocity,
        acceleration=m.acceleration,
        temperature=m.temperature,
    )
