"""A job with the fits that were found: the old one, its ``[[fits]]`` replaced."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._job_text import edited_job
from ...discover import Discovery, Found
from ...kinds import kind
from ...readings import Observation
from ..table._layout import grid_keys
from ._load import Job


def job_with_fits(job: Job, observation: Observation, discovery: Discovery) -> str:
    """Return the text of a job that fits what was found.

    All but the fits and `found_keys` stays as it is.
    """
    fits = [
        _keys_of(job, observation, fit, sources)
        for fit in discovery.found
        if (sources := _sources(observation, discovery, fit))
    ]
    return edited_job(job.text, found_keys(job, observation, discovery), fits)


def found_keys(
    job: Job, observation: Observation, discovery: Discovery
) -> dict[str, dict[str, Any]]:
    """Return the keys of each measurement to change, None for one to remove.

    Its drift and an arbitrary zero, where the job says nothing of them. Where fits are
    identified together, a datum gives way to ``remove = "offset"``, unless `remove` is
    stated: none of these fits is zero there alone, only their sum.
    """
    result: dict[str, dict[str, Any]] = {}
    for number, name in enumerate(observation.names):
        spec, keys = job.spec.measurements[name], dict[str, Any]()
        stated = spec.model_fields_set
        axes = {
            fit.axis
            for fit in discovery.found
            if fit.group is not None and name in _sources(observation, discovery, fit)
        }
        drifts = [d for d in discovery.drifts if d.source == number and d.axis in axes]
        if drifts and "drift" not in stated:
            keys["drift"] = max(drift.pieces for drift in drifts)
        if axes and "datum" in stated:
            keys["datum"] = None
        unzeroed = "datum" in stated or name in observation.unzeroed
        if axes and "remove" not in stated and unzeroed:
            keys["remove"] = "offset"
        if keys:
            result[name] = keys
    return result


def _sources(
    observation: Observation, discovery: Discovery, fit: Found
) -> tuple[str, ...]:
    """Return the measurements that hold all that a fit, or its group, needs."""
    data = observation.data
    if kind(fit.compensation).adds_current:
        finite = np.isfinite(data.current[fit.axis])
        counts = np.bincount(data.source[finite], minlength=len(observation.names))
        return (observation.names[int(np.argmax(counts))],)
    effects = [fit]
    if fit.group is not None:
        effects = [effect for effect in discovery.found if effect.group == fit.group]
    finite = np.isfinite(data.error[fit.axis])
    for effect in effects:
        for axis in {*effect.masters, effect.axis} & set(data.position):
            finite = finite & np.isfinite(data.position[axis])
        for sensor in effect.sensors:
            finite = finite & np.isfinite(data.temperature[sensor])
    held = np.unique(data.source[finite])
    return tuple(observation.names[number] for number in held.tolist())


def _keys_of(
    job: Job, observation: Observation, effect: Found, sources: tuple[str, ...]
) -> dict[str, Any]:
    """Return the keys of a fit."""
    keys: dict[str, Any] = {"compensation": effect.compensation, "axis": effect.axis}
    one = len(sources) == 1
    keys |= {"measurement": sources[0]} if one else {"measurements": list(sources)}
    over = (effect.masters or (effect.axis,)) if kind(effect.compensation).table else ()
    nodes = nodes_for(job, observation, effect.axis, over, sources)
    keys |= dict(effect.keys) | nodes
    if effect.group is not None:
        keys["group"] = effect.group
    return keys


def nodes_for(
    job: Job,
    observation: Observation,
    axis: str,
    over: Sequence[str],
    sources: Sequence[str],
) -> dict[str, Any]:
    """Return the keys that give the nodes of a table of an axis; none without a position.

    It lies over the positions of the axis itself, or of its masters, in these measurements.
    """
    if not over:
        return {}
    data = observation.data
    rows = np.isin(data.source, [observation.names.index(name) for name in sources])
    rows &= np.isfinite(data.error[axis])
    places = [data.position[master][rows] for master in over]
    spec, along = job.spec.axes[over[0]], over == (axis,)
    if len(over) == 1 and spec.modulo is not None:
        low, high = spec.modulo
        keys = {"start": low, "interval": (high - low) / 72.0, "points": 73}
        return keys | {"modulo": True} if along else keys
    # What a cross table does beyond its ends is not documented (S-12).
    limits = None if along else spec.limits
    return grid_keys(places, None if limits is None else (limits[0], limits[1]))
