"""Plots of a temperature compensation."""

import dataclasses

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from ...report import _style as style
from ...report._body import Plot
from ...report._scale import Scale, number, place
from ._law import ThermalLaw
from ._result import TemperatureResult, ThermalView

_SHOWN = 8
"""Laws that are drawn: the best, the chosen one and the one without a temperature."""
_KINDS = {0: "none", 1: "constant", 2: "linear"}


@dataclasses.dataclass(frozen=True)
class _Part:
    """One column of the table in display units; ``nodes`` are those of its law."""

    name: str
    unit: str
    nodes: Float[np.ndarray, " m"]
    values: Float[np.ndarray, " n"]
    deviation: Float[np.ndarray, " n"]


def law_plot(fit: TemperatureResult, scale: Scale) -> Plot | None:
    """Draw the written parameters over the temperature with their uncertainty."""
    law = fit.law
    if law is None:
        return None
    found = fit.relative
    parts = [
        _Part("offset_0", "µm", found.offset.temperature, 1e3 * law.offset,
              1e3 * law.offset_deviation),
    ]  # fmt: skip
    if found.coefficient is not None:
        nodes = found.coefficient.temperature
        parts.append(
            _Part("coefficient", "µm/m", nodes, law.coefficient,
                  law.coefficient_deviation)
        )  # fmt: skip
    shown = [part for part in parts if np.any(part.values)] or parts[:1]
    figure, panels = style.new_figure(2.8, columns=len(shown))
    for panel, part in zip(panels, shown, strict=True):
        _draw(panel, law, part)
        panel.axvline(fit.zero, color=style.GREY, linewidth=0.8, linestyle=":")
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_ylabel(f"{part.name} in {part.unit}")
        panel.set_xlabel(_over(fit))
    panels[0].legend(loc="best")
    bands = " and ".join(
        f"± {number(2.0 * float(np.max(part.deviation)))} {part.unit} for {part.name}"
        for part in shown
    )
    caption = (
        "As written, with the sign that the controller adds; the band is ± 2 standard"
        f" deviations (at most {bands}). It is zero at"
        f" {place(round(fit.zero, 2))} °C by choice, dotted, and held outside."
    )
    return Plot("law", "What the PLC writes, over the temperature", figure, caption)


def _draw(panel: Axes, law: ThermalLaw, part: "_Part") -> None:
    # Beyond its own sensor's range a column of the common table repeats its end.
    own = part.nodes[[0, -1]] + np.array([-0.01, 0.01])
    rows = (law.temperature >= own[0]) & (law.temperature <= own[1])
    warm, values, deviation = (
        each[rows] for each in (law.temperature, part.values, part.deviation)
    )
    room = 0.12 * float(np.ptp(warm))
    panel.fill_between(
        warm, values - 2 * deviation, values + 2 * deviation,
        color=style.BLUE, alpha=0.18, linewidth=0, label="± 2 sd",
    )  # fmt: skip
    panel.plot(
        [warm[0] - room, *warm, warm[-1] + room], [values[0], *values, values[-1]],
        color=style.GREY, linestyle="--", linewidth=1.0, label="held",
    )  # fmt: skip
    panel.plot(warm, values, color=style.BLUE, marker="o", markersize=4, label="law")


def _over(fit: TemperatureResult) -> str:
    if len(fit.sensors) > 1:
        return "temperature of its sensor in °C"
    lagged = any(lag.applied for lag in fit.fit.lags)
    name = next(iter(fit.sensors))
    return f"structure behind {name} in °C" if lagged else f"{name} in °C"


def scores_plot(fit: TemperatureResult, scale: Scale) -> Plot | None:
    """Draw how well each law predicts readings that it has not seen."""
    scores = fit.fit.scores
    if len(scores) < 2:
        return None
    best = sorted(scores, key=lambda each: each.held_out)[:_SHOWN]
    plain = [
        each
        for each in scores
        if each not in best
        and (each.chosen or (each.offset == 1 and each.coefficient <= 1))
    ]
    ordered = [*best, *plain]
    names = [_name(each.offset, each.coefficient) for each in ordered]
    figure, panels = style.new_figure(0.7 + 0.2 * len(ordered))
    panel = panels[0]
    rows = np.arange(len(ordered))
    values = np.array([each.held_out for each in ordered]) * scale.factor
    colours = [style.ORANGE if each.chosen else style.GREY for each in ordered]
    panel.barh(rows, values, color=colours, height=0.7)
    panel.set_yticks(rows, names)
    panel.invert_yaxis()
    panel.grid(visible=False, axis="y")
    wide = float(values.max()) > 20 * float(values[values > 0].min(initial=np.inf))
    if wide:
        panel.set_xscale("log")
    for row, value in zip(rows, values, strict=True):
        panel.annotate(
            number(float(value)), (float(value), float(row)), xytext=(4, 0),
            textcoords="offset points", va="center", fontsize=7.5,
        )  # fmt: skip
    panel.margins(x=0.12)
    panel.set_xlabel(
        f"error left of readings that the law did not see, {scale.error} rms"
    )
    chosen = next(
        (name for name, each in zip(names, ordered, strict=True) if each.chosen), "none"
    )
    caption = (
        f"Chosen: {chosen}, the simplest law that predicts no worse than the best by more"
        f" than chance, of {len(scores)} that were tried. Wild readings count with a"
        " limit."
    )
    return Plot("scores", "Which law predicts best", figure, caption)


def _name(offset: int, coefficient: int) -> str:
    first = _KINDS.get(offset, f"{offset} nodes")
    if coefficient == 0:
        return f"offset {first}"
    second = _KINDS.get(coefficient, f"{coefficient} nodes")
    return f"offset {first}, coefficient {second}"


_GROUPS = 5
"""Temperatures that are drawn as lines of their own."""
_MINUTES = 3 * 3600.0
"""s up to which a time axis is in minutes."""


def lines_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw deviations over the position for several temperatures with fitted lines."""
    view, found = fit.view, fit.relative
    assert view.position is not None  # there is a coefficient
    assert found.coefficient is not None
    warm = view.structure[:, found.coefficient.sensor]
    figure, panels = style.new_figure(3.3, columns=2, sharey=True)
    colours = mpl.colormaps[style.SEQUENTIAL]
    norm = Normalize(float(warm.min()), float(warm.max()))
    ends = np.array([view.position.min(), view.position.max()])
    sound = ~view.wild
    for rows in _by_temperature(warm, sound):
        middle = float(np.median(warm[rows]))
        colour = colours(0.9 * norm(middle))
        structure = np.median(view.structure[rows], axis=0)
        before = view.before[rows]
        if fit.law is not None:
            # To the middle temperature along the law, so that the line is theirs.
            place_of = view.position[rows]
            still = np.tile(structure, (int(rows.sum()), 1))
            before = before + found.predict(still, place_of)
            before = before - found.predict(view.structure[rows], place_of)
            line = found.predict(np.tile(structure, (2, 1)), ends) * scale.factor
            panels[0].plot(ends, line, color=colour, linewidth=1.0)
        for panel, values in zip(panels, (before, view.from_file[rows]), strict=True):
            drawn = style.thin(len(values), 1200)
            panel.plot(
                view.position[rows][drawn], values[drawn] * scale.factor,
                linestyle="none", marker="o", markersize=3, markeredgewidth=0,
                alpha=0.7, color=colour, rasterized=style.as_raster(drawn.size),
                label=f"{middle:.1f} °C",
            )  # fmt: skip
    for panel, name in zip(panels, ("before", _after(fit)), strict=True):
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title(name)
        panel.set_xlabel(f"{fit.axis} in {scale.position}")
    panels[0].set_ylabel(_error_label(fit, scale))
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=_GROUPS, markerscale=1.5)
    caption = _lines_caption(fit, scale, ends)
    return Plot("lines", "Error over the position, by temperature", figure, caption)


def _lines_caption(
    fit: TemperatureResult, scale: Scale, ends: Float[np.ndarray, " 2"]
) -> str:
    found, view = fit.relative, fit.view
    assert found.coefficient is not None
    if fit.law is None:
        return (
            "Each colour is a range of temperatures. No law is drawn, since none was"
            f" found that the readings determine.{_wild_words(view)}"
        )
    slope = 1e6 * found.coefficient.slope
    words = (
        "Each colour is a range of temperatures, its readings moved along the law to the"
        " temperature in the middle; the line is the law there. The slope changes by"
        f" {number(slope, signed=True)} µm/m per K"
    )
    if found.intersects:
        inside = ends[0] <= fit.reference <= ends[1]
        words += f", and the lines meet at {place(round(fit.reference, 1))} mm"
        words += "" if inside else ", outside what was measured"
    left = fit.error["from_file"].sound.rms * scale.factor
    return (
        f"{words}. With the files as written {number(left)} {scale.error} rms are left."
        f"{_wild_words(view)}"
    )


def over_temperature_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw the error over the temperature, measured at one position."""
    view, found = fit.view, fit.relative
    warm = view.structure[:, found.offset.sensor]
    figure, panels = style.new_figure(3.0, columns=2, sharey=True)
    sound = np.flatnonzero(~view.wild)
    rows = sound[style.thin(sound.size, 3000)]
    for panel, name, values in zip(
        panels, ("before", _after(fit)), (view.before, view.from_file), strict=True
    ):
        panel.plot(
            warm[rows], values[rows] * scale.factor, linestyle="none", marker="o",
            markersize=2.6, markeredgewidth=0, alpha=0.5, color=style.BLUE,
            rasterized=style.as_raster(rows.size),
        )  # fmt: skip
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_title(name)
        lagged = any(lag.applied for lag in found.lags)
        panel.set_xlabel("structure in °C" if lagged else _sensor_label(fit))
    if fit.law is not None:
        fine = np.linspace(warm.min(), warm.max(), 200)
        law = found.offset.at(fine) * scale.factor
        panels[0].plot(fine, law, color=style.ORANGE, label="law")
        panels[0].legend(loc="best")
    panels[0].set_ylabel(_error_label(fit, scale))
    left = float(np.sqrt(np.mean(view.from_file[sound] ** 2)))
    before = float(np.sqrt(np.mean(view.before[sound] ** 2)))
    caption = (
        f"Every reading at its temperature: {number(before * scale.factor)} {scale.error}"
        f" rms before, {number(left * scale.factor)} {scale.error} with the law as it"
        f" was written.{_wild_words(view)}"
    )
    return Plot("temperature", "Error over the temperature", figure, caption)


def over_time_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw the error over the time before and after, and the temperatures below."""
    view = fit.view
    clock, label = _clock(view)
    figure, panels = style.new_figure(4.2, rows=2, sharex=True, height_ratios=[1.4, 1])
    sound = np.flatnonzero(~view.wild)
    rows = sound[style.thin(sound.size, 3000)]
    layers = (
        ("before", view.before, style.GREY, 0.5),
        (
            "predicted: the law of other stretches of time",
            view.predicted,
            style.BLUE,
            0.7,
        ),
    )
    for name, values, colour, alpha in layers[: 1 if fit.law is None else 2]:
        panels[0].plot(
            clock[rows], values[rows] * scale.factor, linestyle="none", marker="o",
            markersize=2.6, markeredgewidth=0, alpha=alpha, color=colour, label=name,
            rasterized=style.as_raster(rows.size),
        )  # fmt: skip
    panels[0].axhline(0, color=style.INK, linewidth=0.7)
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")
    panels[0].legend(loc="best", markerscale=2)
    _draw_temperatures(panels[1], fit, clock)
    panels[1].set_xlabel(label)
    sizes = [
        fit.error[name].sound.rms * scale.factor for name in ("before", "predicted")
    ]
    caption = (
        f"Above, each reading as measured ({number(sizes[0])} {scale.error} rms) and with"
        f" the law that the other stretches of time give ({number(sizes[1])}"
        f" {scale.error}): a stretch that alone reaches a temperature is predicted by the"
        f" value held there. Below, what the sensors showed.{_wild_words(view)}"
    )
    if fit.law is None:
        caption = (
            f"Above, each reading ({number(sizes[0])} {scale.error} rms); nothing is"
            f" predicted, since no law is written. Below, what the sensors showed."
            f"{_wild_words(view)}"
        )
    return Plot("time", "Error over the time, before and after", figure, caption)


def _draw_temperatures(panel: Axes, fit: TemperatureResult, clock: np.ndarray) -> None:
    view = fit.view
    order = np.argsort(clock, kind="stable")
    colours = (style.ORANGE, style.GREEN, style.BLUE)
    for k, name in enumerate(fit.sensors):
        colour = colours[k % len(colours)]
        panel.plot(
            clock[order], view.sensor[order, k], color=colour, label=name, linewidth=1.0
        )
        if any(lag.applied and lag.sensor == k for lag in fit.fit.lags):
            panel.plot(
                clock[order], view.structure[order, k], color=colour, linestyle="--",
                linewidth=1.0, label=f"structure behind {name}",
            )  # fmt: skip
    panel.set_ylabel("°C")
    panel.legend(loc="best")


def _clock(view: ThermalView) -> tuple[Float[np.ndarray, " t"], str]:
    if not view.timed:
        return view.time, "row of the measurement"
    span = float(np.ptp(view.time))
    if span <= _MINUTES:
        return view.time / 60.0, "time in minutes"
    return view.time / 3600.0, "time in hours"


def _by_temperature(
    warm: Float[np.ndarray, " t"], sound: Bool[np.ndarray, " t"]
) -> list[Bool[np.ndarray, " t"]]:
    """Return the readings of a few ranges of temperature, equally wide."""
    edges = np.linspace(float(warm.min()), float(warm.max()), _GROUPS + 1)
    cell = np.clip(np.searchsorted(edges, warm, side="right") - 1, 0, _GROUPS - 1)
    groups = [np.asarray((cell == k) & sound) for k in range(_GROUPS)]
    return [group for group in groups if group.any()]


def _error_label(fit: TemperatureResult, scale: Scale) -> str:
    if fit.law is None:
        return f"error about its median in {scale.error}"
    return f"error against {place(round(fit.zero, 1))} °C in {scale.error}"


def _after(fit: TemperatureResult) -> str:
    return "nothing written" if fit.law is None else "from the file"


def _sensor_label(fit: TemperatureResult) -> str:
    return f"{fit.sensors[fit.fit.offset.sensor]} in °C"


def _wild_words(view: ThermalView) -> str:
    wild = int(view.wild.sum())
    if not wild:
        return ""
    word = "reading is" if wild == 1 else "readings are"
    return f" {wild} wild {word} left out of the picture."
