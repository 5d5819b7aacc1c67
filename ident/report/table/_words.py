"""What a fit found, in sentences: the verdict, and how the table was made."""

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ...job import TableResult, largest_wild
from .._body import WildRow
from .._scale import Scale, grouped, number, percent, place
from ._readings import Readings

_WEIGHT = re.compile(r"order (\d+), axis (\d+)")


def how_it_was_made(
    fit: TableResult, readings: Readings, scale: Scale
) -> Iterator[tuple[str, str]]:
    """Return pairs of a heading and a plain sentence on how the table was found."""
    own = fit.fit
    unit = scale.error
    noise = (
        f"A single reading scatters by {number(own.noise * scale.factor)} {unit} "
        "(1 sd) about the table, wild readings left out."
    )
    if own.line_offset:
        # The scatter that is seen, and what one probing cannot show of it.
        seen = np.sqrt(own.noise**2 - own.line_offset**2)
        noise = (
            f"A single reading scatters by {number(seen * scale.factor)} {unit} (1 sd) about "
            "a smooth surface, wild readings left out. An offset of every line of readings, "
            f"{number(own.line_offset * scale.factor)} {unit} (1 sd), is assumed on top: one "
            "probing cannot show it. Probe twice to know."
        )
    yield ("Noise", noise)
    yield ("Wild readings", _loss(own.loss, readings))
    yield ("Smoothness", smoothness_sentence(fit, scale))
    yield (
        "Rounding",
        f"Rounding to whole list units moves the table by at most "
        f"{number(fit.rounding * scale.factor)} {unit}.",
    )
    if fit.every is not None and fit.every > 1:
        shown = (
            f"{grouped(fit.readings)} readings were read in pieces, and the table and the "
            "errors above rest on all of them. What is drawn of single readings, and said of "
            f"slices and cells, is one reading in {grouped(fit.every)} "
            f"({grouped(readings.size)})."
        )
        yield ("Shown", shown)
    if fit.cycles is not None:
        yield (
            "Reversal",
            f"The jump between the two directions is spread over {fit.cycles} "
            "cycles (n_backlash_cyc, P-AXIS-00243).",
        )
    yield ("The fit itself", _fit_message(own.message, own.converged))


def _fit_message(message: str, converged: bool) -> str:
    text = message.strip()
    if text and text[-1] not in ".!?":
        text += "."
    if converged:
        return text or "The iterations reached their tolerance."
    return f"The iterations did NOT reach their tolerance. {text}".strip()


def _loss(loss: str, readings: Readings) -> str:
    wild, size = readings.total_wild, readings.total
    how = {
        "student": "Readings far from the others count less (Student's t)",
        "huber": "Readings far from the others count less (Huber)",
        "gauss": "All readings count fully (Gauss)",
    }.get(loss, f"Loss {loss}")
    if not wild:
        return f"{how}; none of {grouped(size)} was rejected as wild."
    were = "was" if wild == 1 else "were"
    return (
        f"{how}; {grouped(wild)} of {grouped(size)} "
        f"({percent(wild / size)}) {were} rejected as wild and "
        "had no influence."
    )


def smoothness_sentence(fit: TableResult, scale: Scale) -> str:
    """Say which details of the error the table follows and which it treats as noise."""
    weights = fit.fit.smoothness
    if not any(weight > 0 for weight in weights.values()):
        return "None: every node rests on its own readings (smoothness 0)."
    parts = []
    for master, wavelength in damped_wavelengths(fit).items():
        axis = fit.masters[master]
        if wavelength is None:
            parts.append(
                f"along {axis} every detail that the nodes can hold is followed"
            )
        else:
            parts.append(
                f"along {axis} waves of the error shorter than about "
                f"{wavelength:.3g} {scale.position} are damped to less than half, "
                "longer ones are followed"
            )
    named = ", ".join(f"{name}: {weight:.3g}" for name, weight in weights.items())
    stated = f"Weights of the prior relative to 1/noise²: {named}."
    if not parts:
        return stated
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}. {stated}"


def damped_wavelengths(fit: TableResult) -> dict[int, float | None]:
    r"""Return per master the wavelength that the prior damps to one half, in mm or °.

    Nodes at distance $h$ with $\rho$ readings each, smoothed with weights $w_m$ on the
    squared differences of order $m$, pass a wave of $\omega$ radians per node with the
    gain $1 / (1 + \sum_m w_m (2 \sin(\omega/2))^{2m} / \rho)$, as a smoothing spline
    does (Green and Silverman 1994, section 2.3). It is ½ where the sum equals $\rho$.
    None where even the shortest wave that the nodes hold, two node distances, passes.
    Masters without a weight of their own are left out.
    """
    orders: dict[int, list[tuple[int, float]]] = {}
    for name, weight in fit.fit.smoothness.items():
        match = _WEIGHT.search(name)
        if match and weight > 0:
            order, master = int(match[1]), int(match[2]) - 1
            orders.setdefault(master, []).append((order, weight))
    # Every reading belongs to one place between nodes: its share of the measured nodes.
    measured = int(np.count_nonzero(fit.fit.support))
    density = fit.readings / measured if measured else 0.0
    found: dict[int, float | None] = {}
    for master, weights in sorted(orders.items()):
        if master >= len(fit.fit.layout.nodes) or density <= 0:
            continue
        nodes = fit.fit.layout.nodes[master]
        spacing = float(np.median(np.diff(nodes))) if len(nodes) > 1 else 0.0
        found[master] = _half_gain(weights, density, spacing)
    return found


def _half_gain(
    weights: list[tuple[int, float]], density: float, spacing: float
) -> float | None:
    def damping(omega: float) -> float:
        wave = 2 * math.sin(omega / 2)
        return sum(weight * wave ** (2 * order) for order, weight in weights)

    if damping(math.pi) <= density:
        return None
    half: Any = brentq(lambda omega: damping(omega) - density, 0.0, math.pi)
    return 2 * math.pi / max(float(half), 1e-9) * spacing


def wild_rows(fit: TableResult, readings: Readings, scale: Scale) -> list[WildRow]:
    """Return the largest rejected readings, at most a dozen."""
    found = []
    for row in largest_wild(readings.before, readings.wild).tolist():
        spots = zip(fit.masters, readings.positions[row], strict=True)
        where = ", ".join(f"{name} = {place(float(at))}" for name, at in spots)
        direction = {1: ", moving +", -1: ", moving −"}.get(
            int(readings.direction[row]), ""
        )
        run = "" if readings.run is None else str(int(readings.run[row]))
        found.append(
            WildRow(
                grouped((row if fit.every is None else int(readings.order[row])) + 1),
                f"{where} {scale.position}{direction}",
                run,
                f"{number(float(readings.before[row]), signed=True)} {scale.error}",
            )
        )
    return found
