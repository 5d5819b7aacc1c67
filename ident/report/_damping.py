"""Which details of an error a smoothness prior lets through, as a wavelength."""

import math
import re

import numpy as np

from ..job import TableResult

_NAME = re.compile(r"order (\d+), axis (\d+)")


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
        match = _NAME.search(name)
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

    low, high = 0.0, math.pi
    if damping(high) <= density:
        return None
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if damping(middle) <= density else (low, middle)
    return 2 * math.pi / max(high, 1e-9) * spacing
