"""What the page says of a fit that its readings do not tell."""

import numpy as np

from ..job import LeftOutResult
from ._body import Body
from ._scale import Scale, count, number, percent

_MOST = 8


def left_out_body(fit: LeftOutResult, scale: Scale) -> Body:
    """Return the sentences on a fit that nothing was written of."""
    nothing = ("As written", "Nothing: see the remarks above.")
    part = fit.part
    if part is None:
        return Body(plots=[], facts=[nothing])
    told = int(np.sum(part.determined & (part.support > 0)))
    reached = int(np.sum(part.support > 0))
    facts = [
        (
            "Values",
            f"{told} of {count(len(part.values), 'value')} are determined; readings touch"
            f" {reached} of them.",
        ),
        (
            "Information",
            f"Beside the other effects of the group {percent(part.share)} of what these"
            " readings would tell of it alone is left.",
        ),
        ("Scatter of a reading", f"{number(fit.noise * scale.factor)} {scale.error}."),
    ]
    lost = np.flatnonzero(~part.determined & np.isinf(part.standard_deviation))
    if lost.size:
        names = "; ".join(part.labels[int(k)] for k in lost[:_MOST])
        more = f" and {lost.size - _MOST} more" if lost.size > _MOST else ""
        facts.append(("Not determined", f"{names}{more}."))
    facts.append(nothing)
    return Body(plots=[], facts=facts)
