"""One measurement of a job, a column at a time: the only place where readings are made."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ...data.measurements import (
    DirectionUnknown,
    Measurement,
    MeasurementError,
    MissingRole,
    derive_error,
    derive_motion,
    explain_direction,
    is_log,
    on_even_clock,
    recorded_motion,
    reduce_length,
    restart_of,
    with_error,
    without_motion,
)
from ...data.signals import Motion
from ._zero import without_zero

if TYPE_CHECKING:
    from ..exchange import Motion as Commanded
    from ..job.file._load import Job
    from ..job.file._schema import MeasurementSpec

SENSOR = "temperature."
"""How the role of a temperature begins; the name of its sensor follows."""
PLACES = ("position", "encoder", "actual")
"""Kinds of role that tell where an axis is."""
POSITION_ORDER = {"command": PLACES, "actual": ("encoder", "actual", "position")}
"""The same, the best first, by the rule `crosstalk_input`."""

SHOP = (-20.0, 50.0)
"""°C between which machines are measured; in °F and K such rooms show more."""
IN_SHOP = (
    f"expected {SHOP[0]:g} to {SHOP[1]:g} °C: is it in °F (77 °F is 25 °C) or K? A column of"
    ' them has unit = "degF" or "K"'
)
"""What is expected of the temperature of an axis, and what to look at."""
_COOL = 1.0
"""K off the reference temperature that nobody minds."""
_SPARSE, _MISSED = 0.5, 3.0
"""Share of the rows below which a logger of temperatures is slower than the rows; how many of its
readings in a row may be missed."""
_CHANGES, _HELD, _LATE, _REGULAR = 10, 4.0, 0.1, 0.9
"""Changes of a temperature that tell the cycle of its logger, and rows of a cycle at least; share
of a cycle by which one may come late, and of all that come on time."""
_ABSURD = 1e9
"""mm or °: a thousand kilometres, or some million turns."""
_LEFT = 1e-3
"""Share of its travel that an axis has gone when it has surely moved."""
_SHARP, _NOISY, _NOISE = (0.25, 0.1), 0.01, 0.08
"""Cutoffs of a derived motion in sample rates, the sharpest first, of which that is taken with
which noise is a small part of the largest acceleration; and the part at which it looks like one."""


def sensor_name(text: str) -> str:
    """Return the name of a sensor, given with or without ``temperature.``."""
    return text.removeprefix(SENSOR)


def has_error(measured: Measurement, axis: str) -> bool:
    """Return whether the error of an axis was recorded, or what it is derived from."""
    roles = measured.values
    if f"{axis}.error" in roles:
        return True
    others = (f"{axis}.position", f"{axis}.encoder")
    return f"{axis}.actual" in roles and any(role in roles for role in others)


class Rows:
    """The rows of one measurement; each method makes one column of them.

    Motion and the delay of an instrument, modulo axes, values that no machine has, the
    reference temperature and the zero of an instrument are dealt with here, for fits,
    groups, logs in pieces, `discover` and `doctor` alike.

    Attributes:
        job: The job.
        name: Of the measurement.
        spec: What the job says of it.
        measured: Its roles; the errors that were asked for are those of a standstill.
        moving: Axes whose error was recorded in motion.
        gaps: Whether rows stay in which a value was missed, as NaN.
        remarks: What was taken for granted so far, one sentence each.
        change: Largest change of an error by the reference temperature, by axis.
    """

    def __init__(
        self,
        job: "Job",
        name: str,
        measured: Measurement,
        axes: Iterable[str] = (),
        *,
        gaps: bool = False,
    ) -> None:
        """Take a measurement.

        Args:
            job: The job.
            name: Of the measurement.
            measured: As its file says it.
            axes: Whose errors are asked for.
            gaps: Keep rows in which a value was missed, or that no machine has, as NaN.
                Else rows without an error are left out and other such values refused.

        Raises:
            MeasurementError: If an axis moves all the time and its error cannot be told
                from what it lags behind.
        """
        self.job, self.name, self.gaps = job, name, gaps
        self.spec = job.spec.measurements[name]
        names = tuple(axes)
        table = without_motion(measured, names)
        derived = [axis for axis in names if f"{axis}.error" not in measured.values]
        self.moving = frozenset(
            axis for axis in derived if f"{axis}.error" in table.values
        )
        if gaps:
            table = table.with_gaps()
        else:
            for axis in names:
                table = with_error(table, axis)
        self.measured = table
        self.remarks = list(table.remarks)
        self.change: dict[str, float] = {}
        self._motions: dict[tuple[str, tuple[str, ...]], Motion] = {}

    def __len__(self) -> int:
        return self.measured.rows

    @property
    def time(self) -> Float[np.ndarray, " t"] | None:
        """Instants in s, or None."""
        return self._numbers("time")

    def refuse_restart(self) -> None:
        """Raise where the clock begins anew: what follows a temperature late would be mixed.

        Raises:
            MeasurementError: With what to give.
        """
        if self.time is None or (row := restart_of(self.time, self.run)) is None:
            return
        reason = (
            f"the time goes back in line {self.measured.lines[row]}: two recordings, or a clock"
            " that was set back, expected one clock for what follows a temperature: correct the"
            " times, or give each recording as a measurement of its own (its lines by header, rows)"
        )
        raise MeasurementError(str(self.measured.source), reason)

    @property
    def run(self) -> Int[np.ndarray, " t"] | None:
        """Numbers of the runs, or None."""
        run = self.measured.get("run")
        return None if run is None else np.asarray(run).astype(np.int64)

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the temperatures."""
        roles = [role for role in self.measured.values if role.startswith(SENSOR)]
        return tuple(map(sensor_name, roles))

    def temperature(self, sensor: str, why: str = "") -> Float[np.ndarray, " t"]:
        """Return a temperature in °C; on a straight line between the readings of a slow logger.

        Raises:
            MissingRole: If it was not recorded; ``why`` ends the sentence.
        """
        warm, time = self._required(SENSOR + sensor_name(sensor), why), self.time
        known = np.isfinite(warm)
        if time is not None:
            known[known] &= fresh_readings(time[known], warm[known])
        if time is None or not 2 < np.sum(known) < _SPARSE * len(warm):
            return warm
        gaps = np.diff(time[known])
        if (gaps <= 0.0).any():
            return warm
        usual = float(np.median(gaps))
        after = np.clip(np.searchsorted(time[known], time), 1, len(gaps))
        near = (gaps[after - 1] <= _MISSED * usual) & np.isfinite(time)
        between = np.interp(time, time[known], warm[known], np.nan, np.nan)
        words = (
            f"The temperature of {sensor_name(sensor)} was read every {usual:.3g} s: between its"
            " readings it is taken on a straight line."
        )
        if words not in self.remarks:
            self.remarks.append(words)
        return np.where(known | ~near, warm, between)

    def current(self, axis: str) -> Float[np.ndarray, " t"] | None:
        """Return the current of a drive in its unit, or None."""
        return self._numbers(f"{axis}.current")

    def position(
        self, axis: str, why: str = "", kinds: Iterable[str] = ("position",)
    ) -> Float[np.ndarray, " t"]:
        """Return the position of an axis in mm or °, within its modulo range.

        Args:
            axis: Name of the axis.
            why: End of the sentence "expected 'X.position' …".
            kinds: Of the role, the best first.

        Raises:
            MissingRole: If none was recorded.
            MeasurementError: If a value is one that no machine has.
        """
        recorded = [kind for kind in kinds if f"{axis}.{kind}" in self.measured.values]
        role = f"{axis}.{recorded[0] if recorded else 'position'}"
        place = self._sane(role, self._required(role, why))
        return self.job.spec.axes[axis].in_turn(place)

    def positions(
        self, kinds: Iterable[str] = ("position",)
    ) -> dict[str, Float[np.ndarray, " t"]]:
        """Return the positions of all axes that have one, by name."""
        return {
            axis: self.position(axis, kinds=kinds)
            for axis in self.job.spec.axes
            if any(f"{axis}.{kind}" in self.measured.values for kind in kinds)
        }

    def standing(self, axis: str | None) -> "Commanded":
        """Return the rows as the controller takes them, each a position of its own.

        Args:
            axis: Whose direction of motion counts; None: that of none.
        """
        direction = None if axis is None else self.direction(axis)
        return self.job.standing(
            positions=self.positions(),
            directions={} if axis is None or direction is None else {axis: direction},
            temperatures={sensor: self.temperature(sensor) for sensor in self.sensors},
        )

    def error(
        self,
        axis: str,
        position: Mapping[str, Float[np.ndarray, " t"]],
        *,
        lengths: bool = True,
        against: tuple[str, ...] = ("position",),
    ) -> Float[np.ndarray, " t"]:
        """Return the error of an axis at the reference temperature, the zero taken off.

        Args:
            axis: Name of the axis.
            position: Of the axes over which a line may be taken off, by name.
            lengths: The error is one of length along the axis.
            against: Kinds of role that tell where it says it is, the best first.

        Raises:
            MissingRole: If there is none.
            MeasurementError: If a value is one that no machine has.
        """
        error = self.at_reference(axis, position, lengths=lengths, against=against)
        return without_zero(error, [*position.values()], self.spec.remove)

    def at_reference(
        self,
        axis: str,
        position: Mapping[str, Float[np.ndarray, " t"]],
        *,
        lengths: bool = True,
        against: tuple[str, ...] = ("position",),
    ) -> Float[np.ndarray, " t"]:
        """Return `error` before the zero is taken off."""
        error = np.array(derive_error(self.measured, axis, against), dtype=float)
        error = self._sane(f"{axis}.error", error)
        spec, warmth = self.spec, self.spec.material_temperature
        if not lengths or axis not in position:
            return error
        if spec.expansion is None or spec.already_compensated or warmth is None:
            return error
        at = spec.datum.at if spec.datum is not None else 0.0
        reduced = reduce_length(
            error,
            position[axis],
            expansion=spec.expansion,
            material_temperature=(
                self._of_material(warmth) if isinstance(warmth, str) else float(warmth)
            ),
            reference_temperature=spec.reference_temperature,
            datum=float(at if isinstance(at, float | int) else at[0]),
        )
        change = np.abs(reduced - error)
        self.change[axis] = float(np.max(change, initial=0.0, where=~np.isnan(change)))
        return reduced

    def direction(
        self, axis: str, *, needed: bool = False
    ) -> Int[np.ndarray, " t"] | None:
        """Return the direction of motion, ±1; None where it cannot be told.

        Args:
            axis: Name of the axis.
            needed: Raise instead, and say what was taken for granted.

        Raises:
            DirectionUnknown: If it cannot be told and is needed.
            MissingRole: If there is neither direction nor position, and it is needed.
        """
        try:
            directions = explain_direction(self.measured, axis)
        except (DirectionUnknown, MissingRole):
            if needed:
                raise
            return None
        if needed:
            self.remarks += directions.remarks
        return directions.values

    def way(self, axis: str, *, needed: bool = False) -> Float[np.ndarray, " t"] | None:
        """Return `direction`, NaN until an axis of a log has left where it stood.

        Whence it came before that nobody recorded.
        """
        directions = self.direction(axis, needed=needed)
        if directions is None:
            return None
        signs = directions.astype(float)
        if is_log(self.measured, axis):
            place = self.position(axis, kinds=PLACES)
            finite = np.flatnonzero(np.isfinite(place))
            distance = np.abs(place[finite] - place[finite[:1]])
            outside = finite[distance > _LEFT * distance.max(initial=0.0)]
            signs[: outside[0] if outside.size else len(signs)] = np.nan
        return signs

    def motion(
        self, axis: str, what: str, kinds: tuple[str, ...] | None = None
    ) -> Float[np.ndarray, " t"]:
        """Return velocity or acceleration, per s or s², as recorded or else derived.

        Args:
            axis: Name of the axis.
            what: ``velocity`` or ``acceleration``.
            kinds: Positions from which to derive it, the best first; left out: by the
                conventions of the controller.

        Raises:
            MeasurementError: If it was not recorded and cannot be derived, or contradicts
                the positions.
        """
        kinds = kinds or POSITION_ORDER[self.job.conventions.crosstalk_input]
        stated = recorded_motion(self.measured, axis, what, kinds)
        if stated is not None:
            return np.asarray(stated, dtype=float)
        if (axis, kinds) not in self._motions:
            # The filter of a log of few samples is slower than an acceleration of a machine:
            # as sharp a one as the noise of the positions allows.
            log = on_even_clock(self.measured, axis)
            derived = derive_motion(log, axis, order=kinds, cutoff=np.inf)
            for share in _SHARP:
                if max(derived.noise_of_peak) <= _NOISY:
                    break
                derived = derive_motion(log, axis, order=kinds, share=share)
            self._motions[axis, kinds] = derived
            self.remarks += log.remarks[len(self.measured.remarks) :]
        motion = self._motions[axis, kinds]
        moving = motion.noise_of_peak[1]
        if what == "acceleration" and moving > _NOISE:
            noises = 1e3 * motion.position_noise, 1e3 * motion.noise_in_motion
            unit = self.job.spec.axes[axis].small_unit
            reason = (
                f"found positions of {axis} that scatter by {noises[0]:.2g} {unit}, and by"
                f" {noises[1]:.3g} {unit} where it is fast: {100 * moving:.0f} % of the largest"
                f" acceleration that they tell is noise, expected at most {100 * _NOISE:.0f} %;"
                f" record '{axis}.acceleration', or the time at which each sample was taken"
            )
            raise MeasurementError(str(self.measured.source), reason)
        self.remarks.append(
            f"The {what} of {axis} was not recorded: it is derived from the position, up"
            f" to {motion.bandwidth:.3g} Hz."
        )
        return np.asarray(getattr(motion, what), dtype=float)

    def _numbers(self, role: str) -> Float[np.ndarray, " t"] | None:
        values = self.measured.get(role)
        return None if values is None else np.asarray(values, dtype=float)

    def _required(self, role: str, why: str) -> Float[np.ndarray, " t"]:
        return np.asarray(self.measured.require(role, why), dtype=float)

    def _of_material(self, sensor: str) -> Float[np.ndarray, " t"]:
        """Return the temperature of the axis in °C; lone readings beyond `SHOP` are wild ones.

        Raises:
            JobError: If most of them are: the unit, or a sensor that is not there.
        """
        warm = self.temperature(sensor, "as material_temperature")
        finite = warm[np.isfinite(warm)]
        middle = float(np.median(finite)) if finite.size else SHOP[0]
        if not SHOP[0] <= middle <= SHOP[1]:
            key = ("measurements", self.name, "material_temperature")
            role = SENSOR + sensor_name(sensor)
            raise self.job.error(
                key, f"found {middle:.4g} °C of {role} (its median), {IN_SHOP}"
            )
        return warm

    def _sane(
        self, role: str, values: Float[np.ndarray, " t"]
    ) -> Float[np.ndarray, " t"]:
        """Return values without those that no machine has: markers for "no reading".

        The square of such a one may be beyond floating point, so that no robust loss could
        set it aside.
        """
        wrong = np.flatnonzero(np.abs(values) > _ABSURD)
        if wrong.size and not self.gaps:
            at = int(wrong[0])
            reason = (
                f"line {self.measured.lines[at]}: found {values[at]:g} mm or ° for {role},"
                f" expected less than {_ABSURD:g}"
            )
            raise MeasurementError(str(self.measured.source), reason)
        if wrong.size:
            values = np.where(np.abs(values) > _ABSURD, np.nan, values)
            self.remarks.append(
                f"{wrong.size} of {len(values)} values of {role} lie beyond {_ABSURD:g} mm"
                " or °: these readings are left out."
            )
        return values


def fresh_readings(
    time: Float[np.ndarray, " t"], warm: Float[np.ndarray, " t"]
) -> Bool[np.ndarray, " t"]:
    """Return which rows hold a reading of a logger that repeats the last one until the next.

    Such values change after a whole number of its cycles, to a row; those of a coarse display do
    so whenever the temperature passes a digit. One value for each run of several, with breaks
    between them, is what somebody wrote down: it holds for the run.
    """
    changes = 1 + np.flatnonzero(np.diff(warm))
    all_of_them = np.ones(len(warm), dtype=bool)
    if len(changes) < _CHANGES:
        return all_of_them
    gaps = np.diff(changes)
    # The shortest steps are one cycle; then the mean of all by their number of cycles.
    cycle = float(np.percentile(gaps, 10.0))
    for _ in range(2):
        cycle = gaps.sum() / max(np.rint(gaps / cycle).sum(), 1.0)
    count = np.rint(gaps / cycle).astype(np.int64)
    near = np.abs(gaps - count * cycle) <= max(1.0, _LATE * cycle)
    if cycle < _HELD or near.mean() < _REGULAR or count.mean() > _MISSED:
        return all_of_them
    # Readings that changed nothing lie evenly between those that did.
    between = [
        first + np.rint(np.arange(1, times) * gap / times)
        for first, gap, times in zip(changes, gaps, count, strict=False)
    ]
    behind = np.arange(changes[-1] + cycle, len(warm), cycle)
    rows = np.concatenate([[0], changes, *between, np.rint(behind)]).astype(np.int64)
    found = np.zeros(len(warm), dtype=bool)
    found[np.minimum(rows, len(warm) - 1)] = True
    usual = float(np.median(np.diff(time[found])))
    return found if np.diff(time).max() < 0.5 * usual else all_of_them


def away_from(
    degrees: float, warm: Mapping[str, Float[np.ndarray, " t"]]
) -> dict[str, float]:
    """Return the median of each sensor in °C where lengths were read off a reference; else none.

    One sensor that is near it is enough: nobody knows which of them is at the axis.
    """
    known = {k: values[np.isfinite(values)] for k, values in warm.items()}
    usual = {k: float(np.median(values)) for k, values in known.items() if values.size}
    seen = {k: at for k, at in usual.items() if SHOP[0] <= at <= SHOP[1]}
    near = any(abs(at - degrees) <= _COOL for at in seen.values())
    return {} if near else seen


def reference_words(
    name: str, spec: "MeasurementSpec", axis: str, lengths: bool, change: float | None
) -> tuple[str, ...]:
    """Say what was done about the temperature; nothing where no expansion is stated.

    Args:
        name: Of the measurement.
        spec: What the job says of it.
        axis: Whose error it is.
        lengths: The error is one of length along the axis.
        change: `Rows.change` of it, or None.
    """
    degrees = f"{spec.reference_temperature:g} °C"
    if spec.expansion is None:
        return ()
    if not lengths:
        return (
            f"expansion of measurement {name!r} concerns lengths along an axis; the error"
            f" of {axis} over other axes is taken as it is.",
        )
    if change is None:
        return (f"Measurement {name!r} refers to {degrees} as it is.",)
    return (
        f"Measurement {name!r} was reduced to {degrees}; that changed readings by up to"
        f" {1e3 * change:.1f} µm.",
    )
