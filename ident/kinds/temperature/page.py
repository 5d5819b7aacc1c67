"""Plots and sentences of a temperature compensation."""

import itertools
from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.colors import Normalize

from ...job import largest_wild
from ...report import _style as style
from ...report._body import Body, Plot, WildRow
from ...report._scale import Scale, count, grouped, left_out_words, number, place
from ._law import RATE, ThermalLaw
from ._line import Warmth
from ._result import TemperatureResult

_GROUPS = 5
"""Temperatures that are drawn as lines of their own."""
_MINUTES = 3 * 3600.0
"""s up to which a time axis is in minutes."""


def body(fit: TemperatureResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted thermal line."""
    plots = [errors_plot(fit, scale), over_time_plot(fit, scale)]
    if fit.law is not None:
        plots.append(law_plot(fit, fit.law))
    return Body(
        plots=plots,
        facts=[*_facts(fit, scale)],
        wild=_wild_rows(fit, scale),
        wild_count=int(np.sum(fit.fit.wild)),
    )


def _wild_rows(fit: TemperatureResult, scale: Scale) -> list[WildRow]:
    """Return the largest rejected readings."""
    line, wild = fit.fit, []
    for row in largest_wild(fit.before, line.wild).tolist():
        warm = [
            f"{name} {line.data.temperature[name][row]:.1f} °C" for name in line.sensors
        ]
        if line.position is not None:
            warm.insert(0, f"{fit.axis} = {place(float(line.position[row]))} mm")
        error = scale.shown(float(fit.before[row]), signed=True)
        number_of = grouped(int(line.rows[row]) + 1)
        wild.append(WildRow(number_of, ", ".join(warm), "", error))
    return wild


def _facts(fit: TemperatureResult, scale: Scale) -> Iterator[tuple[str, str]]:
    line, offset, law = fit.fit, fit.fit.offset, fit.fit.coefficient
    words = f"Offset {offset.kind}"
    if len(offset.value) > 1:
        slope, deviation = offset.slope
        words += (
            f", {number(scale.factor * slope, signed=True)} ±"
            f" {number(scale.factor * deviation)} µm/K from end to end (1 sd, error)"
        )
    words += (
        "; no coefficient was asked for" if law is None else f"; coefficient {law.kind}"
    )
    if law is not None and len(law.value) > 1:
        words += f", {number(1e6 * law.slope[0], signed=True)} µm/m per K"
    yield ("Law of the error", f"{words}.")
    words = (
        f"{scale.shown(line.noise.white)} from reading to reading,"
        f" {count(len(line.rows), 'complete reading')}."
    )
    if line.noise.drift > 0:
        unit = "rows"
        if line.data.time is not None:
            unit = f"{line.noise.time_constant / 60:.3g} minutes"
        words += f" Beside it a drift of {scale.shown(line.noise.drift)} that forgets in {unit}."
    yield ("Scatter", words)
    words = "Nothing: see the remarks above."
    if fit.law is not None:
        warm = fit.law.temperature
        words = (
            f"{count(len(warm), 'row')} from {place(float(warm[0]))} to"
            f" {place(float(warm[-1]))} °C; nothing is corrected at"
            f" {place(round(fit.zero, 2))} °C. The PLC moves the correction by at"
            f" most {number(1e3 * RATE)} µm per second, holds it where a sensor"
            " fails and at the ends of the range; the controller spreads switching"
            f" over {fit.cycles} cycles (temp_comp_n_cycles, P-AXIS-00275)."
        )
    yield ("As written", words)


def law_plot(fit: TemperatureResult, law: ThermalLaw) -> Plot:
    """Draw the written parameters over the temperature with their uncertainty."""
    thermal = fit.fit
    parts = [
        ("offset_0 in µm", thermal.offset, 1e3 * law.offset, 1e3 * law.offset_deviation)
    ]
    if thermal.coefficient is not None:
        slope = law.coefficient, law.coefficient_deviation
        parts.append(("coefficient in µm/m", thermal.coefficient, *slope))
    shown = [part for part in parts if np.any(part[2])] or parts[:1]
    figure, panels = style.new_figure(2.8, columns=len(shown))
    for panel, (name, fitted, values, deviation) in zip(panels, shown, strict=True):
        # Beyond its own sensor's range a column of the common table repeats its end.
        low, high = fitted.temperature[[0, -1]] + np.array([-0.01, 0.01])
        rows = (law.temperature >= low) & (law.temperature <= high)
        warm, line, band = law.temperature[rows], values[rows], 2.0 * deviation[rows]
        panel.fill_between(
            warm, line - band, line + band,
            color=style.BLUE, alpha=0.18, linewidth=0, label="± 2 sd",
        )  # fmt: skip
        panel.plot(warm, line, color=style.BLUE, marker="o", markersize=4, label="law")
        panel.axvline(fit.zero, color=style.GREY, linewidth=0.8, linestyle=":")
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_ylabel(name)
        panel.set_xlabel(_over(fit))
    panels[0].legend(loc="best")
    caption = (
        "As written, with the sign that the controller adds; the band is ± 2 standard"
        f" deviations. It is zero at {place(round(fit.zero, 2))} °C by choice, dotted, and"
        " held outside."
    )
    return Plot("law", "What the PLC writes, over the temperature", figure, caption)


def _over(fit: TemperatureResult) -> str:
    """Return what a temperature is that a law follows, to stand under its axis."""
    first, *others = fit.fit.lags
    if others:
        return "temperature of its sensor in °C"
    return f"{'structure behind ' * first.applied}{first.sensor} in °C"


def errors_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw errors before and after by temperature, with the law.

    Over the position, or over the temperature where no coefficient was fitted.
    """
    thermal, followed = fit.fit, fit.fit.coefficient or fit.fit.offset
    warm = thermal.structure[followed.sensor]
    x, label = warm, _over(fit)
    if along := thermal.coefficient is not None:
        assert thermal.position is not None  # else there is no coefficient
        x, label = thermal.position, f"{fit.axis} in {scale.position}"
    y_label = f"error against {place(round(fit.zero, 1))} °C in {scale.error}"
    after = "from the file"
    if fit.law is None:
        y_label, after = f"error about its median in {scale.error}", "nothing written"
    figure, panels = style.side_by_side(3.2, ("before", after), label, y_label)
    colours = mpl.colormaps[style.SEQUENTIAL]
    norm = Normalize(float(warm.min()), float(warm.max()))
    for rows in _by_temperature(warm, ~thermal.wild):
        middle = float(np.median(warm[rows]))
        colour = colours(0.9 * norm(middle))
        for panel, values in zip(panels, (fit.before, fit.from_file), strict=True):
            style.marks(
                panel, x[rows], values[rows] * scale.factor,
                color=colour, label=f"{middle:.1f} °C",
            )  # fmt: skip
        if fit.law is not None:
            positions = np.linspace(x[rows].min(), x[rows].max())
            heat: Warmth = {
                k: np.full_like(positions, np.median(each[rows]))
                if along
                else positions
                for k, each in thermal.structure.items()
            }
            line = thermal.predict(heat, positions) * scale.factor
            panels[0].plot(positions, line, color=colour, linewidth=1.0)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=_GROUPS, markerscale=1.5)
    caption = _errors_caption(fit, scale) + left_out_words(int(thermal.wild.sum()))
    if along:
        title = "Error over the position, by temperature"
        return Plot("lines", title, figure, caption)
    return Plot("temperature", "Error over the temperature", figure, caption)


def _errors_caption(fit: TemperatureResult, scale: Scale) -> str:
    words = f"Each colour is a range of temperatures: {_rms(fit, 'before', scale)} rms"
    if fit.law is None:
        words += ". No law is drawn, since none was found that the readings determine."
        return words
    words += f" before, {_rms(fit, 'from_file', scale)} with the files as written."
    if fit.fit.coefficient is None:
        return f"{words} The line is the law."
    slope = number(1e6 * fit.fit.coefficient.slope[0], signed=True)
    words += (
        f" A line is the law in their middle; its slope changes by {slope} µm/m per K"
    )
    if fit.fit.meeting == "met":
        words += f", and the lines meet at {place(round(fit.reference, 1))} mm"
    return f"{words}."


def _rms(fit: TemperatureResult, stage: str, scale: Scale) -> str:
    """Return what is left of the readings that are not wild, with its unit."""
    return scale.shown(fit.error[stage].sound.rms)


def over_time_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw the error over the time before and after, and the temperatures below."""
    thermal, sound = fit.fit, ~fit.fit.wild
    clock, label = thermal.rows.astype(float), "row of the measurement"
    if thermal.data.time is not None:
        long = float(np.ptp(thermal.data.time)) > _MINUTES
        clock = thermal.data.time / (3600.0 if long else 60.0)
        label = f"time in {'hours' if long else 'minutes'}"
    figure, panels = style.new_figure(4.2, rows=2, sharex=True, height_ratios=[1.4, 1])
    style.marks(
        panels[0], clock[sound], fit.before[sound] * scale.factor,
        color=style.GREY, size=2.6, alpha=0.5, label="before",
    )  # fmt: skip
    after = "; nothing is predicted, since no law is written."
    if fit.law is not None:
        style.marks(
            panels[0], clock[sound], fit.predicted[sound] * scale.factor, size=2.6,
            label="predicted: the law of other stretches of time",
        )  # fmt: skip
        after = (
            " and with the law that the other stretches of time give"
            f" ({_rms(fit, 'predicted', scale)})."
        )
    panels[0].axhline(0, color=style.INK, linewidth=0.7)
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")
    order = np.argsort(clock, kind="stable")
    colours = (style.ORANGE, style.GREEN, style.BLUE)
    for lag, colour in zip(thermal.lags, itertools.cycle(colours), strict=False):
        curves = [("-", lag.sensor, thermal.data.temperature[lag.sensor])]
        if lag.applied:
            structure = thermal.structure[lag.sensor]
            curves.append(("--", f"structure behind {lag.sensor}", structure))
        for line, name, values in curves:
            panels[1].plot(
                clock[order], values[order],
                color=colour, linestyle=line, linewidth=1.0, label=name,
            )  # fmt: skip
    panels[1].set_ylabel("°C")
    panels[1].set_xlabel(label)
    for panel in panels:
        # Outside: readings fill the frame.
        panel.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False
        )
    caption = (
        f"Above, each reading as measured ({_rms(fit, 'before', scale)} rms){after} Below,"
        " what the sensors showed."
    )
    caption += left_out_words(int(thermal.wild.sum()))
    return Plot("time", "Error over the time, before and after", figure, caption)


def _by_temperature(
    warm: Float[np.ndarray, " t"], sound: Bool[np.ndarray, " t"]
) -> list[Bool[np.ndarray, " t"]]:
    """Return the readings of a few ranges of temperature, equally wide."""
    edges = np.linspace(float(warm.min()), float(warm.max()), _GROUPS + 1)
    cell = np.clip(np.searchsorted(edges, warm, side="right") - 1, 0, _GROUPS - 1)
    groups = [np.asarray((cell == k) & sound) for k in range(_GROUPS)]
    return [group for group in groups if group.any()]
