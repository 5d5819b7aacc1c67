"""What is said of a fitted axis: deviations, noise, residuals, runs, parts."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from .._types import RunEffect
from ._axis import AxisFit, weights_by_name
from ._confusion_words import undetermined
from ._data import JointData
from ._examine import share_of, touched, variances
from ._lag import FoundLag
from ._memory import memory_along, memory_of_noise
from ._result import Part, RunCurve
from ._temperature import TemperatureEffect

_STEP = 0.02
"""Step in a lag for its slope, as a share of it."""


@dataclasses.dataclass(frozen=True)
class Report:
    """What is said of one axis."""

    datum: tuple[float, float]
    noise: float
    deviation: Float[np.ndarray, " n"]
    unknown: Bool[np.ndarray, " n"]
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    runs: tuple[RunEffect, ...]
    message: str
    lags: Mapping[str, FoundLag]


def report_of(data: JointData, fit: AxisFit) -> Report:
    ready, post = fit.ready, fit.estimate.posterior
    design = ready.design
    error = np.asarray(data.error[design.axis], float)[design.rows]
    left = error - design.columns @ fit.theta
    active, used = fit.active, post.used
    variance = variances(post, ready.rules) * post.variance
    order = np.arange(len(left))
    if data.time is not None:
        order = np.argsort(np.asarray(data.time)[design.rows], kind="stable")
    variance *= memory_of_noise(design, post.factor, ready.rules, fit.pseudo, order)
    lags = _with_memory(data, fit, order)
    for found in lags.values():
        moved = ready.rules.project(found.slope)
        variance = variance + np.square(moved * found.deviation)
    deviation = np.sqrt(variance)
    unknown, confused = undetermined(design, ready.told, ready.sums.reached)
    deviation = np.where(confused, np.inf, deviation)

    def spread(values: np.ndarray, empty: float | bool) -> np.ndarray:
        whole = np.full(len(data), empty)
        whole[design.rows] = values
        return whole

    loss = fit.estimate.loss
    ratio = left / loss.scale
    rejected = int((~active).sum())
    message = f"{len(left)} readings, {used:.1f} effective parameters."
    if rejected:
        message += f" {rejected} wild readings were left out."
    if not fit.settled:
        message += " The iterations did not settle; treat the result with care."
    at = design.datum
    return Report(
        datum=(float(fit.theta[at]), float(deviation[at])),
        noise=fit.estimate.noise,
        deviation=deviation,
        unknown=unknown,
        residual=spread(left, np.nan),
        share=spread(np.where(active, loss.share(ratio), 0.0), 0.0),
        wild=spread(~active, False),
        runs=_runs(fit, post.variance),
        message=message,
        lags=lags,
    )


def _with_memory(
    data: JointData, fit: AxisFit, order: Int[np.ndarray, " r"]
) -> dict[str, FoundLag]:
    """Return the lags, their deviations such as noise with a memory leaves them."""
    design, result = fit.ready.design, {}
    for sensor, found in fit.lags.items():
        direction = design.columns @ found.slope
        step = _STEP * found.value
        for place, effect in enumerate(design.effects):
            if not isinstance(effect, TemperatureEffect) or not step:
                continue
            if sensor in effect.sensor_names:
                values = fit.estimate.values[design.places_of(place)]
                later, sooner = (
                    effect.lagging({sensor: lag}).block(data).columns
                    for lag in (found.value + step, found.value - step)
                )
                change = (later - sooner)[design.rows] @ values
                direction = direction + change / (2.0 * step)
        factor = memory_along(direction, fit.pseudo, order)
        deviation = found.deviation * np.sqrt(factor)
        result[sensor] = dataclasses.replace(found, deviation=float(deviation))
    return result


def _runs(fit: AxisFit, variance: float) -> tuple[RunEffect, ...]:
    """Return offset and drift of each run against the datum."""
    design, rules = fit.ready.design, fit.ready.rules
    own = [part.places for part in design.components if part.kind == "runs"]
    if not own:
        return ()
    places = own[0]
    runs = sorted({run for run, _ in design.knots})
    picks = np.zeros((design.size, 2 * len(runs)))
    for number, run in enumerate(runs):
        knots = [k for k, (label, _) in enumerate(design.knots) if label == run]
        picks[places[knots], 2 * number] = 1.0 / len(knots)
        picks[places[knots[-1]], 2 * number + 1] += 1.0
        picks[places[knots[0]], 2 * number + 1] -= 1.0
    found = picks.T @ fit.theta
    # Functionals of the values under the rule, as functionals of the values as solved.
    before = picks - rules.gain.T @ (rules.null.T @ picks)
    spread = (before * fit.estimate.posterior.factor.solve(before)).sum(axis=0)
    deviation = np.sqrt(np.maximum(variance * spread, 0.0))
    return tuple(
        RunEffect(
            run,
            float(found[2 * number]),
            float(deviation[2 * number]),
            float(found[2 * number + 1]),
            float(deviation[2 * number + 1]),
        )
        for number, run in enumerate(runs)
    )


def part_of(data: JointData, fit: AxisFit, report: Report, place: int) -> Part:
    design = fit.ready.design
    effect = design.effects[place]
    places = design.places_of(place)
    values = fit.theta[places]
    block = effect.block(data)
    contribution = np.where(block.known, block.columns @ values, np.nan)
    used = contribution[design.rows]
    return Part(
        effect=effect,
        values=values,
        standard_deviation=report.deviation[places],
        support=touched(design, fit.active)[places],
        determined=~report.unknown[places],
        labels=design.labels[place],
        share=share_of(fit.ready, place),
        contribution=contribution,
        rms=float(np.sqrt(np.mean(np.square(used)))),
        smoothness=weights_by_name(fit).get(effect.name, {}),
        lags={
            sensor: (found.value, found.deviation)
            for sensor, found in report.lags.items()
            if sensor in effect.sensor_names
        },
    )


def curves_of(fit: AxisFit) -> tuple[RunCurve, ...]:
    """Return what was taken off each run, over the time."""
    design = fit.ready.design
    own = [part.places for part in design.components if part.kind == "runs"]
    if not own:
        return ()
    runs = sorted({run for run, _ in design.knots})
    result = []
    for number, run in enumerate(runs):
        knots = [k for k, (label, _) in enumerate(design.knots) if label == run]
        value = fit.theta[own[0][knots]]
        time = np.zeros(0)
        if design.spans:
            low, high = design.spans[number]
            time = np.linspace(low, high, len(knots))
            for part in design.components:
                if part.kind == "wander" and design.bridges is not None:
                    upon = design.bridges.between(number, fit.theta[part.places])
                    fine = np.linspace(low, high, len(upon))
                    time, value = fine, np.interp(fine, time, value) + upon
        result.append(RunCurve(run, time, value))
    return tuple(result)
