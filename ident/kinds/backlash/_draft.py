"""The backlash of one axis, fitted: judged, written into the axis list, read back."""

import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ....data.lists import Value
from ....models import Backlash
from ...fit import FitError
from ...job._draft import AbstractDraft
from ...job._gating import spread_over
from ...job.file._load import Job
from ...job.result._result import staged
from ...job.result._second import SecondMeasurement
from ...job.table._plan import was_active
from ...proof import GateCheck, reversal_checks
from ...proof.axis import check_switching
from ...readings import Tables
from .._keys import FitSpec
from ._recording import Recording, Sides, read_recording
from ._result import BacklashResult, remarks_of
from .effect import BacklashFit
from .entries import backlash_from_list, entries_of_backlash
from .keys import Spec

if TYPE_CHECKING:
    from ...job.write._lists import AxisFiles

_SPREAD = "lr_param.n_backlash_cyc"
"""Entry that spreads a reversal over cycles (P-AXIS-00243)."""


@dataclasses.dataclass(frozen=True)
class KnownBacklash:
    """What an axis list says of the backlash.

    Attributes:
        old: Its entries, or None.
        active: Whether they acted while measuring.
    """

    old: Backlash | None
    active: bool

    @property
    def reference(self) -> int:
        """Direction in which the axis is right without it."""
        return 1 if self.old is None else self.old.reference

    @property
    def acting(self) -> float:
        """Width that acted while measuring, in mm or °."""
        return float(self.old.width) if self.active and self.old is not None else 0.0


def known_backlash(job: Job, index: int, fit: Spec) -> KnownBacklash:
    """Return what the axis list holds.

    Raises:
        JobError: If it cannot be read, or does not hold what was active.
    """
    old: Backlash | None = None
    holder, machine = None, job.lists[fit.axis].machine
    if machine is not None:
        with job.blaming(("fits", index)):
            old = backlash_from_list(machine, job.conventions)
        if old is not None and float(old.width) != 0.0:
            holder = machine.source
    active = was_active(job, index, fit, holder)
    if active and old is None:
        raise job.error(
            ("axes", fit.axis, "machine_data"),
            "backlash was active while measuring, but no axis list that switches it on"
            " is given, expected machine_data = the file that was loaded",
        )
    return KnownBacklash(old, active)


@final
@dataclasses.dataclass(frozen=True)
class BacklashDraft(AbstractDraft):
    """A fitted backlash.

    Attributes:
        recording: What was measured.
        found: The estimate.
        known: What the axis list holds.
        held_out: Error per reading under lists that were fitted without it, and whether
            these left out whole runs, where a joint fit knows that; else the width is fitted
            anew without each run or block.
    """

    fit: Spec
    recording: Recording
    found: BacklashFit
    known: KnownBacklash
    held_out: tuple[Float[np.ndarray, " t"], bool] | None = None

    @functools.cached_property
    def sides(self) -> Sides:
        """The readings about the mean of both directions."""
        return self.recording.sides(self.found)

    @property
    def width(self) -> float:
        """What is written, in mm or °."""
        return self.found.width + self.known.acting

    @property
    def reference(self) -> int:
        """Direction in which the axis is right without it."""
        return self.known.reference

    @property
    def written(self) -> bool:
        return self.found.significant

    @property
    def settled(self) -> bool:
        return self.found.converged

    @property
    def needs(self) -> str:
        return "Works from start-up on, referenced or not"

    @property
    def cycles(self) -> int | None:
        machine = self.lists.machine
        return spread_over(self.job, self.jump, machine, _SPREAD, switched=True)

    @property
    def jump(self) -> float:
        return abs(self.width)

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        model = dataclasses.replace(self.found, width=self.width).compensation(
            self.reference, cycles or 0
        )
        return dict(entries_of_backlash(model, (), self.job.conventions))

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        job, jump, spread = self.job, self.jump, cycles or 0
        limits, unit = job.limits, job.spec.axes[self.axis].unit
        lines = [
            *reversal_checks(
                jump, spread, job.spec.controller.cycle_time, limits, unit,
                ("at every reversal", f"spread over {spread} cycles"),
            ),
            check_switching(
                jump, spread, limits, unit, _SPREAD, "start-up or COMP ON/OFF"
            ),
        ]  # fmt: skip
        old = self.known.old
        if limits.max_change is not None and old is not None:
            change = abs(self.width - float(old.width))
            words = "against the axis list"
            lines.append(limits.check("max_change", change, unit, words))
        return tuple(lines)

    def left_over(self, tables: Tables, fit: FitSpec) -> SecondMeasurement | None:
        assert isinstance(fit, Spec)
        recording = read_recording(tables, fit)
        found = recording.fit(fit.loss)
        sides = recording.sides(found)
        return SecondMeasurement(
            ", ".join(fit.sources),
            sides.position[:, None],
            sides.before,
            sides.direction,
            wild=sides.wild,
            added=0.5 * abs(self.found.width),
        )

    def left_by(self) -> Mapping[tuple[str, str], np.ndarray]:
        way = self.recording.direction
        if way is None:
            return {}
        change = self.found.compensation(self.reference)
        offset = change.offset(way.astype(float))
        added = np.asarray(offset, dtype=float)
        return {
            (self.axis, name): added[rows]
            for name, rows in self.recording.slices.items()
        }

    def prove(self, done: "AxisFiles") -> BacklashResult:
        sides, half = self.sides, 0.5 * self.sides.direction
        if self.held_out is not None:
            predicted, by_run = self.held_out
        else:
            predicted, by_run = sides.before + half * self._others(), sides.by_run
        back = self._read_back(done)
        # About the mean of both directions, which the tables of the axis look after.
        from_file = sides.before + half * (back - self.known.acting)
        return BacklashResult(
            **self.frame(done),
            error=staged(sides.before, predicted, from_file, sides.wild),
            remarks=(
                *remarks_of(
                    self.recording,
                    self.found,
                    self.known.old is not None,
                    self.known.active,
                ),
                *done.remarks,
            ),
            files=tuple(n for n in done.written if n.name == done.machine_name),
            held_out="run" if by_run else "block",
            width=self.width if self.written else 0.0,
            reference=self.reference,
            cycles=done.cycles or 0,
            fit=self.found,
            view=sides,
            from_file=from_file,
            moving=self.recording.moving,
        )

    def _others(self) -> Float[np.ndarray, " t"]:
        """Return the width that the other groups give, per reading."""
        group = self.sides.group
        found = np.full(len(group), self.found.width)
        if self.recording.moving:
            widths = np.array([turn.width for turn in self.found.reversals])
            sound = ~self.found.wild
            for k in range(len(widths)):
                others = sound & (np.arange(len(widths)) != k)
                found[group == k] = widths[others].mean()
            return found
        for each in np.unique(group):
            try:
                other = self.recording.fit(self.fit.loss, group != each)
                found[group == each] = other.width
            except FitError:
                # What is left tells nothing: neither does the prediction.
                found[group == each] = 0.0
        return found

    def _read_back(self, done: "AxisFiles") -> float:
        """Return the width that the written file holds."""
        listing = done.machine
        if listing is None:
            return 0.0 if self.known.old is None else float(self.known.old.width)
        back = backlash_from_list(listing, self.job.conventions)
        return 0.0 if back is None else float(back.width)
