"""What is seen of the temperature at the machine: in a log, and in a probe."""

from typing import final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ....models import Conventions, TemperatureLine
from ...diagnosis.probe._probe import (
    HEIGHT,
    Masters,
    Outcome,
    Outcomes,
    ProbeAxis,
    Probed,
)
from ...exchange._units import LIST_UNITS
from ...proof.verify import AbstractChannel, Change, LogRows, Parts
from .._protocol import AbstractProbe
from . import KIND
from .entries import PREFIX, temperature_from_list


@final
class TemperatureChannel(AbstractChannel):
    """A straight line over the position (S-43)."""

    def prepare(self) -> None:
        self.listed = self.law(self.conventions).cycles
        self.relevant = ("temperature_filter",)

    def law(self, conventions: Conventions) -> TemperatureLine:
        """Return the line of the list: what a log shows of it needs no unit."""
        line: TemperatureLine | None = temperature_from_list(
            self.one.listing, conventions
        )
        assert line is not None  # the axis list switches it on
        return line

    def cycles_under(self, conventions: Conventions) -> int:
        return self.listed if conventions.temperature_filter == "values" else 0

    def parts(self, change: Change, rows: LogRows) -> Parts:
        place = self.motion.position(self.axis, "for its temperature compensation")
        line = self.law(change.conventions)
        positions: Float[np.ndarray, " r"] = place[rows]
        cold = jnp.zeros((len(positions), 0))
        return Parts(np.asarray(line.offset(jnp.asarray(positions), cold)))


@final
class TemperatureProbe(AbstractProbe):
    """A line that stands 10 µm high and rises by as much over the travel."""

    def additions(self, axis: ProbeAxis) -> dict[str, int | str]:
        line = {
            "position_0": axis.grid.integers[0],
            "offset_0": round(HEIGHT * LIST_UNITS),
            "coefficient": _slope(axis),
            "n_cycles": 10,
        }
        entries = {f"{PREFIX}_{name}": value for name, value in line.items()}
        return {KIND.activation: 1, **entries}

    def outcomes(self, probed: Probed, axis: ProbeAxis, masters: Masters) -> Outcomes:
        rise = 1e-3 * _slope(axis) * (axis.at(10.0) - axis.at(0.0))
        return (
            Outcome(
                f"+{10 + rise:.3g} µm (10 of the offset, {rise:.2g} of the slope)",
                "the line is added as it stands; the coefficient is in µm/m",
                {"temperature_sign": 1},
            ),
            Outcome(
                f"−{10 + rise:.3g} µm",
                "the line is subtracted",
                {"temperature_sign": -1},
            ),
            Outcome("10 µm and something else", "the coefficient has another unit"),
        )


def _slope(axis: ProbeAxis) -> int:
    """Return whole µm/m of a line that rises by 10 µm over the travel."""
    return max(1, int(HEIGHT * 1e6 / (axis.at(10.0) - axis.at(0.0))))


CHANNEL, PROBE = TemperatureChannel, TemperatureProbe()
