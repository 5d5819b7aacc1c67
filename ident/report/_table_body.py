"""Plots and sentences of a plane, cross or leadscrew table."""

from ..job import TableResult
from ._body import Body, Plot
from ._iso import iso_plot
from ._lines import change_plot, curve_plot
from ._maps import change_maps, coverage_maps, error_map, remainder_map
from ._readings import Readings, readings_of
from ._residuals import residual_plot
from ._runs import runs_plot
from ._scale import Scale
from ._spread import spread_plot
from ._words import how_it_was_made, wild_rows


def body(fit: TableResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted table."""
    readings = readings_of(fit, scale)
    return Body(
        plots=_plots(fit, readings, scale),
        facts=[*how_it_was_made(fit, readings, scale)],
        wild=wild_rows(fit, readings, scale),
        wild_count=readings.total_wild,
        wild_runs=fit.samples.run is not None,
    )


def _plots(
    fit: TableResult,
    readings: Readings,
    scale: Scale,
) -> list[Plot]:
    """Draw what the data can show, most telling first."""
    if len(fit.masters) == 2:
        drawn = [
            error_map(fit, readings, scale),
            coverage_maps(fit, scale),
            change_maps(fit, scale),
            remainder_map(fit, readings, scale),
        ]
    else:
        drawn = [
            curve_plot(fit, readings, scale),
            change_plot(fit, scale),
            iso_plot(fit),
        ]
    drawn += [
        residual_plot(fit, readings, scale),
        runs_plot(fit, scale),
        spread_plot(readings, scale),
    ]
    return [plot for plot in drawn if plot is not None]
