"""What fits that are no group take from the same readings, and cannot share."""

from collections.abc import Sequence

from ....data.errors import AxcompError
from ...fit.joint import (
    AbstractEffect,
    examine_design,
)
from ...readings import Tables
from .._load import Job
from ._member import AbstractMember, at_once, few, members_of
from ._recording import GroupRecording, read_group


def untold_apart(
    job: Job,
    tables: Tables,
    indices: Sequence[int],
) -> dict[int, str]:
    """Return which fits that stand alone cannot be told, and why.

    Each of them is fitted as if there was no other. Those of one axis and measurement
    are looked at together: where the readings cannot tell two of them apart, either would
    take the whole.

    Args:
        job: The job.
        tables: Its measurements.
        indices: Fits of no group.
    """
    found: dict[int, str] = {}
    for own in _together(job, tables, indices):
        try:
            members = members_of(job, tables, own)
            recording = read_group(tables, members)
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
        if not fit.kind.adds_current:
            known.setdefault((fit.axis, tuple(sorted(fit.sources))), []).append(k)
    return [
        own
        for own in known.values()
        if len(own) > 1
        or not job.spec.fits[own[0]].kind.table
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
    data = few(recording.data)
    for one in members:
        why = one.undetermined(data) or one.confused(job, members, recording)
        if why:
            found.append((one, why))
    if len(members) < 2 or found:
        return found
    pairs = [(one, _effect(job, one, recording)) for one in members]
    effects = [at_once(effect) for _, effect in pairs if effect is not None]
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
