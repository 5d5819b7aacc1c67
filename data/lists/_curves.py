"""The tables of a compensation list as offset curves: what the controller adds, where.

Enough to show a list and to compare two of them without JAX. The models that fits and
proofs rest on are in `axcomp.models`; a test holds the signs of both together.
"""

import bisect
import dataclasses
import itertools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias

from ._listfile import ListFile

SIGNS: dict[str, int] = {"cross": 1, "plane": 1, "leadscrew": -1}
"""Offset over list entry: cross and plane entries are the offset, a leadscrew entry is
the error actual − setpoint (semantics.md rule 4, S-11, S-18); by default."""
CurveRules: TypeAlias = Mapping[str, int | str]
"""Conventions by name (`axcomp.models.Conventions.to_dict`); left out: the defaults."""
DEFAULT_RULES: CurveRules = MappingProxyType({})

PER_MM = 10_000
"""List units of 0.1 µm in a millimetre; of 0.0001° in a degree."""
PER_MICRON = 10
_MOST = 4_000_000
"""Nodes that are laid out at most: an index may be mistyped by any number of digits."""


@dataclasses.dataclass(frozen=True)
class OffsetCurve:
    """One table of a list: node positions, entries, and the offset they make."""

    compensation: Literal["cross", "plane", "leadscrew"]
    branch: Literal["both", "positive", "negative"]
    """Direction of motion that the table is for."""
    masters: tuple[int | None, ...]
    """Logical number of the axis along each direction of the table."""
    nodes: tuple[tuple[float, ...], ...]
    """Positions along each direction, in mm (increments where not `metric`)."""
    entries: tuple[tuple[int | None, ...], ...]
    """List entries ``[j][i]``; one row where there is one direction; None = missing."""
    metric: bool
    """Whether the list counts in 0.1 µm (0.0001°), not in encoder increments."""
    sign: int
    """Offset over entry."""
    axis: int | None
    """Logical number of the axis that it acts on."""

    @property
    def entry_size(self) -> float:
        """Offset that an entry of 1 makes, in µm (or increments)."""
        return self.sign / PER_MICRON if self.metric else float(self.sign)

    @property
    def offsets(self) -> tuple[tuple[float, ...], ...]:
        """What the controller adds at the nodes, in µm (or increments).

        A missing entry is 0 there, as in the controller.
        """
        scale = self.entry_size
        return tuple(tuple((e or 0) * scale for e in row) for row in self.entries)

    @property
    def missing(self) -> int:
        """Number of nodes without an entry."""
        return sum(entry is None for row in self.entries for entry in row)

    @property
    def ascending(self) -> bool:
        """Whether the node positions ascend, so that there is a curve at all."""
        return all(a < b for axis in self.nodes for a, b in itertools.pairwise(axis))

    @property
    def title(self) -> str:
        """Name of the table."""
        branch = "" if self.branch == "both" else f", {self.branch} direction"
        return f"{self.compensation}{branch}"

    @property
    def turned(self) -> "OffsetCurve":
        """The same plane with its masters exchanged."""
        masters, nodes = self.masters[::-1], self.nodes[::-1]
        entries = tuple(zip(*self.entries, strict=True))
        return dataclasses.replace(self, masters=masters, nodes=nodes, entries=entries)

    def sample(
        self, positions: tuple[tuple[float, ...], ...]
    ) -> list[tuple[float, ...]]:
        """Return the offset on a grid of positions, in µm (or increments).

        Linear between the nodes, bilinear in a plane, the edge held outside.
        """
        rows = [_interpolate(self.nodes[0], row, positions[0]) for row in self.offsets]
        if len(self.nodes) == 1:
            return rows
        columns = [
            _interpolate(self.nodes[1], column, positions[1])
            for column in zip(*rows, strict=True)
        ]
        return list(zip(*columns, strict=True))


def _interpolate(
    nodes: tuple[float, ...], values: tuple[float, ...], at: tuple[float, ...]
) -> tuple[float, ...]:
    if nodes == at:
        return values
    result: list[float] = []
    for position in at:
        right = bisect.bisect_right(nodes, position)
        if right == 0 or right == len(nodes):
            result.append(values[min(right, len(nodes) - 1)])
            continue
        left = right - 1
        share = (position - nodes[left]) / (nodes[right] - nodes[left])
        result.append(values[left] + share * (values[right] - values[left]))
    return tuple(result)


def offset_curves(
    file: ListFile, rules: CurveRules = DEFAULT_RULES
) -> tuple[OffsetCurve, ...]:
    """Return the cross, plane and leadscrew tables that a list holds.

    A table as far as its size entries say; where they are missing, as far as its
    entries reach. Nothing is judged here: that is what `check` is for.

    Args:
        file: The list.
        rules: Signs, order of the indices of a plane (S-17), owner of a cross table (S-10).
    """
    return (*_cross(file, rules), *_plane(file, rules), *_leadscrew(file, rules))


def _sign(compensation: str, rules: CurveRules) -> int:
    return int(rules.get(f"{compensation}_sign", SIGNS[compensation]))


def _positions(units: list[int], metric: bool) -> tuple[float, ...]:
    return tuple(unit / PER_MM if metric else float(unit) for unit in units)


def _line(table: dict[int, int] | dict[tuple[int, int], int]) -> dict[int, int]:
    return {k: value for k, value in table.items() if isinstance(k, int)}


def _count(size: int | None, *tables: dict[int, int]) -> int:
    """Return the number of nodes: the size, where the entries make it believable."""
    extent = max((max(table) + 1 for table in tables if table), default=0)
    count = extent if size is None else max(0, min(size, 2 * extent + 1000))
    return min(count, _MOST)


def _cross(file: ListFile, rules: CurveRules) -> list[OffsetCurve]:
    prefix = "kw.crosscomp"
    setpoints = _line(file.table(prefix, "setpoint"))
    values = _line(file.table(prefix, "correction"))
    if not values:
        return []
    last = file.integer(f"{prefix}.last_index")
    count = _count(None if last is None else last + 1, setpoints, values)
    metric = file.boolean(f"{prefix}.unit") is True
    nodes = _positions([setpoints.get(k, 0) for k in range(count)], metric)
    entries = tuple(values.get(k) for k in range(count))
    axis, master = file.integer("kopf.achs_nr"), file.integer(f"{prefix}.master_ax_nr")
    if rules.get("cross_list") == "master":
        axis, master = master, axis
    form = (nodes,), (entries,), metric, _sign("cross", rules), axis
    return [OffsetCurve("cross", "both", (master,), *form)]


def _leadscrew(file: ListFile, rules: CurveRules) -> list[OffsetCurve]:
    prefix = "kw.ssfk"
    columns = [_line(file.table(prefix, name)) for name in ("pos", "neg")]
    setpoints = _line(file.table(prefix, "setpoint"))
    if not any(columns):
        return []
    count = _count(file.integer(f"{prefix}.kw_nr_max"), *columns, setpoints)
    metric = file.boolean(f"{prefix}.unit") is True
    interval = file.integer(f"{prefix}.interval") or 0
    start = file.integer(f"{prefix}.kw_startpos") or 0
    if interval > 0:
        units = [start + interval * k for k in range(count)]
    else:
        units = [setpoints.get(k, 0) for k in range(count)]
    nodes = _positions(units, metric)
    axis = file.integer("kopf.achs_nr")
    bilateral = file.boolean(f"{prefix}.bilateral") is True
    branches: list[Literal["both", "positive", "negative"]] = ["both"]
    if bilateral:
        branches = ["positive", "negative"]
    return [
        OffsetCurve(
            "leadscrew",
            branch,
            (axis,),
            (nodes,),
            (tuple(column.get(k) for k in range(count)),),
            metric,
            _sign("leadscrew", rules),
            axis,
        )
        for branch, column in zip(branches, columns, strict=False)
    ]


def _plane(file: ListFile, rules: CurveRules) -> list[OffsetCurve]:
    prefix = "kw.crosscomp2"
    values = {
        k[::-1] if rules.get("plane_index") == "ij" else k: value
        for k, value in file.table(prefix, "correction").items()
        if isinstance(k, tuple)
    }
    if not values:
        return []
    extent = (max(i for _, i in values), max(j for j, _ in values))
    rectangular = (file.text(f"{prefix}.grid") or "").upper() == "RECTANGULAR"
    metric = file.boolean(f"{prefix}.unit") is True
    nodes: list[tuple[float, ...]] = []
    counts: list[int] = []
    for k in (1, 2):
        last = file.integer(f"{prefix}.last_index_master{k}")
        size = extent[k - 1] if last is None else last
        counts.append(max(0, min(size, 2 * extent[k - 1] + 1000)) + 1)
    if counts[0] * counts[1] > _MOST:
        counts = [min(count, int(_MOST**0.5)) for count in counts]
    for k, count in zip((1, 2), counts, strict=True):
        step = file.integer(f"{prefix}.interval{k if rectangular else ''}") or 0
        start = file.integer(f"{prefix}.start_position_master{k}") or 0
        nodes.append(_positions([start + step * n for n in range(count)], metric))
    entries = tuple(
        tuple(values.get((j, i)) for i in range(len(nodes[0])))
        for j in range(len(nodes[1]))
    )
    masters = tuple(file.integer(f"{prefix}.master{k}_ax_nr") for k in (1, 2))
    form = tuple(nodes), entries, metric, _sign("plane", rules)
    return [OffsetCurve("plane", "both", masters, *form, file.integer("kopf.achs_nr"))]
