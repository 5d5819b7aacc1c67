"""What the page shows of one fit beside its figures: its compensation knows."""

from ..job import AbstractResult
from ..kinds._parts import page_of
from ._body import Body
from ._scale import Scale


def body_of(fit: AbstractResult, scale: Scale) -> Body:
    """Return plots, facts and wild readings of a fit."""
    if not fit.left_out:
        return page_of(fit.compensation).body(fit, scale)
    # Whatever kind it was to be: its readings do not tell it.
    from ..job import LeftOutResult
    from ._left_out_body import left_out_body

    assert isinstance(fit, LeftOutResult)
    return left_out_body(fit, scale)
