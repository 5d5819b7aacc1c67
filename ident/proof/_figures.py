"""How large an error is: rms, largest, and the figures of ISO 230-2."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.measurements import iso230_figures


@dataclasses.dataclass(frozen=True)
class ErrorFigures:
    """Size of an error in mm (or °).

    Attributes:
        rms: Root of the mean square, over all readings.
        max: Largest magnitude, over all readings.
        iso230: A, R, B, B_mean, E, M … of ISO 230-2 where there are runs, else None;
            figures that the data do not give are left out.
        without_wild: Rms and max of the others; None where no reading is wild.
    """

    rms: float
    max: float
    iso230: Mapping[str, float] | None = None
    without_wild: "ErrorFigures | None" = None

    @property
    def sound(self) -> "ErrorFigures":
        """What the machine does: rms and largest error without wild readings.

        A single reading of 1 mm among thousands of 10 µm would be all that rms and max
        tell of; before and after a list are compared without it.
        """
        return self.without_wild or self

    def as_tree(self) -> dict[str, float]:
        """Return all figures by name, as result.json gives them."""
        return {
            "rms": self.rms,
            "max": self.max,
            "rms_without_wild": self.sound.rms,
            "max_without_wild": self.sound.max,
            **(self.iso230 or {}),
        }


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


@dataclasses.dataclass(frozen=True)
class ErrorTally:
    """What the figures of an error are made of: those of parts of the readings add up.

    Attributes:
        sizes: Number, sum of squares and largest magnitude, of all readings and of those
            that are not wild.
    """

    sizes: Float[np.ndarray, "2 3"]

    @classmethod
    def of(
        cls,
        error: Float[np.ndarray, " t"],
        wild: Bool[np.ndarray, " t"] | None = None,
    ) -> "ErrorTally":
        """Return that of some readings; arguments as `error_figures`."""
        sound = error if wild is None else error[~wild]
        sizes = [
            [len(errors), np.square(errors).sum(), np.abs(errors).max(initial=0.0)]
            for errors in (error, sound)
        ]
        return cls(np.array(sizes, dtype=float))

    def __add__(self, other: "ErrorTally") -> "ErrorTally":
        total = self.sizes + other.sizes
        total[:, 2] = np.maximum(self.sizes[:, 2], other.sizes[:, 2])
        return ErrorTally(total)

    @property
    def figures(self) -> ErrorFigures:
        """What they come to."""
        whole, sound = (
            ErrorFigures(math.sqrt(square / max(count, 1)), largest)
            for count, square, largest in self.sizes.tolist()
        )
        count, count_sound = self.sizes[:, 0]
        if count_sound in (0, count):
            return whole
        return dataclasses.replace(whole, without_wild=sound)


def error_figures(
    error: Float[np.ndarray, " t"],
    runs: RunTable | None = None,
    wild: Bool[np.ndarray, " t"] | None = None,
) -> ErrorFigures:
    """Return the size of an error in mm or °.

    Args:
        error: One value per reading.
        runs: How the readings lie in a run table, or None where they do not.
        wild: Readings that are the instrument's fault; figures without them are given
            beside those of all readings. ISO 230-2 knows no such thing.
    """
    figures = ErrorTally.of(error, wild).figures
    if runs is None:
        return figures
    standard = iso230_figures(runs.target, error, runs.run, runs.direction)
    iso = {key: value for key, value in standard.items() if value is not None}
    return dataclasses.replace(figures, iso230=iso)
