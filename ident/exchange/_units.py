"""List units: integers of 0.1 µm or 0.0001°, and what fits into them or does not."""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float, Int

from ...data.errors import FoundError


class ExchangeError(FoundError):
    """A list that has no model, or a model that no list can hold."""


def expect(holds: object, where: str, found: object, expected: str) -> None:
    """Raise where something does not hold.

    Raises:
        ExchangeError: Saying where, what was found, and what was expected.
    """
    if not holds:
        raise ExchangeError(where, str(found), expected)


LIST_UNITS = 10_000
"""List units per mm or per degree; dividing by it rounds once."""

SGN16 = (-(2**15), 2**15 - 2)
SGN32 = (-(2**31), 2**31 - 2)
SGN64 = (-(2**63), 2**63 - 2)
"""Smallest and largest integer of each type; the manuals exclude the upper end."""


@final
@dataclasses.dataclass(frozen=True)
class ModelUnit:
    """The unit of the values of a model, where it is not that of the library.

    Attributes:
        name: ``"mm"``, ``"deg"``, ``"list"``, ``"A"``, ``"Nm"`` …
        size: What one unit of the list is in it: for currents the rated current times the
            share of it that one unit of ``out`` is. None where nobody said.
    """

    name: str
    size: float | None = None

    def __post_init__(self) -> None:
        size = self.size
        number = type(size) is not bool and isinstance(size, int | float | np.number)
        positive = size is None or (number and 0.0 < size < np.inf)
        words = "a positive number: the sign of a list is that of its model"
        expect(positive, f"ModelUnit({self.name!r}).size", repr(size), words)


_EXACT = 1e-5
"""Distance to an integer in list units that is floating point noise (1 pm)."""


def round_to_list(
    values: Float[np.ndarray, "..."],
    name: str,
    bounds: tuple[int, int] = SGN32,
    units: int = LIST_UNITS,
) -> Int[np.ndarray, "..."]:
    """Round mm or ° to the nearest list unit.

    Node values are rounded, not their differences: a constant slope stays unbiased.

    Args:
        values: In mm or °, or in what the entry is in units of.
        name: Of the list entry, for the message.
        bounds: Smallest and largest integer that the entry may hold.
        units: Of the entry in one of the value.

    Raises:
        ExchangeError: If a value is not finite or does not fit the type of the entry.
    """
    array = np.asarray(values, dtype=float)
    scaled = np.rint(array * units)
    low, high = bounds
    fits = (scaled >= low) & (scaled <= high)
    if not fits.all():
        worst = array[~fits].flat[0]
        raise ExchangeError(
            where=name,
            found=f"{worst:.6g}{' mm or °' * (units == LIST_UNITS)}",
            expected=f"a value from {low / units:.10g} to {high / units:.10g}"
            f" ({low} to {high} list units)",
        )
    return np.asarray(scaled, dtype=np.int64)


def exact_in_list(
    values: Float[np.ndarray, "..."] | float, name: str, bounds: tuple[int, int] = SGN32
) -> Int[np.ndarray, "..."]:
    """Convert mm or ° to list units, refusing what is no multiple of one.

    Positions of nodes are never rounded: a node that moves by half a list unit is
    another table.

    Raises:
        ExchangeError: If a value is no multiple of 0.1 µm or 0.0001°, or does not fit.
    """
    array = np.asarray(values, dtype=float)
    rounded = round_to_list(array, name, bounds)
    off = np.abs(array * LIST_UNITS - rounded) > _EXACT
    if off.any():
        raise ExchangeError(
            where=name,
            found=f"{array[off].flat[0]:.10g}",
            expected="a multiple of 0.0001 (0.1 µm or 0.0001° is the unit of the list)",
        )
    return rounded


def from_list_units(values: Int[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Convert list units to mm or °."""
    return np.asarray(values, dtype=np.int64) / LIST_UNITS
