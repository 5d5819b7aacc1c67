"""Plots and sentences of a plane, cross or leadscrew table."""

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float

from ....data.measurements import Iso230, iso230
from ...job import SampleView, TableResult
from .._body import Body, Plot
from .._iso_chart import draw_iso_chart, iso_chart_sentence
from .._scale import Scale
from ._lines import change_plot, curve_plot
from ._maps import change_maps, coverage_maps, error_map, remainder_map
from ._readings import Readings, readings_of
from ._residuals import residual_plot, runs_plot
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
            _iso_plot(fit),
        ]
    drawn += [
        residual_plot(fit, readings, scale),
        runs_plot(fit, scale),
        spread_plot(readings, scale),
    ]
    return [plot for plot in drawn if plot is not None]


def _iso_plot(fit: TableResult) -> Plot | None:
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
    caption = iso_chart_sentence(tests, unit=fit.unit)
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
