"""Plots and sentences of a backlash."""

from collections.abc import Iterator

import numpy as np

from ...report import _style as style
from ...report._body import Body, Plot
from ...report._scale import Scale, count, number, place
from ._result import BacklashResult


def body(fit: BacklashResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted backlash."""
    return Body(
        plots=[_along_the_axis(fit, scale)],
        facts=[*_facts(fit, scale)],
        wild_count=int(np.sum(fit.fit.wild)),
    )


def _along_the_axis(fit: BacklashResult, scale: Scale) -> Plot:
    """Draw each reading about the mean of both directions, before and after."""
    figure, panels = style.new_figure(3.0, columns=2, sharey=True)
    view = fit.view
    stages = {"before": view.before, "from the file": view.from_file}
    for panel, (name, values) in zip(panels, stages.items(), strict=True):
        for way in (1, -1):
            rows = np.flatnonzero(view.direction == way)
            rows = rows[style.thin(rows.size, 3000)]
            panel.plot(
                view.position[rows],
                values[rows] * scale.factor,
                linestyle="none",
                marker=style.DIRECTION_MARKER[way],
                markersize=3,
                markeredgewidth=0,
                alpha=0.7,
                color=style.DIRECTION_COLOR[way],
                rasterized=style.as_raster(rows.size),
                label=style.DIRECTION_NAME[way],
            )
            if name == "before":
                half = -0.5 * way * fit.fit.width * scale.factor
                panel.axhline(half, color=style.DIRECTION_COLOR[way], linewidth=1.0)
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title(name)
        panel.set_xlabel(f"{fit.axis} in {scale.position}")
    panels[0].set_ylabel(f"about the mean of both directions in {scale.error}")
    panels[0].legend(loc="best")
    half = abs(fit.fit.width) / 2 * scale.factor
    where = "reversal" if fit.moving else "reading"
    caption = (
        f"Each {where} about the mean of both directions: the two lie"
        f" {number(half)} {scale.error} to either side before, and about the same line"
        " with the entry that was written."
    )
    if not fit.fit.significant:
        caption = (
            "Each reading about the mean of both directions: the two directions do not"
            " differ by more than chance."
        )
    return Plot("reversal", "Both directions, before and after", figure, caption)


def _facts(fit: BacklashResult, scale: Scale) -> Iterator[tuple[str, str]]:
    found = fit.fit
    width = number(found.width * scale.factor, signed=True)
    sd = number(found.standard_deviation * scale.factor)
    yield ("Size", f"{width} ± {sd} {scale.error} (1 sd): {found.kind}.")
    yield (
        "Readings",
        f"{count(found.support[0], 'reading')} moving +, {found.support[1]} moving −;"
        f" their scatter is {number(found.noise.white * scale.factor)} {scale.error}.",
    )
    yield ("Along the axis", _dependence(fit, scale))
    if fit.width:
        way = "positive" if fit.reference > 0 else "negative"
        yield (
            "As written",
            f"{number(fit.width * scale.factor, signed=True)} {scale.error}; the axis"
            f" is taken as right when it moves in {way} direction; a reversal is"
            f" spread over {fit.cycles} cycles (n_backlash_cyc, P-AXIS-00243).",
        )
    if found.take_up is not None:
        yield (
            "Take-up",
            f"Nine tenths of it come within {place(found.take_up)} {scale.position}"
            " after a reversal.",
        )
    if found.delay is not None:
        delay, deviation = (1e3 * each for each in found.delay)
        yield (
            "Delay",
            f"The reference is {delay:.2f} ± {deviation:.2f} ms late behind the"
            " encoder; that was taken off.",
        )
    yield ("The fit itself", fit.message)


def _dependence(fit: BacklashResult, scale: Scale) -> str:
    along = fit.fit.dependence
    if along is None:
        return "Too few places to say whether it changes along the axis."
    size = number(along.variation * scale.factor)
    if along.significant:
        return (
            f"It changes along the axis by {size} {scale.error} rms: a bilateral"
            " leadscrew table follows that, one number does not."
        )
    return (
        f"No change along the axis beyond chance ({size} {scale.error} rms, probability"
        f" {along.probability:.2g})."
    )
