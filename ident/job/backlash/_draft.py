"""The backlash of one axis: fitted, judged, written into the axis list, read back."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile, Value
from ...exchange import ExchangeError, backlash_from_list, entries_of_backlash
from ...fit import FitError
from ...kinds.backlash.effect import BacklashFit
from ...proof import (
    GateCheck,
    choose_cycles,
    error_figures,
    gate_check,
    reversal_dynamics,
)
from ...proof.axis import check_switching
from .._draft import AbstractDraft, AxisLists, Leftovers, Planned, Switch
from .._fit_schema import BacklashSpec, FitSpec
from .._gating import limits_of
from .._lists import AxisFiles
from .._load import Job
from .._output import OutFolder
from .._second import SecondMeasurement
from .._source import Tables
from ._known import KnownBacklash, known_backlash
from ._recording import Recording, read_recording
from ._remarks import remarks_of
from ._result import BacklashResult, ReversalView


def plan_backlash(
    job: Job, tables: Tables, index: int, fit: BacklashSpec, lists: AxisLists
) -> Planned:
    """Plan a backlash fit; what it returns fits it.

    Raises:
        JobError: If existing lists do not suit.
    """
    known = known_backlash(job, index, fit, lists)

    def draft(left: Leftovers) -> AbstractDraft:
        recording = read_recording(tables, fit)
        try:
            found = recording.fit(fit.loss)
        except FitError as error:
            reason = f"backlash of {fit.axis} from {', '.join(fit.sources)}: {error}"
            raise job.untold(("fits", index), reason) from None
        return BacklashDraft(index, fit, lists, recording, found, known)

    return draft


@final
@dataclasses.dataclass(frozen=True)
class BacklashDraft(AbstractDraft):
    """A fitted backlash.

    Attributes:
        recording: What was measured.
        found: The estimate.
        known: What the axis list holds.
        left: Error per reading under lists that were fitted without it, where a joint
            fit knows that; else the width is fitted anew without each run or block.
        left_by_run: Whether these left out whole runs.
    """

    recording: Recording
    found: BacklashFit
    known: KnownBacklash
    left: Float[np.ndarray, " t"] | None = None
    left_by_run: bool = False

    @property
    def width(self) -> float:
        """What is written, in mm or °."""
        return self.found.width + self.known.acting

    @property
    def reference(self) -> int:
        """Direction in which the axis is right without it."""
        return self.known.reference

    @property
    def compensation(self) -> str:
        return "backlash"

    @property
    def written(self) -> bool:
        """Whether there is anything to write."""
        return self.found.significant

    @property
    def switch(self) -> Switch | None:
        if not self.written:
            return None
        return Switch("BACKLASH", "Works from start-up on, referenced or not")

    def entries(self, job: Job) -> dict[str, Value]:
        return {}

    def cycles(self, job: Job) -> int | None:
        if not self.written:
            return None
        limits = limits_of(job)
        cycle_time, listing = job.spec.controller.cycle_time, self.lists.machine
        stated = None if listing is None else listing.integer("lr_param.n_backlash_cyc")
        return choose_cycles(
            abs(self.width),
            cycle_time,
            min(limits.max_velocity, limits.max_switching / cycle_time),
            limits.max_acceleration,
            stated,
        )

    def jump(self, job: Job) -> float:
        return abs(self.width) if self.written else 0.0

    def machine_entries(self, job: Job, cycles: int | None) -> dict[str, Value]:
        if not self.written:
            return {}
        model = dataclasses.replace(self.found, width=self.width).compensation(
            self.reference, cycles or 0
        )
        try:
            return dict(entries_of_backlash(model, job.conventions))
        except ExchangeError as error:
            raise job.error(("fits", self.index), str(error)) from None

    def gate(self, job: Job, cycles: int | None) -> tuple[GateCheck, ...]:
        if not self.written:
            return ()
        limits = limits_of(job)
        jump = abs(self.width)
        spread = cycles or 0
        where = f"spread over {spread} cycles"
        fast, hard = reversal_dynamics(jump, spread, job.spec.controller.cycle_time)
        unit = "mm" if job.spec.axes[self.axis].kind == "linear" else "°"
        lines = [
            gate_check(
                "max_reversal", jump, limits.max_reversal, unit, "at every reversal"
            ),
            gate_check(
                "max_velocity at reversal",
                fast,
                limits.max_velocity,
                f"{unit}/s",
                where,
            ),
            gate_check(
                "max_acceleration at reversal",
                hard,
                limits.max_acceleration,
                f"{unit}/s²",
                where,
            ),
            check_switching(
                jump,
                spread,
                limits,
                unit,
                "lr_param.n_backlash_cyc",
                "start-up or COMP ON/OFF",
            ),
        ]
        old = self.known.old
        if limits.max_change is not None and old is not None:
            change = abs(self.width - float(old.width))
            words = "against the axis list"
            lines.append(
                gate_check("max_change", change, limits.max_change, unit, words)
            )
        return tuple(lines)

    def left_over(self, tables: Tables, fit: FitSpec) -> SecondMeasurement | None:
        assert isinstance(fit, BacklashSpec)
        recording = read_recording(tables, fit)
        found = recording.fit(fit.loss)
        again = dataclasses.replace(self, recording=recording, found=found)
        way, where, before, _, _ = again._readings()
        return SecondMeasurement(
            ", ".join(fit.sources),
            where[:, None],
            before,
            way.astype(np.int64),
            wild=again._wild,
            added=0.5 * abs(self.width - self.known.acting),
        )

    def left_by(self) -> Mapping[tuple[str, str], np.ndarray]:
        way = self.recording.direction
        if not self.written or way is None:
            return {}
        own = self.known.acting
        change = dataclasses.replace(self.found, width=self.width - own)
        offset = change.compensation(self.reference).offset(way.astype(float))
        added = np.asarray(offset, dtype=float)
        return {
            (self.axis, name): added[rows]
            for name, rows in self.recording.slices.items()
        }

    def prove(
        self,
        job: Job,
        folder: OutFolder,
        gate: tuple[GateCheck, ...],
        files: AxisFiles,
        written: tuple[Path, ...],
        cycles: int | None,
    ) -> BacklashResult:
        way, where, before, group, by_run = self._readings()
        own = self.known.acting
        predicted = self.left
        if predicted is None:
            predicted = before + 0.5 * way * self._held_out(group, by_run)
        else:
            by_run = self.left_by_run
        back = self._read_back(job, folder, files, written)
        # About the mean of both directions, which the tables of the axis look after.
        from_file = before + 0.5 * way * (back - own)
        return BacklashResult(
            **self.frame(job, gate, files, ("backlash_", "direction_source")),
            error={
                "before": error_figures(before, wild=self._wild),
                "predicted": error_figures(predicted, wild=self._wild),
                "from_file": error_figures(from_file, wild=self._wild),
            },
            remarks=(
                *remarks_of(
                    self.recording,
                    self.found,
                    self.known.old is not None,
                    self.known.active,
                ),
                *files.remarks,
            ),
            files=tuple(file for file in written if file.name == files.machine_name),
            held_out="run" if by_run else "block",
            width=self.width if self.written else 0.0,
            reference=self.reference,
            cycles=cycles or 0,
            fit=self.found,
            view=ReversalView(
                position=where,
                direction=way.astype(np.int64),
                before=before,
                predicted=predicted,
                from_file=from_file,
            ),
            moving=self.recording.moving,
        )

    @property
    def _wild(self) -> np.ndarray:
        wild = self.found.wild
        return np.repeat(wild, 2) if self.recording.moving else wild

    def _readings(
        self,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, bool]:
        """Return direction, place and reversal error of each reading, and its group."""
        one = self.recording
        if one.direction is not None:
            way = one.direction.astype(float)
            residual = np.nan_to_num(self.found.residual)
            before = residual - 0.5 * way * self.found.width
            groups, by_run = one.groups()
            return way, one.position, before, groups, by_run
        # Each reversal gives one width: half of it to either side.
        turns = self.found.reversals
        width = np.repeat([turn.width for turn in turns], 2)
        way = np.tile([1.0, -1.0], len(turns))
        place = np.repeat([turn.position for turn in turns], 2)
        group = np.repeat(np.arange(len(turns)), 2)
        return way, place, -0.5 * way * width, group, False

    def _held_out(self, group: np.ndarray, by_run: bool) -> np.ndarray:
        """Return the width that the other groups give, per reading."""
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
                found[group == each] = self.recording.fit(
                    self.fit.loss, group != each
                ).width
            except FitError:
                # What is left tells nothing: neither does the prediction.
                found[group == each] = 0.0
        return found

    def _read_back(
        self, job: Job, folder: OutFolder, files: AxisFiles, written: tuple[Path, ...]
    ) -> float:
        """Return the width that the written file holds."""
        name = next((f for f in written if f.name == files.machine_name), None)
        if name is None:
            return 0.0 if self.known.old is None else float(self.known.old.width)
        back = backlash_from_list(ListFile.read(folder.root / name), job.conventions)
        return 0.0 if back is None else float(back.width)
