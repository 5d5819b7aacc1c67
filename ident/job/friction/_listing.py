"""From the law to the entries of a friction list, and what they do."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ....data.signals import quantile
from ....models import FrictionCompensation
from ...exchange import FrictionNumbers
from ...fit.friction import DriveSamples, FrictionFit, Knots, ReversalFit, place_knots
from .._fit_schema import FrictionSpec
from ._result import LawCurve

_ENTRIES = 20
_POINTS = 400
_BINS = 60
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


def out_unit(spec: FrictionSpec, unit: str) -> OutUnit:
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


def law_curve(fit: FrictionFit, samples: DriveSamples) -> LawCurve | None:
    """Return the law over the speeds that were driven, or None where there is none."""
    if not fit.has_law:
        return None
    driven = np.sort(np.abs(samples.velocity[samples.in_motion]))
    low, high = max(quantile(driven, 0.001), 1e-3), driven[-1]
    half = _POINTS // 2
    ways = np.geomspace(low, high, half), np.linspace(low, high, half)
    speed = np.sort(np.concatenate(ways))
    speed = np.append(speed[:1], speed[1:][speed[1:] > speed[:-1]])
    positive, positive_sd = fit.band(speed)
    negative, negative_sd = positive, positive_sd
    if fit.structure.directional:
        opposed, negative_sd = fit.band(-speed)
        negative = -opposed
    return LawCurve(
        speed=speed,
        positive=positive,
        negative=negative,
        positive_sd=positive_sd,
        negative_sd=negative_sd,
        listed=None,
        weight=_density(driven, speed),
    )


def _density(
    driven: Float[np.ndarray, " t"], speed: Float[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """Return the share of the samples that each speed stands for; both ascend."""
    # What is slower or faster than all speeds counts with the first and the last.
    edges = np.geomspace(speed[0], speed[-1] * (1 + 1e-9), _BINS + 1)[1:-1]
    ends = np.zeros((2, _BINS + 1), np.int64)
    for end, each in zip(ends, (driven, speed), strict=True):
        end[1:-1], end[-1] = each.searchsorted(edges), len(each)
    counts, points = ends[:, 1:] - ends[:, :-1]
    bin_of = np.repeat(np.arange(_BINS), points)
    weight = counts[bin_of] / points[bin_of]
    return np.asarray(weight / weight.sum())


def knots_of(curve: LawCurve, spec: FrictionSpec, unit: float, fastest: float) -> Knots:
    """Return the entries of the list; ``level`` scales them.

    Raises:
        FitError: If the law makes no table.
    """
    mean = 0.5 * (curve.positive + curve.negative) * spec.level
    return place_knots(
        curve.speed,
        mean,
        curve.weight,
        entries=spec.table_entries or _ENTRIES,
        unit=unit,
        reach=fastest,
    )


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
