"""Plots and sentences of a temperature compensation."""

from collections.abc import Iterator

import numpy as np

from ...report._body import Body, Plot
from ...report._scale import Scale, count, grouped, number, place
from ...report._words import WildRow
from ._plots import (
    law_plot,
    lines_plot,
    over_temperature_plot,
    over_time_plot,
    scores_plot,
)
from ._result import TemperatureResult

_MOST_WILD = 12


def body(fit: TemperatureResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted thermal line."""
    return Body(
        plots=_plots(fit, scale),
        facts=[*_facts(fit, scale)],
        wild=_wild_rows(fit, scale),
        wild_count=int(np.sum(fit.view.wild)),
    )


def _plots(fit: TemperatureResult, scale: Scale) -> list[Plot]:
    along = lines_plot if fit.fit.coefficient is not None else over_temperature_plot
    drawn = [
        along(fit, scale),
        over_time_plot(fit, scale),
        law_plot(fit, scale),
        scores_plot(fit, scale),
    ]
    return [plot for plot in drawn if plot is not None]


def _wild_rows(fit: TemperatureResult, scale: Scale) -> list[WildRow]:
    """Return the largest rejected readings."""
    view = fit.view
    rows = np.flatnonzero(view.wild)
    rows = rows[np.argsort(-np.abs(view.before[rows]), kind="stable")][:_MOST_WILD]
    found = []
    for row in rows.tolist():
        warm = ", ".join(
            f"{name} {view.sensor[row, k]:.1f} °C" for k, name in enumerate(fit.sensors)
        )
        if view.position is not None:
            warm = f"{fit.axis} = {place(float(view.position[row]))} mm, {warm}"
        error = f"{number(float(view.before[row]) * scale.factor, signed=True)} {scale.error}"
        found.append(WildRow(grouped(int(view.row[row]) + 1), warm, "", error))
    return found


def _facts(fit: TemperatureResult, scale: Scale) -> Iterator[tuple[str, str]]:
    found = fit.fit
    yield ("Law of the error", _law_words(fit, scale))
    if found.coefficient is not None:
        yield ("Reference position", _reference_words(fit))
    yield ("Lag", _lag_words(fit))
    yield ("Scatter", _scatter_words(fit, scale))
    if fit.law is not None:
        rows = count(len(fit.law.temperature), "row")
        yield (
            "As written",
            f"{rows} from {place(float(fit.law.temperature[0]))} to"
            f" {place(float(fit.law.temperature[-1]))} °C; nothing is corrected at"
            f" {place(round(fit.zero, 2))} °C. The PLC moves the correction by at"
            f" most {number(1e3 * fit.rate)} µm per second, holds it where a sensor"
            " fails and at the ends of the range; the controller spreads switching"
            f" over {fit.cycles} cycles (temp_comp_n_cycles, P-AXIS-00275).",
        )
    else:
        yield ("As written", "Nothing: see the remarks above.")


def _law_words(fit: TemperatureResult, scale: Scale) -> str:
    found = fit.fit
    slope, deviation = found.slope
    words = [
        f"Offset {found.offset.kind}"
        + (
            f", {number(scale.factor * slope, signed=True)} ±"
            f" {number(scale.factor * deviation)} µm/K from end to end (1 sd, error)"
            if len(found.offset.value) > 1
            else ""
        )
    ]
    if found.coefficient is None:
        words.append("no coefficient, since the error was measured at one position")
    else:
        law = found.coefficient
        part = f"coefficient {law.kind}"
        if len(law.value) > 1:
            part += f", {number(1e6 * law.slope, signed=True)} µm/m per K"
        words.append(part)
    return "; ".join(words) + "."


def _reference_words(fit: TemperatureResult) -> str:
    found = fit.fit
    at = f"{place(round(fit.reference, 3))} mm"
    if not found.intersects:
        return f"{at}: the lines of the temperatures were not taken to meet there."
    sure = found.reference_deviation or 0.0
    return (
        f"{at} ± {number(sure)} mm (1 sd): where the lines of all temperatures meet, so"
        " that only the coefficient follows the temperature."
    )


def _lag_words(fit: TemperatureResult) -> str:
    parts = []
    for lag in fit.fit.lags:
        name = fit.sensors[lag.sensor]
        if lag.sensor_late:
            parts.append(f"{name} itself follows late: the structure is ahead of it.")
        elif not lag.applied:
            parts.append(f"None between {name} and the structure that would show.")
        else:
            low, high = lag.interval
            span = f" (95 %: {low:.3g} to {high:.3g} s)" if high > low else " (given)"
            parts.append(
                f"The structure follows {name} with {lag.time_constant:.3g} s{span};"
                " the PLC program filters the sensor so."
            )
    return " ".join(parts) or "Not looked for."


def _scatter_words(fit: TemperatureResult, scale: Scale) -> str:
    noise, used = fit.fit.noise, int(np.sum(fit.fit.used))
    words = (
        f"{number(scale.factor * noise.white)} {scale.error} from reading to reading,"
        f" {count(used, 'complete reading')}."
    )
    if noise.drift > 0:
        unit = f"{noise.time_constant / 60:.3g} minutes" if fit.view.timed else "rows"
        words += (
            f" Beside it a drift of {number(scale.factor * noise.drift)} {scale.error}"
            f" that forgets in {unit}: the readings tell as much as"
            f" {max(fit.fit.independent, 1):.0f} independent ones."
        )
    return words
