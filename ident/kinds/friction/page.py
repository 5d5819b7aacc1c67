"""Plots and sentences of a friction law and its list."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ....data.units import small_unit
from ...report import _style as style
from ...report._body import Body, Plot
from ...report._scale import Scale, count, grouped, number, percent, place
from ._law import LawCurve
from ._result import FrictionResult

_BINS, _FINE = 28, 40
_FEW = 5
_SLOW = 0.12
"""Share of the speeds that the enlarged part shows."""
_PER_MM = 1000.0
_ROOM = 8.0
"""Medians that the plot of the remainder shows; beyond lie wild samples."""


def body(fit: FrictionResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted friction law."""
    drawn = curve_plot(fit, scale), residual_plot(fit, scale), circle_plot(fit)
    plots = [plot for plot in drawn if plot is not None]
    return Body(plots=plots, facts=[*_facts(fit, scale)])


def _facts(fit: FrictionResult, scale: Scale) -> Iterator[tuple[str, str]]:
    view, found, per = fit.view, fit.view.found, fit.view.samples.unit
    law, chosen = found.law, found.fit
    yield ("Law", _law(fit, scale))
    if chosen.structure != law.structure:
        yield (
            "The list follows",
            f"A {chosen.structure.words}, which predicts better than this law: its"
            " shape is taken from the recording itself.",
        )
    yield (
        "Recording",
        f"{grouped(int(np.sum(view.samples.in_motion)))} samples in motion; the force error"
        f" of the fit is {percent(law.relative_error)} of the load.",
    )
    if (knots := view.knots) is not None:
        yield (
            "List",
            f"{count(len(knots.velocity), 'entry', 'entries')} from 1 {small_unit(per)}/s to"
            f" {knots.velocity[-1] / 1000:g} {per}/s; one unit of out is {knots.unit:.4g}"
            f" {scale.error}; the list follows the curve to {knots.rms / knots.unit:.2f}"
            " units rms.",
        )
    if (reversal := found.reversal) is not None:
        yield (
            "Reversal",
            f"{count(reversal.reversals, 'reversal')}: look-ahead {reversal.lookahead}"
            f" cycles (probability {reversal.lookahead_probability:.0%}), build-up over"
            f" {1e3 * reversal.position_delay:.2f} ±"
            f" {1e3 * reversal.position_delay_sd:.2f} {small_unit(per)}, delay"
            f" {reversal.delay_cycles} cycles (probability"
            f" {reversal.delay_probability:.0%}).",
        )
    if found.output is not None:
        yield (
            "Free run",
            "Driven by the recorded current alone, the simulated axis stays within"
            f" {found.output.free_run:.3g} {per} rms of the measured one.",
        )
    yield ("The fit itself", law.message)


def _law(fit: FrictionResult, scale: Scale) -> str:
    law, per, parts = fit.view.found.law, fit.view.samples.unit, []
    units = {"inertia": f"{scale.error}/({per}/s²)", "stribeck_velocity": f"{per}/s"}
    units["stribeck_shape"] = ""
    for name, value in law.parameters.items():
        unit = units.get(name, scale.error)
        if name.startswith("viscous"):
            unit = f"{scale.error}/({per}/s)"
        plain = name.replace("_", " ")
        size = _with_spread(value, law.standard_deviations.get(name))
        parts.append(f"{plain} {size} {unit}".rstrip())
    words = law.structure.words
    return f"{words[0].upper()}{words[1:]}: {', '.join(parts)}."


def _with_spread(value: float, sd: float | None) -> str:
    """Return a value to the second digit of its standard deviation, and that."""
    text = f"{value:.4g}"
    if sd is not None and sd > 0.0 and math.isfinite(sd):
        digits = max(1 - math.floor(math.log10(sd)), 0)
        text = f"{value:.{digits}f} ± {sd:.{digits}f}"
    elif sd is not None:
        text += f" ± {sd:.2g}"
    return text.replace("-", "−")


def _binned(
    x: Float[np.ndarray, " t"], values: Float[np.ndarray, " t"], bins: int
) -> Float[np.ndarray, "3 b"]:
    """Return place, median and spread of values in bins of equal counts.

    Wild samples hardly move them; bins of too few samples are left out.
    """
    if x.size < _FEW:
        return np.zeros((3, 0))
    edges = np.unique(np.quantile(x, np.linspace(0, 1, bins + 1)))
    index, rows = np.searchsorted(edges[1:-1], x, "right"), []
    for inside in (index == k for k in range(len(edges) - 1)):
        if np.count_nonzero(inside) >= _FEW:
            middle = np.median(values[inside])
            spread = 1.4826 * np.median(np.abs(values[inside] - middle))
            rows.append((np.median(x[inside]), middle, spread))
    return np.array(rows).reshape(-1, 3).T


def curve_plot(fit: FrictionResult, scale: Scale) -> Plot | None:
    """Draw friction over speed, all speeds and the slow ones enlarged."""
    curve = fit.view.curve
    if curve is None:
        return None
    figure, panels = style.new_figure(3.4, columns=2)
    binned, view, samples = {}, fit.view, fit.view.samples
    for direction in (1, -1):
        rows = samples.in_motion & (np.sign(samples.velocity) == direction)
        speed, current = np.abs(samples.velocity[rows]), direction * view.before[rows]
        binned[direction] = _binned(speed, current, _BINS)
    fast = float(curve.speed[-1])
    limits = (fast, max(_SLOW * fast, 4.0 * float(curve.speed[0])))
    for panel, limit in zip(panels, limits, strict=True):
        _draw(panel, fit, curve, binned, limit)
        panel.set_xlim(-0.02 * limit, 1.02 * limit)
        panel.set_xlabel(f"speed in {fit.view.samples.unit}/s")
    panels[0].set_ylabel(f"friction in {scale.error}")
    panels[0].set_title("all speeds")
    panels[1].set_title("slow speeds, enlarged")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper right", ncols=3)
    return Plot("curve", "Friction over speed", figure, _caption(fit, curve))


def _draw(
    panel: Axes,
    fit: FrictionResult,
    curve: LawCurve,
    binned: dict[int, Float[np.ndarray, "3 b"]],
    limit: float,
) -> None:
    laws = zip((1, -1), curve.currents, curve.deviations, strict=False)
    visible = curve.speed <= 1.05 * limit
    heights = []
    for sign, law, sd in laws:
        color = style.DIRECTION_COLOR[sign]
        speed, mean, spread = binned[sign][:, binned[sign][0] <= limit]
        panel.errorbar(
            speed, mean, spread,
            linestyle="none", marker=style.DIRECTION_MARKER[sign], markersize=3.5,
            linewidth=0.7, color=color, alpha=0.8,
            label=f"measured, {style.DIRECTION_NAME[sign]}",
        )  # fmt: skip
        name = f"law, {'+−'[sign < 0]}"
        panel.plot(curve.speed, law, color=color, linewidth=1.2, label=name)
        low, high = law - 2 * sd, law + 2 * sd
        panel.fill_between(curve.speed, low, high, color=color, alpha=0.15, linewidth=0)
        heights += [law[visible], mean]
    if (knots := fit.view.knots) is not None:
        listed = knots.current(curve.speed)
        panel.plot(curve.speed, listed, color=style.INK, linewidth=0.9, label="list")
        panel.errorbar(
            knots.velocity / 1000.0, knots.out * knots.unit, 2 * fit.entry_deviations,
            linestyle="none", marker="s", markersize=3.2, linewidth=0.7,
            color=style.INK, markerfacecolor="white", label="its entries",
        )  # fmt: skip
        heights.append(listed[visible])
    values = np.concatenate([height for height in heights if height.size])
    low, high = float(values.min()), float(values.max())
    room = 0.25 * (high - low) or 0.1 * abs(high) or 1.0
    bottom = min(low - room, 0.0) if low < 0.4 * high else low - room
    panel.set_ylim(bottom, high + room)


def _caption(fit: FrictionResult, curve: LawCurve) -> str:
    slow, fast = place(float(curve.speed[0])), place(float(curve.speed[-1]))
    text = (
        f"Median friction in bins of speed with their scatter, and law and entries with"
        f" ± 2 standard deviations, from {slow} to {fast} {fit.view.samples.unit}/s: only these"
        " speeds were driven."
    )
    if fit.view.knots is None:
        return f"{text} No list is written."
    share = percent(curve.difference)
    return f"{text} The list is the same for both directions, whose mean difference is {share}."


def residual_plot(fit: FrictionResult, scale: Scale) -> Plot | None:
    """Draw what the list leaves on windows held out, over velocity and position.

    Over the position the whole friction is taken off, also where a cautious list gives a
    share of it: what is left there is what depends on the place.
    """
    view = fit.view
    rows = np.flatnonzero(view.samples.in_motion)
    if not rows.size:
        return None
    chosen = rows[style.thin(rows.size)]
    residual = view.predicted[chosen]
    size = np.abs(residual)
    limit = min(_ROOM * float(np.median(size)), 1.2 * float(size.max())) or 1.0
    outside = int(np.sum(size > limit))
    share = 1.0 if fit.view.knots is None else fit.view.level
    beyond = residual - (1.0 / share - 1.0) * view.listed[chosen]
    figure, panels = style.new_figure(2.8, columns=2, sharey=True)
    unit = fit.view.samples.unit
    views = {
        f"velocity in {unit}/s": (view.samples.velocity, residual),
        f"position in {unit}": (view.recording.commanded, beyond),
    }
    largest = 0.0
    for panel, (name, (x, value)) in zip(panels, views.items(), strict=True):
        panel.plot(
            x[chosen], value, linestyle="none", marker=".", markersize=1.6,
            color=style.BLUE, alpha=0.35, markeredgewidth=0, rasterized=True,
        )  # fmt: skip
        places, middle, _ = _binned(x[chosen], value, _FINE)
        largest = float(np.max(np.abs(middle), initial=0.0))  # in the end by place
        panel.plot(places, middle, color=style.ORANGE, linewidth=1.3)
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_ylim(-limit, limit)
        panel.set_xlabel(name)
    panels[0].set_ylabel(f"remaining in {scale.error}")
    level = float(np.median(np.abs(view.before[rows])))
    percentage = percent(largest / level) if level else "–"
    caption = (
        "Current that lists made of the other windows leave, sample by sample; the line"
        " is the running median. Over the position, where the whole law is taken off, it"
        f" moves by up to {percentage} of the friction: what depends on the place, a friction"
        " list cannot say."
    )
    if outside:
        caption += f" {outside} samples lie beyond the plot."
    return Plot("residual", "What remains (held out)", figure, caption)


def circle_plot(fit: FrictionResult) -> Plot | None:
    """Draw the simulated circle without and with the list, deviations magnified."""
    circle = fit.circle
    if circle is None:
        return None
    without, with_list = (_PER_MM * spike for spike in circle.spikes)
    figure, panels = style.new_figure(
        3.4, columns=2, subplot_kw={"projection": "polar"}
    )
    span = max(without, with_list) or 1.0
    angle = np.deg2rad(circle.angle)
    level = np.full(angle.shape, 2 * span)
    stages = {"without the list": circle.without, "with the list": circle.with_list}
    for panel, (name, deviation) in zip(panels, stages.items(), strict=True):
        panel.plot(angle, level, color=style.GREY, linewidth=0.6)
        away = level + _PER_MM * deviation
        panel.plot(angle, away, color=style.BLUE, linewidth=1.1)
        panel.set_ylim(0, 3.2 * span)
        ticks = {span: f"−{span:.2g}", 2 * span: "0", 3 * span: f"+{span:.2g} µm"}
        panel.set_yticks([*ticks], [*ticks.values()])
        panel.tick_params(labelsize=9.5)
        panel.set_title(name, loc="center", y=1.12)  # clear of the angle at the top
    magnified = circle.radius * _PER_MM / (2 * span)
    caption = (
        f"Simulated: circle of {circle.radius:g} mm radius at"
        f" {60 * circle.feed:g} mm/min, deviations magnified {magnified:.0f} times, the"
        f" other axis perfect, loop {circle.loop}. The spikes are"
        f" {number(without)} µm without the list and {number(with_list)} µm with it."
    )
    return Plot("circle", "Quadrant spikes in a circular test", figure, caption)
