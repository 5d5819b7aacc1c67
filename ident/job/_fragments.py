"""What goes into axis and start-up lists: edited lists, or named fragments of them."""

import dataclasses
from collections.abc import Sequence

from ...data.lists import ListFile, Value, new_list
from ._draft import AbstractDraft
from ._load import Job
from ._result import Remark


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
