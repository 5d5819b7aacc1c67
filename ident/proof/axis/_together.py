"""All that acts on one axis, on the readings of a measurement."""

import dataclasses
from collections.abc import Collection

import numpy as np
from jaxtyping import Float

from ....models import AbstractLookup
from ...exchange import LIST_UNITS, AxisLists, Motion
from .._figures import wild_readings
from .._gate import GateCheck, gate_check

_SURE = 3.0
"""Standard deviations of an rms figure, 1/√(2n) each, up to which it is no other."""
_TURNED = 0.5
"""Share of their difference that the sum of two tables stays below where one is turned over."""
_SLACK = 1.1
"""What other tables add by their own noise: a tenth of the error that is left."""


@dataclasses.dataclass(frozen=True)
class Together:
    """What is left of the error of one measurement, by one list alone and by all.

    Attributes:
        measurement: Its name.
        compensation: The fit that was made of it.
        readings: How many count.
        before: rms of the error as measured, in mm or °.
        alone: rms with this list alone.
        together: rms with all that will act on the axis.
        limit: Largest rms that passes.
    """

    measurement: str
    compensation: str
    readings: int
    before: float
    alone: float
    together: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether all together leave no more than the fit promises."""
        return self.together <= self.limit

    def check(self, unit: str) -> GateCheck:
        """Return the line of the gate."""
        where = f"rms of measurement {self.measurement}, all that acts together"
        return gate_check("axis error", self.together, self.limit, unit, where)


def added_beyond(
    after: AxisLists, before: AxisLists, active: Collection[str], motion: Motion
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return what each compensation adds beyond what acted while measuring, mm or °.

    Args:
        after: What will act.
        before: The lists that the controller had while measuring.
        active: Compensations that were on then. What no list holds is taken to act on as
            it did.
        motion: Where the readings are.

    Raises:
        ExchangeError: If a list makes no table, or the motion lacks a position.
    """
    added = after.parts(motion)
    was = [name for name in active if name in before.used]
    if not was:
        return added
    for name, value in before.parts(motion).items():
        if name in was:
            added[name] = added[name] - value if name in added else -value
    return added


def judge_together(
    name: str,
    compensation: str,
    error: Float[np.ndarray, " t"],
    added: dict[str, Float[np.ndarray, " t"]],
    predicted: float | None,
    about_zero: bool,
) -> Together:
    """Return what is left of a measurement by one list alone, and by all together.

    Args:
        name: Of the measurement.
        compensation: Of the fit that was made of it.
        error: As measured, in mm or °.
        added: By compensation (`added_beyond`).
        predicted: rms on readings that the fit did not see, or None.
        about_zero: The zero of the error is known; else it is judged about its middle.
    """
    alone = error + added.get(compensation, 0.0)
    together = error + np.sum(list(added.values()), axis=0)
    sound = ~wild_readings(alone, least=1.0 / LIST_UNITS)
    count, left = int(sound.sum()), _rms(alone[sound], about_zero)
    sure = _SLACK + _SURE / np.sqrt(2.0 * max(count, 1))
    return Together(
        measurement=name,
        compensation=compensation,
        readings=count,
        before=_rms(error[sound], about_zero),
        alone=left,
        together=_rms(together[sound], about_zero),
        limit=float(max(left, predicted or 0.0) * sure) + 1.0 / LIST_UNITS,
    )


def acts_against(partner: AxisLists, own: AxisLists, name: str) -> bool:
    """Return whether a compensation of a gantry partner is that of an axis turned over.

    At the nodes of the axis and in both directions: both together are then less than half
    of what lies between them. What follows more than positions is not compared.

    Raises:
        ExchangeError: If a list makes no table.
    """
    model, axes = own.models[name], own.inputs(name) or (own.axis,)
    ways = [np.array([0.0, 1000.0])] * len(axes)
    if isinstance(model, AbstractLookup):
        ways = [np.asarray(one.positions) for one in model.ways]
    grid = np.meshgrid(*ways)
    places = {
        axis: np.tile(one.ravel(), 2) for axis, one in zip(axes, grid, strict=True)
    }
    direction = np.repeat([1, -1], grid[0].size)
    places |= dict.fromkeys(
        (own.axis, partner.axis), places.get(own.axis, np.zeros(len(direction)))
    )
    added = [
        one.parts(
            Motion(positions=places, directions={one.axis: direction}, time=None)
        ).get(name)
        for one in (own, partner)
    ]
    if added[0] is None or added[1] is None:
        return False
    both = np.linalg.norm(added[0] + added[1])
    return bool(both < _TURNED * np.linalg.norm(added[0] - added[1]))


def _rms(values: Float[np.ndarray, " t"], about_zero: bool) -> float:
    middle = 0.0 if about_zero else float(np.median(values))
    return float(np.sqrt(np.mean(np.square(values - middle))))
