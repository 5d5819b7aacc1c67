"""What a volumetric fit found, in sentences."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..core import DriftNoise
from ._freedoms import Undetermined

_NAMED = 6
"""Blocks that are named with their shapes; more are named alone."""


def undetermined_sentence(found: Undetermined) -> str:
    """Return what points do not tell, and what to measure."""
    if found.tools:
        return (
            f"No point shows {_and(found.names)}: only tools of different offsets do. For the "
            "tool that was measured with it makes no difference."
        )
    few = len(found.shapes) <= _NAMED
    named = [f"{n} ({', '.join(s)})" if few else n for n, s in found.shapes]
    if len(named) == 1:
        return f"These points do not show {named[0]}: {_remedy(found)}."
    number = "one mixture" if found.directions == 1 else f"{found.directions} mixtures"
    return (
        f"These points show only sums of {_and(named)} ({number} of them not at all): "
        f"{_remedy(found)}."
    )


def _remedy(found: Undetermined) -> str:
    """Return which readings would show it."""
    if found.turned:
        return "measure in other directions there, across the measured ones"
    if found.ends:
        return f"measure beyond these points too, out to the ends of {_and(found.ends)}"
    return "measure at positions off the lines or planes of these points, in all directions"


def hidden_sentence(share: float) -> str:
    """Return where a model extrapolates: in which share of its volume, from 0 to 1."""
    return (
        f"The measured points do not tell the offsets in {100.0 * share:.0f} % of the volume of "
        "the model: there they are a guess, with the standard deviation inf. Measure there, or "
        "do not work there with the compensation switched on."
    )


def beyond_sentence(beyond: Float[np.ndarray, "t 3"]) -> str:
    """Return that points lie beyond the volume, by so many mm along X, Y and Z."""
    count, most = int(beyond.any(axis=1).sum()), beyond.max(axis=0)
    along = [
        f"{far:.4g} mm along {a}" for a, far in zip("XYZ", most, strict=True) if far
    ]
    return (
        f"{count} of {len(beyond)} points lie beyond the volume of the model, by up to "
        f"{_and(along)}: it holds its edge there, and took their errors for those of the edge. "
        "State a larger volume, or leave these points out."
    )


def drift_sentence(drift: DriftNoise, count: int) -> str:
    """Return by how much so many points err alike that follow each other; its clock is theirs."""
    over = min(max(drift.time_constant, 2.0), count)
    return (
        f"Points that follow each other err alike (heat, air, what the model does not hold), by "
        f"{1e3 * drift.drift:.2g} µm over some {over:.0f} points: the "
        "standard deviations are wider for it. Measured again in another order, such errors are "
        "told from those of the machine."
    )


def tool_sentence(tool: Sequence[float]) -> str:
    """Return for which tool, in mm from the point that positions name, offsets hold."""
    return (
        f"The offsets hold for a tool of {', '.join(f'{one:g}' for one in tool)} mm in X, Y and Z "
        "from the point that positions name: another one has other levers."
    )


def _shape(named: tuple[str, str]) -> str:
    block, label = named
    return f"{label} of {'the frame' if block == 'frame' else block}"


def _and(names: list[str] | tuple[str, ...]) -> str:
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
