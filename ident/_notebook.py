"""How fits show themselves: a table as text and in HTML, and plots."""

import html
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..data.html import table_html
from ..models import AbstractFriction, AbstractNodes, Cross, Leadscrew, Plane

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._library import Fit, FittedEffect

_COLORS = ("#0072B2", "#D55E00")
"""Of positive and negative direction (Okabe-Ito)."""


_HEADS = ("effect", "values", "largest", "largest σ", "readings")


def fit_text(fit: "Fit") -> str:
    """Return what a fit found as text: effects, noise by axis, what is not determined."""
    rows = [_HEADS, *((name, *_summary(one)) for name, one in fit.items())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
    return "\n".join([*(line.rstrip() for line in lines), *_sentences(fit)])


def fit_html(fit: "Fit") -> str:
    """Return the same in HTML."""
    rows = [(name, *_summary(one)) for name, one in fit.items()]
    sentences = (f"<p>{html.escape(sentence)}</p>" for sentence in _sentences(fit))
    return "".join([table_html(_HEADS, rows), *sentences])


def _sentences(fit: "Fit") -> list[str]:
    noise = ", ".join(f"{axis} {value:.3g}" for axis, value in fit.noise.items())
    sentences = [f"Scatter of one reading: {noise}."]
    sentences += [
        f"Not determined: {one if isinstance(one, str) else one.sentence}"
        for one in fit.undetermined
    ]
    every = {} if fit.joint is None else fit.joint.fits
    if follows := [axis for axis, one in every.items() if one.estimate.follows]:
        sentences.append(
            f"The tables of {' and '.join(follows)} follow every reading: scatter and standard"
            " deviations are a guess, by the smoothness that the readings suggest. Read some"
            " places again."
        )
    for axis, runs in fit.suspect_runs.items():
        counts = "do not count" if every[axis].design.aside else "count"
        named = ", ".join(map(str, runs))
        sentences.append(
            f"Runs of {axis} contradict the others, and {counts} in their mean: {named}."
        )
    if not fit.converged:
        sentences.append("The iterations did not reach their tolerance.")
    return sentences


def _summary(one: "FittedEffect") -> tuple[str, ...]:
    values, deviations = _numbers(one.model), _numbers(one.standard_deviation)
    known = deviations[np.isfinite(deviations)]
    largest = f"{np.abs(values).max(initial=0.0):.4g}"
    spread = f"{known.max(initial=0.0):.2g}" if known.size else "unknown"
    return str(values.size), largest, spread, str(int(np.max(one.support, initial=0)))


def _numbers(tree: Any) -> np.ndarray:
    """Return the values of a model one behind the other, without its nodes."""
    leaves = jax.tree.leaves(tree, is_leaf=lambda one: isinstance(one, AbstractNodes))
    values = [np.ravel(one) for one in leaves if not isinstance(one, AbstractNodes)]
    return np.concatenate([np.zeros(0), *values])


def plot_effect(one: "FittedEffect", name: str, axes: "Axes | None") -> "Axes":
    """Draw the values of an effect with two standard deviations, and return the axes."""
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(layout="constrained")
    model, spread = one.model, one.standard_deviation
    mark, lines = "o-", list[tuple[Any, Any, Any, str]]()
    match model:
        case Leadscrew():
            places = model.nodes.positions
            lines.append((places, model.pos, spread.pos, "moving +"))
            if model.neg is not None:
                lines.append((places, model.neg, spread.neg, "moving −"))
            axes.set(xlabel="position of the axis", ylabel="error in mm or °")
        case Cross():
            lines.append((model.nodes.positions, model.values, spread.values, ""))
            axes.set(xlabel="position of the master", ylabel="offset in mm or °")
        case Plane():
            nodes = [
                np.asarray(each.positions) for each in (model.nodes1, model.nodes2)
            ]
            drawn = axes.pcolormesh(*nodes, np.asarray(model.values), cmap="RdBu_r")
            axes.figure.colorbar(drawn, ax=axes, label="offset in mm or °")
            axes.set(xlabel="position of master 1", ylabel="position of master 2")
        case AbstractFriction():
            speed = np.linspace(-100.0, 100.0, 801)
            axes.plot(speed, np.asarray(model(speed)), color=_COLORS[0])
            axes.set(xlabel="velocity in mm/s or °/s", ylabel="current")
        case _:
            values, sigma = _numbers(model), _numbers(spread)
            mark, sigma = "o", np.resize(sigma, values.size)
            lines.append((np.arange(values.size), values, sigma, ""))
            axes.set(
                xlabel="value, in the order of the model", ylabel="mm or °, or per °C"
            )
    for color, (places, values, sigma, label) in zip(_COLORS, lines, strict=False):
        # What no reading tells has no bar.
        known = np.isfinite(np.asarray(sigma, float))
        bars = np.where(known, 2.0 * np.asarray(sigma, float), 0.0)
        axes.errorbar(
            np.asarray(places), np.asarray(values), bars, fmt=mark, color=color,
            label=label, markersize=3, capsize=2,
        )  # fmt: skip
    if len(lines) > 1:
        axes.legend()
    axes.set_title(name)
    return axes


def plot_fit(effects: "Mapping[str, FittedEffect]") -> "tuple[Axes, ...]":
    """Draw every effect of a fit into a panel of its own, and return the axes."""
    import matplotlib.pyplot as plt

    count = max(len(effects), 1)
    figure, panels = plt.subplots(
        count, 1, squeeze=False, figsize=(6.4, 2.8 * count), layout="constrained"
    )
    for axes, (name, one) in zip(panels.flat, effects.items(), strict=False):
        plot_effect(one, name, axes)
    return tuple(figure.axes[: len(effects)])
