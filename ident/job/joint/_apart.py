"""What fits that are no group take from the same readings, and cannot share."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ....data.errors import AxcompError
from ...fit.joint import (
    AbstractEffect,
    JointData,
    Leadscrew,
    Temperature,
    examine_design,
)
from .._draft import AxisLists
from .._fit_schema import FrictionSpec, PlaneSpec, TableSpec
from .._load import Job
from .._source import Tables
from ._member import AbstractMember
from ._members import members_of
from ._needs import needs_of
from ._recording import GroupRecording, read_group

_MOST = 10_000
"""Readings that are enough to see what goes together."""
_TOGETHER = 0.99
"""Correlation of two masters from which on a plane is told on a line only."""
_NODES = 11


def untold_apart(
    job: Job,
    tables: Tables,
    indices: Sequence[int],
    lists: Mapping[str, AxisLists],
) -> dict[int, str]:
    """Return which fits that stand alone cannot be told, and why.

    Each of them is fitted as if there was no other. Those of one axis and measurement
    are looked at together: where the readings cannot tell two of them apart, either would
    take the whole.

    Args:
        job: The job.
        tables: Its measurements.
        indices: Fits of no group.
        lists: What the axes have already.
    """
    found: dict[int, str] = {}
    for own in _together(job, tables, indices):
        try:
            members = members_of(job, tables, own, lists)
            recording = read_group(
                tables, [one.spec for one in members], needs_of(members)
            )
            for one, sentence in _confused(job, members, recording):
                found.setdefault(one.index, sentence)
        except AxcompError:
            continue  # What is wrong each fit says in its own words.
    return found


def _together(job: Job, tables: Tables, indices: Sequence[int]) -> list[list[int]]:
    """Return fits of one axis and the same measurements; friction has its own.

    A table alone on a log that is read in pieces stays aside: whatever shares the log has it
    read into memory.
    """
    known: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for k in indices:
        fit = job.spec.fits[k]
        if not isinstance(fit, FrictionSpec):
            known.setdefault((fit.axis, tuple(sorted(fit.sources))), []).append(k)
    return [
        own
        for own in known.values()
        if len(own) > 1
        or not isinstance(job.spec.fits[own[0]], TableSpec)
        or not _is_large(job, tables, own[0])
    ]


def _is_large(job: Job, tables: Tables, k: int) -> bool:
    return any(
        job.spec.measurements[name].stream is not False
        and tables.large(name) is not None
        for name in job.spec.fits[k].sources
    )


def _confused(
    job: Job, members: Sequence[AbstractMember], recording: GroupRecording
) -> list[tuple[AbstractMember, str]]:
    found = []
    data = _few(recording.data)
    for one in members:
        why = together(one, data) or bent_by_heat(job, one, members, recording)
        if why:
            found.append((one, why))
    if len(members) < 2 or found:
        return found
    pairs = [(one, _effect(job, one, recording)) for one in members]
    effects = [_at_once(effect) for _, effect in pairs if effect is not None]
    if len(effects) < 2:
        return found
    for pair in examine_design(data, effects).confusions:
        lost = set(pair.effects)
        if len(lost) < 2:
            continue
        found += [
            (one, pair.sentence)
            for one, effect in pairs
            if effect is not None and effect.name in lost
        ]
    return found


def _effect(
    job: Job, one: AbstractMember, recording: GroupRecording
) -> AbstractEffect | None:
    """Return the effect; one whose form is open has that of a fit to the whole error."""
    found = one.effect(job, recording, None)
    if found is None:
        found = one.effect(job, recording, recording.data.error[one.axis])
    return found


def together(one: AbstractMember, data: JointData) -> str:
    """Return that the two masters of a plane moved as one, or nothing."""
    if not isinstance(one.spec, PlaneSpec):
        return ""
    first, second = (data.position[name] for name in one.spec.masters)
    known = np.isfinite(first) & np.isfinite(second)
    known &= np.isfinite(data.error[one.axis])
    x, y = first[known], second[known]
    if len(x) < 3 or not np.ptp(x) > 0 or not np.ptp(y) > 0:
        return ""
    alike = float(np.corrcoef(x, y)[0, 1])
    if abs(alike) < _TOGETHER:
        return ""
    names = " and ".join(one.spec.masters)
    return (
        f"{names} moved together (correlation {alike:.4f}): beside the line on which they"
        " went nothing was measured. Move each of them while the other stands still."
    )


def bent_by_heat(
    job: Job,
    one: AbstractMember,
    members: Sequence[AbstractMember],
    recording: GroupRecording,
) -> str:
    """Return that an error along the axis looks like its temperature, or nothing.

    Beside a leadscrew of the same axis the readings show that themselves.
    """
    if any(
        each.spec.compensation == "leadscrew" and each.axis == one.axis
        for each in members
    ):
        return ""
    if one.spec.compensation != "temperature" or not one.positions:
        return ""
    place = recording.data.position[one.axis]
    low, high = float(np.nanmin(place)), float(np.nanmax(place))
    effect = one.effect(job, recording, None)
    if effect is None or not high > low:
        return ""
    screw = Leadscrew(one.axis, np.linspace(low, high, _NODES))
    told = examine_design(_few(recording.data), [screw, _at_once(effect)])
    own = [each for each in told.confusions if len(set(each.effects)) > 1]
    return own[0].sentence if own else ""


def _at_once(effect: AbstractEffect) -> AbstractEffect:
    if isinstance(effect, Temperature):
        return dataclasses.replace(effect, lag=0.0)
    return effect


def _few(data: JointData) -> JointData:
    step = -(-len(data) // _MOST)
    return data.take(np.arange(0, len(data), step)) if step > 1 else data
