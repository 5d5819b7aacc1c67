"""Offset and drift of each repeated run against the mean of all."""

import numpy as np

from ..job import TableResult
from . import _style as style
from ._body import Plot
from ._scale import Scale, number


def runs_plot(fit: TableResult, scale: Scale) -> Plot | None:
    """Draw the fitted run effects with ± 2 sd; None where there are none."""
    effects = fit.fit.runs
    if not effects:
        return None
    runs = np.array([effect.run for effect in effects])
    figure, (axes,) = style.new_figure(2.5)
    rows = (
        ("offset of the run", 0.0, "o", style.BLUE,
         [(effect.offset, effect.offset_sd) for effect in effects]),
        ("drift from its start to its end", 0.18, "D", style.ORANGE,
         [(effect.drift, effect.drift_sd) for effect in effects]),
    )  # fmt: skip
    drifts = any(effect.drift or effect.drift_sd for effect in effects)
    for label, shift, marker, colour, pairs in rows[: 1 + drifts]:
        value, sd = np.array(pairs).T
        axes.errorbar(
            runs + shift, value * scale.factor,
            2 * np.nan_to_num(sd) * scale.factor, linestyle="none", marker=marker,
            markersize=4.5, color=colour, elinewidth=1, capsize=2, label=label,
        )  # fmt: skip
    axes.axhline(0, color=style.INK, linewidth=0.7)
    axes.set_xlabel("run")
    if runs.size <= 25:
        axes.set_xticks(runs.tolist(), [str(run) for run in runs])
    axes.set_ylabel(f"against the mean in {scale.error}")
    figure.legend(loc="outside upper right", ncols=2)
    return Plot(
        "runs", "Offset and drift of the runs", figure, _say(fit, scale, drifts)
    )


def _say(fit: TableResult, scale: Scale, drifts: bool) -> str:
    effects = fit.fit.runs
    far = max(effects, key=lambda effect: abs(effect.offset))
    text = (
        f"Run {far.run} lies farthest from the mean of the {len(effects)} runs: "
        f"{number(far.offset * scale.factor, signed=True)} ± "
        f"{number(2 * far.offset_sd * scale.factor)} {scale.error} (2 sd)."
    )
    if drifts:
        fast = max(effects, key=lambda effect: abs(effect.drift))
        text += (
            f" Run {fast.run} drifts most, by "
            f"{number(fast.drift * scale.factor, signed=True)} {scale.error} from its "
            "start to its end against the mean drift of all runs."
        )
    return text + " This belongs to the runs and is kept out of the table."
