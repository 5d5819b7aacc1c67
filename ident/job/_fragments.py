"""What goes into axis and start-up lists: edited lists, or named fragments of them."""

import dataclasses
from collections.abc import Sequence

from ...data.lists import ListFile, Value, new_list
from ._fitting import Fitted
from ._load import Job
from ._result import Remark


def machine_list(
    job: Job, axis: str, fitted: Sequence[Fitted], cycles: int | None
) -> tuple[ListFile, str, list[Remark]]:
    """Return the axis list, edited, or just the entries to add to it.

    Args:
        job: The job.
        axis: Its name in the job.
        fitted: The fits of this axis.
        cycles: Value of P-AXIS-00243, where a table has two directions.

    Returns:
        The list, its file name, and what the user must know.
    """
    number = job.spec.axes[axis].number
    values: dict[str, Value] = {one.plan.table.activation: 1 for one in fitted}
    existing = fitted[0].plan.axis_list
    remarks: list[Remark] = []
    if cycles is not None:
        # A bilateral table contains the backlash; the parameter beside it would
        # compensate it twice.
        values |= {"lr_param.anwahl_losekomp": 0, "lr_param.n_backlash_cyc": cycles}
        if existing is not None and existing.integer("lr_param.anwahl_losekomp"):
            remarks.append(
                Remark(
                    "warning",
                    f"{existing.source}: backlash compensation is switched off"
                    " (anwahl_losekomp 0), since the bilateral leadscrew table"
                    " contains the backlash.",
                )
            )
    if existing is not None:
        name = f"achsmds{number}.lis"
        edited = existing.merge(values)
        if added := [entry for entry in values if existing.get(entry) is None]:
            words = f"Added to {existing.source}: {', '.join(added)}."
            remarks.append(Remark("info", words))
        return dataclasses.replace(edited, source=name), name, remarks
    name = f"achsmds{number}.add.lis"
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
