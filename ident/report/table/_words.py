"""How a table was made, in sentences, and its wild readings."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...fit import RunEffect
from ...job import SampleView, TableResult, largest_wild
from .. import _style as style
from .._body import WildRow
from .._scale import Scale, grouped, number, percent, spot

_INSIDE = 0.9545
"""Share of a normal distribution within ± 2 sd."""


def how_it_was_made(
    fit: TableResult, readings: SampleView, scale: Scale
) -> Iterator[tuple[str, str]]:
    """Return pairs of a heading and a plain sentence on how the table was found."""
    table, surface, more = fit.fit, "the table", ""
    scatter = table.noise
    if table.line_offset:
        # The scatter that is seen, and what one probing cannot show of it.
        scatter, surface = (
            np.sqrt(scatter**2 - table.line_offset**2),
            "a smooth surface",
        )
        more = (
            f" An offset of every line of readings, {scale.shown(table.line_offset)} (1 sd), is"
            " assumed on top: one probing cannot show it. Probe twice to know."
        )
    noise = (
        f"A single reading scatters by {scale.shown(scatter)} (1 sd) about {surface}"
    )
    yield ("Noise", f"{noise}, wild readings left out.{more}")
    if honesty := _calibration(readings, scale):
        yield ("Uncertainty", honesty)
    yield ("Wild readings", _loss(fit))
    yield ("Smoothness", _smoothness(table.smoothness))
    if table.runs:
        yield ("Runs", _runs(table.runs, scale))
    yield (
        "Rounding",
        f"Rounding to whole list units moves the table by at most {scale.shown(fit.rounding)}.",
    )
    if fit.every is not None and fit.every > 1:
        text = (
            f"{grouped(fit.readings)} readings were read in pieces, and the table and the "
            "errors above rest on all of them. What is drawn of single readings, and said of "
            f"slices and cells, is one reading in {grouped(fit.every)} "
            f"({grouped(len(readings.error))})."
        )
        yield ("Shown", text)
    if fit.cycles is not None:
        yield (
            "Reversal",
            f"The jump between the two directions is spread over {fit.cycles} "
            "cycles (n_backlash_cyc, P-AXIS-00243).",
        )
    yield ("The fit itself", table.message)


def _loss(fit: TableResult) -> str:
    loss, wild, size = fit.fit.loss, fit.wild, fit.readings
    how = {
        "student": "Readings far from the others count less (Student's t)",
        "huber": "Readings far from the others count less (Huber)",
        "gauss": "All readings count fully (Gauss)",
    }[loss]
    if not wild:
        return f"{how}; none of {grouped(size)} was rejected as wild."
    verb = "was" if wild == 1 else "were"
    end = f"{verb} rejected as wild and had no influence."
    if loss == "huber":
        end = f"{verb} wild: figures leave them out, and their pull is limited."
    return f"{how}; {grouped(wild)} of {grouped(size)} ({percent(wild / size)}) {end}"


def _smoothness(weights: Mapping[str, float]) -> str:
    """Return the weights of the prior, or that there is none."""
    if not any(weight > 0 for weight in weights.values()):
        return "None: every node rests on its own readings (smoothness 0)."
    named = ", ".join(f"{name}: {weight:.3g}" for name, weight in weights.items())
    return f"Weights of the prior relative to 1/noise²: {named}."


def _runs(effects: Sequence[RunEffect], scale: Scale) -> str:
    """Return by how much the runs lie apart, which is kept out of the table."""
    farthest = max(effects, key=lambda effect: abs(effect.offset))
    offset = number(farthest.offset * scale.factor, signed=True)
    text = (
        f"Run {farthest.run} lies farthest from the mean of the {len(effects)} runs: "
        f"{offset} ± {scale.shown(2 * farthest.offset_sd)} (2 sd)."
    )
    fast = max(effects, key=lambda effect: abs(effect.drift))
    if fast.drift:
        text += (
            f" Run {fast.run} drifts most, by "
            f"{scale.shown(fast.drift, signed=True)} from its "
            "start to its end against the mean drift of all runs."
        )
    return text + " This belongs to the runs and is kept out of the table."


def _calibration(readings: SampleView, scale: Scale) -> str:
    """Return how far residuals scatter against what was predicted; empty: too few are."""
    keep = readings.sound & np.isfinite(readings.predicted_sd)
    keep &= readings.predicted_sd > 0
    if np.count_nonzero(keep) < 10:
        return ""
    sd = readings.predicted_sd[keep]
    z = readings.predicted[keep] / sd
    inside, ratio = float(np.mean(np.abs(z) <= 2)), float(np.sqrt(np.mean(z**2)))
    # The median: readings far from all others, as at the end of a left-out block, have
    # a predicted sd that is many times as large.
    text = (
        f"Half of the left-out readings are predicted to {number(float(np.median(sd)))} "
        f"{scale.error} (1 sd) or better; what remains is {ratio:.2f} × the "
        f"predicted sd (rms). {percent(inside)} of the readings lie "
        f"within ± 2 predicted sd ({percent(_INSIDE)} expected of a normal law): "
    )
    if ratio <= 1.25 and inside < 0.9:
        return (
            f"{text}right on the whole, but not everywhere: some places scatter more."
        )
    honesty = "are on the safe side"
    if ratio > 1.25:
        honesty = "are too small by about that factor"
    elif ratio >= 0.8:
        honesty = "can be taken at their word"
    return f"{text}the error bars in this report {honesty}."


def wild_rows(fit: TableResult, readings: SampleView, scale: Scale) -> list[WildRow]:
    """Return the largest rejected readings, at most a dozen."""
    rows = []
    for row in largest_wild(readings.before, readings.wild).tolist():
        where = spot(fit.masters, readings.positions[row], fit.units)
        sign = int(readings.signs[row])
        direction = f", {style.DIRECTION_NAME[sign]}" if sign else ""
        run = "" if readings.run is None else str(int(readings.run[row]))
        place_in_log = row if fit.every is None else int(readings.order[row])
        error = f"{number(float(readings.before[row]), signed=True)} {scale.error}"
        where = f"{where}{direction}"
        rows.append(WildRow(grouped(place_in_log + 1), where, run, error))
    return rows
