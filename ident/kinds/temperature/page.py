"""Plots and sentences of a temperature compensation."""

from collections.abc import Iterator

import numpy as np

from ...report._body import Body, Plot
from ...report._scale import Scale, count, grouped, number, place
from ...report._words import WildRow
from ._law import RATE
from ._plots import law_plot, lines_plot, over_temperature_plot, over_time_plot
from ._remarks import lag_words, meeting_words
from ._result import TemperatureResult
from .effect import LawScore, TemperatureFit

_MOST_WILD = 12
_MOST_LAWS = 4
_NODES = {1: "constant", 2: "linear"}


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
    drawn = [along(fit, scale), over_time_plot(fit, scale), law_plot(fit, scale)]
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
        yield ("Reference position", meeting_words(found))
    lags = [lag_words(lag, fit.sensors[lag.sensor]) for lag in found.lags]
    yield ("Lag", " ".join(lags) or "Not looked for.")
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


def _choice_words(found: TemperatureFit, scale: Scale) -> str:
    """Return how well the best laws predict readings left out, and which was taken."""

    def words(one: LawScore) -> str:
        counts = {"offset": one.offset, "coefficient": one.coefficient}
        laws = [
            f"{law} {_NODES.get(n, f'{n} nodes')}" for law, n in counts.items() if n
        ]
        return f"{', '.join(laws)}: {number(one.held_out * scale.factor)} {scale.error}"

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
