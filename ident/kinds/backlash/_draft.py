"""The backlash of one axis, fitted: judged, written into the axis list, read back."""

import dataclasses
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ....data.lists import Value
from ....models import Backlash
from ...fit import FitError
from ...job._draft import AbstractDraft
from ...job._gating import spread_over
from ...job.result._result import Remark, staged
from ...job.result._second import SecondMeasurement
from ...proof import GateCheck, reversal_checks
from ...proof.axis import check_switching
from ...readings import Readings, Tables
from .._keys import FitSpec
from ._recording import fit_readings, read_backlash
from ._result import BacklashResult, remarks_of
from .effect import BacklashFit
from .entries import backlash_from_list, entries_of_backlash
from .keys import Spec

if TYPE_CHECKING:
    from ...job.write._lists import AxisFiles

_GROUPS = 5
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


@final
@dataclasses.dataclass(frozen=True)
class BacklashDraft(AbstractDraft):
    """A fitted backlash.

    Attributes:
        readings: What was measured: a trace without directions, or readings with them.
        remarks: What was taken for granted.
        found: The estimate.
        known: What the axis list holds.
        joint: Error per reading under lists that were fitted without it, and whether these
            left out whole runs, where a joint fit knows that; else the width is fitted anew
            without each run or block.
    """

    fit: Spec
    readings: Readings
    remarks: tuple[Remark, ...]
    found: BacklashFit
    known: KnownBacklash
    joint: tuple[Float[np.ndarray, " t"], bool] | None = None

    @property
    def width(self) -> float:
        """What is written, in mm or °."""
        return self.found.width + self.known.acting

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
            self.known.reference, cycles or 0
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
        from .plan import BacklashPlan

        plan = BacklashPlan(tables.job, self.index, fit, self.known)
        readings, _ = read_backlash(tables, plan)
        sides = fit_readings(readings, fit.loss).sides
        return SecondMeasurement(
            ", ".join(fit.sources),
            sides.position[:, None],
            sides.before,
            sides.direction,
            wild=sides.wild,
            added=0.5 * abs(self.found.width),
        )

    def prove(self, done: "AxisFiles") -> BacklashResult:
        sides, half = self.found.sides, 0.5 * self.found.sides.direction
        predicted, by_run = self._held_out() if self.joint is None else self.joint
        back = self._read_back(done)
        # About the mean of both directions, which the tables of the axis look after.
        from_file = sides.before + half * (back - self.known.acting)
        result = BacklashResult(
            **self.frame(done),
            error=staged(sides.before, predicted, from_file, sides.wild),
            remarks=(),
            files=tuple(n for n in done.written if n.name == done.machine_name),
            held_out="run" if by_run else "block",
            width=self.width if self.written else 0.0,
            reference=self.known.reference,
            cycles=done.cycles or 0,
            fit=self.found,
            from_file=from_file,
            moving=self.readings.direction is None,
        )
        said = remarks_of(result, self.known.old is not None, self.known.active)
        remarks = (*self.remarks, *said, *done.remarks)
        return dataclasses.replace(result, remarks=remarks)

    def _held_out(self) -> tuple[Float[np.ndarray, " t"], bool]:
        """Return the error under the width of the others, and whether runs are left out."""
        readings, sides = self.readings, self.found.sides
        if readings.direction is None:
            widths, sound = np.diff(sides.before.reshape(-1, 2))[:, 0], ~sides.wild[::2]
            others = (widths @ sound - widths * sound) / (sound.sum() - sound)
            half = 0.5 * sides.direction * np.repeat(others, 2)
            return sides.before + half, False
        width = np.full(len(sides.before), self.found.width)
        # Whole targets: those that stay must still be approached from both sides.
        targets = np.unique(np.round(sides.position, 6), return_inverse=True)[1]
        group, by_run = targets.reshape(-1) % _GROUPS, False
        if readings.run is not None and len(np.unique(readings.run)) > 1:
            group, by_run = readings.run, True
        for each in np.unique(group):
            try:
                other = fit_readings(readings, self.fit.loss, group != each).width
            except FitError:
                # What is left tells nothing: neither does the prediction.
                other = 0.0
            width[group == each] = other
        return sides.before + 0.5 * sides.direction * width, by_run

    def _read_back(self, done: "AxisFiles") -> float:
        """Return the width that the written file holds."""
        listing = done.machine
        if listing is None:
            return 0.0 if self.known.old is None else float(self.known.old.width)
        back = backlash_from_list(listing, self.job.conventions)
        return 0.0 if back is None else float(back.width)
