"""What the page shows of one fit beside its figures, by kind of compensation."""

import importlib
from collections.abc import Callable

from ..job import AbstractResult, TableResult
from ._body import Body
from ._scale import Scale
from ._table_body import table_body

_ROOMS = ("backlash", "crosstalk", "friction", "temperature")
"""Kinds with a body of their own, imported when a result asks for it."""


def body_of(fit: AbstractResult, scale: Scale) -> Body:
    """Return plots, facts and wild readings of a fit."""
    if fit.compensation in _ROOMS and not fit.left_out:
        name = fit.compensation
        room = importlib.import_module(f"._{name}_body", __package__)
        draw: Callable[[AbstractResult, Scale], Body] = getattr(room, f"{name}_body")
        return draw(fit, scale)
    if not isinstance(fit, TableResult):
        # Whatever kind it was to be: its readings do not tell it.
        from ..job import LeftOutResult
        from ._left_out_body import left_out_body

        assert isinstance(fit, LeftOutResult)
        return left_out_body(fit, scale)
    return table_body(fit, scale)
