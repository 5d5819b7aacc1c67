"""Processor time of a friction job's two searches: the law, and the knots of its list."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.ident.friction import DriveSamples, Knots, choose_law, place_knots

ROUNDS = 5
CURVES, KNOTS_TIME = 40, 40e-3  # s of CPU with annotations checked
CHOICE_TIME = 0.25  # s of CPU with annotations checked; 25 ms without


def best_of(run: Callable[[], object]) -> float:
    """Return the least processor time of several runs: cores are shared with other work."""
    times = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        run()
        times.append(time.thread_time() - begin)
    return min(times)


@pytest.mark.parametrize("rate", [100, 1000])
def test_choice_of_a_law(benchmark: BenchmarkFixture, rate: int) -> None:
    seconds = np.arange(0.0, 20.0, 1.0 / rate)
    velocity = 200.0 * np.sin(2 * np.pi * seconds / 3.1) * np.sin(0.3 * seconds + 0.2)
    level = 2.0 + 1.5 * np.exp(-np.abs(velocity) / 15.0) + 0.004 * np.abs(velocity)
    noise = 0.1 * np.random.default_rng(0).normal(size=len(seconds))
    current = np.sign(velocity) * level + noise

    def choose() -> object:
        acceleration = np.gradient(velocity, 1.0 / rate)
        return choose_law(DriveSamples(seconds, velocity, current, acceleration))

    least = best_of(choose)
    benchmark.extra_info |= {"cpu_s_per_choice": least}
    assert least <= CHOICE_TIME
    benchmark(choose)


def test_knots_of_a_list(benchmark: BenchmarkFixture) -> None:
    speed = np.unique(
        np.concatenate([np.geomspace(0.1, 300.0, 200), np.linspace(0.1, 300.0, 200)])
    )
    rng = np.random.default_rng(5)
    places = np.exp(rng.uniform(np.log(1.0), np.log(60.0), CURVES))
    curves = [
        1.0 + rng.uniform(0.2, 1.5) * np.exp(-((speed / place) ** rng.uniform(0.7, 2.0)))
        + rng.uniform(0.1, 1.0) * speed / 300.0
        for place in places
    ]  # fmt: skip
    even = np.ones_like(speed)

    def place_all() -> list[Knots]:
        return [place_knots(speed, curve, even, unit=0.01) for curve in curves]

    found, each = place_all(), best_of(place_all) / CURVES
    rms = [knots.rms / knots.unit for knots in found]
    benchmark.extra_info |= {
        "cpu_s_per_list": each,
        "rms_in_units": float(np.mean(rms)),
        "worst_rms_in_units": max(rms),
    }
    # Rounding alone would cost 0.24 units, sqrt(2/3)/sqrt(12).
    assert max(rms) <= 0.24
    assert each <= KNOTS_TIME
    benchmark(place_all)
