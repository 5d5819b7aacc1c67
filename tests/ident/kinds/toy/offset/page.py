"""What the report shows of an offset."""

from axcomp.ident.report._body import Body
from axcomp.ident.report._scale import Scale

from .plan import OffsetResult


def body(fit: OffsetResult, scale: Scale) -> Body:
    """Return its one sentence."""
    value = f"{scale.factor * fit.value:+.1f} {scale.error}, the same everywhere."
    return Body(plots=[], facts=[("As written", value)])
