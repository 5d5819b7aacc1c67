"""Plots and sentences of a temperature compensation."""

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ...job import largest_wild
from ...report import _style as style
from ...report._body import Body, Plot, WildRow
from ...report._scale import Scale, count, grouped, number, place
from .._drawing import left_out_words, marks, side_by_side
from ._law import RATE, ThermalLaw
from ._result import TemperatureResult
from .fit import LawScore, TemperatureFit

_MOST_LAWS = 4
_NODES = {1: "constant", 2: "linear"}
_GROUPS = 5
"""Temperatures that are drawn as lines of their own."""
_MINUTES = 3 * 3600.0
"""s up to which a time axis is in minutes."""


def body(fit: TemperatureResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted thermal line."""
    along = lines_plot if fit.fit.coefficient is not None else over_temperature_plot
    plots = [along(fit, scale), over_time_plot(fit, scale)]
    if fit.law is not None:
        plots.append(law_plot(fit, fit.law))
    return Body(
        plots=plots,
        facts=[*_facts(fit, scale)],
        wild=_wild_rows(fit, scale),
        wild_count=int(np.sum(fit.view.wild)),
    )


def _wild_rows(fit: TemperatureResult, scale: Scale) -> list[WildRow]:
    """Return the largest rejected readings."""
    view = fit.view
    found = []
    for row in largest_wild(view.before, view.wild).tolist():
        warm = ", ".join(
            f"{name} {view.temperature[row, k]:.1f} °C"
            for k, name in enumerate(fit.sensors)
        )
        if view.position is not None:
            warm = f"{fit.axis} = {place(float(view.position[row]))} mm, {warm}"
        error = scale.shown(float(view.before[row]), signed=True)
        found.append(WildRow(grouped(int(view.row[row]) + 1), warm, "", error))
    return found


def _facts(fit: TemperatureResult, scale: Scale) -> Iterator[tuple[str, str]]:
    found = fit.fit
    yield ("Law of the error", _law_words(fit, scale))
    yield ("Scatter", _scatter_words(fit, scale))
    if found.scores:
        yield ("Choice of the law", _choice_words(found, scale))
    if fit.law is not None:
        rows = count(len(fit.law.temperature), "row")
        yield (
            "As written",
            f"{rows} from {place(float(fit.law.temperature[0]))} to"
            f" {place(float(fit.law.temperature[-1]))} °C; nothing is corrected at"
            f" {place(round(fit.zero, 2))} °C. The PLC moves the correction by at"
            f" most {number(1e3 * RATE)} µm per second, holds it where a sensor"
            " fails and at the ends of the range; the controller spreads switching"
            f" over {fit.cycles} cycles (temp_comp_n_cycles, P-AXIS-00275).",
        )
    else:
        yield ("As written", "Nothing: see the remarks above.")


def _law_words(fit: TemperatureResult, scale: Scale) -> str:
    found = fit.fit
    slope, deviation = found.slope
    words = f"Offset {found.offset.kind}"
    if len(found.offset.value) > 1:
        words += (
            f", {number(scale.factor * slope, signed=True)} ±"
            f" {number(scale.factor * deviation)} µm/K from end to end (1 sd, error)"
        )
    law = found.coefficient
    if law is None:
        return f"{words}; no coefficient, since the error was measured at one position."
    words += f"; coefficient {law.kind}"
    if len(law.value) > 1:
        words += f", {number(1e6 * law.slope, signed=True)} µm/m per K"
    return f"{words}."


def _choice_words(found: TemperatureFit, scale: Scale) -> str:
    """Return how well the best laws predict readings left out, and which was taken."""

    def words(one: LawScore) -> str:
        counts = {"offset": one.offset, "coefficient": one.coefficient}
        laws = [
            f"{law} {_NODES.get(n, f'{n} nodes')}" for law, n in counts.items() if n
        ]
        return f"{', '.join(laws)}: {scale.shown(one.held_out)}"

    best = sorted(found.scores, key=lambda one: one.held_out)[:_MOST_LAWS]
    chosen = next(one for one in found.scores if one.chosen)
    return (
        f"Readings left out are predicted within (rms) {'; '.join(map(words, best))}."
        f" Taken is the simplest of {len(found.scores)} that is not worse than the best by"
        f" more than chance ({words(chosen)})."
    )


def _scatter_words(fit: TemperatureResult, scale: Scale) -> str:
    noise, used = fit.fit.noise, int(np.sum(fit.fit.used))
    words = (
        f"{scale.shown(noise.white)} from reading to reading,"
        f" {count(used, 'complete reading')}."
    )
    if noise.drift > 0:
        unit = (
            f"{noise.time_constant / 60:.3g} minutes"
            if fit.view.time is not None
            else "rows"
        )
        words += (
            f" Beside it a drift of {scale.shown(noise.drift)}"
            f" that forgets in {unit}: the readings tell as much as"
            f" {max(fit.fit.independent, 1):.0f} independent ones."
        )
    return words


def law_plot(fit: TemperatureResult, law: ThermalLaw) -> Plot:
    """Draw the written parameters over the temperature with their uncertainty."""
    found = fit.relative
    parts = [
        ("offset_0 in µm", found.offset, 1e3 * law.offset, 1e3 * law.offset_deviation)
    ]
    if found.coefficient is not None:
        slope = law.coefficient, law.coefficient_deviation
        parts.append(("coefficient in µm/m", found.coefficient, *slope))
    shown = [part for part in parts if np.any(part[2])] or parts[:1]
    figure, panels = style.new_figure(2.8, columns=len(shown))
    bands = []
    for panel, (name, own, values, deviation) in zip(panels, shown, strict=True):
        # Beyond its own sensor's range a column of the common table repeats its end.
        low, high = own.temperature[[0, -1]] + np.array([-0.01, 0.01])
        rows = (law.temperature >= low) & (law.temperature <= high)
        warm, line, band = law.temperature[rows], values[rows], 2.0 * deviation[rows]
        panel.fill_between(
            warm, line - band, line + band,
            color=style.BLUE, alpha=0.18, linewidth=0, label="± 2 sd",
        )  # fmt: skip
        room = 0.12 * float(np.ptp(warm)) * np.array([-1.0, 1.0])
        panel.plot(
            np.concatenate([room[:1] + warm[:1], warm, warm[-1:] + room[1:]]),
            np.pad(line, 1, mode="edge"),
            color=style.GREY, linestyle="--", linewidth=1.0, label="held",
        )  # fmt: skip
        panel.plot(warm, line, color=style.BLUE, marker="o", markersize=4, label="law")
        panel.axvline(fit.zero, color=style.GREY, linewidth=0.8, linestyle=":")
        panel.axhline(0, color=style.INK, linewidth=0.7)
        panel.set_ylabel(name)
        panel.set_xlabel(_over(fit))
        what, _, unit = name.partition(" in ")
        bands.append(f"± {number(2.0 * float(deviation.max()))} {unit} for {what}")
    panels[0].legend(loc="best")
    caption = (
        "As written, with the sign that the controller adds; the band is ± 2 standard"
        f" deviations (at most {' and '.join(bands)}). It is zero at"
        f" {place(round(fit.zero, 2))} °C by choice, dotted, and held outside."
    )
    return Plot("law", "What the PLC writes, over the temperature", figure, caption)


def _over(fit: TemperatureResult) -> str:
    """Return what a temperature is that a law follows, to stand under its axis."""
    if len(fit.sensors) > 1:
        return "temperature of its sensor in °C"
    behind = "structure behind " if any(lag.applied for lag in fit.fit.lags) else ""
    return f"{behind}{next(iter(fit.sensors))} in °C"


def lines_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw deviations over the position for several temperatures with fitted lines."""
    view, found = fit.view, fit.relative
    assert view.position is not None  # there is a coefficient
    assert found.coefficient is not None
    warm = view.structure[:, found.coefficient.sensor]
    figure, panels = _before_after(fit, scale, f"{fit.axis} in {scale.position}")
    colours = mpl.colormaps[style.SEQUENTIAL]
    norm = Normalize(float(warm.min()), float(warm.max()))
    ends = np.array([view.position.min(), view.position.max()])
    for rows in _by_temperature(warm, ~view.wild):
        middle = float(np.median(warm[rows]))
        colour, before = colours(0.9 * norm(middle)), view.before[rows]
        if fit.law is not None:
            # To the middle temperature along the law, so that the line is theirs.
            own, where = view.structure[rows], view.position[rows]
            level = np.median(own, axis=0)
            before = before + found.predict(np.tile(level, (len(own), 1)), where)
            before = before - found.predict(own, where)
            line = found.predict(np.tile(level, (2, 1)), ends) * scale.factor
            panels[0].plot(ends, line, color=colour, linewidth=1.0)
        for panel, values in zip(panels, (before, view.from_file[rows]), strict=True):
            marks(
                panel, view.position[rows], values * scale.factor,
                color=colour, label=f"{middle:.1f} °C",
            )  # fmt: skip
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper right", ncols=_GROUPS, markerscale=1.5)
    caption = _lines_caption(fit, scale, ends) + left_out_words(int(view.wild.sum()))
    return Plot("lines", "Error over the position, by temperature", figure, caption)


def _lines_caption(
    fit: TemperatureResult, scale: Scale, ends: Float[np.ndarray, " 2"]
) -> str:
    found = fit.relative
    assert found.coefficient is not None
    if fit.law is None:
        return (
            "Each colour is a range of temperatures. No law is drawn, since none was"
            " found that the readings determine."
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
    left = _rms(fit, "from_file", scale)
    return f"{words}. With the files as written {left} rms are left."


def _rms(fit: TemperatureResult, stage: str, scale: Scale) -> str:
    """Return what is left of the readings that are not wild, with its unit."""
    return scale.shown(fit.error[stage].sound.rms)


def over_temperature_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw the error over the temperature, measured at one position."""
    view, found = fit.view, fit.relative
    warm = view.structure[:, found.offset.sensor]
    figure, panels = _before_after(fit, scale, _over(fit))
    sound = ~view.wild
    for panel, values in zip(panels, (view.before, view.from_file), strict=True):
        marks(panel, warm[sound], values[sound] * scale.factor, size=2.6, alpha=0.5)
    if fit.law is not None:
        fine = np.linspace(warm.min(), warm.max(), 200)
        law = found.offset.at(fine) * scale.factor
        panels[0].plot(fine, law, color=style.ORANGE, label="law")
        panels[0].legend(loc="best")
    before, left = (_rms(fit, stage, scale) for stage in ("before", "from_file"))
    caption = (
        f"Every reading at its temperature: {before} rms before, {left} with the law as it"
        " was written."
    )
    caption += left_out_words(int(view.wild.sum()))
    return Plot("temperature", "Error over the temperature", figure, caption)


def over_time_plot(fit: TemperatureResult, scale: Scale) -> Plot:
    """Draw the error over the time before and after, and the temperatures below."""
    view, sound = fit.view, ~fit.view.wild
    clock, label = view.row.astype(float), "row of the measurement"
    if view.time is not None:
        long = float(np.ptp(view.time)) > _MINUTES
        clock = view.time / (3600.0 if long else 60.0)
        label = f"time in {'hours' if long else 'minutes'}"
    figure, panels = style.new_figure(4.2, rows=2, sharex=True, height_ratios=[1.4, 1])
    before, predicted = (_rms(fit, stage, scale) for stage in ("before", "predicted"))
    marks(
        panels[0], clock[sound], view.before[sound] * scale.factor,
        color=style.GREY, size=2.6, alpha=0.5, label="before",
    )  # fmt: skip
    after = "; nothing is predicted, since no law is written."
    if fit.law is not None:
        marks(
            panels[0], clock[sound], view.predicted[sound] * scale.factor, size=2.6,
            label="predicted: the law of other stretches of time",
        )  # fmt: skip
        after = (
            " and with the law that the other stretches of time give"
            f" ({predicted}): a stretch that alone reaches a temperature is predicted by"
            " the value held there."
        )
    panels[0].axhline(0, color=style.INK, linewidth=0.7)
    panels[0].set_ylabel(f"error of {fit.axis} in {scale.error}")
    panels[0].legend(loc="best", markerscale=2)
    _draw_temperatures(panels[1], fit, clock)
    panels[1].set_xlabel(label)
    caption = (
        f"Above, each reading as measured ({before} rms){after} Below, what the sensors"
        " showed."
    )
    caption += left_out_words(int(view.wild.sum()))
    return Plot("time", "Error over the time, before and after", figure, caption)


def _draw_temperatures(
    panel: Axes, fit: TemperatureResult, clock: Float[np.ndarray, " t"]
) -> None:
    view, order = fit.view, np.argsort(clock, kind="stable")
    colours = (style.ORANGE, style.GREEN, style.BLUE)
    lagged = {lag.sensor for lag in fit.fit.lags if lag.applied}
    for k, name in enumerate(fit.sensors):
        colour = colours[k % len(colours)]
        shown = [("-", name, view.temperature)]
        if k in lagged:
            shown.append(("--", f"structure behind {name}", view.structure))
        for line, label, values in shown:
            panel.plot(
                clock[order], values[order, k], color=colour, linestyle=line,
                linewidth=1.0, label=label,
            )  # fmt: skip
    panel.set_ylabel("°C")
    panel.legend(loc="best")


def _by_temperature(
    warm: Float[np.ndarray, " t"], sound: Bool[np.ndarray, " t"]
) -> list[Bool[np.ndarray, " t"]]:
    """Return the readings of a few ranges of temperature, equally wide."""
    edges = np.linspace(float(warm.min()), float(warm.max()), _GROUPS + 1)
    cell = np.clip(np.searchsorted(edges, warm, side="right") - 1, 0, _GROUPS - 1)
    groups = [np.asarray((cell == k) & sound) for k in range(_GROUPS)]
    return [group for group in groups if group.any()]


def _before_after(
    fit: TemperatureResult, scale: Scale, across: str
) -> tuple[Figure, list[Axes]]:
    """Return two panels for errors before and with what was written."""
    up = f"error against {place(round(fit.zero, 1))} °C in {scale.error}"
    after = "from the file"
    if fit.law is None:
        up, after = f"error about its median in {scale.error}", "nothing written"
    return side_by_side(3.2, ("before", after), across, up)
