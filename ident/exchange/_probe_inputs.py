"""What lists that are loaded now say for a probe: compensations, axes and travel."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...data.lists import ListFile
from ...models import Conventions
from ._controller import model_of
from ._identity import Increments
from ._machine_lists import Reading, machine_lists
from ._probe import Probed

Travel = tuple[float, float]


def probed_in(lists: Sequence[ListFile], conventions: Conventions) -> list[Probed]:
    """Return what lists hold and can be probed; tables whether active or not.

    Friction is probed where a list holds it, at a low level of it: a current that nobody
    measured must not be put on a drive.

    Raises:
        ExchangeError: If an axis has two lists, or a table does not name its master.
    """
    machine = machine_lists(lists)
    tables = dataclasses.replace(machine, machine={}).in_use(conventions)
    lines = dataclasses.replace(machine, compensation={}).in_use(conventions)
    return [one.kind.probe.probed(one) for one in (*tables, *lines)]


def travel_in(
    lists: Sequence[ListFile], conventions: Conventions, increment: Increments = None
) -> dict[int, Travel]:
    """Return over which positions in mm or ° the tables of the lists go, by axis.

    Raises:
        ExchangeError: If a list makes no table.
    """
    machine = dataclasses.replace(machine_lists(lists), machine={})
    found: dict[int, list[float]] = {}
    for one in machine.in_use(conventions):
        if not one.kind.table:
            continue
        ways = model_of(one, Reading(conventions, increment)).ways
        for axis, nodes in zip(one.masters, ways, strict=True):
            places = np.asarray(nodes.positions, dtype=float)
            found.setdefault(axis, []).extend((places[0], places[-1]))
    return {axis: (float(min(p)), float(max(p))) for axis, p in found.items()}
