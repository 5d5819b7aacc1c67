"""The machine of `axcomp demo`: a small portal mill with three known faults."""

from ._machine import VirtualMachine
from ._measure import Instrument
from ._sources import BeamBow, Reversal, ScrewPitch, TableFlatness

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


def example_machine() -> VirtualMachine:
    """Return a portal mill: X screw off, beam bent (Y over X), table uneven (Z)."""
    length = TRAVEL[0]
    return VirtualMachine(
        axes={"X": 1, "Y": 2, "Z": 3},
        sources=(
            ScrewPitch("X", slope=5.2e-5, bow=-0.011, length=length,
                       periodic=0.0016, lead=40.0),
            Reversal("X", at_start=0.005, at_end=0.011, length=length),
            BeamBow("Y", along="X", bow=0.024, length=length, wave=0.0022,
                    wavelength=260.0),
            TableFlatness("Z", across=("X", "Y"), size=TRAVEL, twist=0.012,
                          sag=0.021, dent=0.009),
        ),
    )  # fmt: skip
