"""The tables that can be written: plane, cross and leadscrew."""

import dataclasses
from typing import ClassVar, final

import numpy as np
from jaxtyping import Int

from ...data.lists import ListFile
from ...models import Cross, Leadscrew, Plane
from . import _cross, _leadscrew, _plane
from ._errors import ExchangeError
from ._identity import Increments
from ._modulo import wrapped
from ._nodes import PointNodes, as_array
from ._table import AbstractTable, Model
from ._units import SGN16, from_list_units, round_to_list


@final
@dataclasses.dataclass(frozen=True)
class PlaneTable(AbstractTable):
    """A plane table: the offset over the positions of two masters."""

    compensation: ClassVar[str] = "plane"
    prefix: ClassVar[str] = _plane.PREFIX
    activation: ClassVar[str] = "lr_param.crosscomp2"
    keyword: ClassVar[str] = "PLANE"

    @property
    def sign(self) -> int:
        return int(self.conventions.plane_sign)

    def model(self, integers: Int[np.ndarray, "..."]) -> Model:
        first, second = (nodes.model() for nodes in self.nodes)
        return Plane(
            nodes1=first,
            nodes2=second,
            values=as_array(from_list_units(integers)),
            sign=float(self.conventions.plane_sign),
        )

    def entries(
        self,
        integers: Int[np.ndarray, "..."],
        *,
        existing: ListFile | None = None,
        max_points: int | None = None,
        build: str | None = None,
    ) -> dict[str, int | str]:
        model = self.model(integers)
        assert isinstance(model, Plane)
        first, second = self.masters
        return _plane.entries_of_plane(
            model,
            (first, second),
            self.conventions,
            existing=existing,
            max_points=max_points,
            build=build,
        )

    def is_in(self, listing: ListFile) -> bool:
        return _plane.has_plane(listing)

    def read(self, listing: ListFile, increments: Increments = None) -> Model:
        return _plane.plane_from_list(listing, self.conventions, increments)

    def masters_in(self, listing: ListFile) -> tuple[int, ...]:
        return _plane.plane_masters(listing)


@final
@dataclasses.dataclass(frozen=True)
class CrossTable(AbstractTable):
    """A cross table: the offset over the position of one master."""

    compensation: ClassVar[str] = "cross"
    prefix: ClassVar[str] = _cross.PREFIX
    activation: ClassVar[str] = "lr_param.crosscomp"
    keyword: ClassVar[str] = "CROSS"

    @property
    def sign(self) -> int:
        return int(self.conventions.cross_sign)

    def model(self, integers: Int[np.ndarray, "..."]) -> Model:
        # The list knows single setpoints only.
        points = PointNodes(self.nodes[0].integers)
        return Cross(
            nodes=wrapped(points.model(), self.modulo),
            values=as_array(from_list_units(integers)),
            sign=float(self.conventions.cross_sign),
            held=self.conventions.cross_edge == "hold",
        )

    def entries(
        self,
        integers: Int[np.ndarray, "..."],
        *,
        existing: ListFile | None = None,
        max_points: int | None = None,
        build: str | None = None,
    ) -> dict[str, int | str]:
        model = self.model(integers)
        assert isinstance(model, Cross)
        return _cross.entries_of_cross(
            model,
            self.masters[0],
            existing=existing,
            max_points=max_points,
            build=build,
        )

    def is_in(self, listing: ListFile) -> bool:
        return _cross.has_cross(listing)

    def read(self, listing: ListFile, increments: Increments = None) -> Model:
        ranges = None if self.modulo is None else {self.masters[0]: self.modulo}
        return _cross.cross_from_list(
            listing, self.conventions, increments, modulo=ranges
        )

    def masters_in(self, listing: ListFile) -> tuple[int, ...]:
        return (_cross.cross_master(listing),)


@final
@dataclasses.dataclass(frozen=True)
class LeadscrewTable(AbstractTable):
    """A leadscrew table: the offset over the position of the axis itself.

    Attributes:
        bilateral: One value per direction of motion.
    """

    bilateral: bool = False

    compensation: ClassVar[str] = "leadscrew"
    prefix: ClassVar[str] = _leadscrew.PREFIX
    activation: ClassVar[str] = "lr_param.ssfk"
    keyword: ClassVar[str] = "LEAD"
    branch_names: ClassVar[tuple[str, ...]] = ("pos", "neg")
    value_bounds: ClassVar[tuple[int, int]] = SGN16

    @property
    def sign(self) -> int:
        return int(self.conventions.leadscrew_sign)

    @property
    def branches(self) -> int:
        return 2 if self.bilateral else 1

    def model(self, integers: Int[np.ndarray, "..."]) -> Model:
        return _leadscrew.leadscrew_of(
            self.nodes[0].model(),
            np.atleast_2d(from_list_units(integers)),
            self.modulo,
            self.conventions,
        )

    def entries(
        self,
        integers: Int[np.ndarray, "..."],
        *,
        existing: ListFile | None = None,
        max_points: int | None = None,
        build: str | None = None,
    ) -> dict[str, int | str]:
        rows = np.atleast_2d(from_list_units(integers))
        branches = {
            name: round_to_list(row, f"{self.prefix}.table[].{name}", SGN16)
            for name, row in zip(self.branch_names, rows, strict=False)
        }
        return _leadscrew.entries_of_integers(
            self.nodes[0],
            branches,
            modulo=self.modulo is not None,
            existing=existing,
            max_points=max_points,
            build=build,
        )

    def is_in(self, listing: ListFile) -> bool:
        return _leadscrew.has_leadscrew(listing)

    def read(self, listing: ListFile, increments: Increments = None) -> Model:
        return _leadscrew.read_leadscrew(
            listing, self.conventions, increments, modulo=self.modulo
        )

    def masters_in(self, listing: ListFile) -> tuple[int, ...]:
        return (self.axis,)


def _integers_of(positions: np.ndarray, size: float = 1e-4) -> set[int]:
    return set(np.rint(positions / size).astype(np.int64).tolist())


def refuse_lost_nodes(table: AbstractTable, old: Model, source: str) -> None:
    """Raise where a table that continues an old one lacks some of its nodes.

    Only on the old nodes, or on more, is old + residual a table again.

    Raises:
        ExchangeError: Naming the nodes that are missing.
    """
    if isinstance(old, Leadscrew) and isinstance(table, LeadscrewTable):
        for name, was, will in (
            ("bilateral", old.neg is not None, table.bilateral),
            ("modulo", old.modulo is not None, table.periodic),
        ):
            # A table for both directions may become one per direction, not vice versa.
            if was != will and (was or name == "modulo"):
                raise ExchangeError(
                    where=f"{source}: {table.prefix}.{name}",
                    found=f"{int(was)} in the table that was active while measuring",
                    expected=f"{name} = {str(was).lower()} in the fit as well",
                )
    ways = (old.nodes1, old.nodes2) if isinstance(old, Plane) else (old.nodes,)
    for master, mine, theirs in zip(table.masters, table.nodes, ways, strict=True):
        had = np.asarray(theirs.positions, dtype=float)
        lost = sorted(_integers_of(had) - set(mine.integers))
        if lost:
            shown = ", ".join(f"{k / 10_000:g}" for k in lost[:5])
            more = f" and {len(lost) - 5} more" if len(lost) > 5 else ""
            raise ExchangeError(
                where=f"{source}: {table.prefix}",
                found=f"nodes of axis {master} at {shown}{more} in the table that was"
                " active while measuring, but not in the new one",
                expected="the old nodes or more of them",
            )
