"""Plots and sentences of a backlash."""

from collections.abc import Iterator

import numpy as np

from ...report import _style as style
from ...report._body import Body, Plot
from ...report._scale import Scale, count, left_out_words, number
from ._result import BacklashResult


def body(fit: BacklashResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted backlash."""
    plots, facts = [_along_the_axis(fit, scale)], [*_facts(fit, scale)]
    return Body(plots=plots, facts=facts, wild_count=int(np.sum(fit.sides.wild)))


def _along_the_axis(fit: BacklashResult, scale: Scale) -> Plot:
    """Draw each reading about the mean of both directions, before and after."""
    x_label = f"{fit.axis} in {scale.position}"
    y_label = f"about their mean in {scale.error}"
    figure, panels = style.side_by_side(
        3.0, ("before", "from the file"), x_label, y_label
    )
    view, width, sound = fit.sides, fit.measured_width[0], ~fit.sides.wild
    for panel, values in zip(panels, (view.before, fit.from_file), strict=True):
        scaled = values[sound] * scale.factor
        style.draw_cloud(panel, view.position[sound], scaled, view.direction[sound])
    for direction in (1, -1):
        half = -0.5 * direction * width * scale.factor
        panels[0].axhline(half, color=style.DIRECTION_COLOR[direction], linewidth=1.0)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=2, markerscale=1.5)
    caption = (
        "Each reading about the mean of both directions: the two lie"
        f" {scale.shown(abs(width) / 2)} to either side before, and about the same line"
        " with the entry that was written."
    )
    if not fit.significant:
        caption = (
            "Each reading about the mean of both directions: the two directions do not"
            " differ by more than chance."
        )
    caption += left_out_words(int(view.wild.sum()))
    return Plot("reversal", "Both directions, before and after", figure, caption)


def _facts(fit: BacklashResult, scale: Scale) -> Iterator[tuple[str, str]]:
    width, deviation = fit.measured_width
    size = number(width * scale.factor, signed=True)
    yield ("Size", f"{size} ± {scale.shown(deviation)} (1 sd): {fit.type}.")
    positive, negative = fit.support
    yield (
        "Readings",
        f"{count(positive, 'reading')} moving +, {negative} moving −;"
        f" their scatter is {scale.shown(fit.noise)}.",
    )
    yield ("Along the axis", _dependence(fit, scale))
    if fit.width:
        direction = "positive" if fit.reference > 0 else "negative"
        yield (
            "As written",
            f"{scale.shown(fit.width, signed=True)}; the axis"
            f" is taken as right when it moves in {direction} direction; a reversal is"
            f" spread over {fit.cycles} cycles (n_backlash_cyc, P-AXIS-00243).",
        )


def _dependence(fit: BacklashResult, scale: Scale) -> str:
    dependence = fit.dependence
    if dependence is None:
        return "Too few places to say whether it changes along the axis."
    size, chance = scale.shown(dependence.variation), dependence.probability
    return (
        f"It changes by {size} rms, by chance alone with a probability of {chance:.2g}."
    )
