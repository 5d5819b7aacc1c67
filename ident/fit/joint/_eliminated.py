"""One axis with everything eliminated but its temperatures, for one lag after the other."""

import dataclasses
from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ...core import ArrowFactor, Estimate
from ...kinds.temperature import Clocked
from ._data import JointData
from ._design import Design
from ._temperature import TemperatureEffect

_RIDGE = 1e-9


@dataclasses.dataclass(frozen=True)
class Heated:
    """A temperature over the rows that are fitted, for one lag after the other."""

    effect: TemperatureEffect
    taken: JointData
    rows: Int[np.ndarray, " r"]
    clocks: Mapping[str, Clocked]

    def columns(self, lags: Mapping[str, float]) -> Float[np.ndarray, "r p"]:
        """Return its columns for trial lags; sensors that have none keep theirs."""
        warm = {}
        for sensor, own in self.effect.lags.items():
            lag = lags.get(sensor, 0.0 if isinstance(own, str) else own)
            clock = self.clocks.get(sensor)
            if clock is None or not lag:
                warm[sensor] = self.taken.column(
                    "temperature", sensor, self.effect.name
                )
            else:
                warm[sensor] = clock.structure(lag)[self.rows]
        return self.effect.columns(self.taken, warm)[0]


@dataclasses.dataclass(frozen=True)
class Rest:
    """Everything but the temperatures, eliminated.

    The factor of the fit has the temperatures in it; `response` and `inner` take them out:
    where they are held, the others solve as with them, less what the temperatures did.
    """

    factor: ArrowFactor
    response: Float[np.ndarray, "n k"]
    inner: Float[np.ndarray, "k k"]
    across: sp.csr_array
    target: Float[np.ndarray, " r"]
    base: Float[np.ndarray, " n"]
    square: float
    free: float
    own: Int[np.ndarray, " k"]
    heated: tuple[Heated, ...]

    def solve(self, right: Float[np.ndarray, "n *k"]) -> Float[np.ndarray, "n *k"]:
        """Return the solution with the temperatures held at zero."""
        found = self.factor.solve(right)
        found = found - self.response @ np.linalg.solve(self.inner, found[self.own])
        found[self.own] = 0.0
        return np.asarray(found)

    def profile(
        self, lags: Mapping[str, float]
    ) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the evidence of trial lags, up to a constant, and all unknowns."""
        columns = np.hstack([each.columns(lags) for each in self.heated])
        columns = columns * (self.target != 0.0)[:, None]
        beside = np.asarray(self.across @ columns)
        beside[self.own] = 0.0
        through = self.solve(beside)
        schur = columns.T @ columns - beside.T @ through
        right = columns.T @ self.target - beside.T @ self.base
        scale = np.sqrt(np.maximum((columns**2).sum(axis=0), 1e-300))
        scaled = schur / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
        values = np.linalg.solve(scaled, right / scale) / scale
        square = max(self.square - float(right @ values), 1e-300)
        _, logdet = np.linalg.slogdet(scaled * np.outer(scale, scale))
        theta = self.base - through @ values
        theta[self.own] = values
        return self.free * float(np.log(square)) + float(logdet), theta


def eliminated(
    design: Design,
    data: JointData,
    found: Estimate,
    pseudo: Float[np.ndarray, " r"],
) -> Rest:
    """Return an axis about a fit with any lags.

    Args:
        design: Columns; the present lags do not matter.
        data: All rows: a lag remembers those that are not fitted.
        found: The fit.
        pseudo: Its pseudo-readings about `Estimate.centre`, 0 where a reading is not believed.
    """
    own = np.concatenate(
        [
            design.places_of(number)
            for number, effect in enumerate(design.effects)
            if isinstance(effect, TemperatureEffect)
        ]
    )
    factor = found.posterior.factor
    unit = np.zeros((design.size, len(own)))
    unit[own, np.arange(len(own))] = 1.0
    response = factor.solve(unit)
    target = np.where(pseudo != 0.0, pseudo + design.columns @ found.centre, 0.0)
    across = sp.csr_array(design.columns.T)
    vector = np.asarray(across @ target)
    vector[own] = 0.0
    rest = Rest(
        factor=factor,
        response=response,
        inner=response[own],
        across=across,
        target=target,
        base=vector,
        square=float(target @ target),
        free=found.posterior.problem.degrees,
        own=own,
        heated=(),
    )
    base = rest.solve(vector)
    taken = data.take(design.rows)
    heated = tuple(
        Heated(effect, taken, design.rows, _clocks(effect, data))
        for effect in design.effects
        if isinstance(effect, TemperatureEffect)
    )
    return dataclasses.replace(
        rest, base=base, square=rest.square - float(vector @ base), heated=heated
    )


def _clocks(effect: TemperatureEffect, data: JointData) -> dict[str, Clocked]:
    """Return the clock of each sensor that any lag belongs to."""
    return {
        sensor: effect.clocked(data, sensor)
        for sensor, lag in effect.lags.items()
        if isinstance(lag, str) or lag > 0.0 or data.time is not None
    }
