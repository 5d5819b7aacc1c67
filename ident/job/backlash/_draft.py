"""The backlash of one axis: fitted, judged, written into the axis list, read back."""

import dataclasses
from pathlib import Path
from typing import final

import numpy as np

from ....data.lists import ListFile, Value
from ....models import Backlash
from ...exchange import ExchangeError, backlash_from_list, entries_of_backlash
from ...fit import FitError
from ...fit.backlash import BacklashFit
from ...proof import GateCheck, choose_cycles, error_figures, reversal_dynamics
from .._conventions import convention_states
from .._draft import AbstractDraft, AxisLists, Leftovers, Planned, Switch
from .._fit_schema import BacklashSpec
from .._gating import limits_of
from .._lists import AxisFiles
from .._load import Job
from .._output import OutFolder
from .._source import Tables
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
    where = ("fits", index)
    states = {"backlash" in job.spec.measurements[name].active for name in fit.sources}
    if len(states) > 1:
        raise job.error(
            where,
            "found measurements with backlash on and off (active), expected one state"
            " for all that are joined",
        )
    active = states == {True}
    old: Backlash | None = None
    if lists.machine is not None:
        try:
            old = backlash_from_list(lists.machine, job.conventions)
        except ExchangeError as error:
            raise job.error(where, str(error)) from None
    if active and old is None:
        raise job.error(
            ("axes", fit.axis, "machine_data"),
            "backlash was active while measuring, but no axis list that switches it on"
            " is given, expected machine_data = the file that was loaded",
        )

    def draft(left: Leftovers) -> AbstractDraft:
        recording = read_recording(tables, fit)
        try:
            found = recording.fit(fit.loss)
        except FitError as error:
            reason = f"backlash of {fit.axis} from {', '.join(fit.sources)}: {error}"
            raise job.error(where, reason) from None
        width = found.width
        if active and old is not None:
            width += float(old.width)
        reference = 1 if old is None else old.reference
        return BacklashDraft(
            index, fit, lists, recording, found, old, active, width, reference
        )

    return draft


@final
@dataclasses.dataclass(frozen=True)
class BacklashDraft(AbstractDraft):
    """A fitted backlash.

    Attributes:
        recording: What was measured.
        found: The estimate.
        old: What the axis list holds, or None.
        active: Whether that was active while measuring.
        width: What is written, in mm or °.
        reference: Direction in which the axis is right without it.
    """

    recording: Recording
    found: BacklashFit
    old: Backlash | None
    active: bool
    width: float
    reference: int

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
        listing = self.lists.machine
        stated = None if listing is None else listing.integer("lr_param.n_backlash_cyc")
        return choose_cycles(
            abs(self.width),
            job.spec.controller.cycle_time,
            limits.max_velocity,
            limits.max_acceleration,
            stated,
        )

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
            _check(
                "max_reversal", jump, limits.max_reversal, unit, "at every reversal"
            ),
            _check(
                "max_velocity at reversal",
                fast,
                limits.max_velocity,
                f"{unit}/s",
                where,
            ),
            _check(
                "max_acceleration at reversal",
                hard,
                limits.max_acceleration,
                f"{unit}/s²",
                where,
            ),
        ]
        if limits.max_change is not None and self.old is not None:
            change = abs(self.width - float(self.old.width))
            words = "against the axis list"
            lines.append(_check("max_change", change, limits.max_change, unit, words))
        return tuple(lines)

    def refuse_misread(self, job: Job, listing: ListFile) -> None:
        """Nothing of it stands in the compensation list."""

    def left_by(self) -> Leftovers:
        way = self.recording.direction
        if not self.written or way is None:
            return {}
        own = 0.0 if not self.active or self.old is None else float(self.old.width)
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
        own = 0.0 if not self.active or self.old is None else float(self.old.width)
        predicted = before + 0.5 * way * self._held_out(group, by_run)
        back = self._read_back(job, folder, files, written)
        # About the mean of both directions, which the tables of the axis look after.
        from_file = before + 0.5 * way * (back - own)
        linear = job.spec.axes[self.axis].kind == "linear"
        return BacklashResult(
            compensation="backlash",
            axis=self.axis,
            axis_number=job.spec.axes[self.axis].number,
            unit="mm" if linear else "deg",
            error={
                "before": error_figures(before, wild=self._wild),
                "predicted": error_figures(predicted, wild=self._wild),
                "from_file": error_figures(from_file, wild=self._wild),
            },
            gate=gate,
            remarks=(
                *remarks_of(
                    self.recording, self.found, self.old is not None, self.active
                ),
                *files.remarks,
            ),
            conventions=convention_states(job, ("backlash_", "direction_source")),
            files=tuple(file for file in written if file.name == files.machine_name),
            findings=tuple(dataclasses.asdict(item) for item in files.findings),
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
            return 0.0 if self.old is None else float(self.old.width)
        back = backlash_from_list(ListFile.read(folder.root / name), job.conventions)
        return 0.0 if back is None else float(back.width)


def _check(name: str, value: float, limit: float, unit: str, where: str) -> GateCheck:
    passed = bool(value <= limit * (1 + 1e-9))
    return GateCheck(name, float(value), float(limit), unit, passed, where)
