"""Readings of fits, of a group or of one alone: every role that they need, all joined."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import DirectionUnknown, derive_error
from ..._recording import CHANNELS, JointData, stacked
from ...kinds import kind
from ...kinds._keys import FitSpec
from ...readings import (
    POSITION_ORDER,
    SENSOR,
    Readings,
    Rows,
    Tables,
    away_from,
    cycles_of,
    joined,
    joined_runs,
    longer_than,
    reference_words,
    rows_of,
)
from ..result._result import Remark

if TYPE_CHECKING:
    from .._draft import AbstractPlan
    from ..file._load import Job

_FOLDS, _BLOCKS = 5, 20
"""In how many turns readings are held out, and stretches of the recording."""
_MOST_RUNS = 10
_COLDEST, _HOTTEST = -100.0, 500.0
"""°C beyond which a sensor is broken: its wire, or a short circuit."""
_ABSOLUTE_ZERO, _NOT_THERE = -273.15, 0.5
"""°C; and the share of broken readings from which on there is no sensor."""
_LEAST = {"µm": (2e-4, "mm or inch for µm"), "m°": (3e-5, "° for arcsec")}
"""mm or ° that the readings of any axis differ by, and what else their unit may be."""
_WINDOW = 7
"""Readings over which a temperature is compared with its neighbours."""
_GLITCH, _LEAST_GLITCH, _MOST_GLITCHES = 8.0, 1.0, 0.1
"""Distance from the neighbours that no structure can follow: in typical distances, and in K
below which it is none in any case; share of the readings up to which there are such."""
_STEEL = 11.5
"""Expansion of steel in µm/m per K."""
_TAKEN_UP, _LONGEST = 0.02, 1.0
"""Way after a reversal in which the play is taken up: share of the travel, and mm or °."""


@dataclasses.dataclass(frozen=True)
class GroupRecording:
    """What a group has been measured with, or one fit that stands alone.

    Attributes:
        data: All readings, measurements one after the other.
        slices: Rows of each measurement.
        run: Cycle of each reading, or None where nothing was repeated.
        fold: Turn in which each reading is held out.
        by_run: Whether whole runs are held out, else stretches of the recording.
        moving: Compensated axes whose error was recorded in motion, with their velocity.
        drift: Pieces of a slow drift of the instrument that is allowed for.
        remarks: What was taken for granted.
        rows: All columns of each measurement.
    """

    data: JointData
    slices: Mapping[str, slice]
    run: Int[np.ndarray, " t"] | None
    fold: Int[np.ndarray, " t"]
    by_run: bool
    moving: frozenset[str]
    drift: int
    remarks: tuple[Remark, ...]
    rows: Mapping[str, Rows]

    @property
    def drifting(self) -> bool:
        """Whether a slow drift of the instrument is allowed for, and known when held out."""
        return self.drift > 0 and not self.by_run

    @property
    def held_out(self) -> str:
        """What the prediction leaves out together."""
        return "run" if self.by_run else "block"

    def readings(
        self,
        over: Sequence[str],
        turns: str | None,
        error: Float[np.ndarray, " n"],
        keep: Bool[np.ndarray, " t"],
    ) -> Readings:
        """Return readings as a table takes them.

        Args:
            over: Axes whose positions it needs.
            turns: Axis whose direction of motion counts where it is known; None: it does not.
            error: Of those that are kept, in mm or °.
            keep: Which.
        """
        direction = self.data.direction.get(turns or "")
        if direction is not None:
            direction = direction[keep] if np.isfinite(direction[keep]).all() else None
        ends = np.concatenate([[0], np.cumsum(keep)])
        own_zero = None if self.data.own_zero is None else self.data.own_zero[keep]
        if own_zero is not None and own_zero.all() == own_zero.any():
            own_zero = None  # those of another axis are the others
        return Readings(
            positions=np.stack([self.data.position[name][keep] for name in over], 1),
            error=error,
            direction=None if direction is None else direction.astype(np.int64),
            run=None if self.run is None else self.run[keep],
            order=self.data.order[keep],
            timed=self.data.time is not None,
            slices={
                name: slice(int(ends[rows.start]), int(ends[rows.stop]))
                for name, rows in self.slices.items()
            },
            own_zero=own_zero,
        )


def read_group(
    tables: Tables, members: Sequence["AbstractPlan"], *, alone: bool = False
) -> GroupRecording:
    """Return the readings of a group: every column that its members use.

    They have the same measurements. Of one table that stands alone a cell without a value is
    refused, and the direction is read wherever the file tells it.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        JobError: If a measurement does not suit.
    """
    parts, remarks, every = list[JointData](), list[Remark](), dict[str, Rows]()
    lead = max((member.fit for member in members), key=lambda fit: len(fit.over))
    masters = lead.over
    if len(masters) < 2:
        masters = _used(members, "position") or (lead.axis,)
    axes = _unique((member.axis,) for member in members)
    for name in lead.sources:
        measured = tables.measured(name, lead.axis, masters)
        rows = Rows(tables.job, name, measured, axes, gaps=not alone)
        parts.append(_columns(rows, members, axes, alone))
        every[name] = rows
        remarks += [Remark.info(words) for words in dict.fromkeys(rows.remarks)]
    moving = frozenset(
        axis
        for rows, part in zip(every.values(), parts, strict=True)
        for axis in rows.moving & set(part.velocity)
    )
    # Beside a log in motion, what was read from place to place stood still.
    parts = [
        dataclasses.replace(
            part, velocity={a: np.zeros(len(part)) for a in moving} | {**part.velocity}
        )
        for part in parts
    ]
    counts = [len(part) for part in parts]
    columns = {table: stacked(parts, table, counts) for table in CHANNELS}
    own_zero = _own_zero(tables.job, lead.sources, parts)
    run = joined_runs([part.run for part in parts], counts)
    signs = [*columns["direction"].values()]
    one_way = len(signs) == 1 and np.isin(signs[0], (-1.0, 1.0)).all()
    if run is not None and one_way and own_zero is None:
        run = cycles_of(run, signs[0].astype(np.int64))
    several = run is not None and len(np.unique(run)) > 1
    for axis, values in columns["error"].items():
        remarks += _unmoved(axis, values, tables.job.spec.axes[axis].small_unit)
    time = joined([part.time for part in parts])
    slices = rows_of(lead.sources, counts)
    remarks += _grown(tables.job, members, columns, slices)
    remarks += _warm(tables.job, members, every)
    specs = [tables.job.spec.measurements[name] for name in lead.sources]
    zeroed = any(spec.zeroed for spec in specs)
    # Runs without an offset: it is what tells the temperature, unless that moves no whole axis
    # and the zero of the instrument is arbitrary.
    heated = _unique(
        (member.axis,)
        for member in members
        if "temperature" in member.inputs
        and (member.shifting or not (zeroed and several))
    )
    # Only where the zero of each measurement is arbitrary, each has an offset of its own.
    beside = None
    if len(counts) > 1 and any(spec.remove != "none" for spec in specs):
        beside = np.repeat(np.arange(1, len(counts) + 1), counts)
    if several and heated and beside is None:
        words = (
            f"Runs have no offset of their own on {' and '.join(heated)}: it could"
            " not be told from what the temperature does from run to run."
        )
        remarks.append(Remark.info(words))
    apart = time is not None and not followed(time, slices)
    data = JointData(
        **columns,
        time=time,
        # A table alone finds the zeros of its measurements itself.
        run=run if several else None if alone else beside,
        runs=dict.fromkeys(heated, beside),
        clock_number=np.repeat(np.arange(len(counts)), counts) if apart else None,
        own_zero=own_zero,
    )
    fold, by_run = folds(_held_out_together(run, parts), data.order)
    return GroupRecording(
        data=data,
        slices=slices,
        run=run,
        fold=fold,
        by_run=by_run,
        moving=moving,
        drift=max(spec.drift for spec in specs),
        remarks=tuple(remarks),
        rows=every,
    )


def _unmoved(axis: str, error: Float[np.ndarray, " t"], unit: str) -> Iterator[Remark]:
    """Yield a doubt of the unit where errors in mm or ° are as small as no machine's."""
    finite = error[np.isfinite(error)]
    least, other = _LEAST[unit]
    if finite.size and (span := float(np.ptp(finite))) < least:
        yield Remark.warning(
            f"The readings of {axis} differ by {1e3 * span:.2g} {unit} at most, less than any"
            f" machine errs: is the unit of their column right ({other})? A list of them"
            " holds zeros."
        )


def _grown(
    job: "Job",
    members: Sequence["AbstractPlan"],
    columns: Mapping[str, Mapping[str, Float[np.ndarray, " t"]]],
    slices: Mapping[str, slice],
) -> Iterator[Remark]:
    """Yield that measurements of a length differ as they do at other temperatures."""
    specs = [job.spec.measurements[name] for name in slices]
    alike = len({frozenset(spec.active or ()) for spec in specs}) == 1
    if not alike or any(spec.remove == "line" for spec in specs):
        return
    for axis in _unique((m.axis,) for m in members if m.fit.lengths):
        sensed = _used([m for m in members if m.axis == axis], "temperature")
        linear = job.spec.axes[axis].unit == "mm" and axis in columns["position"]
        if sensed or not linear:
            continue
        place, error = columns["position"][axis], columns["error"][axis]
        parts = {name: (place[at], error[at]) for name, at in slices.items()}
        if words := longer_than(parts):
            yield Remark.warning(f"{words}. What is written holds a mean of them.")


def _warm(
    job: "Job", members: Sequence["AbstractPlan"], every: Mapping[str, Rows]
) -> Iterator[Remark]:
    """Yield that lengths were read away from the reference temperature, and hold what that does."""

    def heated(names: Iterable[str]) -> bool:
        return any("temperature" in kind(name).follows for name in names)

    for axis in _unique((m.axis,) for m in members if m.takes_line):
        laws = [fit.compensation for fit in job.spec.fits if fit.axis == axis]
        if heated(laws) or job.spec.axes[axis].unit != "mm":
            continue
        for name, rows in every.items():
            spec = rows.spec
            if spec.at_reference or spec.remove == "line" or heated(spec.active):
                continue
            values = rows.measured.values.with_gaps()
            warm = {k: np.asarray(values[f"{SENSOR}{k}"], float) for k in rows.sensors}
            degrees = spec.reference_temperature
            if away := away_from(degrees, warm):
                nearest = min(away.values(), key=lambda each: abs(each - degrees))
                shown = ", ".join(f"{at:.3g} °C ({k})" for k, at in away.items())
                yield Remark.warning(
                    f"Measurement {name!r} was read at {shown}, and its lengths are not brought to"
                    f" {degrees:g} °C: what is written holds what {axis} has grown by,"
                    f" {_STEEL * (nearest - degrees):+.3g} µm/m if it is of steel and at"
                    f" {nearest:.3g} °C. State expansion, and as material_temperature the sensor"
                    " or the °C of the axis itself, or already_compensated = true where the"
                    " instrument did that."
                )


def _own_zero(
    job: "Job", sources: Sequence[str], parts: Sequence[JointData]
) -> Bool[np.ndarray, " t"] | None:
    """Return whether the zero of each reading is the machine's; None where all are alike.

    Those of an axis, that is: of another axis the instrument is another one. Where the slope is
    the instrument's in some measurements only, what the others leave of it would be taken for
    the machine's: that is refused.
    """
    removed = {name: job.spec.measurements[name].remove for name in sources}
    mixed = False
    for axis in _unique([*part.error] for part in parts):
        kinds = {
            name: removed[name]
            for name, part in zip(sources, parts, strict=True)
            if axis in part.error and np.isfinite(part.error[axis]).any()
        }
        lines = [name for name, kind in kinds.items() if kind == "line"]
        if lines and len(lines) < len(kinds):
            others = ", ".join(name for name in kinds if name not in lines)
            reason = (
                f'found "line" beside {others}, whose slope is the machine\'s, expected one'
                f" of both for measurements of {axis} that are fitted together: leave"
                f' {", ".join(lines)} out, or state "line" in all, and the list has no slope'
            )
            raise job.error(("measurements", lines[0], "remove"), reason)
        mixed |= len({*kinds.values()}) > 1
    if not mixed:
        return None
    own = [removed[name] == "none" for name in sources]
    return np.repeat(own, [len(part) for part in parts])


def _unique(names: Iterable[Sequence[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(itertools.chain.from_iterable(names)))


def _used(members: Sequence["AbstractPlan"], channel: str) -> tuple[str, ...]:
    return _unique(member.inputs.get(channel, ()) for member in members)


def _columns(
    rows: Rows, members: Sequence["AbstractPlan"], axes: Sequence[str], alone: bool
) -> JointData:
    """Return every column of a measurement that the effects of a group need."""
    fits = [member.fit for member in members]
    why = f"for the {fits[0].compensation} fit of {fits[0].axis}"
    if fits[0].group is not None:
        why = f"for group {fits[0].group!r}"
    roles = {*rows.measured.values}
    measured = [a for a in axes if roles & {f"{a}.error", f"{a}.actual"}]
    if not measured:
        derive_error(rows.measured, axes[0])  # says what is missing
    kinds = ("position", "encoder") if rows.moving else ("position",)
    placed, driven = _used(members, "position"), _used(members, "acceleration")
    hint = why + "".join(dict.fromkeys(member.without_position for member in members))
    # A crosstalk has its own rule from which positions the controller computes it.
    order = POSITION_ORDER[rows.job.conventions.crosstalk_input]
    adapted = _used([m for m in members if "acceleration" in m.inputs], "position")
    position = {
        axis: rows.position(axis, hint, order if axis in adapted else kinds)
        for axis in placed
    }
    direction, error = _directions(rows, members, alone), {}
    for axis in measured:
        lengths = any(fit.lengths for fit in fits if fit.axis == axis)
        # What the drive gives way while another axis accelerates is no crosstalk.
        pushed = _used([m for m in members if m.axis == axis], "acceleration")
        against = ("encoder", "position") if pushed else ("position",)
        error[axis] = rows.error(axis, position, lengths=lengths, against=against)
        change = rows.change.get(axis)
        rows.remarks += reference_words(rows.name, rows.spec, axis, lengths, change)
    sensors = _used(members, "temperature")
    if sensors:
        rows.refuse_restart()
    shown = [axis for axis in rows.moving if f"{axis}.velocity" in rows.measured.values]
    warm = {
        sensor: _without_glitches(rows.temperature(sensor, why)) for sensor in sensors
    }
    return JointData(
        position=position,
        error=error,
        direction=direction,
        velocity={axis: rows.motion(axis, "velocity") for axis in (*driven, *shown)},
        acceleration={axis: rows.motion(axis, "acceleration") for axis in driven},
        temperature=warm,
        time=rows.time,
        run=rows.run,
    )


def _without_glitches(warm: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
    """Return temperatures in °C, NaN where one is none: impossible, or a lone jump."""
    from scipy.ndimage import median_filter  # takes long to load

    broken = (warm < _COLDEST) | (warm > _HOTTEST)
    # A sensor that is hardly ever whole is not there, which is said of all that it shows.
    broken = warm < _ABSOLUTE_ZERO if broken.mean() > _NOT_THERE else broken
    warm = np.where(broken, np.nan, warm)
    rows = np.flatnonzero(np.isfinite(warm))
    if len(rows) >= _WINDOW:
        away = np.abs(warm[rows] - median_filter(warm[rows], _WINDOW, mode="nearest"))
        typical = 1.4826 * float(np.median(away))
        glitch = away > max(_GLITCH * typical, _LEAST_GLITCH)
        # So many that recur: not they are at fault.
        if glitch.mean() < _MOST_GLITCHES:
            warm[rows[glitch]] = np.nan
    return warm


def _directions(
    rows: Rows, members: Sequence["AbstractPlan"], alone: bool
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return the directions of motion by axis."""
    turning, fit = _used(members, "direction"), members[0].fit
    if not alone:
        return {axis: _direction(rows, axis, fit) for axis in turning}
    names = turning or ((fit.axis,) if fit.lengths else ())
    signs = {axis: rows.direction(axis, needed=bool(turning)) for axis in names}
    return {axis: way.astype(float) for axis, way in signs.items() if way is not None}


def _direction(rows: Rows, axis: str, fit: FitSpec) -> Float[np.ndarray, " t"]:
    """Return ±1, or NaN where this measurement does not tell it.

    In motion neither does what follows a reversal, as long as the play is taken up.
    """
    try:
        direction = rows.way(axis, needed=True)
    except DirectionUnknown:
        if len(fit.sources) == 1:
            raise
        return np.full(len(rows), np.nan)
    assert direction is not None  # else it has raised
    if axis not in rows.moving:
        return direction
    place = rows.position(axis)
    turned = np.maximum.accumulate(
        np.where(np.diff(direction, prepend=0.0), np.arange(len(direction)), 0)
    )
    play = min(_TAKEN_UP * float(np.ptp(place[np.isfinite(place)])), _LONGEST)
    return np.where(np.abs(place - place[turned]) < play, np.nan, direction)


def followed(time: Float[np.ndarray, " t"], slices: Mapping[str, slice]) -> bool:
    """Return whether the clocks of all measurements follow each other, as one clock would."""
    parts = [time[rows] for rows in slices.values()]
    return all(np.nanmax(a) < np.nanmin(b) for a, b in itertools.pairwise(parts))


def folds(
    label: Int[np.ndarray, " t"] | None, order: Float[np.ndarray, " t"]
) -> tuple[Int[np.ndarray, " t"], bool]:
    """Return the turn of each reading, and whether runs are held out as a whole."""
    if label is not None:
        runs, index = np.unique(label, return_inverse=True)
        if len(runs) > 2:
            return np.asarray(index.reshape(-1) % min(len(runs), _MOST_RUNS)), True
    return _turns(order), False


def _turns(order: Float[np.ndarray, " t"]) -> Int[np.ndarray, " t"]:
    """Return the turn of each reading, stretch by stretch.

    The turns of one round begin two after those of the last: else two, four or eight passes there
    and back have all readings of a place in one turn, and the end of the travel is extrapolated.
    """
    rank = np.empty(len(order), dtype=np.int64)
    rank[np.argsort(order, kind="stable")] = np.arange(len(order))
    stretch = rank * _BLOCKS // max(len(order), 1)
    return np.asarray((stretch + 2 * (stretch // _FOLDS)) % _FOLDS)


def _held_out_together(
    run: Int[np.ndarray, " t"] | None, parts: Sequence[JointData]
) -> Int[np.ndarray, " t"] | None:
    """Return a label of readings that are held out together: those of a run.

    A measurement without runs beside others with some may be all that tells an effect:
    stretches of it.
    """
    if run is None or all(part.run is None for part in parts):
        return None
    label, first = run.copy(), 0
    for part in parts:
        if part.run is None:
            rows = np.arange(len(part), dtype=float)
            label[first : first + len(part)] = label.max() + 1 + _turns(rows)
        first += len(part)
    return label
