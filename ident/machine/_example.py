"""The machine of `axcomp demo`: a small portal mill with three known faults, and its drive."""

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from ...models import AbstractFriction, StribeckFriction
from ._instruments import Instrument
from ._machine import VirtualMachine
from ._sources import beam_bow, reversal, screw_pitch, table_flatness

TRAVEL = (800.0, 400.0)
"""Travel of X and of Y in mm."""

LASER = Instrument(
    noise=0.0006, resolution=0.00001, drift=0.001, run_offset=0.0008,
    zero=0.0131,
)  # fmt: skip
STRAIGHTEDGE = Instrument(
    noise=0.0008, resolution=0.0001, run_offset=0.0005, zero=-0.212, tilt=6.5e-5,
    wild=0.01, wild_size=0.06,
)  # fmt: skip
PROBE = Instrument(
    noise=0.0012, resolution=0.0005, zero=0.045, wild=0.01, wild_size=0.4
)  # fmt: skip

_SPEEDS = (0.6, 1.5, 4.0, 10.0, 25.0, 60.0, 150.0)
"""mm/s, each driven forth and back."""
_CYCLE = 0.002
_HOLD = 0.7
_RAMP = 0.12


def example_machine() -> VirtualMachine:
    """Return a portal mill: X screw off, beam bent (Y over X), table uneven (Z)."""
    length = TRAVEL[0]
    return VirtualMachine(
        axes={"X": 1, "Y": 2, "Z": 3},
        sources=(
            screw_pitch("X", slope=5.2e-5, bow=-0.011, length=length,
                       periodic=0.0016, lead=40.0),
            reversal("X", at_start=0.005, at_end=0.011, length=length),
            beam_bow("Y", along="X", bow=0.024, length=length, wave=0.0022,
                    wavelength=260.0),
            table_flatness("Z", across=("X", "Y"), size=TRAVEL, twist=0.012,
                          sag=0.021, dent=0.009),
        ),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Drive:
    """A drive and its axis.

    Attributes:
        law: Friction in A over mm/s.
        inertia: In A per mm/s².
        rated_current: In A.
        torque_unit: Share of the rated current that one unit of the drive is.
        noise: Standard deviation of the recorded current in A.
    """

    law: AbstractFriction
    inertia: float
    rated_current: float
    torque_unit: float
    noise: float


def example_drive(size: float = 1.0) -> Drive:
    """Return the drive of X of the demo's portal mill, or one of another size like it."""
    law = (1.6 * size, 2.3 * size, 4.0, 2.0, 0.006 * size)
    return Drive(
        # Coulomb, break-away, Stribeck velocity and exponent, viscous.
        law=StribeckFriction(*map(jnp.asarray, law)),
        inertia=0.004 * size,
        rated_current=9.0,
        torque_unit=0.001,
        noise=0.05,
    )


def record_drive(path: Path, drive: Drive, seed: int) -> None:
    """Record constant speeds, forth and back, with soft ramps, as a drive writes them.

    A CSV with time in ms, position in mm and current in A, which opposes the motion.
    """
    count, ramp = round(_HOLD / _CYCLE), round(_RAMP / _CYCLE)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, np.arange(count) / ramp))
    shape = rise * rise[::-1]
    velocity = np.concatenate([way * v * shape for v in _SPEEDS for way in (1.0, -1.0)])
    acceleration = np.gradient(velocity, _CYCLE)
    friction = np.asarray(drive.law(velocity))
    noise = drive.noise * np.random.default_rng(seed).normal(size=velocity.size)
    current = drive.inertia * acceleration + friction + noise
    time = np.arange(velocity.size) * _CYCLE
    position = 100.0 + np.cumsum(velocity) * _CYCLE
    table = np.column_stack([1e3 * time, position, -current])
    np.savetxt(path, table, "%.5f", ",", header="time_ms,x,current", comments="")
