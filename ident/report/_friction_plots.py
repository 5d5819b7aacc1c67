"""Friction: what remains over speed and place, which law was chosen, and the circle."""

import numpy as np

from ..job import FrictionResult, choice_sentence
from . import _style as style
from ._plot import Plot
from ._scale import Scale, number, percent

_PER_MM = 1000.0
_ROOM = 8.0
"""Medians that the plot of the remainder shows; beyond lie wild samples."""


def residual_plot(fit: FrictionResult, scale: Scale) -> Plot | None:
    """Draw what the law leaves on windows held out, over velocity and position."""
    view = fit.view
    rows = np.flatnonzero(view.moving)
    if not rows.size:
        return None
    chosen = rows[style.thin(rows.size)]
    left = view.predicted[chosen]
    limit = _ROOM * float(np.median(np.abs(left))) or 1.0
    outside = int(np.sum(np.abs(left) > limit))
    figure, panels = style.new_figure(2.8, columns=2, sharey=True)
    unit = fit.length_unit
    views = {
        f"velocity in {unit}/s": view.velocity,
        f"position in {unit}": view.position,
    }
    medians = []
    for panel, (name, where) in zip(panels, views.items(), strict=True):
        panel.plot(
            where[chosen], left, linestyle="none", marker=".", markersize=1.6,
            color=style.BLUE, alpha=0.35, markeredgewidth=0, rasterized=True,
        )  # fmt: skip
        places, middle = _running(where[chosen], left)
        panel.plot(places, middle, color=style.ORANGE, linewidth=1.3)
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_ylim(-limit, limit)
        panel.set_xlabel(name)
        medians.append(float(np.max(np.abs(middle), initial=0.0)))
    panels[0].set_ylabel(f"remaining in {scale.error}")
    level = float(np.median(np.abs(view.before[rows])))
    over = percent(medians[1] / level) if level else "–"
    caption = (
        "Current that lists made of the other windows leave, sample by sample; the line"
        f" is the running median. Over the position it moves by up to {over} of the"
        " friction: what depends on the place, a friction list cannot say."
    )
    if outside:
        caption += f" {outside} samples lie beyond the plot."
    return Plot("residual", "What remains (held out)", figure, caption)


def _running(
    where: np.ndarray, left: np.ndarray, bins: int = 40
) -> tuple[np.ndarray, np.ndarray]:
    edges = np.unique(np.quantile(where, np.linspace(0, 1, bins + 1)))
    if len(edges) < 2:
        return np.zeros(0), np.zeros(0)
    index = np.clip(np.searchsorted(edges, where, "right") - 1, 0, len(edges) - 2)
    pairs = [
        (float(np.median(where[index == k])), float(np.median(left[index == k])))
        for k in range(len(edges) - 1)
        if np.any(index == k)
    ]
    columns = np.array(pairs).reshape(-1, 2)
    return columns[:, 0], columns[:, 1]


def choice_plot(fit: FrictionResult) -> Plot:
    """Draw how well each law predicts windows held out."""
    choice = fit.choice
    figure, (panel,) = style.new_figure(2.4, columns=1)
    names = [each.structure.words for each in choice.candidates]
    errors = 100 * np.array([each.error for each in choice.candidates])
    spreads = 100 * np.array([each.standard_error for each in choice.candidates])
    rows = np.arange(len(names))[::-1]
    colours = [
        style.ORANGE if k == choice.chosen else style.BLUE for k in range(len(names))
    ]
    for row, error, spread, colour in zip(rows, errors, spreads, colours, strict=True):
        panel.errorbar(
            error, row, xerr=spread, marker="o", markersize=4, color=colour, linewidth=1
        )
    panel.set_yticks(rows, names, fontsize=6.5)
    panel.set_xlabel("force error held out in %")
    return Plot("choice", "Which law predicts best", figure, choice_sentence(choice))


def circle_plot(fit: FrictionResult) -> Plot | None:
    """Draw the simulated circle without and with the list, deviations magnified."""
    circle = fit.circle
    if circle is None:
        return None
    without, with_list = (_PER_MM * each for each in circle.spikes)
    figure, panels = style.new_figure(
        3.4, columns=2, subplot_kw={"projection": "polar"}
    )
    span = max(without, with_list) or 1.0
    angle = np.deg2rad(circle.angle)
    stages = {"without the list": circle.without, "with the list": circle.with_list}
    for panel, (name, deviation) in zip(panels, stages.items(), strict=True):
        panel.plot(
            angle, np.full(angle.shape, 2 * span), color=style.GREY, linewidth=0.6
        )
        panel.plot(
            angle, 2 * span + _PER_MM * deviation, color=style.BLUE, linewidth=1.1
        )
        panel.set_ylim(0, 3.2 * span)
        panel.set_yticks(
            [span, 2 * span, 3 * span], [f"−{span:.2g}", "0", f"+{span:.2g} µm"]
        )
        panel.tick_params(labelsize=6.5)
        panel.set_title(name)
    magnified = circle.radius * _PER_MM / (2 * span)
    caption = (
        f"Simulated: circle of {circle.radius:g} mm radius at"
        f" {60 * circle.feed:g} mm/min, deviations magnified {magnified:.0f} times, the"
        f" other axis perfect, loop {circle.loop}. The spikes fall from"
        f" {number(without)} µm to {number(with_list)} µm."
    )
    if with_list >= without:
        caption = caption.replace("fall from", "do not fall:").replace(
            "µm to", "µm and"
        )
    return Plot("circle", "Quadrant spikes in a circular test", figure, caption)
