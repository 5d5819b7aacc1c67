"""One measurement of a group: every role that its effects need."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ....data.measurements import (
    DirectionUnknown,
    derive_error,
    explain_direction,
    without_motion,
)
from ...kinds._keys import FitSpec
from .._remove import without_zero
from .._runs import cycles_of
from .._source import (
    ABSURD,
    Tables,
    Wanted,
    at_reference,
    measured_for,
    motion_of,
    refuse_absurd,
)

_SLOW = 1e-3
"""Share of the largest velocity up to which an axis stands."""


@dataclasses.dataclass(frozen=True)
class GroupNeeds:
    """Which columns the effects of a group use, by axis or sensor; ``heated``: by axis too."""

    error: tuple[str, ...]
    position: tuple[str, ...]
    direction: tuple[str, ...]
    motion: tuple[str, ...]
    temperature: tuple[str, ...]
    heated: tuple[str, ...]


_Columns = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class ReadPart:
    """One measurement."""

    count: int
    position: _Columns
    error: _Columns
    direction: _Columns
    velocity: _Columns
    acceleration: _Columns
    temperature: _Columns
    time: Float[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    moving: frozenset[str]


class GroupReader:
    """Reads one measurement for a group; collects remarks."""

    def __init__(
        self,
        tables: Tables,
        name: str,
        lead: FitSpec,
        fits: Sequence[FitSpec],
        needs: GroupNeeds,
    ) -> None:
        self.tables, self.name, self.fits, self.needs = tables, name, fits, needs
        masters = lead.over if len(lead.over) > 1 else needs.position or (lead.axis,)
        plain = measured_for(tables, name, lead, masters)
        self.measured = without_motion(plain, needs.error).with_gaps()
        self.moving = frozenset(
            axis
            for axis in needs.error
            if f"{axis}.error" not in plain.values
            and f"{axis}.error" in self.measured.values
        )
        self.remarks = list(self.measured.remarks)
        self.why = f"for group {lead.group!r}"

    def read(self) -> ReadPart:
        """Return the columns of the measurement."""
        measured, needs = self.measured, self.needs
        error: _Columns = {}
        for axis in needs.error:
            found = self._error(axis)
            if found is not None:
                error[axis] = found
        if not error:
            derive_error(measured, needs.error[0])  # says what is missing
        position = {axis: self._position(axis) for axis in needs.position}
        velocity = {axis: self._motion(axis, "velocity") for axis in needs.motion}
        for axis in self.moving:
            speed = measured.get(f"{axis}.velocity")
            if speed is not None:
                velocity[axis] = np.asarray(speed, dtype=float)
        direction = {axis: self._direction(axis) for axis in needs.direction}
        time, run = measured.get("time"), measured.get("run")
        if run is not None and len(direction) == 1:
            way = next(iter(direction.values()))
            if np.isin(way, (-1.0, 1.0)).all():
                run = cycles_of(run.astype(np.int64), way.astype(np.int64))
        return ReadPart(
            count=measured.rows,
            position=position,
            error={axis: self._reduced(axis, e, position) for axis, e in error.items()},
            direction=direction,
            velocity=velocity,
            acceleration={
                axis: self._motion(axis, "acceleration") for axis in needs.motion
            },
            temperature={
                sensor: np.asarray(
                    measured.require(f"temperature.{sensor}", self.why), dtype=float
                )
                for sensor in needs.temperature
            },
            time=None if time is None else np.asarray(time, dtype=float),
            run=None if run is None else run.astype(np.int64),
            moving=self.moving & set(velocity),
        )

    def _error(self, axis: str) -> np.ndarray | None:
        """Return the error of an axis, None where this measurement has none."""
        there = self.measured.values
        if f"{axis}.error" not in there and f"{axis}.actual" not in there:
            return None
        error = np.array(derive_error(self.measured, axis), dtype=float)
        error[~(np.abs(error) <= ABSURD)] = np.nan
        return error

    def _position(self, axis: str) -> np.ndarray:
        """Return positions, wrapped where the axis turns; the encoder's in motion."""
        role = f"{axis}.position"
        if role not in self.measured.values and self.moving:
            role = f"{axis}.encoder"
        place = np.array(self.measured.require(role, self.why), dtype=float)
        refuse_absurd(self.measured, role, place)
        span = self.tables.job.spec.axes[axis].modulo
        if span is not None:
            place = span[0] + np.mod(place - span[0], span[1] - span[0])
        return place

    def _reduced(self, axis: str, error: np.ndarray, position: _Columns) -> np.ndarray:
        """Return the error at the reference temperature, the instrument's zero off."""
        spec = self.tables.job.spec.measurements[self.name]
        own = [fit for fit in self.fits if fit.axis == axis]
        if spec.expansion is not None and axis in position:
            lengths = any(fit.lengths for fit in own)
            error, note = at_reference(
                self.tables.job, self.name, self.measured, own[0],
                Wanted((axis,), "no", lengths), position[axis][:, None], error,
            )  # fmt: skip
            self.remarks.append(note)
        known = np.isfinite(error)
        places = [column for column in position.values()]
        for column in places:
            known &= np.isfinite(column)
        if known.any():
            at = np.stack(places or [np.zeros(len(error))], axis=1)[known]
            error[known] = without_zero(error[known], at, spec.remove)
        return error

    def _direction(self, axis: str) -> np.ndarray:
        """Return ±1, or NaN where this measurement does not tell it."""
        measured = self.measured
        try:
            found = explain_direction(measured, axis)
        except DirectionUnknown:
            if len(self.fits[0].sources) > 1:
                return np.full(measured.rows, np.nan)
            raise
        self.remarks += found.remarks
        way = found.values.astype(float)
        speed = measured.get(f"{axis}.velocity")
        if speed is not None and self.moving:
            # Where an axis came from before its first motion nobody saw.
            moved = np.abs(speed) > _SLOW * float(np.max(np.abs(speed), initial=0.0))
            way[: int(np.argmax(moved))] = np.nan
        return way

    def _motion(self, axis: str, what: str) -> np.ndarray:
        """Return velocity or acceleration, as recorded or else derived."""
        rules = self.tables.job.conventions
        found, words = motion_of(self.measured, axis, what, rules)
        self.remarks += words
        return found
