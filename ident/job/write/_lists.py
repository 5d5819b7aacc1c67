"""The lists of an axis after its fits: edited entry by entry, or new, and checked."""

import dataclasses
import functools
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ....data.lists import Finding, ListFile, Value, check, compare, new_list
from ...exchange import (
    AxisLists,
    axis_file,
    compensation_file,
    entries_of_activation,
    to_add,
    with_tables,
)
from ...kinds import kind
from ...proof import GateCheck
from .._draft import AbstractDraft
from .._gating import fit_checks, gate_remarks
from ..file._load import Job
from ..result._job_result import WholeAxis
from ..result._result import Remark


@dataclasses.dataclass(frozen=True)
class AxisFiles:
    """One axis from its drafts to its files.

    Attributes:
        existing: What it has already.
        drafts: All its fits, in the order of the job.
        cycles: Value of P-AXIS-00243, where a fit asks for one.
        gates: What the gate says of each fit, by its index; empty where it is not written.
        compensation: The compensation list, or None where no fit needs one; once it is
            written, as it was read back.
        machine: The axis list, or the entries to add to it, or None likewise.
        extra: Further files by name, such as those for the PLC.
        restart: Why the controller must be restarted, or None where a reload is enough.
        remarks: What the user must know.
        findings: What `check` says of both; empty until `judge_files`.
        same: Names of lists that say what the controller's own ones say already.
        root: Folder of the written files.
        written: Their names in it, the compensation list first where there is one; empty
            until they are written.
    """

    axis: str
    existing: AxisLists
    drafts: tuple[AbstractDraft, ...]
    cycles: int | None
    gates: Mapping[int, tuple[GateCheck, ...]]
    compensation: ListFile | None
    machine: ListFile | None
    extra: Mapping[str, bytes]
    restart: str | None
    remarks: tuple[Remark, ...]
    findings: tuple[Finding, ...] = ()
    same: frozenset[str] = frozenset()
    root: Path = Path()
    written: tuple[Path, ...] = ()

    @property
    def number(self) -> int:
        """Its logical number."""
        return self.existing.axis

    @property
    def compensation_name(self) -> str:
        """File name of the compensation list."""
        return compensation_file(self.number)

    @property
    def machine_name(self) -> str:
        """File name of the axis list, or of the entries to add to it."""
        return axis_file(self.number, whole=self.existing.machine is not None)

    @property
    def is_new(self) -> bool:
        """Whether there was no compensation list before."""
        return self.compensation is not None and self.existing.compensation is None

    @property
    def lists(self) -> tuple[tuple[str, ListFile], ...]:
        """What is there to write, by name, the compensation list first."""
        pairs = (
            (self.compensation_name, self.compensation),
            (self.machine_name, self.machine),
        )
        return tuple((name, listing) for name, listing in pairs if listing is not None)

    @functools.cached_property
    def after(self) -> AxisLists:
        """What the axis has with these files, as they will be read."""
        before, machine = self.existing, read_back(self.machine)
        if before.machine is None and machine is not None:
            # What the axis list itself says nobody knows: all that the compensation list
            # holds is taken to act.
            tables = [k for k in before.used if machine.get(kind(k).activation) is None]
            machine = machine.merge(entries_of_activation(tables))
        machine = machine or before.machine
        drafts = [draft for draft in self.drafts if draft.written]
        lines = [line for draft in drafts if (line := draft.line(machine))]
        own_line = {self.number: lines[-1]} if lines else {}
        reading = dataclasses.replace(before.reading, lines=own_line)
        compensation = read_back(self.compensation) or before.compensation
        return AxisLists(self.number, compensation, machine, reading)

    @property
    def failed(self) -> bool:
        """Whether its lists must not be loaded."""
        checks = [check for gate in self.gates.values() for check in gate]
        error = any(remark.level == "error" for remark in self.remarks)
        return error or not all(check.passed for check in checks)

    def judged(self, whole: WholeAxis) -> "AxisFiles":
        """Return it with what was found of the axis as a whole.

        A list is let out with all that acts on its axis, or not at all: every fit that is
        written has the lines of its axis.
        """
        drafts = {draft.index: draft for draft in self.drafts}
        gates = {
            k: (*gate, *whole.gate) if drafts[k].written else gate
            for k, gate in self.gates.items()
        }
        remarks = (*self.remarks, *whole.remarks)
        return dataclasses.replace(self, gates=gates, remarks=remarks)

    def as_written(self, root: Path, names: Sequence[Path]) -> "AxisFiles":
        """Return it with the lists as they lie in a folder, read back."""
        done = dataclasses.replace(self, root=root, written=tuple(names))
        files = done.path(self.compensation_name), done.path(self.machine_name)
        lists = [None if file is None else ListFile.read(file) for file in files]
        return dataclasses.replace(done, compensation=lists[0], machine=lists[1])

    def path(self, name: str) -> Path | None:
        """Return where a written file lies, or None."""
        path = next((file for file in self.written if file.name == name), None)
        return None if path is None else self.root / path


def read_back(listing: ListFile | None) -> ListFile | None:
    """Return a list as its bytes read."""
    return None if listing is None else ListFile.parse(listing.dumps(), listing.source)


def files_of(job: Job, drafts: Sequence[AbstractDraft]) -> tuple[AxisFiles, ...]:
    """Return what is written for each axis."""
    axes = dict.fromkeys(draft.axis for draft in drafts)
    return tuple(
        _axis_files(job, tuple(draft for draft in drafts if draft.axis == axis))
        for axis in axes
    )


def with_cycles(job: Job, files: AxisFiles, least: int) -> AxisFiles:
    """Return judged files whose axis list spreads a reversal over at least so many cycles."""
    spread = _axis_files(job, files.drafts, least)
    # Of nothing else are there other findings.
    return dataclasses.replace(spread, findings=files.findings, remarks=files.remarks)


def _axis_files(
    job: Job, every: tuple[AbstractDraft, ...], least: int = 0
) -> AxisFiles:
    axis, lists = every[0].axis, every[0].lists
    drafts = [draft for draft in every if draft.written]
    spreads = [spread for draft in drafts if (spread := draft.cycles) is not None]
    cycles = max(least, *spreads) if spreads else None
    gates = {
        d.index: (*d.gate(cycles), *fit_checks(d)) if d.written else () for d in every
    }
    entries, machine_entries = dict[str, Value](), dict[str, Value]()
    extra, remarks = dict[str, bytes](), list[Remark]()
    for draft in drafts:
        with job.blaming(("fits", draft.index)):
            entries |= draft.entries()
            machine_entries |= draft.machine_entries(cycles)
        extra |= draft.extra_files()
        remarks += draft.machine_remarks()
        remarks += gate_remarks(draft, gates[draft.index], drafts)
    listing, machine = None, None
    if entries:
        listing, notes = _listing(job, drafts, entries)
        remarks = [*notes, *remarks]
    existing = lists.machine
    if machine_entries and existing is None:
        machine = to_add(lists.axis, machine_entries, of=axis)
    elif machine_entries and existing is not None:
        machine = existing.merge(machine_entries)
        machine = dataclasses.replace(machine, source=axis_file(lists.axis))
        if added := [entry for entry in machine_entries if existing.get(entry) is None]:
            words = f"Added to {existing.source}: {', '.join(added)}."
            remarks.append(Remark.info(words))
    pairs = (lists.compensation, listing), (lists.machine, machine)
    both = [(old, new) for old, new in pairs if old is not None and new is not None]
    diffs = {new.source: compare(old, new) for old, new in both}
    reasons = [reason for diff in diffs.values() for reason in diff.reasons]
    if listing is not None and lists.compensation is None:
        reasons = ["the list is new to the controller (hochlauf.lis names it)"]
    elif listing is None and machine is not None and lists.machine is None:
        reasons = ["axis lists are not updated at run time"]
    return AxisFiles(
        axis=axis,
        existing=lists,
        drafts=every,
        cycles=cycles,
        gates=gates,
        compensation=listing,
        machine=machine,
        extra=extra,
        restart=reasons[0] if reasons else None,
        remarks=tuple(remarks),
        same=frozenset(name for name, diff in diffs.items() if diff.action == "none"),
    )


def _listing(
    job: Job, drafts: Sequence[AbstractDraft], entries: Mapping[str, Value]
) -> tuple[ListFile, list[Remark]]:
    """Return the compensation list of an axis, edited or new, and what changed in it."""
    axis, existing = drafts[0].axis, drafts[0].lists.compensation
    spec = job.spec.axes[axis]
    name = spec.name or axis[:16]
    edited = with_tables(
        existing,
        spec.number,
        entries,
        f"Compensation list of axis {name}, written by axcomp",
        f"Job: {job.spec.title or job.path.name}",
        name=name,
    )
    listing = edited.listing
    if existing is None:
        words = (
            f"{listing.source} is a new list, since no list of {axis} was given: copied over"
            " another one, it would lose that one's other compensations."
        )
        return listing, [Remark.info(words)]
    remarks = []
    if edited.added:
        plain = [name for name in edited.added if "[" not in name]
        rows = len(edited.added) - len(plain)
        names = ", ".join([*plain, *[f"{rows} table entries"] * bool(rows)])
        remarks.append(Remark.info(f"Added to {existing.source}: {names}."))
    if edited.removed:
        words = f"{len(edited.removed)} table entries beyond the new table."
        remarks.append(Remark.info(f"Removed from {existing.source}: {words}"))
    return listing, remarks


def startup_fragment(files: Sequence[AxisFiles]) -> ListFile | None:
    """Return the start-up entries of new lists that are let out, or None."""
    fresh = [axis for axis in files if axis.is_new and not axis.failed]
    if not fresh:
        return None
    values: dict[str, Value] = {"zahl_kw": len(fresh)}
    for k, axis in enumerate(fresh):
        values[f"achs_kw_log_ax_nr[{k}]"] = axis.number
        values[f"achs_kw[{k}]"] = axis.compensation_name
    fragment = new_list(
        values,
        comment=(
            "Entries to add to hochlauf.lis: no whole start-up list.",
            "Count on from the indices that are there, and raise zahl_kw by"
            f" {len(fresh)}.",
        ),
    )
    return dataclasses.replace(fragment, source="hochlauf.add.lis")


def judge_files(
    job: Job, files: Sequence[AxisFiles]
) -> tuple[tuple[AxisFiles, ...], tuple[Remark, ...]]:
    """Return the lists with their findings, and what the set as a whole has.

    New lists are judged beside the existing ones of the other axes. What stood in the
    user's lists before is named as such; an error that is new fails the list.
    """
    existing = [
        (axis, listing)
        for axis, listed in job.lists.items()
        for listing in (listed.compensation, listed.machine)
        if listing is not None
    ]
    theirs = [listing for _, listing in existing]
    fitted = {axis.axis for axis in files}
    others = [listing for axis, listing in existing if axis not in fitted]
    ours = [listing for axis in files for _, listing in axis.lists]
    known = {_identity(item) for item in _check(job, theirs)} if theirs else set()
    findings = _check(job, [*ours, *others])
    judged = []
    for axis in files:
        names = [name for name, _ in axis.lists]
        listed = tuple(item for item in findings if item.file in names)
        remarks = (*axis.remarks, *_remarks(listed, known))
        judged.append(dataclasses.replace(axis, findings=listed, remarks=remarks))
    rest = [item for item in findings if item.file in {one.source for one in others}]
    new = [item for item in rest if _identity(item) not in known]
    return tuple(judged), tuple(_remarks(new, known))


def _check(job: Job, lists: Sequence[ListFile]) -> list[Finding]:
    axes = job.spec.axes
    pairs = [
        (axis.number, axes[axis.gantry].number)
        for axis in axes.values()
        if axis.gantry is not None
    ]
    build, index = job.spec.controller.build, job.conventions.plane_index
    return check(lists, build=build, gantry=pairs, plane_index=index, modulo=job.ranges)


def _identity(item: Finding) -> tuple[str | None, str, str]:
    # Without the line, which an edit may move.
    return item.id, item.message, item.found


def _remarks(
    findings: Iterable[Finding], earlier: set[tuple[str | None, str, str]]
) -> Iterable[Remark]:
    for item in findings:
        if item.level == "info":
            continue
        if _identity(item) in earlier:
            yield Remark.warning(f"Was in your list before and stays: {item}")
        else:
            yield Remark("error" if item.level == "error" else "warning", str(item))
