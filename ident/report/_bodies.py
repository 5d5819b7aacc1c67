"""What the page shows of one fit beside its figures, by kind of compensation."""

from ..job import AbstractResult, TableResult
from ._body import Body
from ._scale import Scale
from ._second import SecondMeasurement
from ._table_body import table_body


def body_of(
    fit: AbstractResult, scale: Scale, second: SecondMeasurement | None
) -> Body:
    """Return plots, facts and wild readings of a fit."""
    assert isinstance(fit, TableResult)
    return table_body(fit, scale, second)
