"""Crosstalk compensation: ``kw.crosstalk`` in a list ↔ `Crosstalk`, old form read."""

from typing import Any, final

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import (
    AbstractSurface,
    Conventions,
    Crosstalk,
    DelaunaySurface,
    LegacyCrosstalk,
    Setpoints,
    ThinPlateSurface,
    surface_through,
)
from ...exchange._capacity import ANY_LIST, ListTarget, refuse_huge
from ...exchange._identity import (
    column,
    flag,
    not_negative,
    optional,
    required,
    values_of,
)
from ...exchange._machine_lists import InUse, Reading
from ...exchange._nodes import as_array, refuse_unordered
from ...exchange._units import (
    SGN32,
    SGN64,
    ExchangeError,
    exact_in_list,
    expect,
    from_list_units,
    round_to_list,
)
from ...exchange.controller._motion import Motion
from .._protocol import AbstractEntries, Axes
from . import KIND, SAFE_TESTS

PREFIX = KIND.prefix
MOST_CYCLES = 20
VALUES = (
    "correction_accelerate_dir_pos",
    "correction_accelerate_dir_neg",
    "correction_decelerate_dir_pos",
    "correction_decelerate_dir_neg",
)
"""Entries of a test, in the order of the rows of `Crosstalk.values`."""

_MASTERS = ("master_dyn_ax_nr", "master_pos1_ax_nr", "master_pos2_ax_nr")
_RATES = {"acceleration": 1, "deceleration": -1}
_OLD = ("master_ax_nr", "last_index", "table[].acceleration", "table[].correction")
_NEW = (*(f"position[].{name}" for name in VALUES), "mode", *_RATES)
"""Entries of the older and of the present form of the list, and of no other."""


def _surface(
    points: Float[np.ndarray, "p k"], conventions: Conventions, source: str
) -> AbstractSurface:
    kind = conventions.crosstalk_surface
    try:
        if points.shape[1] == 2 and kind == "triangles":
            return DelaunaySurface.through(points)
        if points.shape[1] == 2 and kind == "thin_plate":
            return ThinPlateSurface.through(points)
        return surface_through(points)
    except ValueError as error:
        raise ExchangeError(
            where=f"{source}: {PREFIX}.position[]",
            found=str(error).rstrip("."),
            expected="tests that a surface can go through (70660)",
        ) from None


def _is_old(listing: ListFile) -> bool:
    old, new = (
        [name for name in names if f"{PREFIX}.{name}" in listing.columns]
        for names in (_OLD, _NEW)
    )
    if old and new:
        raise ExchangeError(
            where=f"{listing.source}: {PREFIX}",
            found=f"{old[0]} beside {new[0]}",
            expected="the older or the present form of the list, not both",
        )
    return bool(old)


def _mode(listing: ListFile) -> int:
    mode = optional(listing, f"{PREFIX}.mode")
    expect(mode in (1, 2, 3), f"{listing.source}: {PREFIX}.mode", mode, "1 to 3")
    return mode


def _tests(listing: ListFile) -> int:
    count = optional(listing, f"{PREFIX}.max_points")
    if not count:
        # The manuals' own example leaves it out: then all tests that stand there (S-40).
        used: set[Any] = {k for n in VALUES for k in values_of(listing, PREFIX, n)}
        count = 1 + max(used, default=-1)
    refuse_huge(count, f"{listing.source}: {PREFIX}.max_points")
    return count


def _old_from_list(listing: ListFile, conventions: Conventions) -> LegacyCrosstalk:
    count = optional(listing, f"{PREFIX}.last_index") + 1
    refuse_huge(count, f"{listing.source}: {PREFIX}.last_index")
    nodes = column(listing, PREFIX, "acceleration", count)
    name = f"{listing.source}: {PREFIX}.table[].acceleration"
    refuse_unordered(nodes, name, "ascending accelerations (70659)")
    table = column(listing, PREFIX, "correction", count)
    return LegacyCrosstalk(
        nodes=Setpoints(as_array(nodes.astype(float))),
        values=as_array(from_list_units(table)),
        cycles=not_negative(listing, f"{PREFIX}.n_cycles"),
        sign=float(conventions.crosstalk_sign),
    )


def _rate(value: object, name: str) -> int:
    number = float(np.asarray(value))
    whole = number == round(number) and SGN32[0] <= number <= SGN32[1]
    words = f"{number:.10g} mm/s²"
    expect(whole, f"{PREFIX}.{name}", words, "a whole number of mm/s²")
    return round(number)


@final
class CrosstalkEntries(AbstractEntries):
    """``kw.crosstalk`` ↔ `Crosstalk`."""

    kind = KIND
    models = (Crosstalk, LegacyCrosstalk)
    value = f"{PREFIX}.position[]"
    stale = ("table[", "position[", "max_points", "master_", "last_index")
    rules = ("by_speed", "rest_direction", "held_above", "held_outside")

    def is_in(self, listing: ListFile) -> bool:
        return _is_old(listing) or any(listing.table(PREFIX, name) for name in VALUES)

    def named_masters(self, listing: ListFile) -> Axes:
        # The axis that accelerates, then the adaptation axes.
        if _is_old(listing):
            return (required(listing, f"{PREFIX}.master_ax_nr"),)
        names = _MASTERS[: _mode(listing)]
        return tuple(required(listing, f"{PREFIX}.{name}") for name in names)

    def model(
        self, listing: ListFile, axis: int, reading: Reading
    ) -> Crosstalk | LegacyCrosstalk:
        conventions = reading.conventions
        if _is_old(listing):
            return _old_from_list(listing, conventions)
        mode = _mode(listing)
        count = 1 if mode == 1 else _tests(listing)
        axes = [column(listing, PREFIX, f"ax_{k}", count) for k in range(1, mode)]
        points = np.array(axes, dtype=np.int64).reshape(mode - 1, count).T
        table = np.stack([column(listing, PREFIX, name, count) for name in VALUES])
        rates = {name: required(listing, f"{PREFIX}.{name}") for name in _RATES}
        for name, sign in _RATES.items():
            where, words = f"{listing.source}: {PREFIX}.{name}", f"{rates[name]} mm/s²"
            bound = f"{'more' if sign > 0 else 'less'} than 0 (70659)"
            expect(rates[name] * sign > 0, where, words, bound)
        return Crosstalk(
            surface=_surface(from_list_units(points), conventions, listing.source),
            values=as_array(from_list_units(table)),
            acceleration=as_array(float(rates["acceleration"])),
            deceleration=as_array(float(rates["deceleration"])),
            velocity_dependent=flag(listing, f"{PREFIX}.velocity_dependent"),
            cycles=not_negative(listing, f"{PREFIX}.n_cycles"),
            **conventions.of_crosstalk,
        )

    def to_list(
        self,
        model: Crosstalk | LegacyCrosstalk,
        masters: Axes = (),
        target: ListTarget = ANY_LIST,
    ) -> dict[str, int | str]:
        # Always with ``velocity_dependent 1``: what is the same for both directions, or for
        # acceleration and deceleration, is written twice (S-35).
        if isinstance(model, LegacyCrosstalk):
            raise ExchangeError(
                where=f"{PREFIX}.table[]",
                found="a table of the older form",
                expected="tests of the present form (mode 1 to 3): the older one is read only",
            )
        points = np.asarray(model.surface.points)
        count, axes = points.shape
        words = f"{axes + 1}: the axis that accelerates and {axes} adaptation axes"
        expect(len(masters) == axes + 1, f"{PREFIX} masters", len(masters), words)
        words, bound = f"{count} tests", f"at most {SAFE_TESTS}"
        expect(count <= SAFE_TESTS, f"{PREFIX}.max_points", words, bound)
        bound = f"at most {MOST_CYCLES}"
        expect(model.cycles <= MOST_CYCLES, f"{PREFIX}.n_cycles", model.cycles, bound)
        entries: dict[str, int | str] = {f"{PREFIX}.mode": axes + 1}
        entries |= {f"{PREFIX}.{n}": k for n, k in zip(_MASTERS, masters, strict=False)}
        if axes:
            entries[f"{PREFIX}.max_points"] = count
        entries |= {
            f"{PREFIX}.n_cycles": model.cycles,
            f"{PREFIX}.velocity_dependent": 1,
        }
        entries |= {f"{PREFIX}.{n}": _rate(getattr(model, n), n) for n in _RATES}
        places = exact_in_list(points, f"{PREFIX}.position[].ax_1 and ax_2", SGN64)
        # The entries that act, row by row of `VALUES`.
        acts = [0, 0, 2, 2] if model.own_deceleration else [0, 0, 0, 0]
        acts = [0, 1, 2, 3] if model.velocity_dependent else acts
        name = f"{PREFIX}.position[].{VALUES[0]} …"
        values = round_to_list(np.asarray(model.values)[acts], name, SGN64)
        # Ordered along ax_1, then ax_2: the only order that no manual refuses (70660).
        order = np.lexsort(places.T[::-1]) if axes else np.zeros(1, dtype=np.int64)
        for k, test in enumerate(order):
            at = f"{PREFIX}.position[{k}]"
            entries |= {f"{at}.ax_{j + 1}": int(places[test, j]) for j in range(axes)}
            entries |= {f"{at}.{n}": int(values[b, test]) for b, n in enumerate(VALUES)}
        return entries

    def lacks(self, in_use: InUse, motion: Motion, reading: Reading) -> str | None:
        master = in_use.masters[0]
        if motion.rates(master)[1] is None:
            return motion.lacks(master, "acceleration")
        by_slave = reading.conventions.crosstalk_velocity == "slave"
        mover = in_use.axis if by_slave else master
        if motion.rates(mover)[0] is None:
            return motion.lacks(mover, "velocity")
        return None

    def looks_at(self, in_use: InUse, motion: Motion, reading: Reading) -> Axes:
        return in_use.masters[1:]

    def inputs(self, masters: Axes) -> Axes:
        return ()


ENTRIES = CrosstalkEntries()
crosstalk_from_list, entries_of_crosstalk = ENTRIES.from_list, ENTRIES.to_list
