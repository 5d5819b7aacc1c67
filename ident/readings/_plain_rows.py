"""Rows of plain numbers as machine code: the bulk of a recording, in one pass.

Importing this module compiles it, which takes a second the first time.
"""

from typing import Any, no_type_check

import numpy as np
from jaxtyping import Float
from numba import types

from ..core._machine_code import machine_code

_LARGEST = (2**53 - 9) // 10
"""Of whole numbers to which another digit can be added, so that a float holds them."""
_POWERS = 10.0 ** np.arange(23)
"""All powers of ten that a float holds exactly."""


def plain_rows(
    raw: bytes, start: int, width: int
) -> Float[np.ndarray, "width t"] | None:
    """Return the numbers of a table from an offset to its end, a column in each row.

    None where a line is not that many numbers between commas, or a number has an
    exponent or more digits than a float holds: whole number and power of ten are exact,
    and one division rounds as reading the number does.
    """
    cells = np.frombuffer(raw, np.uint8)[start:]
    lines = int(np.count_nonzero(cells == ord("\n"))) + (not raw.endswith(b"\n"))
    values = np.empty((width, lines))
    return values if _filled(cells, _POWERS, values) else None


@no_type_check
def _fill(cells, powers, values):
    """Fill in the numbers; False where anything else stands there."""
    at, size = 0, len(cells)
    for row in range(values.shape[1]):
        for column in range(values.shape[0]):
            negative = False
            if at < size and (cells[at] == 45 or cells[at] == 43):
                negative = cells[at] == 45
                at += 1
            whole, digits, point = 0, 0, -1
            while at < size:
                digit = np.int64(cells[at]) - 48
                if 0 <= digit <= 9:
                    if whole > _LARGEST:
                        return False
                    whole = 10 * whole + digit
                    digits += 1
                elif digit == -2 and point < 0:
                    point = digits
                else:
                    break
                at += 1
            decimals = 0 if point < 0 else digits - point
            if digits == 0 or digits > 22:
                return False
            number = whole / powers[decimals]
            values[column, row] = -number if negative else number
            if column < values.shape[0] - 1:
                if at == size or cells[at] != 44:
                    return False
                at += 1
        if at < size:
            if cells[at] != 10:
                return False
            at += 1
    return at == size


_Cells = types.Array(types.uint8, 1, "C", readonly=True)
_Powers = types.Array(types.float64, 1, "C")
_Values = types.Array(types.float64, 2, "C")
_filled: Any = machine_code(_fill, types.boolean(_Cells, _Powers, _Values))
