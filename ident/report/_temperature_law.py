"""The law of a temperature compensation over the temperature, and how laws compare."""

import dataclasses

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from ..job import TemperatureResult, ThermalLaw
from . import _style as style
from ._plot import Plot
from ._scale import Scale, number, place

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
