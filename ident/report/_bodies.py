"""What the page shows of one fit beside its figures, by kind of compensation."""

from ..job import (
    AbstractResult,
    BacklashResult,
    FrictionResult,
    TableResult,
    TemperatureResult,
)
from ._backlash_body import backlash_body
from ._body import Body
from ._friction_body import friction_body
from ._scale import Scale
from ._second import SecondMeasurement
from ._table_body import table_body
from ._temperature_body import temperature_body


def body_of(
    fit: AbstractResult, scale: Scale, second: SecondMeasurement | None
) -> Body:
    """Return plots, facts and wild readings of a fit."""
    if isinstance(fit, BacklashResult):
        return backlash_body(fit, scale)
    if isinstance(fit, FrictionResult):
        return friction_body(fit, scale)
    if isinstance(fit, TemperatureResult):
        return temperature_body(fit, scale)
    assert isinstance(fit, TableResult)
    return table_body(fit, scale, second)
