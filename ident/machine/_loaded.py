"""Lists in the virtual controller: what each adds, by the rules of the models."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int

from ...data.lists import ListFile
from ...models import Conventions
from ..exchange import (
    Model,
    axis_number,
    cross_from_list,
    cross_master,
    has_cross,
    has_leadscrew,
    has_plane,
    leadscrew_from_list,
    offset_at,
    plane_from_list,
    plane_masters,
)


@dataclasses.dataclass(frozen=True)
class LoadedTable:
    """A table that the controller applies.

    Attributes:
        axis: Number of the axis that it moves.
        masters: Numbers of the axes whose positions enter.
        model: The table.
    """

    axis: int
    masters: tuple[int, ...]
    model: Model

    def offset(
        self,
        positions: Mapping[int, Float[np.ndarray, " t"]],
        direction: Int[np.ndarray, " t"],
    ) -> Float[np.ndarray, " t"]:
        """Return what is added to the command position in mm."""
        columns = np.stack([positions[number] for number in self.masters], axis=1)
        return offset_at(self.model, columns, direction)


def load(listing: ListFile, conventions: Conventions) -> tuple[LoadedTable, ...]:
    """Return every table of a compensation list that the machine can apply."""
    axis = axis_number(listing)
    found = []
    if has_cross(listing):
        model: Model = cross_from_list(listing, conventions)
        found.append(LoadedTable(axis, (cross_master(listing),), model))
    if has_plane(listing):
        model = plane_from_list(listing, conventions)
        found.append(LoadedTable(axis, plane_masters(listing), model))
    if has_leadscrew(listing):
        model = leadscrew_from_list(listing, conventions)
        found.append(LoadedTable(axis, (axis,), model))
    return tuple(found)
