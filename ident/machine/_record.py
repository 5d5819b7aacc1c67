"""A machine at work, its loops that lag, and the log of its motion with the truth behind it."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...data.signals import last_direction
from ...models import Motion
from ._example import Drive
from ._instruments import HeatedPart, Instrument, response
from ._machine import VirtualMachine
from ._programme import CYCLE, Programme
from ._sources import Column, Columns, State

_ENCODER_NOISE = 2e-5
"""Standard deviation of an encoder reading in mm."""


@dataclasses.dataclass(frozen=True)
class AxisLoop:
    """A position controller over a fast velocity loop, all of it linear.

    Attributes:
        gain: Kv in 1/s: at constant speed the axis stays behind by speed / gain.
        feed_forward: Share of the commanded velocity that is fed forward; it takes that
            share off the following error.
        settling: Time constant of the velocity loop in s.
        compliance: How far a step of the friction by 1 A would push the axis away at most,
            about twice over, in mm; the integrator takes it back.
        integral_time: Of that integrator in s.
    """

    gain: float
    feed_forward: float
    settling: float
    compliance: float
    integral_time: float

    def follow(self, command: Column) -> Column:
        """Return the encoder's position, or its derivative for a command's derivative."""
        above, below = [self.feed_forward, self.gain], [self.settling, 1.0, self.gain]
        return response(above, below, command, CYCLE)

    def yielding(self, current: Column) -> Column:
        """Return by how much friction (in A, less what is fed forward) moves the axis."""
        push = -self.compliance * (current - current[0])
        below = np.convolve([self.settling, 1.0, self.gain], [self.integral_time, 1.0])
        return response([1.0, 0.0], below.tolist(), push, CYCLE)


@dataclasses.dataclass(frozen=True, eq=False)
class WorkingMachine:
    """A machine with loops and drives, observed by instruments while it moves.

    Attributes:
        machine: Its errors and its lists.
        loops: By axis.
        drives: By axis.
        parts: That warm up, each with a sensor of the same name.
        trackers: One instrument per axis.
        plc_lags: By sensor, the time constant in s with which the PLC follows it before
            it sets the temperature compensation.
    """

    machine: VirtualMachine
    loops: Mapping[str, AxisLoop]
    drives: Mapping[str, Drive]
    parts: tuple[HeatedPart, ...]
    trackers: Mapping[str, Instrument]
    plc_lags: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors, as columns of the controller's temperatures."""
        return tuple(part.name for part in self.parts)


@dataclasses.dataclass(frozen=True, eq=False)
class MotionLog(Programme):
    """What was recorded while a machine moved, with the truth; one row per sample.

    Attributes:
        encoder: As the controller displays it, what lists add taken off, in mm.
        actual: As the external instrument has it, in mm; late by its delay.
        current: Torque feedback in A; it opposes the motion.
        temperature: By sensor in °C.
        state: Truth: of the machine.
        truth: Truth: actual − encoder in mm, with the lists that are loaded.
    """

    encoder: Columns
    actual: Columns
    current: Columns
    temperature: Columns
    state: State
    truth: Columns

    def __len__(self) -> int:
        return len(self.time)

    def every(self, step: int) -> "MotionLog":
        """Return each row of so many, as one thins a log that is too long."""

        def thinned(value: Any) -> Any:
            if isinstance(value, State):
                return State(**thinned(vars(value)))
            if isinstance(value, Mapping):
                return {name: thinned(column) for name, column in value.items()}
            return value[::step]

        return MotionLog(**thinned(vars(self)))


def record(work: WorkingMachine, programme: Programme, seed: int) -> MotionLog:
    """Run a programme on a machine and record everything, cycle by cycle."""
    rng = np.random.default_rng(seed)
    sensors, warmth = {}, {}
    for part in work.parts:
        sensors[part.name], warmth[part.name] = part.warm(programme.time, rng)
    axes = tuple(work.machine.axes)
    added, fed = _compensated(work, programme, sensors)
    raw, direction, acceleration, current = {}, {}, {}, {}
    for axis in axes:
        loop, drive = work.loops[axis], work.drives[axis]
        speed = loop.follow(programme.velocity[axis])
        rate = loop.follow(programme.acceleration[axis])
        friction = _friction(drive, speed)
        torque = drive.inertia * rate + friction
        noise = drive.noise * rng.standard_normal(len(speed))
        current[axis] = -(torque + noise)
        pushed = loop.yielding(friction - fed[axis])
        raw[axis] = loop.follow(programme.position[axis] + added[axis]) + pushed
        # What is slower than 0.2 mm/s is the creeping of a loop that settles.
        direction[axis] = last_direction(speed, 0.2)
        acceleration[axis] = rate
    state = State(raw, direction, acceleration, warmth)
    encoder, actual, truth = {}, {}, {}
    for axis in axes:
        fault = work.machine.true_error(axis, state)
        noise = _ENCODER_NOISE * rng.standard_normal(len(fault))
        encoder[axis] = raw[axis] - added[axis] + noise
        truth[axis] = fault + added[axis]
        actual[axis], _ = work.trackers[axis].follow(raw[axis] + fault, rng)
    return MotionLog(
        **vars(programme),
        encoder=encoder,
        actual=actual,
        current=current,
        temperature=sensors,
        state=state,
        truth=truth,
    )


def _friction(drive: Drive, velocity: Column) -> Column:
    """Return the friction in A; an axis that creeps to rest keeps what it had."""
    held = last_direction(velocity, 0.05) * np.maximum(np.abs(velocity), 0.05)
    return np.asarray(drive.law(held))


def _compensated(
    work: WorkingMachine, programme: Programme, sensors: Columns
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return what the controller adds to positions in mm and to currents in A."""
    axes = tuple(work.machine.axes)
    zeros = {axis: np.zeros(len(programme.time)) for axis in axes}
    controller = work.machine.controller
    if controller is None:
        return zeros, zeros
    heat = [
        response([1.0], [work.plc_lags.get(name, 0.0), 1.0], values, CYCLE)
        for name, values in sensors.items()
    ]

    def columns(values: Columns) -> Float[Array, "t a"]:
        return jnp.asarray(np.stack([values[axis] for axis in axes], axis=1))

    motion = Motion(
        columns(programme.position),
        columns(programme.velocity),
        columns(programme.acceleration),
        temperature=jnp.asarray(np.stack(heat, axis=1)) if heat else None,
    )
    offsets, _ = controller.run(controller.start(), motion)
    added = dict(zip(axes, np.asarray(offsets.offset).T, strict=True))
    if offsets.friction is None:
        return added, zeros
    fed = dict(zip(axes, np.asarray(offsets.friction).T, strict=True))
    units = {a: work.drives[a].rated_current * work.drives[a].torque_unit for a in axes}
    return added, {axis: units[axis] * fed[axis] for axis in axes}


def write_motion_log(path: Path, log: MotionLog) -> None:
    """Write a log with roles as column names: mm, s, °C, A."""
    columns: dict[str, np.ndarray] = {"time": log.time}
    roles = ("position", "velocity", "acceleration", "encoder", "actual", "current")
    for axis in log.position:
        columns |= {f"{axis}.{role}": getattr(log, role)[axis] for role in roles}
    columns |= {f"temperature.{name}": value for name, value in log.temperature.items()}
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, "%.6f", ",", header=",".join(columns), comments="")
