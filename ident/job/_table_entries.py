"""The list entries of one fitted table, and whether a list holds it when read back."""

import numpy as np

from ...data.lists import ListFile, Value
from ..exchange import ExchangeError
from ._fitting import AbstractFitted
from ._load import Job
from ._switching import chosen_cycles

_RESIZED = {"cross": 110639, "plane": 110640, "leadscrew": 110638}
"""Error of the controller when `max_points` changes after start-up."""


def table_entries(job: Job, one: AbstractFitted) -> dict[str, Value]:
    """Return the entries of one table, with the options of its fit.

    Raises:
        JobError: If it fits no list of the controller's build.
    """
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
        "n_cycles": chosen_cycles(job, one),
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


def refuse_misread(job: Job, listing: ListFile, one: AbstractFitted) -> None:
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


def restart_of_table(
    existing: ListFile, listing: ListFile, one: AbstractFitted
) -> str | None:
    """Return why a table needs a restart, or None where a reload is enough."""
    table = one.plan.table
    name = f"{table.prefix}.max_points"
    if existing.integer(name) == listing.integer(name):
        return None
    number = _RESIZED[table.compensation]
    return f"{name} changes (a reload would end in error {number})"
