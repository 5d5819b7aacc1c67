"""What acts on an axis: while its readings were taken, and with the files of a job."""

import dataclasses

from ...data.lists import ListFile, new_list
from ..exchange import (
    Reading,
    entries_of_activation,
)
from ..kinds import kinds
from ..proof.axis import Loaded
from ._draft import AbstractDraft, AxisLists
from ._lists import AxisFiles
from ._load import Job


def acting_before(job: Job, axis: str, lists: AxisLists) -> Loaded:
    """Return what the existing lists of an axis hold and switch on.

    Without an axis list everything in the compensation list counts.
    """
    number = job.spec.axes[axis].number
    return Loaded(
        number,
        _lists(number, lists.compensation, lists.machine),
        reading_of(job),
    )


def acting_after(job: Job, files: AxisFiles) -> Loaded:
    """Return what acts on an axis with the files of a job, as they will be read."""
    number, lists = files.number, files.existing
    before = acting_before(job, files.axis, lists)
    listing = _read_back(files.compensation) or lists.compensation
    machine = _read_back(files.machine) or lists.machine
    if lists.machine is None and machine is not None:
        machine = _with_all_on(machine, before)
    drafts = [one for one in files.drafts if one.written]
    lines = [line for one in drafts if (line := one.line(job, machine))]
    return dataclasses.replace(
        before,
        lists=_lists(number, listing, machine),
        reading=dataclasses.replace(
            before.reading, lines={number: lines[-1]} if lines else {}
        ),
    )


def acting_alone(job: Job, draft: AbstractDraft) -> Loaded:
    """Return what one fit adds, as if it were all that acts on its axis."""
    number = job.spec.axes[draft.axis].number
    entries = draft.entries(job)
    listing = new_list({"kopf.achs_nr": number} | entries) if entries else None
    return Loaded(
        number,
        _lists(number, _read_back(listing), None),
        reading_of(job),
    )


def reading_of(job: Job) -> Reading:
    """Return how the lists of a job are read, what waits for COMP ON as switched on."""
    return Reading(job.conventions, job.increments, job.ranges, commanded=True)


def _lists(
    number: int, listing: ListFile | None, machine: ListFile | None
) -> tuple[ListFile, ...]:
    pairs = ("compensation", listing), ("axis", machine)
    return tuple(
        # The job says whose list it is where the file does not.
        one if one.integer("kopf.achs_nr") else one.merge({"kopf.achs_nr": number})
        for kind, one in pairs
        if one is not None and one.kind == kind
    )


def _read_back(listing: ListFile | None) -> ListFile | None:
    """Return a list as its bytes read."""
    return None if listing is None else ListFile.parse(listing.dumps(), listing.source)


def _with_all_on(fragment: ListFile, before: Loaded) -> ListFile:
    """Return the entries to add to an axis list beside what the list may switch on.

    What the axis list itself says nobody knows: all that the compensation list holds is
    taken to act.
    """
    known = {one.name for one in kinds() if fragment.get(one.activation) is not None}
    tables = [name for name in before.used if name not in known]
    return fragment.merge(entries_of_activation(tables))
