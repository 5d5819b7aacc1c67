"""A machine that has every fault at once, and half an hour of its work."""

import dataclasses
from collections.abc import Collection

import numpy as np

from ._example import example_drive
from ._instruments import HeatedPart, Instrument
from ._machine import VirtualMachine
from ._programme import Path, Programme
from ._record import AxisLoop, WorkingMachine
from ._sources import (
    beam_bow,
    nodding,
    part_growth,
    reversal,
    screw_pitch,
    table_flatness,
)

SPACE = {"X": 800.0, "Y": 400.0, "Z": 200.0}
"""Travel of each axis from 0, in mm."""
_AXES = {"X": (1.0, 0.31), "Y": (0.8, -0.12), "Z": (1.3, 0.05)}
"""Size of the drive of each axis, and the zero in mm of the instrument that follows it."""
_LOOP = AxisLoop(
    gain=45.0, feed_forward=0.6, settling=0.003, compliance=0.003, integral_time=0.01
)
_TRACKER = Instrument(
    noise=0.0005, delay=0.0043, rate=4e-7, drift=0.001, outliers=0.005,
    outlier_size=0.02, wild=0.0002, wild_size=1.0,
)  # fmt: skip
_HARD = 1500.0
"""Largest acceleration of the programme in mm/s²."""

_SOURCES = (
    screw_pitch("X", slope=4.1e-5, bow=-0.011, length=800.0, periodic=0.0, lead=40.0),
    reversal("X", at_start=0.004, at_end=0.009, length=800.0),
    part_growth("X", "scale", stretch=11.5e-6, reference=250.0),
    screw_pitch("Y", slope=-2.6e-5, bow=0.006, length=400.0, periodic=0.0, lead=40.0),
    reversal("Y", 0.006, 0.006, length=400.0, compensation="backlash"),
    beam_bow("Y", "X", bow=0.018, length=800.0, wave=0.0022, wavelength=260.0),
    nodding("Y", "X", "Z", at_start=0.002, at_end=0.007, length=200.0, braking=0.8),
    screw_pitch("Z", slope=3.0e-5, bow=-0.003, length=200.0, periodic=0.0, lead=40.0),
    reversal("Z", 0.004, 0.004, length=200.0, compensation="backlash"),
    table_flatness("Z", ("X", "Y"), (800.0, 400.0), twist=0.012, sag=0.021, dent=0.005),
    part_growth("Z", "spindle", shift=0.0021),
)

_Fault = tuple[str, str]
"""Compensation and axis, such as ``("backlash", "Z")``."""


def machine_with_everything(
    absent: Collection[_Fault] = (), *, swapped: bool = False, pace: float = 1.0
) -> WorkingMachine:
    """Return a portal mill with every compensation's fault on three axes.

    Leadscrew (X with lost motion that grows along it), backlash (Y, Z), cross (Y over X),
    plane (Z over X and Y), crosstalk (Y from the acceleration of X, over Z), temperature
    (the scale of X, the spindle for Z), friction (all).

    Args:
        absent: Faults that this machine does not have.
        swapped: The beam along X is straight, and the column along Z is bent instead.
        pace: How slowly it warms and cools, for programmes shorter than half an hour.
    """
    sources = tuple(s for s in _SOURCES if (s.compensation, s.axis) not in absent)
    if swapped:
        bent = beam_bow(
            "Y", "Z", bow=0.012, length=200.0, wave=0.0015, wavelength=110.0
        )
        sources = tuple(bent if s.compensation == "cross" else s for s in sources)
    return WorkingMachine(
        machine=VirtualMachine({"X": 1, "Y": 2, "Z": 3}, sources),
        loops=dict.fromkeys(SPACE, _LOOP),
        drives={axis: example_drive(size) for axis, (size, _) in _AXES.items()},
        parts=(
            HeatedPart("scale", 6.0, 200.0 * pace, 90.0 * pace, 420.0 * pace),
            HeatedPart("spindle", 14.0, 80.0 * pace, 45.0 * pace, 200.0 * pace),
        ),
        trackers={
            axis: dataclasses.replace(_TRACKER, zero=zero)
            for axis, (_, zero) in _AXES.items()
        },
    )


def work_programme(seconds: float = 1800.0, seed: int = 0) -> Programme:
    """Return a programme that goes everywhere in all directions at many feeds.

    Rows along X and along Y, strokes of Z, short strokes of X at several heights, circles,
    pauses, and jobs anywhere. Shorter ones have the same parts, fewer of each.
    """
    rng = np.random.default_rng(seed)
    path = Path({"X": 5.0, "Y": 5.0, "Z": 100.0}, _HARD)
    share = seconds / 1800.0
    path.rest(1.0)
    # All axes come from below, so that from here on each has a direction.
    path.line(50.0, X=15.0, Y=15.0, Z=110.0)
    path.rest(1.0)
    half = 0.5 * seconds
    _rows(path, rng, "X", "Y", max(round(67 * share), 9))
    _strokes(path, rng, max(round(100 * share), 24))
    while path.seconds < half:
        _job(path, rng)
    _rows(path, rng, "Y", "X", max(round(67 * share), 9))
    for _ in range(max(round(20 * share), 3)):
        top = 0.0 if path.place[2] > 100.0 else 200.0
        path.line(float(rng.uniform(10.0, 120.0)), Z=top)
    _circles(path, rng, max(round(12 * share), 2))
    while path.seconds < seconds - 3.0:
        _job(path, rng)
    path.rest(1.0)
    return path.programme()


def _rows(
    path: Path, rng: np.random.Generator, along: str, across: str, count: int
) -> None:
    """Go to and fro along one axis, from end to end of the other."""
    fast = 0.3 * SPACE[along]
    for place in np.linspace(0.0, SPACE[across], count):
        path.line(150.0, **{across: float(place)})
        end = 0.0 if path.place[path.axes.index(along)] > 0.5 * SPACE[along] else 1.0
        feed = float(rng.uniform(0.35, 1.0)) * fast
        path.line(feed, **{along: end * SPACE[along]})
        if rng.random() < 0.3:
            path.rest(0.3)


def _strokes(path: Path, rng: np.random.Generator, count: int) -> None:
    """Accelerate X hard, over and over, at several heights of Z; nothing else moves."""
    for k in range(count):
        if k % 4 == 0:
            heights = np.linspace(0.0, SPACE["Z"], 5)
            path.line(100.0, Z=float(heights[(k // 4) % 5]))
            path.line(200.0, X=float(rng.uniform(100.0, 700.0)))
            path.rest(0.4)
        stroke = float(rng.uniform(40.0, 90.0)) * (1 if k % 2 else -1)
        goal = float(np.clip(path.place[0] + stroke, 0.0, SPACE["X"]))
        path.line(float(rng.uniform(120.0, 250.0)), X=goal)
        path.rest(0.3)


def _circles(path: Path, rng: np.random.Generator, count: int) -> None:
    for k in range(count):
        radius = float(rng.choice([20.0, 50.0, 80.0]))
        first, second = (("X", "Y"), ("X", "Z"), ("Y", "Z"))[k % 3]
        radius = min(radius, 0.4 * SPACE[second])
        start = {first: float(rng.uniform(2.1 * radius, SPACE[first]))}
        start[second] = float(rng.uniform(radius, SPACE[second] - radius))
        path.line(150.0, **start)
        feed = float(rng.uniform(20.0, 90.0))
        path.circle(first, second, radius, feed, 1.5 if k % 2 else -1.5)
        path.rest(0.2)


def _job(path: Path, rng: np.random.Generator) -> None:
    """Go somewhere, then a few cuts about it."""
    target = {axis: float(rng.uniform(0.0, size)) for axis, size in SPACE.items()}
    path.line(float(rng.uniform(80.0, 250.0)), **target)
    for _ in range(int(rng.integers(2, 6))):
        axis = str(rng.choice(list(SPACE)))
        place = path.place[path.axes.index(axis)]
        goal = place + float(rng.normal(0.0, 0.15)) * SPACE[axis]
        goal = float(np.clip(goal, 0.0, SPACE[axis]))
        path.line(float(10 ** rng.uniform(0.7, 2.2)), **{axis: goal})
    if rng.random() < 0.5:
        path.rest(float(rng.uniform(0.1, 0.6)))
