"""The lists of an axis after its fits: edited entry by entry, or new."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ...data.lists import Finding, ListFile, Value, new_list
from ..exchange import ExchangeError
from ._fitting import Fitted
from ._fragments import machine_list
from ._load import Job
from ._result import Remark


@dataclasses.dataclass(frozen=True)
class AxisFiles:
    """What is written for one axis.

    Attributes:
        axis: Name in the job.
        compensation: The compensation list; `compensation_name` its file name.
        compensation_name: See `compensation`.
        machine: The axis list, or the entries to add to it; `machine_name` likewise.
        machine_name: See `machine`.
        is_new: There was no compensation list before.
        restart: Why the controller must be restarted, or None where a reload is enough.
        remarks: What the user must know.
        findings: What `check` says of both; empty until `judge_files`.
    """

    axis: str
    compensation: ListFile
    compensation_name: str
    machine: ListFile
    machine_name: str
    is_new: bool
    restart: str | None
    remarks: tuple[Remark, ...]
    findings: tuple[Finding, ...] = ()


def axis_files(
    job: Job, axis: str, fitted: Sequence[Fitted], cycles: int | None
) -> AxisFiles:
    """Return the lists of one axis with all its new tables.

    Args:
        job: The job.
        axis: Its name in the job.
        fitted: The fits of this axis.
        cycles: Value of P-AXIS-00243, where a table has two directions.

    Raises:
        JobError: If a table does not fit into a list of the controller's build, or
            is not found again in it.
    """
    spec = job.spec.axes[axis]
    plan = fitted[0].plan
    name = f"achskw{spec.number}.lis"
    entries: dict[str, Value] = {}
    for one in fitted:
        entries |= _entries_of(job, one)
    remarks: list[Remark] = []
    if plan.existing is None:
        head: dict[str, Value] = {
            "kopf.achs_nr": spec.number,
            "kopf.log_achs_name": spec.name or axis,
        }
        listing = new_list(
            head | entries,
            comment=(
                f"Compensation list of axis {spec.name or axis}, written by axcomp",
                f"Job: {job.spec.title or job.path.name}",
            ),
        )
        remarks.append(
            Remark(
                "info",
                f"{name} is a new list, since no list of {axis} was given: copied over"
                " another one, it would lose that one's other compensations.",
            )
        )
    else:
        listing, more = _edited(plan.existing, spec.number, entries, fitted)
        remarks += more
    listing = dataclasses.replace(listing, source=name)
    for one in fitted:
        _refuse_misread(job, listing, one)
    machine, machine_name, more = machine_list(job, axis, fitted, cycles)
    remarks += more
    return AxisFiles(
        axis=axis,
        compensation=listing,
        compensation_name=name,
        machine=machine,
        machine_name=machine_name,
        is_new=plan.existing is None,
        restart=_restart(plan.existing, listing, fitted),
        remarks=tuple(remarks),
    )


def _entries_of(job: Job, one: Fitted) -> dict[str, Value]:
    """Return the entries of one table, with the options of its fit."""
    plan = one.plan
    spec, prefix = plan.fit, plan.table.prefix
    try:
        found: dict[str, Value] = dict(
            plan.table.entries(
                one.integers,
                existing=plan.existing,
                max_points=spec.max_points,
                build=job.spec.controller.build,
            )
        )
    except ExchangeError as error:
        raise job.error(("fits", plan.index), str(error)) from None
    options = {
        "n_cycles": spec.n_cycles,
        "manual_activation": spec.manual_activation,
    }
    sizes = {key: value for key, value in found.items() if "[" not in key}
    table = {key: value for key, value in found.items() if "[" in key}
    chosen = {
        f"{prefix}.{key}": int(value)
        for key, value in options.items()
        if value is not None
    }
    return sizes | chosen | table


def _edited(
    existing: ListFile,
    number: int,
    entries: Mapping[str, Value],
    fitted: Sequence[Fitted],
) -> tuple[ListFile, list[Remark]]:
    """Return an existing list with new entries, and what was added to it."""
    prefixes = tuple(f"{one.plan.table.prefix}.table[" for one in fitted)
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
        remarks.append(
            Remark("info", f"Added to {existing.source}: {', '.join(words)}.")
        )
    if stale:
        remarks.append(
            Remark(
                "info",
                f"Removed from {existing.source}: {len(stale)} table entries beyond"
                " the new table.",
            )
        )
    return edited, remarks


def _refuse_misread(job: Job, listing: ListFile, one: Fitted) -> None:
    """Raise where the bytes to be written, read back, are not the table that was fitted.

    Raises:
        JobError: Naming the list; nothing has been written then.
    """
    table = one.plan.table
    back = table.read(ListFile.parse(listing.dumps(), listing.source))
    if not np.array_equal(table.to_integers(table.at_nodes(back)), one.integers):
        raise job.error(
            ("fits", one.plan.index),
            f"found another table in {listing.source} when it was read back, expected"
            " the one that was fitted",
        )


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
    existing: ListFile | None, listing: ListFile, fitted: Sequence[Fitted]
) -> str | None:
    """Return why a restart is needed, or None where a reload is enough."""
    if existing is None:
        return "the list is new to the controller (hochlauf.lis names it)"
    for one in fitted:
        name = f"{one.plan.table.prefix}.max_points"
        if existing.integer(name) != listing.integer(name):
            number = {"cross": 110639, "plane": 110640}.get(
                one.plan.table.compensation, 110638
            )
            return f"{name} changes (a reload would end in error {number})"
    return None
