"""What the page shows of a plane, cross or leadscrew table: `body` puts it together.

`_fitted` (table and readings in display units), `_lines` and `_maps` (the table itself),
`_residuals` (what remains), `_words` (how it was made, and whether its deviations are honest).
"""

import numpy as np

from ....data.measurements import iso230
from ...job import TableResult
from .._body import Body, Plot
from .._iso_chart import draw_iso_chart, iso_chart_sentence
from .._scale import Scale
from ._fitted import readings_of
from ._lines import curve_plot
from ._maps import coverage_maps, error_map
from ._residuals import residual_plot
from ._words import how_it_was_made, wild_rows


def body(fit: TableResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted table."""
    readings = readings_of(fit, scale)
    # What the data can show, most telling first.
    plots: tuple[Plot | None, ...]
    if len(fit.masters) == 2:
        plots = error_map(fit, readings, scale), coverage_maps(fit, scale)
    else:
        plots = curve_plot(fit, readings, scale), _iso_plot(fit)
    drawn = (*plots, residual_plot(fit, readings, scale))
    return Body(
        plots=[plot for plot in drawn if plot is not None],
        facts=[*how_it_was_made(fit, readings, scale)],
        wild=wild_rows(fit, readings, scale),
        wild_count=fit.wild,
    )


def _iso_plot(fit: TableResult) -> Plot | None:
    """Draw all runs before, predicted and verified; None without a run table."""
    figures, samples = fit.error.get("before"), fit.samples
    if figures is None or not figures.iso230 or samples.run is None:
        return None
    # Wild ones included, as in the figures beside the chart.
    finite = np.isfinite(samples.before) & np.isfinite(samples.predicted)
    place, run = samples.positions[finite, 0], samples.run[finite]
    signs = None if samples.direction is None else samples.direction[finite]
    tests = {
        name: iso230(place, getattr(samples, name)[finite], run, signs)
        for name in ("before", "predicted")
    }
    runs = fit.measured
    if runs is not None and (proven := runs.iso230) is not None:
        tests[fit.measured_as] = proven
    figure = draw_iso_chart(tests, axis=fit.axis, unit=fit.unit, caption=False)
    caption = iso_chart_sentence(tests, unit=fit.unit)
    if any(each.without_wild is not None for each in fit.error.values()):
        caption += " Wild readings are in all of it: the standard leaves none out."
    return Plot("iso-230-2", "ISO 230-2: all runs and their means", figure, caption)
