"""What a fitted line amounts to: laws, lags, support, sentences."""

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._regression import Regression
from ._line import Data, Line
from ._types import Lag, Law, LawScore, TemperatureFit, ThermalReadings
from ._words import confusions, lag_sentence


def line_result(
    readings: ThermalReadings,
    keep: Bool[np.ndarray, " t"],
    rows: Int[np.ndarray, " r"],
    data: Data,
    line: Line,
    found: Regression,
    settled: bool,
    scores: tuple[LawScore, ...],
    free: tuple[int, ...],
    intersects: bool,
    late: tuple[bool, bool],
    messages: tuple[str, ...],
) -> TemperatureFit:
    """Return the fit as users of the floor see it."""
    deviation = found.standard_deviation
    count = len(line.nodes[0])
    both = (
        Law(
            sensor if sensor is not None else 0,
            nodes,
            line.value[part],
            deviation[part],
        )
        for sensor, nodes, part in zip(
            data.sensors,
            line.nodes,
            (slice(0, count), slice(count, len(line.value))),
            strict=True,
        )
    )
    offset, coefficient = both
    wild = np.zeros(len(keep), bool)
    wild[rows[found.wild]] = True
    residual: Float[np.ndarray, " t"] = np.full(len(keep), np.nan)
    residual[rows] = data.error - line.predict(data)
    temperature = np.full(readings.temperature.shape, np.nan)
    theta = data.structure(line.lags)
    for sensor, values in zip(data.sensors, theta, strict=True):
        if sensor is not None:
            temperature[rows, sensor] = values
    lags = _reported_lags(data, line, deviation, free, intersects, late)
    names = list(line.names())
    names += ["reference position"] if intersects else []
    names += ["time constant"] * (len(found.coefficients) - len(names))
    used = np.abs(line.columns(data)[~found.wild]) > 0
    confounded = confusions(data, line.lags)
    said = [*messages, *(lag_sentence(each) for each in lags)]
    if found.wild.any():
        said.append(f"{int(found.wild.sum())} wild readings were left out.")
    missed = int((~keep).sum())
    if missed:
        said.append(f"{missed} readings were missed or incomplete.")
    for each in confounded:
        said.append(
            f"These readings cannot tell the {each.first} from the {each.second}: both "
            "change together. Measure each temperature at all positions."
        )
    return TemperatureFit(
        offset=offset,
        coefficient=coefficient if len(coefficient.value) else None,
        reference=line.reference,
        reference_deviation=float(deviation[len(line.value)]) if intersects else None,
        intersects=intersects,
        lags=lags,
        names=tuple(names),
        covariance=found.covariance,
        noise=found.noise,
        independent=float(found.independent[: len(line.value)].min()),
        used=keep,
        wild=wild,
        residual=residual,
        temperature=temperature,
        scores=scores,
        confounded=confounded,
        support=tuple(int(number) for number in used.sum(axis=0)),
        converged=settled,
        messages=tuple(said),
    )


def _reported_lags(
    data: Data,
    line: Line,
    deviation: Float[np.ndarray, " k"],
    free: tuple[int, ...],
    intersects: bool,
    late: tuple[bool, bool],
) -> tuple[Lag, ...]:
    result: dict[int, Lag] = {}
    at = len(line.value) + int(intersects)
    shared = data.sensors[0] == data.sensors[1]
    for number, sensor in enumerate(data.sensors):
        if sensor is None or sensor in result:
            continue
        constant = line.lags[number]
        interval = (constant, constant)
        if number in free:
            own = at if shared else at + sum(k < number for k in free)
            factor = float(np.exp(min(1.96 * deviation[own], 50.0)))
            interval = (constant / factor, constant * factor)
        result[sensor] = Lag(sensor, constant, interval, constant > 0, late[number])
    return tuple(result.values())
