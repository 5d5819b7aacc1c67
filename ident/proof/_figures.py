"""How large an error is: rms, largest, and the figures of ISO 230-2."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.measurements import iso230


@dataclasses.dataclass(frozen=True)
class ErrorFigures:
    """Size of an error in mm (or °).

    Attributes:
        rms: Root of the mean square.
        max: Largest magnitude.
        iso230: A, R, B, B_mean, E, M … of ISO 230-2 where there are runs, else None;
            figures that the data do not give are left out.
    """

    rms: float
    max: float
    iso230: Mapping[str, float] | None = None


@dataclasses.dataclass(frozen=True)
class RunTable:
    """Which target, run and direction each reading belongs to.

    Attributes:
        target: In mm or °, shape ``(t,)``.
        run: Any integers.
        direction: ±1.
    """

    target: Float[np.ndarray, " t"]
    run: Int[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]


def error_figures(
    error: Float[np.ndarray, " t"],
    runs: RunTable | None = None,
    wild: Bool[np.ndarray, " t"] | None = None,
) -> ErrorFigures:
    """Return the size of an error in mm or °.

    Args:
        error: One value per reading.
        runs: How the readings lie in a run table, or None where they do not.
        wild: Readings that are the instrument's fault: rms and largest leave them out.
            ISO 230-2 knows no such thing and keeps every reading.
    """
    figures: dict[str, float] | None = None
    if runs is not None:
        found = iso230(runs.target, error, runs.run, runs.direction).figures()
        figures = {key: value for key, value in found.items() if value is not None}
    if wild is not None and not wild.all():
        error = error[~wild]
    return ErrorFigures(
        rms=float(np.sqrt(np.mean(np.square(error)))),
        max=float(np.max(np.abs(error))),
        iso230=figures,
    )
