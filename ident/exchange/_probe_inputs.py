"""What lists that are loaded now say for a probe: compensations, axes and travel."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...data.lists import ListFile
from ...models import AbstractNodes, Conventions
from ._cross import cross_from_list
from ._identity import Increments, optional
from ._leadscrew import leadscrew_from_list
from ._machine_lists import machine_lists
from ._plane import plane_from_list
from ._probe import DEFAULT_ACCELERATION, Probed

PROBED = ("cross", "plane", "leadscrew", "crosstalk", "temperature", "backlash")
"""Friction is left out: a current that nobody measured must not be put on a drive."""

Travel = tuple[float, float]


def probed_in(lists: Sequence[ListFile], conventions: Conventions) -> list[Probed]:
    """Return what lists hold and can be probed; tables whether active or not.

    Raises:
        ExchangeError: If an axis has two lists, or a table does not name its master.
    """
    machine = machine_lists(lists)
    tables = dataclasses.replace(machine, machine={}).in_use(conventions)
    lines = dataclasses.replace(machine, compensation={}).in_use(conventions)
    found = []
    for one in (*tables, *lines):
        if one.name == "crosstalk":
            rate = optional(one.listing, "kw.crosstalk.acceleration")
            rate = rate if rate > 0 else DEFAULT_ACCELERATION
            found.append(Probed(one.axis, one.name, one.masters[:1], rate))
        elif one.name in PROBED:
            found.append(Probed(one.axis, one.name, one.masters))
    return found


def names_in(lists: Sequence[ListFile]) -> dict[int, str]:
    """Return the name of each axis that a list gives one (``kopf.log_achs_name``)."""
    machine = machine_lists(lists)
    found = {}
    for number, listing in (*machine.machine.items(), *machine.compensation.items()):
        name = listing.text("kopf.log_achs_name")
        if name is not None:
            found[number] = name
    return found


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
        ways: tuple[AbstractNodes, ...]
        if one.name == "cross":
            ways = (cross_from_list(one.listing, conventions, increment).nodes,)
        elif one.name == "plane":
            plane = plane_from_list(one.listing, conventions, increment)
            ways = (plane.nodes1, plane.nodes2)
        elif one.name == "leadscrew":
            ways = (leadscrew_from_list(one.listing, conventions, increment).nodes,)
        else:
            continue
        for axis, nodes in zip(one.masters, ways, strict=True):
            places = np.asarray(nodes.positions, dtype=float)
            found.setdefault(axis, []).extend((places[0], places[-1]))
    return {axis: (float(min(p)), float(max(p))) for axis, p in found.items()}
