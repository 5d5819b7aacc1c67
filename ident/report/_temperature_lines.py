"""Errors of an axis at several temperatures: over the position, the temperature, the time."""

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from ..job import TemperatureResult, ThermalView
from . import _style as style
from ._plot import Plot
from ._scale import Scale, number, place

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
