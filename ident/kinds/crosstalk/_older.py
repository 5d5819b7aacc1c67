"""The older crosstalk list, as far as the present form can say the same."""

import numpy as np

from ....models import BilinearGrid, Crosstalk, LegacyCrosstalk
from ...exchange._errors import ExchangeError
from ...exchange._nodes import as_array

_SAME = 1e-9
"""mm; far below the list unit of 1e-4 mm."""


def as_mode_1(old: LegacyCrosstalk) -> Crosstalk:
    """Return the table of the older form as one of mode 1, the sign of a deciding.

    Raises:
        ExchangeError: If it is not one straight line on either side of 0, through 0.
    """
    rates, values = np.asarray(old.nodes.points), np.asarray(old.values)
    low, high = rates[0], rates[-1]
    straight = False
    if low < 0 < high:
        corners = np.interp(rates, [low, 0.0, high], [values[0], 0.0, values[-1]])
        through = abs(float(np.interp(0.0, rates, values))) <= _SAME
        straight = through and bool(np.all(np.abs(corners - values) <= _SAME))
    if not straight:
        raise ExchangeError(
            where="kw.crosstalk.table[]",
            found=f"a table of the older form from {low:g} to {high:g} mm/s²",
            expected="a straight line on either side of 0, through 0, as the present"
            " form has it",
        )
    first, last = values[-1], values[0]
    return Crosstalk(
        surface=BilinearGrid((), (0,)),
        values=as_array(np.array([[first], [first], [last], [last]])),
        acceleration=as_array(high),
        deceleration=as_array(low),
        cycles=old.cycles,
        sign=old.sign,
    )
