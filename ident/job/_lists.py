"""The lists of an axis after its fits: edited entry by entry, or new."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...data.lists import Finding, ListFile, Value, compare, new_list
from ._draft import AbstractDraft
from ._load import Job
from ._result import Remark


@dataclasses.dataclass(frozen=True)
class AxisFiles:
    """What is written for one axis.

    Attributes:
        axis: Name in the job.
        compensation: The compensation list, or None where no fit needs one.
        compensation_name: Its file name.
        machine: The axis list, or the entries to add to it, or None likewise.
        machine_name: Its file name.
        extra: Further files by name, such as those for the PLC.
        is_new: There was no compensation list before.
        restart: Why the controller must be restarted, or None where a reload is enough.
        remarks: What the user must know.
        findings: What `check` says of both; empty until `judge_files`.
        same: Names of lists that say what the controller's own ones say already.
    """

    axis: str
    compensation: ListFile | None
    compensation_name: str
    machine: ListFile | None
    machine_name: str
    extra: Mapping[str, bytes]
    is_new: bool
    restart: str | None
    remarks: tuple[Remark, ...]
    findings: tuple[Finding, ...] = ()
    same: frozenset[str] = frozenset()

    @property
    def lists(self) -> tuple[tuple[str, ListFile], ...]:
        """What is there to write, by name, the compensation list first."""
        pairs = (
            (self.compensation_name, self.compensation),
            (self.machine_name, self.machine),
        )
        return tuple((name, one) for name, one in pairs if one is not None)

    def of_lists(self, written: Sequence[Path]) -> tuple[Path, ...]:
        """Return those of the written files that are lists, not the PLC's."""
        return tuple(file for file in written if file.name not in self.extra)


def axis_files(
    job: Job, axis: str, drafts: Sequence[AbstractDraft], cycles: int | None
) -> AxisFiles:
    """Return the lists of one axis with all that was fitted for it.

    Args:
        job: The job.
        axis: Its name in the job.
        drafts: The fits of this axis.
        cycles: Value of P-AXIS-00243, where a fit asks for one.

    Raises:
        JobError: If a table does not fit into a list of the controller's build, or
            is not found again in it.
    """
    name = f"achskw{job.spec.axes[axis].number}.lis"
    lists = drafts[0].lists
    existing = lists.compensation
    drafts = [one for one in drafts if one.written]
    entries: dict[str, Value] = {}
    for one in drafts:
        entries |= one.entries(job)
    listing, remarks = None, list[Remark]()
    if entries and existing is None:
        listing = _new(job, axis, entries)
        remarks.append(
            Remark.info(
                f"{name} is a new list, since no list of {axis} was given: copied over"
                " another one, it would lose that one's other compensations."
            )
        )
    elif entries and existing is not None:
        number = job.spec.axes[axis].number
        listing, more = _edited(existing, number, entries, drafts)
        remarks += more
    if listing is not None:
        listing = dataclasses.replace(listing, source=name)
        for one in drafts:
            one.refuse_misread(job, listing)
    machine, machine_name, more = machine_list(job, axis, lists.machine, drafts, cycles)
    pairs = (existing, listing), (lists.machine, machine)
    same = {
        new.source
        for old, new in pairs
        if old is not None and new is not None and compare(old, new).action == "none"
    }
    remarks += more
    extra: dict[str, bytes] = {}
    for one in drafts:
        extra |= one.extra_files(job)
    return AxisFiles(
        axis=axis,
        compensation=listing,
        compensation_name=name,
        machine=machine,
        machine_name=machine_name,
        extra=extra,
        is_new=listing is not None and existing is None,
        restart=_restart(pairs, drafts),
        remarks=tuple(remarks),
        same=frozenset(same),
    )


def _new(job: Job, axis: str, entries: Mapping[str, Value]) -> ListFile:
    spec = job.spec.axes[axis]
    name = spec.name or axis
    head: dict[str, Value] = {
        "kopf.achs_nr": spec.number,
        "kopf.log_achs_name": name,
    }
    return new_list(
        head | dict(entries),
        comment=(
            f"Compensation list of axis {name}, written by axcomp",
            f"Job: {job.spec.title or job.path.name}",
        ),
    )


def _edited(
    existing: ListFile,
    number: int,
    entries: Mapping[str, Value],
    drafts: Sequence[AbstractDraft],
) -> tuple[ListFile, list[Remark]]:
    """Return an existing list with new entries, and what was added to it."""
    prefixes = tuple(prefix for one in drafts for prefix in one.replaces)
    there = _names(existing)
    stale = [
        name for name in there if name.startswith(prefixes) and name not in entries
    ]
    wanted = dict(entries)
    if "kopf.achs_nr" not in there:
        wanted = {"kopf.achs_nr": number} | wanted
    added = [name for name in wanted if name not in there]
    edited = existing.remove(stale).merge(wanted)
    remarks: list[Remark] = []
    plain = [name for name in added if "[" not in name]
    rows = len(added) - len(plain)
    if added:
        words = plain + ([f"{rows} table entries"] if rows else [])
        remarks.append(Remark.info(f"Added to {existing.source}: {', '.join(words)}."))
    if stale:
        remarks.append(
            Remark.info(
                f"Removed from {existing.source}: {len(stale)} table entries beyond"
                " the new table."
            )
        )
    return edited, remarks


def _names(listing: ListFile) -> dict[str, None]:
    """Return the canonical names of all entries, in order of their keys."""
    found: dict[str, None] = {}
    for key, rows in listing.columns.items():
        parts = key.split("[]")
        for indices in rows.last:
            name = parts[0]
            for index, part in zip(indices, parts[1:], strict=True):
                name += f"[{index}]{part}"
            found[name] = None
    return found


def _restart(
    pairs: Sequence[tuple[ListFile | None, ListFile | None]],
    drafts: Sequence[AbstractDraft],
) -> str | None:
    """Return why a restart is needed, or None where a reload is enough.

    Args:
        pairs: The compensation list and the axis list, each before and after.
        drafts: The fits of this axis.
    """
    existing, listing = pairs[0]
    if listing is not None and existing is None:
        return "the list is new to the controller (hochlauf.lis names it)"
    reasons: list[str | None] = []
    if existing is not None and listing is not None:
        reasons += [one.restart(existing, listing) for one in drafts]
    for old, new in pairs:
        if old is not None and new is not None:
            reasons += compare(old, new).reasons
    return next((reason for reason in reasons if reason is not None), None)


def machine_list(
    job: Job,
    axis: str,
    existing: ListFile | None,
    drafts: Sequence[AbstractDraft],
    cycles: int | None,
) -> tuple[ListFile | None, str, list[Remark]]:
    """Return the axis list, edited, or just the entries to add to it.

    Args:
        job: The job.
        axis: Its name in the job.
        existing: The axis list that is there, or None.
        drafts: The fits of this axis that are written.
        cycles: Value of P-AXIS-00243, where a fit asks for one.

    Returns:
        The list or None where nothing is to be set, its file name, and what the user
        must know.
    """
    number = job.spec.axes[axis].number
    values: dict[str, Value] = {}
    remarks: list[Remark] = []
    for one in drafts:
        values |= one.machine_entries(job, cycles)
        remarks += one.machine_remarks()
    if existing is not None:
        name = f"achsmds{number}.lis"
        if not values:
            return None, name, remarks
        edited = existing.merge(values)
        if added := [entry for entry in values if existing.get(entry) is None]:
            words = f"Added to {existing.source}: {', '.join(added)}."
            remarks.append(Remark.info(words))
        return dataclasses.replace(edited, source=name), name, remarks
    name = f"achsmds{number}.add.lis"
    if not values:
        return None, name, remarks
    fragment = new_list(
        values,
        comment=(
            f"Entries to set in achsmds{number}.lis of axis {axis}: no whole axis list",
        ),
    )
    return dataclasses.replace(fragment, source=name), name, remarks


def startup_fragment(job: Job, fresh: Sequence[tuple[str, str]]) -> ListFile | None:
    """Return the start-up entries of new lists, or None where there are none.

    Args:
        job: The job.
        fresh: Axis and file name of each new list.
    """
    if not fresh:
        return None
    values: dict[str, Value] = {"zahl_kw": len(fresh)}
    for k, (axis, name) in enumerate(fresh):
        values[f"achs_kw_log_ax_nr[{k}]"] = job.spec.axes[axis].number
        values[f"achs_kw[{k}]"] = name
    fragment = new_list(
        values,
        comment=(
            "Entries to add to hochlauf.lis: no whole start-up list.",
            "Count on from the indices that are there, and raise zahl_kw by"
            f" {len(fresh)}.",
        ),
    )
    return dataclasses.replace(fragment, source="hochlauf.add.lis")
