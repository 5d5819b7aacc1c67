"""The ISO 230-2 chart of a fit: before, predicted, and proven where it was."""

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float

from ...data.measurements import Iso230, describe_iso230, iso230
from ..job import SampleView, TableResult
from ._body import Plot
from ._iso_chart import draw_iso_chart


def iso_plot(fit: TableResult) -> Plot | None:
    """Draw all runs before, predicted and verified; None without a run table."""
    figures = fit.error.get("before")
    if figures is None or not figures.iso230 or fit.samples.run is None:
        return None
    rows = _rows(fit)
    if not rows.any():
        return None
    tests = {
        "before": _evaluate(fit.samples, fit.samples.before, rows),
        "predicted": _evaluate(fit.samples, fit.samples.predicted, rows),
    }
    seen = fit.measured
    if seen is not None and (proven := seen.iso230) is not None:
        tests[fit.measured_as] = proven
    # The chart marks B with a mathematical sign; a name may hold a dollar all the same.
    with mpl.rc_context({"text.parse_math": True}):
        name = fit.axis.replace("$", r"\$")
        figure = draw_iso_chart(tests, axis=name, unit=fit.unit, caption=False)
    caption = (
        "Thin lines are single runs, thick lines their means, bands ± 2 s. "
        + describe_iso230(tests, unit=fit.unit)
    )
    return Plot("iso-230-2", "ISO 230-2: all runs and their means", figure, caption)


def _evaluate(
    samples: SampleView, error: Float[np.ndarray, " t"], rows: Bool[np.ndarray, " t"]
) -> Iso230:
    assert samples.run is not None
    direction = samples.direction
    return iso230(
        samples.positions[rows, 0],
        error[rows],
        samples.run[rows],
        None if direction is None else direction[rows],
    )


def _rows(fit: TableResult) -> Bool[np.ndarray, " t"]:
    """Return the readings behind the figures of the table: with wild ones or without.

    The chart and the table beside it must tell the same A.
    """
    finite = np.isfinite(fit.samples.before) & np.isfinite(fit.samples.predicted)
    wild = np.asarray(fit.samples.share <= 0.05)
    stated = (fit.error["before"].iso230 or {}).get("A")
    if stated is None or not wild.any():
        return np.asarray(finite)
    choices = (finite, finite & ~wild)
    found = [_evaluate(fit.samples, fit.samples.before, rows).A for rows in choices]
    gaps = [abs((value or 0.0) - stated) for value in found]
    return np.asarray(choices[int(np.argmin(gaps))])
