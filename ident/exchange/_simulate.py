"""What the lists of a machine add along a motion: all tables, and their sum."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...data.lists import ListFile
from ...models import Conventions, Leadscrew
from ._cross import cross_from_list, cross_master, has_cross
from ._errors import ExchangeError
from ._evaluate import offset_at
from ._identity import Increments, axis_number, flag, optional
from ._leadscrew import PREFIX as SCREW, has_leadscrew, leadscrew_from_list
from ._plane import has_plane, plane_from_list, plane_masters

_OTHERS = {"frict_comp": "friction", "crosstalk": "crosstalk"}
"""Structures of the compensation list that this version does not evaluate."""
_OF_AXIS = {"backlash": "anwahl_losekomp", "temperature": "temp_comp"}
"""Compensations that the axis list alone sets up, with what switches them on."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """Commanded motion of a machine, one row per cycle or independent position.

    Attributes:
        positions: By logical axis number, in mm or °.
        directions: ±1 by axis, where the user gives them.
        time: In s; None where the rows are independent positions.
    """

    positions: Mapping[int, Float[np.ndarray, " t"]]
    directions: Mapping[int, Int[np.ndarray, " t"]]
    time: Float[np.ndarray, " t"] | None

    def position(self, axis: int, why: str) -> Float[np.ndarray, " t"]:
        """Return the commanded position of an axis.

        Raises:
            ExchangeError: If the motion does not have it.
        """
        if axis not in self.positions:
            known = ", ".join(f"A{number}.position" for number in self.positions)
            raise ExchangeError(
                where="motion", found=known or "no position",
                expected=f"A{axis}.position {why}",
            )  # fmt: skip
        return self.positions[axis]


@dataclasses.dataclass(frozen=True)
class AxisOffsets:
    """What an axis's lists add, in mm or ° per row.

    Attributes:
        axis: Logical number.
        parts: By compensation, those that are active.
        total: Their sum.
        left_out: Compensations in the list that are not evaluated by this version.
    """

    axis: int
    parts: Mapping[str, Float[np.ndarray, " t"]]
    total: Float[np.ndarray, " t"]
    left_out: tuple[str, ...]


def simulate(
    lists: Sequence[ListFile],
    motion: Motion,
    conventions: Conventions,
    increment: Increments = None,
) -> tuple[AxisOffsets, ...]:
    """Return what the controller adds to each axis along a motion.

    Without an axis list everything in a list is active; with one, what its activation
    bits say. The leadscrew table comes last: its input contains the other offsets
    unless ``set_pos_without_comp`` is 1 (S-23, S-56). A reversal is spread over
    ``n_backlash_cyc`` rows where time runs and an axis list says so (S-63).

    Args:
        lists: Compensation and axis lists in any order.
        motion: Commanded positions.
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.

    Raises:
        ExchangeError: If a list makes no table, an axis has two lists, or the motion
            lacks an axis.
    """
    tables = _by_axis(lists, "compensation")
    machines = _by_axis(lists, "axis")
    if not tables:
        names = ", ".join(one.source for one in lists)
        raise ExchangeError(
            where=names or "lists",
            found="no compensation list",
            expected="at least one (kopf.*, kw.*)",
        )
    return tuple(
        _axis(number, tables[number], machines.get(number), motion, conventions,
              increment)
        for number in sorted(tables)
    )  # fmt: skip


def _by_axis(lists: Sequence[ListFile], kind: str) -> dict[int, ListFile]:
    found: dict[int, ListFile] = {}
    for listing in lists:
        if listing.kind != kind:
            if listing.kind == "unknown":
                raise ExchangeError(
                    where=listing.source,
                    found="none of the entries of a compensation or axis list",
                    expected="kopf.*, kw.*, frict_comp.* or lr_param.*",
                )
            continue
        number = axis_number(listing)
        if number in found:
            raise ExchangeError(
                where=listing.source,
                found=f"a second {kind} list of axis {number} beside"
                f" {found[number].source}",
                expected="one per axis",
            )
        found[number] = listing
    return found


def _axis(
    number: int,
    listing: ListFile,
    machine: ListFile | None,
    motion: Motion,
    conventions: Conventions,
    increment: Increments,
) -> AxisOffsets:
    def active(entry: str) -> bool:
        return machine is None or flag(machine, f"lr_param.{entry}")

    parts: dict[str, np.ndarray] = {}
    if has_cross(listing) and active("crosscomp"):
        cross = cross_from_list(listing, conventions, increment)
        place = motion.position(
            cross_master(listing), f"for the cross table of A{number}"
        )
        parts["cross"] = offset_at(cross, place[:, None])
    if has_plane(listing) and active("crosscomp2"):
        plane = plane_from_list(listing, conventions, increment)
        why = f"for the plane of A{number}"
        places = [motion.position(axis, why) for axis in plane_masters(listing)]
        parts["plane"] = offset_at(plane, np.stack(places, axis=1))
    others = sum(parts.values(), np.zeros(_rows(motion)))
    if has_leadscrew(listing) and active("ssfk"):
        screw = leadscrew_from_list(listing, conventions, increment)
        place = motion.position(number, f"for the leadscrew table of A{number}")
        alone = flag(listing, f"{SCREW}.set_pos_without_comp")
        into = (
            place if alone or conventions.leadscrew_input == "none" else place + others
        )
        cycles = optional(machine, "lr_param.n_backlash_cyc") if machine else 0
        parts["leadscrew"] = _screw(
            screw, number, place, into, motion, conventions, cycles
        )
    total = sum(parts.values(), np.zeros(_rows(motion)))
    left_out = [
        name
        for stem, name in _OTHERS.items()
        if active(stem) and any(f"{stem}." in key for key in listing.columns)
    ]
    left_out += [
        name
        for name, entry in _OF_AXIS.items()
        if machine is not None and machine.text(f"lr_param.{entry}") not in (None, "0")
    ]
    return AxisOffsets(number, parts, total, tuple(left_out))


def _rows(motion: Motion) -> int:
    return len(next(iter(motion.positions.values()), np.zeros(0)))


def _screw(
    screw: Leadscrew,
    number: int,
    commanded: Float[np.ndarray, " t"],
    into: Float[np.ndarray, " t"],
    motion: Motion,
    conventions: Conventions,
    cycles: int,
) -> Float[np.ndarray, " t"]:
    place = into[:, None]
    if screw.neg is None:
        return offset_at(screw, place)
    start = conventions.start_direction
    if number in motion.directions:
        direction = motion.directions[number]
    elif motion.time is None:
        direction = np.full(len(into), start)
    else:
        direction = direction_of_motion(commanded, start)
    forward = offset_at(screw, place, np.ones(len(into), dtype=np.int64))
    back = offset_at(screw, place, -np.ones(len(into), dtype=np.int64))
    share = (direction < 0).astype(float)
    if motion.time is not None and cycles > 1:
        share = spread(share, cycles, 0.0 if start > 0 else 1.0)
    return np.asarray((1.0 - share) * forward + share * back)


def direction_of_motion(
    position: Float[np.ndarray, " t"], start: int = 1
) -> Int[np.ndarray, " t"]:
    """Return the direction of motion per cycle: that of the last step that was one.

    Args:
        position: Commanded, in mm or °.
        start: Direction before the first motion (S-21).
    """
    step = np.sign(np.diff(position, prepend=position[:1])).astype(np.int64)
    last = np.maximum.accumulate(np.where(step != 0, np.arange(len(step)), -1))
    return np.where(last < 0, start, step[np.maximum(last, 0)])


def spread(
    share: Float[np.ndarray, " t"], cycles: int, start: float
) -> Float[np.ndarray, " t"]:
    """Return a step signal with each step spread over cycles by sin² (S-06, S-63).

    Args:
        share: 0 or 1 per cycle.
        cycles: Number of cycles; the first one of a step already shows its first part.
        start: Value before the first cycle.
    """
    done = np.sin(0.5 * np.pi * np.arange(cycles + 1) / cycles) ** 2
    steps = np.diff(share, prepend=start)
    shown = np.convolve(steps, np.diff(done))[: len(share)]
    return np.asarray(start + np.cumsum(shown))
