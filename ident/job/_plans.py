"""Every fit of a job, planned, and the lists that are there already."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...data.lists import ListFile
from ..exchange import ExchangeError, axis_number
from ..readings import Tables
from ._checks import groups_of
from ._draft import AbstractDraft, AxisLists, Planned
from ._load import Job

if TYPE_CHECKING:
    from .joint import GroupPlan

_TABLES = ("kw.", "frict_comp.")
"""What only a compensation list holds."""


@dataclasses.dataclass(frozen=True)
class Plans:
    """Every fit of a job, planned.

    Attributes:
        single: Those that are fitted alone, by index.
        groups: Those that are identified together.
        lists: What the axes have already.
    """

    single: Mapping[int, Planned]
    groups: tuple["GroupPlan", ...]
    lists: Mapping[str, AxisLists]


def plan_all(job: Job, tables: Tables) -> Plans:
    """Return every fit of a job, planned: nothing is fitted yet.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
    """
    lists = existing_lists(job)
    grouped = groups_of(job.spec)
    together = {index for own in grouped.values() for index in own}
    _refuse_streams(job, together)
    groups: tuple[GroupPlan, ...] = ()
    if grouped:
        from .joint import plan_groups

        groups = plan_groups(job, tables, lists)
    single = {
        index: fit.kind.single.plan(job, tables, index, fit, lists[fit.axis])
        for index, fit in enumerate(job.spec.fits)
        if index not in together
    }
    return Plans(single, groups, lists)


def _refuse_streams(job: Job, grouped: set[int]) -> None:
    """Raise where a log is to be read in pieces for a fit that needs the whole of it.

    Raises:
        JobError: Naming the measurement.
    """
    for index, fit in enumerate(job.spec.fits):
        if index not in grouped and fit.kind.table:
            continue
        for name in fit.sources:
            if job.spec.measurements[name].stream is True:
                whose = f"the {fit.compensation} fit of {fit.axis}"
                whose += " in a group" if index in grouped else ""
                raise job.error(
                    ("measurements", name, "stream"),
                    f"found true, but {whose} needs its log in memory, expected it for"
                    " plane, cross and leadscrew fits of their own",
                )


def existing_lists(job: Job) -> dict[str, AxisLists]:
    """Return the lists that the axes have already, by axis.

    Raises:
        JobError: If a file is another kind of list, or that of another axis.
    """
    found = {}
    for name, axis in job.spec.axes.items():
        pair = {"list": axis.listing, "machine_data": axis.machine_data}
        read: dict[str, ListFile | None] = {}
        for key, file in pair.items():
            read[key] = None
            if file is not None:
                listing = ListFile.read(job.file(file))
                _refuse_other_kind(job, name, key, listing)
                _refuse_other_axis(job, name, key, listing)
                read[key] = listing
        found[name] = AxisLists(read["list"], read["machine_data"])
    return found


def _refuse_other_kind(job: Job, name: str, key: str, listing: ListFile) -> None:
    """Raise where a file is none of the lists that the key asks for.

    An axis list edited as a compensation list, or a table of readings, would come back
    looking like a valid one. An empty list, or one of comments, is one to be filled.
    """
    expected = {"list": "compensation", "machine_data": "axis"}[key]
    kind = listing.kind
    if kind == expected or not any(map(_says_something, listing.lines)):
        return
    if expected == "axis" and listing.entries and kind != "startup":
        # Its header alone counts as that of a compensation list, and most of its
        # entries are none that the manuals name.
        if not any(one.key.startswith(_TABLES) for one in listing.entries):
            return
    words = f"a{'n' if kind == 'axis' else ''} {kind} list"
    if kind == "unknown":
        words = "none of the entries of such a list"
    raise job.error(
        ("axes", name, key),
        f"found {words} in {listing.source}, expected a"
        f"{'n' if expected == 'axis' else ''} {expected} list",
    )


def _says_something(line: str) -> bool:
    text = line.strip()
    return bool(text) and not text.startswith(("#", ";", "(", "//", "/*"))


def _refuse_other_axis(job: Job, name: str, key: str, listing: ListFile) -> None:
    number = job.spec.axes[name].number
    try:
        found = axis_number(listing)
    except ExchangeError:
        return  # The file does not say; the job does.
    stated = listing.integer("kopf.achs_nr")
    if stated is not None and found != number:
        raise job.error(
            ("axes", name, key),
            f"found a list of axis {found} (kopf.achs_nr), expected axis {number}",
        )


def left_out(job: Job, plans: Plans, k: int, why: str) -> AbstractDraft:
    """Return what stands for a fit that its readings do not tell: the rest is written."""
    from .joint import LeftOutDraft

    spec = job.spec.fits[k]
    return LeftOutDraft(k, spec, plans.lists[spec.axis], why)


def untold_alone(job: Job, tables: Tables, plans: Plans) -> dict[int, str]:
    """Return which fits of no group their readings do not tell apart, and why."""
    fits = job.spec.fits
    several = len({fits[k].axis for k in plans.single}) < len(plans.single)
    if not several and not any(fits[k].kind.often_open for k in plans.single):
        return {}
    from .joint import untold_apart

    return untold_apart(job, tables, list(plans.single), plans.lists)
