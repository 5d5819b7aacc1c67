"""The machine with every fault, as a fit and its truth see it: for the tests and the benchmark."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from axcomp.data.measurements import Measurement
from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    Crosstalk,
    JointData,
    JointFit,
    Leadscrew,
    Part,
    Plane,
    Temperature,
)
from axcomp.ident.machine import SPACE, State, WorkingMachine

from ..joint.gauge import in_gauge

AXES = tuple(SPACE)
NOISE = 0.0005
"""Of one reading of the machine's instruments, in mm."""


def joint(found: Measurement) -> JointData:
    """Return a measurement in which nothing moves any more as data of a joint fit."""

    def of(kind: str) -> dict[str, np.ndarray]:
        return {
            axis: np.asarray(found.values[f"{axis}.{kind}"], dtype=float)
            for axis in AXES
        }

    return JointData(
        position=of("position"),
        error=of("error"),
        direction=of("direction"),
        velocity=of("velocity"),
        acceleration=of("acceleration"),
        temperature={
            name: np.asarray(found.values[f"temperature.{name}"], dtype=float)
            for name in ("scale", "spindle")
        },
        time=np.asarray(found.values["time"], dtype=float),
    )


def workspace(
    seed: int,
    count: int = 4000,
    scale: tuple[float, float] = (20.5, 23.5),
    spindle: tuple[float, float] = (21.0, 28.0),
) -> tuple[JointData, State]:
    """Return places all over the machine, warm and cold, for a fit and for the truth.

    Args:
        seed: Of the places.
        count: How many.
        scale: From how cold to how warm it is, in °C.
        spindle: The same.
    """
    rng = np.random.default_rng(seed)
    place = {axis: rng.uniform(0.0, most, count) for axis, most in SPACE.items()}
    way = {axis: rng.choice([-1.0, 1.0], count) for axis in AXES}
    rate = {"X": rng.uniform(-1500.0, 1500.0, count)}
    none = np.zeros(count)
    rate |= {"Y": none, "Z": none}
    heat = {
        "scale": rng.uniform(*scale, count),
        "spindle": rng.uniform(*spindle, count),
    }
    data = JointData(
        position=place,
        error={},
        direction=way,
        velocity={axis: none for axis in AXES},
        acceleration=rate,
        temperature=heat,
        time=np.arange(count, dtype=float),
    )
    return data, State(place, way, rate, heat)


def at_once(effect: AbstractEffect) -> AbstractEffect:
    """Return an effect for places that have been as warm as they are for long."""
    if isinstance(effect, Temperature):
        return dataclasses.replace(effect, lag=0.0)
    return effect


def in_the_workspace(
    parts: Sequence[Part], machine: WorkingMachine, places: tuple[JointData, State]
) -> dict[str, np.ndarray]:
    """Return fit − truth in mm at many places, arbitrary zeros aside."""
    data, state = places
    found = {}
    for axis in AXES:
        total = np.zeros(len(data))
        for part in parts:
            if part.effect.axis == axis and part.effect.compensation != "delay":
                total += at_once(part.effect).block(data)[0] @ part.values
        wrong = total - machine.machine.true_error(axis, state)
        found[axis] = wrong - np.median(wrong)
    return found


def at_nodes(part: Part, machine: WorkingMachine) -> np.ndarray:
    """Return the true values of a part, before any gauge."""
    effect, axis = part.effect, part.effect.axis

    def true(state: State) -> np.ndarray:
        own = [
            source.error(state)
            for source in machine.machine.sources
            if (source.axis, source.compensation) == (axis, effect.compensation)
        ]
        return np.asarray(sum(own))

    if isinstance(effect, Leadscrew):
        # A table of one direction has no lost motion to know of.
        sides = (1.0, -1.0) if effect.bilateral else (0.0,)
        places = np.tile(effect.nodes, len(sides))
        return true(State({axis: places}, {axis: np.repeat(sides, len(effect.nodes))}))
    if isinstance(effect, Cross):
        return true(State({effect.master: effect.nodes}, {}))
    if isinstance(effect, Plane):
        first, second = np.meshgrid(*effect.grid)
        one, two = effect.masters
        return true(State({one: first.ravel(), two: second.ravel()}, {}))
    if isinstance(effect, Crosstalk):
        heights = np.tile(effect.points[:, 0], 2)
        rate = np.repeat([effect.acceleration, effect.deceleration], len(effect.points))
        return true(State({"Z": heights}, {}, {effect.master: rate}))
    if isinstance(effect, Backlash):
        return 2.0 * true(State({axis: np.zeros(1)}, {axis: np.array([-1.0])}))
    if isinstance(effect, Temperature):
        found = []
        for name, nodes in effect.nodes.items():
            warm = {effect.sensors[name]: nodes}
            place = np.full(len(nodes), effect.reference)
            shift, further = (
                true(State({axis: at}, {}, {}, warm)) for at in (place, place + 1.0)
            )
            found.append(shift if name == "offset" else further - shift)
        return np.concatenate(found)
    return part.values


def in_deviations(fit: JointFit, machine: WorkingMachine) -> dict[str, np.ndarray]:
    """Return (value − truth) / deviation of each part's known values, in the fit's gauge."""
    truth, _ = in_gauge(fit, [at_nodes(part, machine) for part in fit.parts])
    found = {}
    for part, true in zip(fit.parts, truth, strict=True):
        known = part.determined & (part.support > 0) & (part.standard_deviation > 0)
        if known.any() and part.effect.compensation != "delay":
            away = (part.values - true)[known] / part.standard_deviation[known]
            found[part.name] = away
    return found
