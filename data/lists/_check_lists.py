"""The lists of one machine: which belongs to which axis."""

import dataclasses
import re
from collections.abc import Sequence

from ._check_view import ListView

AXIS_DIFFERS = 110229
"""Controller: axis number differs from the start-up list."""
EXTERNAL_LIMITS = "lr_param.ext_comp"
"""Limits of an external compensation of the axis; `axcomp export-external` writes them."""

_NUMBER = re.compile(r"([0-9]{1,5})\D*$")


@dataclasses.dataclass
class ListSet:
    """The lists of one machine, by what they are and by axis."""

    compensation: list[ListView]
    axis: list[ListView]
    startup: list[ListView]

    def compensation_of(self, axis: int) -> list[ListView]:
        """Return the compensation lists of an axis."""
        return [view for view in self.compensation if axis_number(view) == axis]

    def axis_of(self, axis: int) -> list[ListView]:
        """Return the axis lists of an axis, fragments behind whole lists."""
        lists = [view for view in self.axis if axis_number(view) == axis]
        return sorted(lists, key=is_fragment)


def axis_number(view: ListView) -> int | None:
    """Return the logical axis of a list, else the number in its file name."""
    number = view.integer("kopf.achs_nr") if "kopf.achs_nr" in view.columns else None
    return file_number(view) if number is None else number


def base_name(path: str) -> str:
    r"""Return the file name of a path with ``/`` or ``\``, in lower case."""
    return re.split(r"[\\/]", path)[-1].lower()


def file_number(view: ListView) -> int | None:
    """Return the last number in the name of the file: 3 of ``achskw3.lis``."""
    match = _NUMBER.search(base_name(view.file.source))
    return int(match.group(1)) if match else None


def is_fragment(view: ListView) -> bool:
    """Return whether the file holds only entries to add to another: ``*.add.lis``."""
    return base_name(view.file.source).endswith(".add.lis")


def in_force(views: Sequence[ListView], key: str) -> ListView:
    """Return the list whose entry counts: the last that has it, else the first."""
    return next((view for view in reversed(views) if key in view.columns), views[0])
