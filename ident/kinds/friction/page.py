"""Plots and sentences of a friction law and its list."""

from collections.abc import Iterator

import numpy as np

from ...report._body import Body
from ...report._scale import Scale, count, grouped, percent
from ._plots import choice_plot, circle_plot, curve_plot, residual_plot
from ._result import FrictionResult


def body(fit: FrictionResult, scale: Scale) -> Body:
    """Return what the page shows of a fitted friction law."""
    drawn = [
        curve_plot(fit, scale),
        residual_plot(fit, scale),
        choice_plot(fit),
        circle_plot(fit),
    ]
    return Body(
        plots=[plot for plot in drawn if plot is not None],
        facts=[*_facts(fit, scale)],
    )


def _facts(fit: FrictionResult, scale: Scale) -> Iterator[tuple[str, str]]:
    found = fit.law
    yield ("Law", _law(fit, scale))
    if fit.fit is not fit.law and fit.fit.structure != fit.law.structure:
        yield (
            "The list follows",
            f"A {fit.fit.structure.words}, which predicts better than this law: its"
            " shape is taken from the recording itself.",
        )
    yield (
        "Recording",
        f"{grouped(int(np.sum(fit.view.moving)))} samples in motion; the force error"
        f" of the fit is {percent(found.relative_error)} of the load.",
    )
    if found.undetermined:
        lines = [f"{_plain(n)}: {why}" for n, why in found.undetermined.items()]
        yield ("Not known", " ".join(_sentence(line) for line in lines))
    if found.gauges:
        yield ("Told only together", " ".join(found.gauges))
    if fit.knots is not None:
        rounded = fit.knots.rms / fit.knots.unit
        slowest = "1 µm/s" if fit.length_unit == "mm" else "0.001°/s"
        yield (
            "List",
            f"{count(len(fit.knots.velocity), 'entry', 'entries')} from {slowest} to"
            f" {fit.knots.velocity[-1] / 1000:g} {fit.length_unit}/s; one unit of out is"
            f" {fit.knots.unit:.4g} {scale.error}; the list follows the curve to"
            f" {rounded:.2f} units rms.",
        )
    around = fit.identified.reversal
    if around is not None:
        small = "µm" if fit.length_unit == "mm" else "· 0.001°"
        yield (
            "Reversal",
            f"{count(around.reversals, 'reversal')}: look-ahead {around.lookahead}"
            f" cycles (probability {around.lookahead_probability:.0%}), build-up over"
            f" {1e3 * around.position_delay:.2f} ±"
            f" {1e3 * around.position_delay_sd:.2f} {small}, delay"
            f" {around.delay_cycles} cycles (probability"
            f" {around.delay_probability:.0%}).",
        )
    output = fit.identified.output
    if output is not None:
        yield (
            "Free run",
            "Driven by the recorded current alone, the simulated axis stays within"
            f" {output.free_run:.3g} {fit.length_unit} rms of the measured one.",
        )
    yield ("The fit itself", _sentence(found.message))


def _law(fit: FrictionResult, scale: Scale) -> str:
    found = fit.law
    per = fit.length_unit
    units = {"inertia": f"{scale.error}/({per}/s²)", "stribeck_velocity": f"{per}/s"}
    parts = []
    for name, value in found.parameters.items():
        unit = units.get(name, scale.error)
        if name.startswith("viscous"):
            unit = f"{scale.error}/({per}/s)"
        if name == "stribeck_shape":
            unit = ""
        sd = found.standard_deviations.get(name)
        spread = "" if sd is None else f" ± {sd:.2g}"
        parts.append(f"{_plain(name)} {value:.4g}{spread} {unit}".rstrip())
    words = found.structure.words
    return f"{words[0].upper()}{words[1:]}: {', '.join(parts)}."


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."
