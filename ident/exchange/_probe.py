"""Probe lists: one plateau of 10 µm per compensation, where it can be told apart.

A list that somebody fitted says little about the controller's own rules: its values are
small and all over the place. A plateau is either there or not, up or down, and stands
at one place.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ...data.lists import ListFile, new_list
from ...models import BilinearGrid, Conventions, Cross, Crosstalk, Leadscrew, Plane
from ._axis_list import ACTIVATION, CYCLES, WIDTH
from ._cross import entries_of_cross
from ._crosstalk import entries_of_crosstalk
from ._errors import ExchangeError
from ._leadscrew import entries_of_leadscrew
from ._machine_lists import PREFIXES
from ._nodes import GridNodes, PointNodes, as_array
from ._plane import entries_of_plane
from ._units import LIST_UNITS

HEIGHT = 0.01
"""Height of a plateau: 10 µm, or 0.01° of a rotary axis."""
FIRST, SECOND = (2, 4), (6, 8)
"""Tenths of the travel where a plateau begins and ends: two places, told apart."""
QUADRANTS = (0.010, 0.008, 0.006, 0.004)
"""Crosstalk in mm, one height per quadrant, in the order of the list's entries."""
DEFAULT_ACCELERATION = 1000
"""mm/s² at which a crosstalk table reaches its values, where no list says it."""

_TENTHS = 10
_SHORTEST = 10.0
"""mm or °: the ramps of a shorter travel would be steep."""


@dataclasses.dataclass(frozen=True)
class ProbeAxis:
    """An axis of the machine to be probed.

    Attributes:
        number: Logical number.
        name: For people and for the header of the list.
        travel: Positions in mm or ° between which it may move.
        rotary: Positions are in °.
        modulo: The travel is one turn.
    """

    number: int
    name: str
    travel: tuple[float, float]
    rotary: bool = False
    modulo: bool = False

    @property
    def grid(self) -> GridNodes:
        """Eleven nodes over the travel, a tenth of it apart, on whole mm or 0.1 mm."""
        low, high = self.travel
        if not high - low >= _SHORTEST:
            raise ExchangeError(
                where=f"travel of axis {self.number}",
                found=f"{low:g} to {high:g}",
                expected=f"{_SHORTEST:g} mm or ° or more, for gentle slopes",
            )
        # Whole units of 1 mm where the travel is long enough to lose none of it.
        unit = LIST_UNITS if high - low >= 100 else LIST_UNITS // 100
        if self.modulo:
            unit = 1
        start = int(np.ceil(round(low * LIST_UNITS / unit, 6))) * unit
        step = int((high * LIST_UNITS - start) / _TENTHS / unit + 1e-9) * unit
        return GridNodes(start, step, _TENTHS + 1)

    @property
    def slope(self) -> int:
        """Whole µm/m of a temperature line that rises by 10 µm over the travel."""
        return max(1, int(HEIGHT * 1e6 / (self.at(float(_TENTHS)) - self.at(0.0))))

    def at(self, tenths: float) -> float:
        """Return a position in mm or °, counted in tenths of the travel."""
        grid = self.grid
        return (grid.start + tenths * grid.interval) / LIST_UNITS


@dataclasses.dataclass(frozen=True)
class Probed:
    """One compensation that is probed.

    Attributes:
        axis: Logical number of the axis that it acts on.
        name: Of the compensation.
        masters: Logical numbers of the axes that it looks at.
        acceleration: Of a crosstalk table in mm/s², where the values are reached.
    """

    axis: int
    name: str
    masters: tuple[int, ...]
    acceleration: int = DEFAULT_ACCELERATION


@dataclasses.dataclass(frozen=True)
class Probe:
    """What is to be loaded for a probe.

    Attributes:
        axes: By logical number.
        tables: What is probed.
        lists: Compensation list by axis.
        additions: By axis what its axis list needs, as a list of just these entries.
    """

    axes: Mapping[int, ProbeAxis]
    tables: tuple[Probed, ...]
    lists: Mapping[int, ListFile]
    additions: Mapping[int, ListFile]


def make_probe(
    axes: Mapping[int, ProbeAxis],
    tables: Sequence[Probed],
    conventions: Conventions,
    existing: Mapping[int, ListFile] | None = None,
) -> Probe:
    """Return the probe lists of a machine.

    Args:
        axes: All axes that are probed or looked at, by logical number.
        tables: What is to be probed.
        conventions: Order of the indices of a plane.
        existing: Lists that are loaded now: the memory that they reserve stays, so that
            no restart is needed.

    Raises:
        ExchangeError: If an axis is not known, or its travel is too short.
    """
    for one in tables:
        for axis in (one.axis, *one.masters):
            if axis not in axes:
                known = ", ".join(map(str, sorted(axes)))
                raise ExchangeError(
                    where=f"{one.name} of axis {one.axis}",
                    found=f"axis {axis}, whose travel is not known",
                    expected=(f"one of {known}, or " if known else "")
                    + f"its limits in the job, or --travel A{axis}=0:500",
                )
    lists, additions = {}, {}
    for number in sorted({one.axis for one in tables}):
        mine = [one for one in tables if one.axis == number]
        old = (existing or {}).get(number)
        entries: dict[str, int | str] = {}
        for one in mine:
            entries |= _entries(one, axes, conventions)
            entries |= _kept_sizes(one, old)
        head: dict[str, int | str] = {"kopf.achs_nr": number}
        head["kopf.log_achs_name"] = axes[number].name
        title = f"Probe list of {axes[number].name}: 10 um plateaus, not for machining."
        if entries:
            lists[number] = dataclasses.replace(
                new_list(head | entries, comment=(title,)), source=f"achskw{number}.lis"
            )
        added = {"kopf.achs_nr": number} | _additions(mine, axes[number])
        additions[number] = dataclasses.replace(
            new_list(added, comment=("Add these entries to the axis list.",)),
            source=f"achsmds{number}.add.lis",
        )
    return Probe(dict(axes), tuple(tables), lists, additions)


def _kept_sizes(one: Probed, old: ListFile | None) -> dict[str, int | str]:
    name = f"{PREFIXES.get(one.name, '')}.max_points"
    if old is None or one.name in ("crosstalk", "temperature", "backlash"):
        return {}
    size = old.integer(name)
    return {name: size} if size else {}


def _plateau(between: tuple[int, int]) -> np.ndarray:
    tenths = np.arange(_TENTHS + 1)
    return np.where((tenths >= between[0]) & (tenths <= between[1]), HEIGHT, 0.0)


def _entries(
    one: Probed, axes: Mapping[int, ProbeAxis], conventions: Conventions
) -> dict[str, int | str]:
    """Return the entries of a probe table; they are 10 µm whatever sign they get."""
    if one.name == "crosstalk":
        rate = float(one.acceleration)
        crosstalk = Crosstalk(
            surface=BilinearGrid((), (0,)),
            values=as_array(np.array(QUADRANTS)[:, None]),
            acceleration=as_array(rate),
            deceleration=as_array(-rate),
        )
        return entries_of_crosstalk(crosstalk, one.masters)
    grids = [axes[master].grid for master in one.masters]
    if one.name == "cross":
        points = PointNodes(grids[0].integers)
        cross = Cross(nodes=points.model(), values=as_array(_plateau(SECOND)))
        return entries_of_cross(cross, one.masters[0])
    if one.name == "plane":
        values = np.outer(_plateau(SECOND), _plateau(FIRST)) / HEIGHT
        plane = Plane(grids[0].model(), grids[1].model(), as_array(values))
        first, second = one.masters
        return entries_of_plane(plane, (first, second), conventions)
    if one.name == "leadscrew":
        turns = axes[one.axis].modulo
        screw = Leadscrew(
            nodes=grids[0].model(),
            pos=as_array(_plateau(FIRST)),
            modulo=axes[one.axis].travel if turns else None,
        )
        # The input without other offsets: the plateau stays where it is (S-23).
        alone = {"kw.ssfk.set_pos_without_comp": 1}
        return entries_of_leadscrew(screw) | alone
    return {}


def _additions(mine: Sequence[Probed], axis: ProbeAxis) -> dict[str, int | str]:
    """Return what the axis list needs: activation, and what only stands there."""
    entries: dict[str, int | str] = {}
    units = round(HEIGHT * LIST_UNITS)
    for one in mine:
        if one.name == "backlash":
            entries |= {ACTIVATION["backlash"]: 1, WIDTH: units, CYCLES: 10}
        elif one.name == "temperature":
            entries |= {
                ACTIVATION["temperature"]: 1,
                "lr_param.temp_comp_position_0": axis.grid.start,
                "lr_param.temp_comp_offset_0": units,
                "lr_param.temp_comp_coefficient": axis.slope,
                "lr_param.temp_comp_n_cycles": 10,
            }
        else:
            entries[ACTIVATION[one.name]] = 1
    return entries
