"""The controller in pieces, under vmap and under grad, and what bounds its offsets."""

import itertools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.models import (
    AxisCompensations,
    Backlash,
    BilinearGrid,
    CompCommand,
    Coupled,
    Cross,
    Crosstalk,
    EquidistantNodes,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    ModuloNodes,
    Motion,
    Offsets,
    Plane,
    PositionController,
    Setpoints,
    TemperatureCurve,
    TemperatureLine,
    commanded,
)

CYCLES = 240


def random_machine(seed: int) -> PositionController:
    """Two axes with everything and one rotary master, tables of 10 µm."""
    rng = np.random.default_rng(seed)
    axes = []
    for number in range(2):
        other = 1 - number
        around = 0.01 * rng.normal(size=9)
        around[-1] = around[0]
        rotary = ModuloNodes(EquidistantNodes(0.0, 45.0, 9))
        plane = Plane.quadratic((-6.0, -6.0), 2.0, 0.01 * rng.normal(size=(7, 7)))
        shake = Crosstalk(
            BilinearGrid((Setpoints([-4.0, 0.5, 4.0]),), (0, 1, 2)),
            0.01 * rng.normal(size=(4, 3)),
            60.0,
            -50.0,
            cycles=6,
        )
        drag = FrictionTable(Setpoints([0.0, 5.0, 20.0]), rng.uniform(1, 2, 3))
        axes.append(
            AxisCompensations(
                backlash=Backlash(0.004, 1, 5),
                temperature=TemperatureLine(
                    0.5,
                    TemperatureCurve.of([19.0, 22.0], 0.01 * rng.normal(size=2)),
                    TemperatureCurve.of([19.0, 22.0], 1e-4 * rng.normal(size=2)),
                    7,
                ),
                cross=Coupled(Cross(rotary, around), (2,), 4 + number),
                plane=Coupled(plane, (number, other), 6),
                crosstalk=Coupled(shake, (other, number)),
                leadscrew=Leadscrew(
                    Setpoints([-6.0, -3.3, -0.2, 2.1, 6.0]),
                    0.01 * rng.normal(size=5),
                    0.01 * rng.normal(size=5),
                ),
                friction=FrictionCompensation(drag, 4, 0.3, 2),
            )
        )
    return PositionController((*axes, AxisCompensations()))


def random_motion(seed: int, cycles: int = CYCLES, **more: Any) -> Motion:
    rng = np.random.default_rng(seed)
    time = np.arange(cycles) * 0.01
    phase = rng.uniform(0, 6, 3)
    place = np.stack(
        [4 * np.sin(2 * time + p) + np.sin(5 * time + 2 * p) for p in phase], axis=1
    )
    place[:, 0] = np.clip(place[:, 0], -2.3, 3.1)  # dwells
    place[:, 2] = 300.0 * time + 7.0
    speed = np.gradient(place, 0.01, axis=0)
    return Motion(
        place,
        speed,
        np.gradient(speed, 0.01, axis=0),
        20.5 + 0.3 * np.sin(time)[:, None],
        **more,
    )


MACHINE = random_machine(0)
SWITCHED = commanded(
    MACHINE,
    CYCLES,
    [
        CompCommand(30, 0, False, ("cross", "temperature")),
        CompCommand(33, 1, False),
        CompCommand(60, 0, True, ("cross",)),
        CompCommand(130, 1, True, ("plane", "friction", "backlash", "leadscrew")),
    ],
)
HOMED = np.broadcast_to(np.arange(CYCLES)[:, None] >= [9, 11, 15], (CYCLES, 3))
LOG = random_motion(1, active=SWITCHED, homed=HOMED)


def rows(motion: Motion, start: int, stop: int) -> Motion:
    return jax.tree.map(lambda leaf: leaf[start:stop], motion)


def equal(found: Offsets, expected: Offsets) -> None:
    for name, one in vars(found).items():
        np.testing.assert_array_equal(one, getattr(expected, name), err_msg=name)


@pytest.mark.usefixtures("optimised")  # without, the last bit depends on the length
def test_a_log_in_pieces_and_chunks_is_the_log_at_once_to_the_last_bit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, _ = MACHINE.run(MACHINE.start(), LOG)
    monkeypatch.setattr("axcomp.models._controller._CHUNK", 7)
    # A single cycle, pieces that end while filters are at work, chunks and a rest.
    ends = [0, 1, 123, CYCLES]
    pieces = [rows(LOG, a, b) for a, b in itertools.pairwise(ends)]
    parts = list(MACHINE.run_pieces(iter(pieces)))
    assert [part.offset.shape[0] for part in parts] == list(np.diff(ends))
    equal(jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts), whole)


def test_pieces_shorter_than_the_look_ahead_still_see_what_follows() -> None:
    friction = PositionController(
        (AxisCompensations(friction=MACHINE.axes[0].friction),)
    )
    one = jax.tree.map(lambda leaf: leaf[:12, :1], random_motion(6, 50))
    whole = friction.run(friction.start(), one)[0].offset
    pieces = (rows(one, at, at + 1) for at in range(12))
    found = [part.offset for part in friction.run_pieces(pieces)]
    np.testing.assert_array_equal(np.concatenate(found), whole)


def test_vmap_over_machines_gives_what_a_loop_gives() -> None:
    machines = [random_machine(seed) for seed in (0, 1, 2)]
    logs = [random_motion(n, active=SWITCHED, homed=HOMED) for n in (3, 4, 5)]

    def run(machine: PositionController, log: Motion) -> Offsets:
        return machine.run(machine.start(), log)[0]

    stacked = [
        jax.tree.map(lambda *leaves: jnp.stack(leaves), *many)
        for many in (machines, logs)
    ]
    found = jax.jit(jax.vmap(run))(*stacked)
    for number, (machine, log) in enumerate(zip(machines, logs, strict=True)):
        one = run(machine, log)
        assert not found.further
        for name, values in vars(found).items():
            if name == "further":
                continue
            # Currents of size 1, a few roundings where sums are contracted otherwise.
            np.testing.assert_allclose(
                values[number], getattr(one, name), rtol=0, atol=1e-14, err_msg=name
            )


@eqx.filter_jit
def squares(machine: PositionController, log: Motion) -> jax.Array:
    found = machine.run(machine.start(), log)[0]
    assert found.friction is not None
    return 1e4 * jnp.sum(found.offset**2) + jnp.sum(found.friction**2)


@pytest.mark.slow
def test_gradients_by_tables_parameters_and_motion_agree_with_differences() -> None:
    arguments = (MACHINE, random_motion(7, cycles=60))
    slopes = eqx.filter_grad(lambda both: squares(*both))(arguments)
    leaves, tree = jax.tree.flatten_with_path(arguments)
    rng = np.random.default_rng(8)
    for number, (path, leaf) in enumerate(leaves):
        slope = jax.tree.leaves(slopes)[number]
        way = jnp.asarray(rng.uniform(0.5, 1.0, size=leaf.shape))
        # Smaller than the distance of any sample from a kink; tables are linear.
        step = 1e-7 if "position" in str(path) else 1e-5
        step *= max(float(jnp.median(jnp.abs(leaf))), 1e-2)
        if "position" in str(path[1:2]) or "velocity" in str(path):
            way = jnp.where(_is_turning(arguments[1]), 0.0, way)
        if "acceleration" in str(path[1:2]):  # at 0 there is a kink
            way = jnp.where(jnp.abs(leaf) < 1.0, 0.0, way)

        def moved(step: float, number: int = number, way: jax.Array = way) -> float:
            changed = [leaf for _, leaf in leaves]
            changed[number] = changed[number] + step * way
            return float(squares(*jax.tree.unflatten(tree, changed)))

        found = (moved(step) - moved(-step)) / (2 * step)
        exact = float(jnp.sum(slope * way))
        assert exact == pytest.approx(found, rel=1e-6, abs=1e-6), str(path)


def _is_turning(motion: Motion) -> jax.Array:
    """Return where a small change would move a reversal: at rest and next to it."""
    step = jnp.abs(jnp.diff(motion.position, axis=0)) > 1e-3
    before = jnp.pad(step, ((1, 0), (0, 0)))
    after = jnp.pad(step, ((0, 1), (0, 0)))
    return ~(before & after)


def test_offsets_are_finite_and_within_the_range_of_their_tables() -> None:
    found, _ = MACHINE.run(MACHINE.start(), LOG)
    axes: Any = MACHINE.axes
    for number, axis in enumerate(axes[:2]):
        for name, values in (
            ("cross", axis.cross.law.values),
            ("plane", axis.plane.law.values),
            ("crosstalk", axis.crosstalk.law.values),
            ("leadscrew", jnp.stack([axis.leadscrew.pos, axis.leadscrew.neg])),
        ):
            offsets = getattr(found, name)[:, number]
            assert bool(jnp.all(jnp.isfinite(offsets)))
            # Twenty sums of numbers of size 0.03.
            assert jnp.max(jnp.abs(offsets)) <= jnp.max(jnp.abs(values)) + 1e-15


def test_offsets_do_not_jump_where_the_axis_does_not_reverse() -> None:
    machine = PositionController(
        tuple(
            eqx.tree_at(
                lambda a: (a.backlash, a.friction), axis, (None, None), is_leaf=_is_none
            )
            for axis in MACHINE.axes
        )
    )
    # 1000 small steps in one direction over the tables and the modulo transition.
    time = jnp.linspace(0.0, 1.0, 1001)[:, None]
    place = jnp.concatenate([10 * time - 5, 8 * time - 4, 720 * time], axis=1)
    flat = jnp.zeros_like(place)
    still = Motion(place, flat, flat, jnp.full((1001, 1), 20.0))
    offset = machine.run(machine.start(), still)[0].offset
    # Slopes: 0.06 mm per 2 mm and direction, 0.06 mm per 45°, four of them at once.
    assert float(jnp.max(jnp.abs(jnp.diff(offset, axis=0)))) < 2e-3


def _is_none(leaf: object) -> bool:
    return leaf is None
