"""A constant and a slope in the error: of the machine, or of the instrument?

The zero of a laser is arbitrary, as is the slope of a straightness measurement. A table
takes both over, and the axis then moves by as much: nobody but the user can tell whose they
are. Where they stand out of the error and the job does not say, nothing is written.
"""

import dataclasses
from typing import final

import numpy as np
from jaxtyping import Float

from ...fit import TableFit
from ...kinds._keys import TableSpec
from ..file._load import Job
from ..result._second import LeftTrend
from ._plan import Plan

_SURE = 3.0
"""Standard deviations from which a constant or a slope is none by chance."""
_NEGLIGIBLE = 1e-3
"""Share of the largest correction that the gate allows: less moves no axis to speak of."""

_ABSURD = 0.01
"""Slope in mm per mm that no machine has."""


@final
@dataclasses.dataclass(frozen=True)
class Trend:
    """The straight line, or plane, through an error.

    Attributes:
        values: Constant at the middle of the nodes that were measured, in mm or °, and the slope
            per master, in mm or ° per mm or °.
        deviations: Their standard deviations.
        reach: 1, and the rms distance of the nodes from their middle, per master, in mm or °.
        remainder: What a single reading is off the line: scatter and shape of the error,
            rms in mm or °.
    """

    values: Float[np.ndarray, " n"]
    deviations: Float[np.ndarray, " n"]
    reach: Float[np.ndarray, " n"]
    remainder: float

    @property
    def sizes(self) -> Float[np.ndarray, " n"]:
        """The constant, and the rms of each slope over the nodes, in mm or °."""
        return np.asarray(np.abs(self.values) * self.reach)


def trend_of(fit: TableFit) -> Trend:
    """Return the line through the nodes of a table that were measured.

    What the nodes are off it counts as scatter: their own uncertainty, and the shape of the
    error, of which a mean and a slope are no more than a sample.
    """
    layout = fit.layout
    grids = np.meshgrid(*reversed(layout.nodes), indexing="ij")
    # The last index of a table runs over the first master; a bilateral one has two values
    # per place.
    places = np.stack([grid.ravel() for grid in reversed(grids)], axis=1)
    places = np.tile(places, (layout.branches, 1))
    measured = np.asarray(fit.support).ravel() > 0
    deviation = np.asarray(fit.standard_deviation).ravel()[measured]
    return trend_through(
        places[measured],
        np.asarray(fit.values).ravel()[measured],
        deviation=float(np.sqrt(np.mean(deviation**2))),
        noise=fit.noise,
        periodic=layout.periodic,
    )


def trend_through(
    places: Float[np.ndarray, "n d"],
    values: Float[np.ndarray, " n"],
    *,
    deviation: float = 0.0,
    noise: float = 0.0,
    periodic: bool = False,
) -> Trend:
    """Return the line through errors at places.

    Args:
        places: In mm or °, one column per master.
        values: Error in mm or °.
        deviation: Standard deviation of a value, rms.
        noise: Standard deviation of a single reading.
        periodic: The places go round: there is no slope.
    """
    distance = places - places.mean(axis=0)
    if periodic:
        distance = distance[:, :0]  # a whole turn has no slope
    design = np.column_stack([np.ones(len(values)), distance])
    solution = np.linalg.lstsq(design, values)[0]
    residual = values - design @ solution
    free = max(len(values) - design.shape[1], 1)
    variance = float(np.sum(residual**2) / free + deviation**2)
    # By the rows, which no place that is far off rounds below zero.
    spread = np.sqrt(variance * np.sum(np.square(np.linalg.pinv(design)), axis=1))
    return Trend(
        values=solution,
        deviations=spread,
        reach=np.sqrt(np.mean(design**2, axis=0)),
        remainder=float(np.hypot(np.sqrt(np.sum(residual**2) / free), noise)),
    )


def refuse_unowned_trend(plan: Plan, fit: TableFit) -> None:
    """Raise where the job does not say whose a significant constant or slope is.

    The fit is that of the error as the readings show it, nothing taken off.
    """
    job, unstated = plan.job, _unstated(plan)
    if not unstated:
        return
    trend = trend_of(fit)
    if not asks_for_owner(job, trend):
        return
    grouped = plan.fit.group is not None
    datum = "" if grouped else "datum = { at = … } (it is zero there), "
    raise job.error(
        ("measurements", unstated[0]),
        f"found {trend_words(job, plan.fit, trend)} in the error of {plan.fit.axis}, which the"
        f" {plan.fit.compensation} table would take over; expected the job to say whose"
        f' they are: {datum}remove = "none" (both are the machine\'s), "offset" (the'
        ' constant is the instrument\'s) or "line" (the slope is, too)',
    )


def trend_left(
    plan: Plan,
    first: Plan,
    places: Float[np.ndarray, "t d"],
    error: Float[np.ndarray, " t"],
) -> LeftTrend | None:
    """Return the constant and slopes of a second measurement; None where they are small.

    The plan is that of the table with the second job, the first that with the first one.
    """
    trend = trend_through(places, error, periodic=plan.table.periodic)
    if not asks_for_owner(plan.job, trend):
        return None
    again, before = (
        any(each.job.spec.measurements[name].zeroed for name in each.fit.sources)
        for each in (plan, first)
    )
    owned = not _unstated(plan) and (again or not before)
    return LeftTrend(trend_words(plan.job, plan.fit, trend), trend.remainder, owned)


def _unstated(plan: Plan) -> list[str]:
    """Return the measurements of which the job does not say whose zero and slope are."""
    spec, keys = plan.job.spec.measurements, {"datum", "remove"}
    return [n for n in plan.fit.sources if not keys & spec[n].model_fields_set]


def asks_for_owner(job: Job, trend: Trend) -> bool:
    """Return whether a job must say whose the constant and the slopes of an error are.

    One of them must be surely there (three standard deviations), and larger than what a
    reading is off the line anyway: every error has a mean and a slope, and where they do not
    stand out of its scatter and shape, a list without them is no other list.
    """
    sure = _SURE * trend.deviations * trend.reach
    least = max(trend.remainder, _NEGLIGIBLE * job.spec.gate.max_correction)
    return bool(np.any(trend.sizes > np.maximum(sure, least)))


def is_negligible(job: Job, trend: Trend) -> bool:
    """Return whether a list without the constant and the slopes is no other list."""
    limit = _NEGLIGIBLE * job.spec.gate.max_correction
    return bool(np.all(trend.sizes <= limit))


def trend_words(job: Job, fit: TableSpec, trend: Trend) -> str:
    """Return constant and slopes with unit and standard deviation."""
    axes, unit = job.spec.axes, job.spec.axes[fit.axis].small_unit
    constant, *pairs = zip(trend.values, trend.deviations, strict=True)
    words, slopes = [f"a constant of {_amount(*constant)} {unit}"], trend.values[1:]
    for master, (slope, deviation) in zip(fit.over, pairs, strict=False):
        along = axes[master].kind == "linear"
        scale, per = (1e3, "m") if along else (1.0, "°")
        over = "" if master == fit.axis else f" over {master}"
        words.append(
            f"a slope of {_amount(scale * slope, scale * deviation)} {unit}/{per}{over}"
        )
    doubt = ""
    if np.any(np.abs(slopes) > _ABSURD):
        doubt = " (is a unit wrong?)"
    alone = tuple(fit.over) == (fit.axis,)
    if alone and np.any(np.abs(slopes + 2.0) < _ABSURD):
        doubt = (
            " (does the instrument count the other way? sign = -1 beside its column)"
        )
    return " and ".join(words) + doubt


def _amount(value: float, deviation: float) -> str:
    """Return thousandths of a value with its deviation, to two digits of the latter."""
    small = 1e3 * deviation
    digits = 1 if small <= 0 else int(np.clip(1 - np.floor(np.log10(small)), 0, 6))
    rounded = round(1e3 * value, digits) + 0.0  # no minus before a zero
    return f"{rounded:.{digits}f} ± {small:.{digits}f}"
