"""Speed of the position controller: six axes with all compensations, a million cycles.

Two cores shared with other work: each time is the best of several, the contenders take
turns, and beside the time on the clock stands that of the processors, by which they are
compared. The NumPy version does the same, vectorised over the cycles, axis by axis.
"""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.models import (
    AxisCompensations,
    Backlash,
    Coupled,
    Cross,
    Crosstalk,
    EquidistantNodes,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    Motion,
    Plane,
    PositionController,
    Setpoints,
    TemperatureCurve,
    TemperatureLine,
    grid_through,
)

AXES, CYCLES, STEP = 6, 1_000_000, 1e-3
FILTER, REVERSAL = 20, 10
START, INTERVAL = -300.0, 10.0
NODES = 61
KNOTS = np.r_[0.0, np.geomspace(0.01, 500.0, 14)]
POINTS = np.linspace(-300.0, 300.0, NODES) + 0.3 * np.sin(np.arange(NODES))
TESTS = np.array([[x, y] for x in (-200.0, 0.0, 200.0) for y in (-100.0, 0.0, 100.0)])
WARM = np.array([10.0, 20.0, 30.0])


def build() -> PositionController:
    surface = grid_through(TESTS)
    assert surface is not None
    rng = np.random.default_rng(0)
    axes = []
    for number in range(AXES):
        one, two = (number + 1) % AXES, (number + 2) % AXES
        plane = 0.01 * rng.normal(size=(NODES, NODES))
        axes.append(
            AxisCompensations(
                backlash=Backlash(0.005, 1, REVERSAL),
                temperature=TemperatureLine(
                    0.0,
                    TemperatureCurve.of(WARM, 0.01 * rng.normal(size=3)),
                    TemperatureCurve.of(WARM, 1e-6 * rng.normal(size=3), 1),
                ),
                cross=Coupled(
                    Cross(Setpoints(POINTS), 0.01 * rng.normal(size=NODES)), (one,)
                ),
                plane=Coupled(
                    Plane.quadratic((START, START), INTERVAL, plane), (one, two)
                ),
                crosstalk=Coupled(
                    Crosstalk(
                        surface,
                        0.01 * rng.normal(size=(4, 9)),
                        1000.0,
                        -900.0,
                        cycles=FILTER,
                    ),
                    (one, one, two),
                ),
                leadscrew=Leadscrew(
                    EquidistantNodes(START, INTERVAL, NODES),
                    0.01 * rng.normal(size=NODES),
                    0.01 * rng.normal(size=NODES),
                ),
                friction=FrictionCompensation(
                    FrictionTable(Setpoints(KNOTS), rng.uniform(10, 20, KNOTS.size)),
                    4,
                    0.03,
                    9,
                ),
            )
        )
    return PositionController(tuple(axes))


def move(cycles: int) -> Motion:
    clock = np.arange(cycles) * STEP
    place = np.stack(
        [
            # Every axis reverses, and stands at one end of its way.
            np.clip(280 * np.sin(0.3 * (a + 1) * clock + a), -250.0, 265.0 - 10 * a)
            for a in range(AXES)
        ],
        axis=1,
    )
    speed = np.diff(place, axis=0, prepend=place[:1]) / STEP
    change = np.diff(speed, axis=0, prepend=speed[:1]) / STEP
    heat = np.stack([20 + 5 * np.sin(clock / 100), 22 + 5 * np.cos(clock / 70)], axis=1)
    return Motion(place, speed, change, heat)


# ------------------------------------------------------------------------ NumPy version


def spread(values: np.ndarray, cycles: int) -> np.ndarray:
    shares = np.sin(0.5 * np.pi * np.arange(cycles + 1) / cycles) ** 2
    before = np.full(cycles - 1, values[0])
    return np.convolve(np.r_[before, values], np.diff(shares), mode="valid")


def last_way(steps: np.ndarray, start: float) -> np.ndarray:
    number = np.maximum.accumulate(
        np.where(steps != 0, np.arange(1, steps.size + 1), 0)
    )
    return np.where(number > 0, np.sign(steps)[number - 1], start)


def bilinear(
    table: np.ndarray, row: np.ndarray, column: np.ndarray, *branch: np.ndarray
) -> np.ndarray:
    j = np.minimum(row.astype(int), table.shape[-2] - 2)
    i = np.minimum(column.astype(int), table.shape[-1] - 2)
    v, u = row - j, column - i
    return (1 - v) * ((1 - u) * table[*branch, j, i] + u * table[*branch, j, i + 1]) + (
        v * ((1 - u) * table[*branch, j + 1, i] + u * table[*branch, j + 1, i + 1])
    )


def rub(law: FrictionCompensation, place: np.ndarray, speed: np.ndarray) -> np.ndarray:
    cycles = law.reversal_lookahead
    way = last_way(speed, 0.0)
    turns = (way != np.r_[0.0, way[:-1]]) & (speed != 0)
    number = np.maximum.accumulate(np.where(turns, np.arange(1, turns.size + 1), 0))
    origin = np.r_[place[0], place][np.maximum(number - 1, 0)]
    weight = np.minimum(np.abs(place - origin) / float(law.position_delay), 1.0)
    weight = np.where(number > 0, weight, 1.0)
    falls = np.ones(place.size)
    reverses = turns & (np.r_[0.0, way[:-1]] != 0.0)
    for away in range(cycles, 0, -1):
        ahead = np.r_[reverses[away:], np.zeros(away, dtype=bool)]
        falls[ahead] = (away - 1) / cycles
    table = law.law
    assert isinstance(table, FrictionTable)
    level = np.interp(np.abs(speed), table.nodes.points, table.values)
    found = weight * falls * np.sign(speed) * level
    return np.r_[np.zeros(law.delay_cycles), found][: place.size]


def plain(machine: PositionController, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    place, speed, change, heat = (
        np.asarray(part)
        for part in (
            motion.position,
            motion.velocity,
            motion.acceleration,
            motion.temperature,
        )
    )
    offsets, currents = np.empty_like(place), np.empty_like(place)
    axes: Any = machine.axes
    for number, axis in enumerate(axes):
        s = place[:, number]
        way = spread(last_way(np.diff(s, prepend=s[0]), 1.0), REVERSAL)
        total = float(axis.backlash.width) * 0.5 * (way - 1.0)
        line = axis.temperature
        total += np.interp(heat[:, 0], WARM, line.offset_0.values)
        total += np.interp(heat[:, 1], WARM, line.coefficient.values) * s
        one, two = axis.plane.masters
        total += np.interp(place[:, one], POINTS, axis.cross.law.values)
        row, column = ((place[:, m] - START) / INTERVAL for m in (two, one))
        total += bilinear(np.asarray(axis.plane.law.values), row, column)
        shake = axis.crosstalk.law
        a, v = change[:, one], speed[:, one]
        slows = a < 0
        share = np.minimum(
            a / np.where(slows, float(shake.deceleration), float(shake.acceleration)), 1
        )
        row = np.clip(place[:, one] / 200 + 1, 0, 2)
        column = np.clip(place[:, two] / 100 + 1, 0, 2)
        branch = 2 * slows + (v < 0)
        table = np.asarray(shake.values).reshape(4, 3, 3)
        total += spread(share * bilinear(table, row, column, branch), FILTER)
        back = 0.5 * (1.0 - way)
        grid = START + INTERVAL * np.arange(NODES)
        total -= (1 - back) * np.interp(s + total, grid, axis.leadscrew.pos) + (
            back * np.interp(s + total, grid, axis.leadscrew.neg)
        )
        offsets[:, number] = total
        currents[:, number] = rub(axis.friction, s, speed[:, number])
    return offsets, currents


# --------------------------------------------------------------------------- contenders


@jax.jit
def sums(machine: PositionController, motion: Motion) -> tuple[jax.Array, jax.Array]:
    found = machine.run(machine.start(), motion)[0]
    assert found.friction is not None
    return found.offset, found.friction


@jax.jit
def everything(machine: PositionController, motion: Motion) -> Any:
    return machine.run(machine.start(), motion)


def tables(machine: PositionController) -> list[Any]:
    axes: Any = machine.axes
    return [
        table
        for axis in axes
        for table in (
            axis.backlash.width,
            axis.temperature.offset_0.values,
            axis.temperature.coefficient.values,
            axis.cross.law.values,
            axis.plane.law.values,
            axis.crosstalk.law.values,
            axis.leadscrew.pos,
            axis.leadscrew.neg,
            axis.friction.law.values,
        )
    ]


def squares(
    machine: PositionController, motion: Motion, target: tuple[jax.Array, jax.Array]
) -> jax.Array:
    offset, current = sums(machine, motion)
    return jnp.sum((offset - target[0]) ** 2) + jnp.sum((current - target[1]) ** 2)


@jax.jit
def value_and_gradient(
    machine: PositionController, motion: Motion, target: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, list[jax.Array]]:
    def by_tables(entries: list[jax.Array]) -> jax.Array:
        return squares(eqx.tree_at(tables, machine, entries), motion, target)

    return jax.value_and_grad(by_tables)(tables(machine))


@jax.jit
def by_everything(
    machine: PositionController, motion: Motion, target: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, PositionController]:
    return jax.value_and_grad(squares)(machine, motion, target)


def spent(run: Callable[[], Any]) -> np.ndarray:
    """Return the time that a run takes, and that of the processors, in s."""
    began = np.array([time.perf_counter(), time.process_time()])
    jax.block_until_ready(run())
    return np.array([time.perf_counter(), time.process_time()]) - began


def test_a_million_cycles_of_six_axes(benchmark: BenchmarkFixture) -> None:
    machine, motion = build(), move(CYCLES)
    target = (jnp.zeros((CYCLES, AXES)), jnp.zeros((CYCLES, AXES)))
    runs: dict[str, Callable[[], Any]] = {
        "sums": lambda: sums(machine, motion),
        "everything": lambda: everything(machine, motion),
        "value_and_gradient": lambda: value_and_gradient(machine, motion, target),
        "by_everything": lambda: by_everything(machine, motion, target),
    }
    compiling = {name: spent(run) for name, run in runs.items()}
    runs["numpy"] = lambda: plain(machine, motion)
    best = {name: spent(run) for name, run in runs.items()}
    for _ in range(4):
        for name, run in runs.items():
            best[name] = np.minimum(best[name], spent(run))
    offsets, currents = plain(machine, motion)
    found = benchmark.pedantic(
        lambda: jax.block_until_ready(sums(machine, motion)), rounds=3
    )
    error = float(np.max(np.abs(np.asarray(found[0]) - offsets)))
    rubbing = float(np.max(np.abs(np.asarray(found[1]) - currents)))
    ratio = float(best["value_and_gradient"][1] / best["sums"][1])
    faster = float(best["numpy"][1] / best["sums"][1])
    benchmark.extra_info |= {
        **{f"{name}_s": float(both[0]) for name, both in best.items()},
        **{f"{name}_processor_s": float(both[1]) for name, both in best.items()},
        **{
            f"{name}_with_compiling_s": float(both[0])
            for name, both in compiling.items()
        },
        **{
            f"{name}_with_compiling_processor_s": float(both[1])
            for name, both in compiling.items()
        },
        "times_faster_than_numpy": faster,
        "gradient_times_the_evaluation": ratio,
        "largest_difference_to_numpy_mm": error,
        "largest_difference_of_currents": rubbing,
    }
    # Positions of 300 mm are rounded to 3e-14 mm, and slopes are below 0.01 mm/mm; the
    # filter is summed up in another order.
    assert error < 1e-14
    assert rubbing < 1e-12  # currents of 20 over distances of 0.03 mm
    assert faster > 1.0
    assert ratio <= 3.5  # the goal is 3; cores are shared
