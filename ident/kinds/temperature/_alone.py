"""A thermal line that stands alone: the readings that count, and the law and lag that they show.

A line that can bend is fitted to all readings once, by the joint fit. With the weights that its
loss left the readings every law is fitted again without each block, and judged on that block.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..._recording import JointData
from ...core import FitError, one_blas_thread, simplest
from ...fit.joint import Leadscrew, Temperature, fit_joint
from ...job.joint._recording import GroupRecording, folds, read_group
from ...job.result._result import Remark
from ...readings import sensor_name
from .keys import Plateau

if TYPE_CHECKING:
    from .plan import TemperaturePlan

FEWEST = 4
"""Readings of a fit, and between two nodes below which no node is set."""
_RANGE = 0.5
"""Range of a sensor in K below which no law is determined."""
_MANY = 3_000
"""Readings by which laws and lags are chosen."""
_MOST_NODES = {"offset": 5, "coefficient": 4}
"""A law that the PLC interpolates needs no more."""
_BENT = {"offset": 3, "coefficient": 2}
"""Laws with which a lag is looked for."""
_BLOCKS, _FOLDS = 20, 5
"""Stretches of time, and turns in which they are left out."""
_FEW = 20
"""Readings below which no lag is looked for."""
_LEAST = 1e-9
"""mm below which residuals are none."""
_MATTERS = 0.02
"""Share of the squared held-out residuals by which a richer law must be better."""


def read_thermal(
    plan: "TemperaturePlan",
) -> tuple[GroupRecording, Int[np.ndarray, " n"]]:
    """Return the readings of a temperature fit, all its measurements joined.

    Returns:
        The recording; and the rows that count, which are all but where a plateau is asked for.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        FitError: If there is no plateau where one is asked for.
        JobError: If the measurements do not suit each other.
    """
    group = read_group(plan.tables, [plan])
    data, rows, remarks = group.data, np.arange(len(group.data)), [*group.remarks]
    time = None
    if data.time is not None and data.clock_number is None:
        time = data.time - np.nanmin(data.time)
    else:
        words = (
            "The rows have no time in common: they are taken in their order, and a lag behind the"
            " sensor cannot be seen."
        )
        remarks.append(Remark.info(words))
    data = dataclasses.replace(data, time=time)
    if (plateau := plan.fit.steady) is not None:
        name = sensor_name(plateau.sensor)
        warm = data.temperature[name]
        keep = steady(data.order, warm, plateau)
        sentence = (
            f"Only the {int(keep.sum())} of {len(keep)} readings count that were taken"
            f" while {name} stayed at {float(np.median(warm[keep])):.4g} °C within"
            f" ±{plateau.within:g} K (steady)."
        )
        remarks.append(Remark.info(sentence))
        rows = np.flatnonzero(keep)
    return dataclasses.replace(group, data=data, remarks=tuple(remarks)), rows


def only_these(
    recording: GroupRecording, rows: Int[np.ndarray, " n"]
) -> GroupRecording:
    """Return a recording with errors in some rows only: lags remember the others."""
    (axis, error), *_ = recording.data.error.items()
    errors = np.full(len(error), np.nan)
    errors[rows] = error[rows]
    fold = recording.fold.copy()
    if not recording.by_run:
        fold[rows], _ = folds(None, recording.data.order[rows])
    data = dataclasses.replace(recording.data, error={axis: errors})
    return dataclasses.replace(recording, data=data, fold=fold)


def steady(
    time: Float[np.ndarray, " t"], value: Float[np.ndarray, " t"], plateau: Plateau
) -> Bool[np.ndarray, " t"]:
    """Return the readings of the longest plateau of a signal: heating done, load constant.

    Args:
        time: In s, ascending.
        value: Of the signal that is to be steady (a heater, a spindle), NaN = missed.
        plateau: Distance from a level; without one from the most frequent.

    Raises:
        FitError: If there is none.
    """
    finite, level, within = np.isfinite(value), plateau.level, plateau.within
    if level is None and finite.any():
        ordered = np.sort(value[finite])
        # The densest half: a plateau is where the signal spends its time.
        half = max(len(ordered) // 2, 1)
        width = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
        first = int(np.argmin(width))
        level = float(np.median(ordered[first : first + half]))
    inside = finite & (np.abs(value - (0.0 if level is None else level)) <= within)
    # A lone reading outside does not end a plateau.
    bridged = inside.copy()
    bridged[1:-1] |= inside[:-2] & inside[2:]
    masked = np.ma.array(value, mask=bridged)
    stretches: list[slice] = np.ma.clump_masked(masked)  # type: ignore[no-untyped-call]
    if not stretches:
        msg = (
            f"steady: {plateau.sensor}: no reading lies within ±{within:g} of a plateau, expected"
            " a steady stretch."
        )
        raise FitError(msg)
    longest = max(stretches, key=lambda rows: float(np.ptp(time[rows])))
    result = np.zeros(len(value), bool)
    result[longest] = inside[longest]
    return result


def about_runs(
    values: Float[np.ndarray, "t *p"], run: Int[np.ndarray, " t"]
) -> Float[np.ndarray, "t *p"]:
    """Return values less the mean of their run."""
    _, index, count = np.unique(run, return_inverse=True, return_counts=True)
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, index, values)
    means = sums / count.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray(values - means[index])


def complete_rows(
    line: Temperature, data: JointData, rows: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " t"]:
    """Return which of some rows have all that a line needs, in order of time.

    Raises:
        FitError: If they cannot tell what is asked for.
    """
    columns = [data.column(*key, line.name) for key in line.inputs]
    error = data.column("error", line.axis, line.name)
    complete = np.asarray(np.isfinite([error, data.order, *columns]).all(axis=0))
    usable = rows[complete[rows]]
    if len(usable) < FEWEST:
        msg = (
            f"{len(usable)} of {len(rows)} readings are complete, expected at least"
            f" {FEWEST}."
        )
        raise FitError(msg)
    for sensor in line.sensor_names:
        # What a noisy sensor shows of a temperature that stays is no range.
        low, high = np.percentile(data.temperature[sensor][usable], [1.0, 99.0])
        if high - low < _RANGE:
            msg = (
                f"{sensor} stays at {0.5 * (low + high):.4g} °C within {high - low:.2g} K,"
                f" expected a range of {_RANGE:g} K or more."
            )
            raise FitError(msg)
    for axis in line.masters:
        place = data.position[axis][usable]
        if np.ptp(place) == 0.0:
            first = line.sensor_names[0]
            msg = (
                f"found all readings at {place[0]:g} mm, expected two positions or more"
                f" for the coefficient, or sensors = {{ offset = {first!r} }}: at one position"
                " only the offset can be fitted"
            )
            raise FitError(msg)
    return np.asarray(usable[np.argsort(data.order[usable], kind="stable")])


@one_blas_thread()
def choose_line(
    data: JointData, rows: Int[np.ndarray, " t"], line: Temperature, loss: str
) -> Temperature:
    """Return a line with law and lag as they are given, or else chosen on readings held out.

    The simplest of constant, linear and piecewise linear laws (as numbers of nodes) that predicts
    readings left out as well as the best, and a lag in s where it predicts them better.

    Args:
        data: All readings; lags remember those that are not fitted, too.
        rows: Those to fit, in order of time.
        line: What is asked for.
        loss: As for `fit_joint`.

    Raises:
        FitError: If not even the simplest law can be held to readings left out.
    """
    fixed = {k: len(v) for k, v in line.placed(data).nodes.items() if k in line.law}
    lagged = [sensor for sensor, lag in line.lags.items() if lag == "fit"]
    line = line.lagging(dict.fromkeys(lagged, 0.0))
    if not lagged and len(fixed) == len(line.sensors):
        return dataclasses.replace(line, law=fixed)
    sample = rows[:: -(-len(rows) // _MANY)]
    bent = dataclasses.replace(line, law={k: _BENT[k] for k in line.sensors} | fixed)
    try:
        trial = place_nodes(bent, data, sample)
    except FitError:
        bent = dataclasses.replace(line, law=dict.fromkeys(line.sensors, 2) | fixed)
        trial = place_nodes(bent, data, sample)
    if len(sample) >= _FEW:
        trial = trial.lagging(dict.fromkeys(lagged, "fit"))
    places = [data.position[axis][sample] for axis in line.masters]
    screw = [Leadscrew(line.axis, np.sort(place)[[0, -1]]) for place in places]
    use = np.isin(np.arange(len(data)), sample)
    fit = fit_joint(data, [trial, *screw], loss=loss, use=use)
    # Readings without any scatter are told apart by what computing leaves of them.
    scale = max(fit.noise[line.axis], _LEAST)
    judge = _HeldOut(data, sample, fit.share[line.axis][sample], scale)
    # One that may be a seventh or seven times as long is none that the readings show.
    lags = {
        sensor: lag if deviation < lag else 0.0
        for sensor, (lag, deviation) in fit.parts[0].lags.items()
    }
    if any(lags.values()):
        choice = judge.simplest([bent, bent.lagging(lags)], [0, 1])
        line = line.lagging(lags if choice else {})
    counts = [
        [fixed[law]] if law in fixed else range(_MOST_NODES[law], 0, -1)
        for law in line.sensors
    ]
    shapes = list(itertools.product(*counts))
    laws = [dict(zip(line.sensors, shape, strict=True)) for shape in shapes]
    lines = [dataclasses.replace(line, law=law) for law in laws]
    best = judge.simplest(lines, [*map(sum, shapes)]) if len(lines) > 1 else 0
    # A sensor that no law follows has no lag.
    moving = {line.sensors[name] for name, count in laws[best].items() if count > 1}
    return lines[best].lagging({name: 0.0 for name in lagged if name not in moving})


def place_nodes(
    line: Temperature, data: JointData, rows: Int[np.ndarray, " t"]
) -> Temperature:
    """Return a line with nodes over the temperatures of the structure in these rows.

    Raises:
        FitError: If two of them have too few readings between.
    """
    theta = {name: line.structure(data, name)[rows] for name in line.sensor_names}
    line = line.placed(dataclasses.replace(data.take(rows), temperature=theta))
    for law, nodes in line.nodes.items():
        warm = theta[line.sensors[law]]
        if len(nodes) > 2 and np.histogram(warm, nodes)[0].min() < FEWEST:
            msg = f"too few readings between {len(nodes)} nodes."
            raise FitError(msg)
    return line


@dataclasses.dataclass(frozen=True)
class _HeldOut:
    """Readings that laws are judged on.

    Attributes:
        data: All readings.
        rows: Those that count, in order of time.
        share: Weight that the loss left each of them.
        scale: Of their residuals in mm.
    """

    data: JointData
    rows: Int[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    scale: float

    def simplest(self, lines: Sequence[Temperature], sizes: Sequence[int]) -> int:
        """Return the number of the simplest line that predicts as well as the best.

        Raises:
            FitError: If they tell none where some are left out.
        """
        blocks = np.arange(len(self.rows)) * _BLOCKS // len(self.rows)
        residuals: dict[int, Float[np.ndarray, " t"]] = {}
        for number, line in enumerate(lines):
            try:
                residuals[number] = self._left_out(line, blocks % _FOLDS)
            except FitError:
                continue
        if not residuals:
            msg = "too few readings to tell which law they follow: give the law."
            raise FitError(msg)
        nodes = [sizes[number] for number in residuals]
        best = simplest([*residuals.values()], nodes, self.scale, blocks, _MATTERS)
        return [*residuals][best]

    def _left_out(
        self, line: Temperature, folds: Int[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return what a line fitted without its turn leaves of each reading in mm.

        Beyond all temperatures of the others no law claims anything, and nothing counts:
        judging there would reward what luckily extends.

        Raises:
            FitError: If the others do not tell the line.
        """
        data = self.data.take(self.rows)
        theta = {s: line.structure(self.data, s)[self.rows] for s in line.sensor_names}
        data = dataclasses.replace(data, temperature=theta)
        line = line.lagging(dict.fromkeys(theta, 0.0))
        error, residual = data.error[line.axis], np.zeros(len(folds))
        run, ones = data.run_of(line.axis), np.ones(len(folds))
        own = ones == (run is None) if data.own_zero is None else data.own_zero
        for fold in np.unique(folds):
            held, training = folds == fold, np.flatnonzero(folds != fold)
            placed = place_nodes(line, data, training)
            columns = placed.rows(placed.columns_of(data))[1]
            if "offset" not in line.sensors:
                columns = np.column_stack([columns, ones])
            if run is not None:  # a zero that is the instrument's tells nothing
                columns = np.where(own[:, None], columns, about_runs(columns, run))
                error = np.where(own, error, about_runs(error, run))
            root = np.sqrt(self.share[training])
            design = columns[training] * root[:, None]
            values, _, rank, _ = np.linalg.lstsq(design, error[training] * root)
            # The constant of all is one of the columns, or the sum of those of the offset.
            if rank < columns.shape[1] - (not own.any()):
                msg = "the others do not tell the law."
                raise FitError(msg)
            for warm in theta.values():
                held &= (warm >= warm[training].min()) & (warm <= warm[training].max())
            residual[held] = (error - columns @ values)[held]
        return residual
