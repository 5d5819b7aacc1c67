"""The thermal line fitted alone: readings and what is asked for in, the line out.

The columns are those of `Temperature`, law and lag what predicts readings best that it has not
seen. A law is fitted robustly to all readings once; with the weights that the loss left them it
is fitted again without each block and judged on that block.
"""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import median_filter

from ..._recording import JointData
from ...core import (
    FitError,
    Regression,
    one_blas_thread,
    regress,
    regress_curve,
    simplest,
)
from ...fit.joint import Leadscrew, Temperature, fit_joint
from ...fit.joint._lag import lag_bounds
from ._line import Lag, LawScore, TemperatureFit
from ._meeting import about_meeting

_FEWEST = 4
"""Readings of a fit, and between two nodes below which no node is set."""
_RANGE = 0.5
"""Range of a sensor in K below which no law is determined."""
_MANY = 3_000
"""Readings by which laws and lags are chosen; the chosen one is fitted to all."""
_MOST_NODES = {"offset": 5, "coefficient": 4}
"""A law that the PLC interpolates needs no more."""
_BENT = {"offset": 3, "coefficient": 2}
"""Laws with which a lag is looked for."""
_BLOCKS, _MOST_TURNS, _FOLDS = 20, 10, 5
"""Stretches of time that are left out one after the other; of more than so many, some
together in so many turns."""
_VISIT = 0.05
"""Share of the range of temperatures that counts as staying where it is."""
_FEW = 20
"""Readings below which no lag is looked for."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""
_GRID, _STEP = 6, 0.02
"""Lags of a sensor that is late itself, over what the clock can show; step in the logarithm of
a lag for slopes."""
_ABSOLUTE_ZERO = -273.15
_WINDOW = 7
"""Readings over which a temperature is compared with its neighbours."""
_GLITCH, _LEAST_GLITCH, _MOST_GLITCHES = 8.0, 1.0, 0.1
"""Distance from the neighbours that no structure can follow: in typical distances, and in K
below which it is none in any case; share of the readings up to which there are such."""


@one_blas_thread()
def fit_temperature(
    data: JointData, line: Temperature, *, meet: bool = False, loss: str = "student"
) -> TemperatureFit:
    r"""Fit $e = o(T_1) + c(T_2)(s - s_0)$ to errors at positions and temperatures.

    Least squares, wild readings set aside. Standard deviations count in that residuals drift:
    white noise plus an Ornstein–Uhlenbeck drift is fitted to them by restricted maximum
    likelihood, and its covariance is carried through the estimate.

    Args:
        data: Readings, NaN = missed; without a clock the rows are in order of time, at equal
            distances.
        line: What is asked for. Without a sensor of its own the offset is a constant; without
            one of the coefficient no slope is fitted (the error was measured at one position).
            Laws that are not given are chosen: the simplest of constant, linear and piecewise
            linear ones that predicts readings left out as well as the best. A lag to be fitted
            is applied where it predicts better.
        meet: Look from the reference of the line for the position where the lines of all
            temperatures meet, so that only the coefficient depends on the temperature.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    rows = complete_rows(line, data)
    own = data.take(rows)
    if own.time is None:
        own = dataclasses.replace(own, time=rows.astype(float))
    if "offset" not in line.sensors:
        # A constant has the sensor of the coefficient: that tells it no node.
        sensors = {"offset": line.sensors["coefficient"], **line.sensors}
        law = {**line.law, "offset": 1}
        line = dataclasses.replace(line, sensors=sensors, law=law)
    few = own.take(np.arange(0, len(rows), -(-len(rows) // _MANY)))
    lags = _choose_lags(few, line, loss)
    wanted = [name for name, lag in line.lags.items() if lag == "fit"]
    line = line.lagging({name: max(lag, 0.0) for name, lag in lags.items()})
    line, scores = _choose_law(few, line, loss)
    free = [name for name in wanted if line.lags[name]]
    fit, found = _fitted(own, line, loss, free)
    if meet and line.masters:
        met, other = fit, found
        try:
            bends = len(fit.line.nodes["coefficient"])
            if len(fit.line.nodes["offset"]) < bends:
                # Where the lines meet, the offset bends as the coefficient does.
                bent = dataclasses.replace(line, law=dict.fromkeys(line.law, bends))
                met, other = _fitted(own, bent, loss, free)
            met = about_meeting(met)
        except FitError:
            met = dataclasses.replace(met, meeting="too few")
        if met.meeting == "met":
            fit, found = met, other
        fit = dataclasses.replace(fit, meeting=met.meeting)
    turns = _stretches(own) % _FOLDS
    left, _ = _left_out(own, fit.line, found.share, turns)
    level = fit.error - np.median(fit.error)
    return dataclasses.replace(
        fit,
        data=data.take(rows),
        rows=rows,
        missed=len(data) - len(rows),
        lags=tuple(
            dataclasses.replace(lag, sensor_late=lags[lag.sensor] < 0.0)
            for lag in fit.lags
        ),
        predicted=np.where(np.isnan(left), level, left),
        scores=scores,
    )


def complete_rows(line: Temperature, data: JointData) -> Int[np.ndarray, " t"]:
    """Return the rows that have all that a line needs, in order of time.

    Raises:
        FitError: If they cannot tell what is asked for.
    """
    clock = np.arange(len(data), dtype=float) if data.time is None else data.time
    places = [data.column("position", axis, line.name) for axis in line.masters]
    error = data.column("error", line.axis, line.name)
    keep = np.isfinite([error, clock, *places]).all(axis=0)
    for sensor in line.sensor_names:
        keep &= ~_missed(data.column("temperature", sensor, line.name))
    rows = np.flatnonzero(keep)
    if len(rows) < _FEWEST:
        msg = f"{len(rows)} of {len(data)} readings are complete, expected at least {_FEWEST}."
        raise FitError(msg)
    for sensor in line.sensor_names:
        # What a noisy sensor shows of a temperature that stays is no range.
        low, high = np.percentile(data.temperature[sensor][rows], [1.0, 99.0])
        if high - low < _RANGE:
            msg = (
                f"{sensor} stays at {0.5 * (low + high):.4g} °C within {high - low:.2g} K,"
                f" expected a range of {_RANGE:g} K or more."
            )
            raise FitError(msg)
    for place in places:
        if np.ptp(place[rows]) == 0.0:
            asked = line.sensor_names[0]
            msg = (
                f"found all readings at {place[rows[0]]:g} mm, expected two positions or more"
                f" for the coefficient, or sensors = {{ offset = {asked!r} }}: at one position"
                " only the offset can be fitted"
            )
            raise FitError(msg)
    return rows[np.argsort(clock[rows], kind="stable")]


def _missed(temperature: Float[np.ndarray, " t"]) -> Bool[np.ndarray, " t"]:
    """Return which readings of a sensor are none: not finite, impossible, or lone jumps."""
    missed = ~np.isfinite(temperature) | (temperature < _ABSOLUTE_ZERO)
    values = temperature[~missed]
    if len(values) >= _WINDOW:
        away = np.abs(values - median_filter(values, _WINDOW, mode="nearest"))
        typical = 1.4826 * float(np.median(away))
        glitch = away > max(_GLITCH * typical, _LEAST_GLITCH)
        # So many that recur: not they are at fault.
        missed[~missed] = glitch & (glitch.mean() < _MOST_GLITCHES)
    return np.asarray(missed)


def _fitted(
    data: JointData, line: Temperature, loss: str, free: Sequence[str]
) -> tuple[TemperatureFit, Regression]:
    """Return the fit of a law with what its regression says, the prediction left open."""
    line, found = _regressed(data, line, loss, free)
    size, sensors = line.size, line.sensor_names
    # Those of logarithms.
    unsure = dict(zip(free, found.standard_deviation[size:].tolist(), strict=True))
    columns = line.rows(line.columns_of(data))[1]
    fit = TemperatureFit(
        line=line,
        data=data,
        rows=np.arange(len(data)),
        missed=0,
        structure=np.stack([line.structure(data, name) for name in sensors], axis=1),
        values=found.coefficients[:size],
        covariance=found.covariance,
        lags=tuple(
            Lag(name, float(lag), float(lag) * unsure.get(name, 0.0))
            for name, lag in line.lags.items()
        ),
        noise=found.noise,
        independent=float(found.independent[:size].min()),
        wild=found.wild,
        predicted=found.residual,
        support=tuple((np.abs(columns[~found.wild]) > 0).sum(axis=0).tolist()),
        converged=found.converged,
    )
    return fit, found


def _regressed(
    data: JointData,
    line: Temperature,
    loss: str,
    free: Sequence[str] = (),
    quick: bool = False,
) -> tuple[Temperature, Regression]:
    """Return a line with nodes and lags, and the regression behind it.

    Args:
        data: Complete readings, in order of time.
        line: Its law a number of nodes, its lags those to begin with.
        loss: As for `regress`.
        free: Sensors whose lag is fitted.
        quick: The regression needs no covariance.

    Returns:
        Line and regression; its coefficients are values, then the logarithms of the lags that
        are free.

    Raises:
        FitError: If the readings do not determine them.
    """
    line, count = _placed(line, data), len(free)
    first, last = lag_bounds(line.axis, data) if free else (0.0, 0.0)

    def at(logs: Float[np.ndarray, " s"]) -> Temperature:
        return line.lagging(dict(zip(free, np.exp(logs).tolist(), strict=True)))

    def columns(logs: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t k"]:
        trial = at(logs)
        return trial.rows(trial.columns_of(data))[1]

    start = np.log([float(line.lags[sensor]) for sensor in free])
    names = (*line.labels, *["time constant"] * count)
    logs, found = regress_curve(
        columns, data.error[line.axis], np.clip(start, first, last),
        width=np.full(count, _STEP), bounds=(np.full(count, first), np.full(count, last)),
        time=data.time, names=names, loss=loss, quick=quick,
    )  # fmt: skip
    if lacking := ", ".join(itertools.compress(names, found.undetermined)):
        msg = (
            f"the readings that agree with each other do not determine {lacking}: "
            f"{int(found.wild.sum())} wild ones are left out."
        )
        raise FitError(msg)
    return at(logs), found


def _placed(line: Temperature, data: JointData) -> Temperature:
    """Return a line with nodes over the temperatures of the structure.

    Raises:
        FitError: If two of them have too few readings between.
    """
    theta = {name: line.structure(data, name) for name in line.sensor_names}
    line = line.placed(dataclasses.replace(data, temperature=theta))
    for law, nodes in line.nodes.items():
        warm = theta[line.sensors[law]]
        if len(nodes) > 2 and np.histogram(warm, nodes)[0].min() < _FEWEST:
            msg = f"too few readings between {len(nodes)} nodes."
            raise FitError(msg)
    return line


def _choose_law(
    data: JointData, line: Temperature, loss: str
) -> tuple[Temperature, tuple[LawScore, ...]]:
    """Return the simplest law that predicts no worse than the best by more than chance.

    Returns:
        The line, its law a number of nodes; and what was compared: nothing where it is given.

    Raises:
        FitError: If not even the simplest law can be held to readings left out.
    """
    given = _given(line, data)
    each = [
        [given[law]] if law in given else range(_MOST_NODES[law], 0, -1)
        for law in line.sensors
    ]
    shapes = sorted(itertools.product(*each), key=lambda shape: -sum(shape))
    lines = [
        dataclasses.replace(line, law=dict(zip(line.sensors, shape, strict=True)))
        for shape in shapes
    ]
    best, scores = 0, list[LawScore]()
    if len(lines) > 1:
        best, left = _simplest(data, lines, loss, [sum(shape) for shape in shapes])
        if not left:
            msg = "too few readings to tell which law they follow: give the law."
            raise FitError(msg)
        scores = [
            LawScore(shapes[k][0], sum(shapes[k][1:]), rms, k == best)
            for k, rms in left.items()
        ]
    # A sensor that no law follows has no lag.
    followed = zip(line.sensors.values(), shapes[best], strict=True)
    moved = {sensor for sensor, count in followed if count > 1}
    still = {name: 0.0 for name in line.sensor_names if name not in moved}
    return lines[best].lagging(still), tuple(reversed(scores))


def _given(line: Temperature, data: JointData) -> dict[str, int]:
    """Return the nodes of the laws that are given."""
    nodes = line.placed(data).nodes.items()
    return {law: len(own) for law, own in nodes if law in line.law}


def _choose_lags(data: JointData, line: Temperature, loss: str) -> dict[str, float]:
    """Return the lag in s of each sensor; a negative one is late itself.

    That of the joint fit of laws that can bend, or else one of the structure ahead of the
    sensor, where it predicts held-out readings better by more than chance.
    """
    unknown = [name for name, lag in line.lags.items() if lag == "fit"]
    none = {
        name: 0.0 if lag == "fit" else float(lag) for name, lag in line.lags.items()
    }
    if not unknown or len(data) < _FEW:
        return none
    law = {name: _BENT[name] for name in line.sensors} | _given(line, data)
    bent = dataclasses.replace(line, law=law)
    places = [data.position[axis] for axis in line.masters]
    screw = [Leadscrew(line.axis, np.array([own.min(), own.max()])) for own in places]
    try:
        found = fit_joint(data, [bent, *screw], loss=loss).parts[0].lags
    except FitError:
        return none
    behind = none | {name: lag for name, (lag, _) in found.items()}
    grid = np.exp(np.linspace(*lag_bounds(line.axis, data), _GRID)).tolist()
    ahead = [{**none, name: -lag} for name in unknown for lag in grid]
    for trials in ([none, behind], [none, *ahead]):
        lines = [bent.lagging(lags) for lags in trials]
        best, _ = _simplest(data, lines, loss, [0, *[1] * (len(trials) - 1)])
        if best:
            return trials[best]
    return none


def _simplest(
    data: JointData, lines: Sequence[Temperature], loss: str, sizes: Sequence[int]
) -> tuple[int, dict[int, float]]:
    """Return which line is the simplest that predicts readings left out as well as the best.

    Beyond all temperatures that are left no law claims anything, and nothing counts: judging
    there would reward what luckily extends.

    Returns:
        Its number, and the root mean square of the held-out residuals in mm of each line that
        the readings tell where some are left out.
    """
    blocks, scale = _blocks(data, lines[0]), 0.0
    turns = blocks % _FOLDS if blocks.max() + 1 > _MOST_TURNS else blocks
    tried: dict[int, Float[np.ndarray, " t"]] = {}
    for number, line in enumerate(lines):
        try:
            placed, found = _regressed(data, line, loss, quick=True)
        except FitError:
            continue
        middle = 1.4826 * float(np.median(np.abs(found.residual)))
        least = max(1e-9, 1e-6 * float(np.ptp(found.residual)))
        scale = scale or max(middle, least)
        left, inside = _left_out(data, placed, found.share, turns)
        if not np.isnan(left).any():
            tried[number] = np.where(inside, left, 0.0)
    if not tried:
        return 0, {}
    kept = [sizes[number] for number in tried]
    best, rms = simplest([*tried.values()], kept, scale, blocks, _MATTERS)
    return [*tried][best], dict(zip(tried, rms.tolist(), strict=True))


def _left_out(
    data: JointData,
    line: Temperature,
    share: Float[np.ndarray, " t"],
    groups: Int[np.ndarray, " t"],
) -> tuple[Float[np.ndarray, " t"], Bool[np.ndarray, " t"]]:
    """Return what a line fitted without its group leaves of each reading in mm.

    Reference, lags, number of nodes and the weights that the loss left the readings are those
    of the line; its nodes lie over the temperatures of the others.

    Returns:
        NaN where the others do not tell the law; and which readings lie within the
        temperatures of the others.
    """
    theta = {name: line.structure(data, name) for name in line.sensor_names}
    data = dataclasses.replace(data, temperature=theta)
    law = {name: len(nodes) for name, nodes in line.nodes.items()}
    line = dataclasses.replace(line, law=law, lag=0.0)
    error = data.error[line.axis]
    left, inside = np.full(len(groups), np.nan), np.ones(len(groups), bool)
    for group in np.unique(groups):
        out = groups == group
        for warm in theta.values():
            low, high = warm[~out].min(), warm[~out].max()
            inside[out] &= (warm[out] >= low) & (warm[out] <= high)
        try:
            other = _placed(line, data.take(~out))
            columns = other.rows(other.columns_of(data))[1]
            found = regress(
                columns[~out], error[~out], weight=share[~out], loss="gauss", quick=True
            )
        except FitError:
            continue
        left[out] = error[out] - columns[out] @ found.coefficients
    return left, inside


def _stretches(data: JointData) -> Int[np.ndarray, " t"]:
    """Return stretches of time, as many readings in each."""
    return np.arange(len(data)) * _BLOCKS // len(data)


def _blocks(data: JointData, line: Temperature) -> Int[np.ndarray, " t"]:
    """Return stays at one temperature, which are held out together, or stretches of time."""
    theta = data.temperature[line.sensor_names[0]]
    limit = _VISIT * max(float(np.ptp(theta)), 1e-9)
    stay = np.zeros(len(theta), np.int64)
    start, number = theta[0], 0
    for row, value in enumerate(theta):
        if abs(value - start) > limit:
            start, number = value, number + 1
        stay[row] = number
    return stay if 3 <= number + 1 < _BLOCKS else _stretches(data)
