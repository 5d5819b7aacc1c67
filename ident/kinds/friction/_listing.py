"""From the law to the entries of a friction list, and what they do."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ....data.signals import quantile
from ....models import FrictionCompensation
from ...friction import (
    DriveSamples,
    FrictionFit,
    Knots,
    ReversalFit,
    WindowLaw,
    place_knots,
)
from ._result import LawCurve
from .entries import FrictionNumbers
from .keys import Spec

_ENTRIES = 20
_POINTS = 400
_BINS = 60
_ENOUGH = 0.05
"""Samples at a speed, as a share of the mean, at which a direction counts half."""
_OF_RATED = {"A": "rated_current", "Nm": "rated_torque", "N": "rated_torque"}
_MOST_DELAY = 0.001
"""mm: P-COMP-00043 goes no further."""


@dataclasses.dataclass(frozen=True)
class OutUnit:
    """What one unit of ``out`` is.

    Attributes:
        current: In the unit of the recording; None where the job does not say.
        share: Of the rated value; None likewise.
        missing: What the job would have to say.
    """

    current: float | None
    share: float | None
    missing: str = ""


def out_unit(spec: Spec, unit: str) -> OutUnit:
    """Return what one unit of the list is in the unit of the recording."""
    if spec.torque_unit is None:
        return OutUnit(None, None, "torque_unit")
    if unit == "%":
        return OutUnit(100.0 * spec.torque_unit, spec.torque_unit)
    if unit == "raw":
        return OutUnit(1.0, spec.torque_unit)
    key = _OF_RATED.get(unit)
    rated = None if key is None else getattr(spec, key)
    if rated is None:
        return OutUnit(None, None, key or "a current in A, %, Nm, N or raw")
    return OutUnit(float(rated) * spec.torque_unit, spec.torque_unit)


@dataclasses.dataclass(frozen=True)
class DrivenSpeeds:
    """Speeds for which a list is wanted, and which direction saw them.

    Attributes:
        speed: In mm/s or °/s, ascending, positive.
        weight: Share of the recording at each speed.
        positive_share: How much the positive direction counts at each speed, 0 to 1.
        positive: Slowest and fastest speed driven in positive direction.
        negative: Likewise in negative direction.
    """

    speed: Float[np.ndarray, " v"]
    weight: Float[np.ndarray, " v"]
    positive_share: Float[np.ndarray, " v"]
    positive: tuple[float, float]
    negative: tuple[float, float]

    def held(self, way: int) -> Float[np.ndarray, " v"]:
        """Return the speeds at which the law of one direction speaks for each of them."""
        return np.asarray(
            np.clip(self.speed, *(self.positive if way > 0 else self.negative))
        )

    def mean(self, law: WindowLaw) -> Float[np.ndarray, " v"]:
        """Return what a list can say of a law: the mean of both directions."""
        ahead, back = (way * law.friction(way * self.held(way)) for way in (1, -1))
        share = self.positive_share
        return np.asarray(share * ahead + (1.0 - share) * back)


def driven_speeds(samples: DriveSamples) -> DrivenSpeeds | None:
    """Return the speeds that were driven; None where one direction never was."""
    velocity = samples.velocity[samples.in_motion]
    driven = [np.sort(way * velocity[way * velocity > 0]) for way in (1, -1)]
    if any(len(each) == 0 for each in driven):
        return None
    low = max(quantile(np.abs(velocity), 0.001), 1e-3)
    high = max(each[-1] for each in driven)
    half = _POINTS // 2
    ways = np.geomspace(low, high, half), np.linspace(low, high, half)
    speed = np.unique(np.concatenate(ways))
    # What is slower or faster than all speeds counts with the first and the last.
    edges = np.geomspace(low, high * (1 + 1e-9), _BINS + 1)
    inner = edges[1:-1]
    counts = np.stack(
        [
            np.diff(each.searchsorted(inner), prepend=0, append=len(each))
            for each in driven
        ]
    )
    points = np.diff(speed.searchsorted(inner), prepend=0, append=len(speed))
    weight = np.repeat(counts.sum(axis=0) / np.maximum(points, 1), points)
    # Two directions that both saw a speed well count alike, however often they did.
    enough = _ENOUGH * counts.sum() / _BINS
    seen = counts / (counts + enough)
    some = seen.sum(axis=0) > 0
    share = seen[0, some] / seen[:, some].sum(axis=0)
    middle = np.log(np.sqrt(edges[1:] * edges[:-1]))[some]
    return DrivenSpeeds(
        speed=speed,
        weight=weight / weight.sum(),
        positive_share=np.interp(np.log(speed), middle, share),
        positive=(float(driven[0][0]), float(driven[0][-1])),
        negative=(float(driven[1][0]), float(driven[1][-1])),
    )


def law_curve(fit: FrictionFit, speeds: DrivenSpeeds) -> LawCurve:
    """Return the law over the speeds that were driven."""
    positive, positive_sd = fit.band(speeds.held(1))
    negative, negative_sd = fit.band(-speeds.held(-1))
    return LawCurve(
        speed=speeds.speed,
        positive=positive,
        negative=-negative,
        positive_sd=positive_sd,
        negative_sd=negative_sd,
        positive_share=speeds.positive_share,
        listed=None,
        weight=speeds.weight,
    )


FIRST_LEVEL = 0.15
"""Share of the friction that a list gives until the sign of its current is settled."""


def level_of(spec: Spec, settled: bool) -> float:
    """Return the share of the friction that the list gives.

    Args:
        spec: Of the fit; what it states counts.
        settled: Whether a measurement has settled the sign of the current: one of full
            size with the wrong sign shakes the machine.
    """
    if spec.level is not None:
        return spec.level
    return 1.0 if settled else FIRST_LEVEL


def knots_of(
    curve: LawCurve, spec: Spec, level: float, unit: float, fastest: float
) -> Knots:
    """Return the entries of the list; ``level`` is the share of the friction in them.

    Raises:
        FitError: If the law makes no table.
    """
    return place_knots(
        curve.speed,
        curve.mean * level,
        curve.weight,
        entries=spec.table_entries or _ENTRIES,
        unit=unit,
        reach=fastest,
    )


def without_inertia(samples: DriveSamples, inertia: float) -> Float[np.ndarray, " t"]:
    """Return the current without what acceleration takes."""
    if samples.acceleration is None:
        return samples.current
    return np.asarray(samples.current - inertia * samples.acceleration)


def numbers_of(
    knots: Knots, reversal: ReversalFit | None, before: FrictionCompensation | None
) -> FrictionNumbers:
    """Return what the list says, currents in list units.

    Args:
        knots: Entries.
        reversal: What was found around reversals; where None, all stays as it was.
        before: What the list said, or None where there was none.
    """
    entries = FrictionNumbers(knots.velocity / 1000.0, knots.out.astype(float))
    if reversal is not None:
        unknown = reversal.undetermined
        delay = min(reversal.position_delay, _MOST_DELAY)
        return dataclasses.replace(
            entries,
            reversal_lookahead=(
                0 if "reversal_lookahead" in unknown else reversal.lookahead
            ),
            position_delay=0.0 if "position_delay" in unknown else delay,
            delay_cycles=0 if "delay_cycles" in unknown else reversal.delay_cycles,
        )
    if before is None:
        return entries
    return dataclasses.replace(
        entries,
        reversal_lookahead=before.reversal_lookahead,
        position_delay=float(before.position_delay),
        delay_cycles=before.delay_cycles,
    )
