"""Standard deviations of friction: how often the truth lies within two of them.

Drives of many laws and seeds go through `run_job`; the law over the driven speeds and the
written entries are judged, with the deviations that `result.json` states. Places of one curve
err together, so that a run by itself shows little: shares are over all runs of a case.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.ident.job import FrictionResult, run_job
from tests.ident.friction_job import friction_job

SEEDS = 6
SECONDS = 20.0
NOISE = 0.02  # A
SLOWEST, FASTEST = 1.0, 200.0  # mm/s that the drive is asked for
KEYS = "rated_current = 12.0\ntorque_unit = 0.001\nlevel = 1.0"
LAWS = ("0.5", "1", "2", "power", "coulomb", "asymmetric")


class Case(NamedTuple):
    """How a drive is recorded: samples per s, and a force that follows the place, in A."""

    rate: int
    ripple: float = 0.0


CASES = {
    "100 Hz": Case(100),
    "100 Hz with ripple": Case(100, 0.15),
    "1 kHz": Case(1000),
    "1 kHz with ripple": Case(1000, 0.15),
}


def truth_of(name: str, rng: np.random.Generator) -> Callable[[np.ndarray], np.ndarray]:
    """Return friction in A over velocities in mm/s."""
    coulomb, viscous = rng.uniform(1.5, 2.5), rng.uniform(0.001, 0.006)
    drop, place = rng.uniform(0.5, 1.5), np.exp(rng.uniform(np.log(5.0), np.log(30.0)))

    def law(velocity: np.ndarray) -> np.ndarray:
        speed, way = np.abs(velocity), np.sign(velocity)
        level = coulomb + viscous * speed
        if name == "power":
            level = coulomb + 0.08 * speed**0.5
        elif name == "asymmetric":
            level += drop * np.exp(-speed / place) + 0.3 * way + 0.001 * way * speed
        elif name != "coulomb":
            level += drop * np.exp(-((speed / place) ** float(name)))
        return np.asarray(way * level)

    return law


def motion(rate: int, rng: np.random.Generator) -> np.ndarray:
    """Plateaus of random speed, both ways, with ramps between them, in mm/s."""
    pieces, last = [np.zeros(rate // 4)], 0.0
    while sum(map(len, pieces)) < SECONDS * rate:
        speed = np.exp(rng.uniform(*np.log([SLOWEST, FASTEST])))
        for aim in (speed, -speed):
            ramp, even = rng.uniform(0.2, 0.5, 2) * rate
            bend = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, int(ramp)))
            pieces += [last + (aim - last) * bend, np.full(int(even), aim)]
            last = aim
    return np.concatenate(pieces)


def judged(folder: Path, case: Case, name: str, seed: int) -> dict[str, np.ndarray]:
    """Return (found − truth) / deviation of the law and of the entries of one job."""
    rng = np.random.default_rng([seed, LAWS.index(name), case.rate])
    truth, velocity = truth_of(name, rng), motion(case.rate, rng)
    time = np.arange(len(velocity)) / case.rate
    between = 0.5 * (velocity[1:] + velocity[:-1])
    place = np.append(0.0, np.cumsum(between)) / case.rate
    current = 0.002 * np.gradient(velocity, time) + truth(velocity) + 0.3
    current += case.ripple * np.sin(2 * np.pi * place / 10.0)
    # Noise alike per second, whatever the rate.
    current += NOISE * np.sqrt(case.rate / 100.0) * rng.normal(size=len(time))
    rows = np.column_stack([time, place, current])
    np.savetxt(
        folder / "trace.csv", rows, "%.7f", ",", comments="", header="t,x,i"
    )  # fmt: skip
    (folder / "job.toml").write_text(friction_job(KEYS))
    found = run_job(folder / "job.toml", folder / "out", sync=False).fits[0]
    assert isinstance(found, FrictionResult)
    curve, said = found.view.curve, found.details()
    assert curve is not None
    # Which part of a constant load is friction that differs by direction is a choice.
    shift = 0.0
    if found.view.found.fit.structure.directional:
        shift = 0.3 - found.view.found.fit.parameters["offset"]
    ahead, back = truth(curve.speed) + shift, truth(-curve.speed) + shift
    share = curve.positive_share
    right = share * ahead - (1.0 - share) * back
    deviations: dict[str, Any] = said["standard_deviations"]
    law = (curve.mean - right) / deviations["curve"]["current"]
    table = said["parameters"]["table"]
    at = table["velocity"]
    wanted = np.interp(at, curve.speed, right)
    entries = (table["current"] - wanted) / deviations["table"]["current"]
    driven = (at >= curve.speed[0]) & (at <= curve.speed[-1])
    return {"law": law, "entries": entries[driven]}


def test_truth_lies_within_two_deviations(
    benchmark: BenchmarkFixture, tmp_path: Path
) -> None:
    def every() -> dict[str, list[dict[str, np.ndarray]]]:
        return {
            name: [
                judged(tmp_path, case, law, seed)
                for law in LAWS
                for seed in range(SEEDS)
            ]
            for name, case in CASES.items()
        }

    found = benchmark.pedantic(every, rounds=1)
    for what in ("law", "entries"):
        ratios = {name: [each[what] for each in own] for name, own in found.items()}
        inside = {
            name: float(np.mean([np.mean(np.abs(each) <= 2.0) for each in own]))
            for name, own in ratios.items()
        }
        square = [np.mean(each**2) for own in ratios.values() for each in own]
        covered = float(np.mean(list(inside.values())))
        benchmark.extra_info |= {
            f"{what} inside two deviations": covered,
            f"{what} by case": inside,
            f"{what} rms ratio": float(np.sqrt(np.mean(square))),
        }
        assert 0.90 <= covered <= 0.99
