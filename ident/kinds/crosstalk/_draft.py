"""The crosstalk of one axis, fitted: judged, written into its list, read back."""

import dataclasses
import functools
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ....data.lists import Value
from ....models import Crosstalk, LegacyCrosstalk
from ...exchange import ExchangeError
from ...job._draft import AbstractDraft
from ...job._gating import spread_over
from ...job.file._load import Job
from ...job.result._result import Remark, staged
from ...job.table._plan import was_active
from ...proof import GateCheck
from ._events import CrosstalkReadings, cut_events
from ._result import (
    CrosstalkResult,
    coverage_of,
    judge_crosstalk,
    largest_jump,
    remarks_of,
)
from .effect import CrosstalkFit, full_offsets
from .entries import ENTRIES, crosstalk_from_list, entries_of_crosstalk
from .keys import Spec

if TYPE_CHECKING:
    from ...job.write._lists import AxisFiles


@dataclasses.dataclass(frozen=True)
class Existing:
    """Crosstalk of the list that is there.

    Attributes:
        model: As the controller runs it; None: there is none, or none that can be read.
        masters: Logical numbers: the axis that accelerates, then adaptation axes.
        unread: Why it cannot be read, or nothing.
        active: The same where it was active while measuring.
    """

    model: Crosstalk | LegacyCrosstalk | None = None
    masters: tuple[int, ...] = ()
    unread: str = ""
    active: Crosstalk | None = None


def existing_crosstalk(job: Job, index: int, fit: Spec) -> Existing:
    """Return the crosstalk of the list that is there, and whether it was active.

    Raises:
        JobError: If it was, and cannot be added to.
    """
    found, listing, holder = Existing(), job.lists[fit.axis].compensation, None
    if listing is not None and ENTRIES.is_in(listing):
        try:
            model = crosstalk_from_list(listing, job.conventions)
            found = Existing(model, ENTRIES.named_masters(listing))
        except ExchangeError as error:
            found = Existing(unread=str(error))
    if found.model is not None or found.unread:
        holder = job.spec.axes[fit.axis].listing
    if not was_active(job, index, fit, holder):
        return found
    where, axes = ("fits", index), job.spec.axes
    if found.model is None:
        raise job.error(
            ("axes", fit.axis, "list"),
            "crosstalk was active while measuring, but no list with its tests is given"
            f"{f' ({found.unread})' if found.unread else ''}, expected list = the file"
            " that was loaded",
        )
    if not isinstance(found.model, Crosstalk):
        raise job.error(
            where,
            "crosstalk was active by a list of the older form, to which no tests can be"
            " added, expected a measurement with COMP OFF CROSSTALK",
        )
    named = tuple(axes[name].number for name in (fit.master, *fit.adapts_to))
    if named != found.masters:
        raise job.error(
            where,
            f"found master and adaptation axes {list(named)}, expected"
            f" {list(found.masters)} as in the list that was active",
        )
    for key in ("acceleration", "deceleration"):
        given, own = getattr(fit, key), float(getattr(found.model, key))
        if given is not None and given != own:
            reason = f"found {given:g}, expected {own:g} as in the list that was active"
            raise job.error((*where, key), reason)
    return dataclasses.replace(found, active=found.model)


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkDraft(AbstractDraft):
    """A fitted crosstalk.

    Attributes:
        remarks: What was taken for granted while reading.
        found: The estimate.
        readings: What it saw: positions of its own adaptation axes only, no delay.
        old: Crosstalk of the list that is there.
        delay: By how much the error follows the acceleration, in s; taken off.
    """

    fit: Spec
    remarks: tuple[Remark, ...]
    found: CrosstalkFit
    readings: CrosstalkReadings
    old: Existing
    delay: float = 0.0

    @property
    def masters(self) -> tuple[str, ...]:
        """Names of its adaptation axes."""
        return self.found.effect.adaptation

    @functools.cached_property
    def list_model(self) -> Crosstalk | None:
        """The list as the controller runs it, without a filter; None: nothing is written."""
        if not (self.found.significant and self.found.complete.any()):
            return None
        return self.found.compensation(self.old.active)

    @property
    def written(self) -> bool:
        return self.list_model is not None

    @functools.cached_property
    def model(self) -> Crosstalk:
        """The list that is written as the controller runs it."""
        model, cycles = self.list_model, self.fit.n_cycles
        assert model is not None  # it is written
        if cycles is None:
            jump = largest_jump(model)
            entry = f"{self.kind.prefix}.n_cycles"
            cycles = spread_over(self.job, jump, self.lists.compensation, entry)
        return dataclasses.replace(model, cycles=cycles)

    @property
    def settled(self) -> bool:
        return self.found.converged

    @property
    def needs(self) -> str:
        masters = self.masters
        if not masters:
            return "Works from start-up on"
        verb = "is" if len(masters) == 1 else "are"
        return f"Works once {' and '.join(masters)} {verb} referenced"

    @property
    def _masters(self) -> tuple[int, ...]:
        """Numbers of the axes that it acts over, the accelerating one first."""
        names = (self.fit.master, *self.masters)
        return tuple(self.job.spec.axes[name].number for name in names)

    def entries(self) -> dict[str, Value]:
        return {**entries_of_crosstalk(self.model, self._masters), **self.manual_entry}

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        return judge_crosstalk(self)

    @property
    def change(self) -> Float[np.ndarray, "4 p"] | None:
        """What the new list adds beyond the old one, where both can be compared, in mm."""
        old, model = self.old.model, self.model
        if old is None or self.old.masters != self._masters:
            return None
        return np.asarray(full_offsets(model, model) - full_offsets(old, model))

    def prove(self, done: "AxisFiles") -> CrosstalkResult:
        fit, log = self.found, self.readings
        added = self.added_to_log(done)
        corrected = dataclasses.replace(log, error=log.error + added)
        left = cut_events(corrected, fit.effect).value
        before = fit.events.value
        model, predicted = (
            (self.model, fit.predicted) if self.written else (None, before)
        )
        result = CrosstalkResult(
            **self.frame(done),
            error=staged(before, predicted, left, fit.events.wild),
            remarks=(),
            files=() if model is None else done.written,
            held_out="event",
            model=model,
            written=fit.kept(self.old.active) & self.written,
            coverage=0.0 if model is None else coverage_of(model, self._workspace()),
            fit=fit,
            from_file=left,
            time=log.time[fit.events.start],
        )
        said = remarks_of(result, self)
        remarks = (*self.remarks, *said, *self._about_the_old(), *done.remarks)
        return dataclasses.replace(result, remarks=remarks)

    def added_to_log(self, done: "AxisFiles") -> Float[np.ndarray, " t"]:
        """Return what the written file adds in each row beyond what acted already."""
        readings, listing = self.readings, done.compensation
        motion = readings.acceleration, readings.velocity, readings.positions
        if not self.written or listing is None:
            return np.zeros(len(readings.time))
        model = crosstalk_from_list(listing, self.job.conventions)
        added = np.asarray(model.offset(*motion))
        if self.old.active is not None:
            added = added - np.asarray(self.old.active.offset(*motion))
        return added

    def _workspace(self) -> Float[np.ndarray, "k 2"]:
        """Return where the adaptation axes go: software limits, else as measured."""
        places = self.readings.positions
        spans = [
            self.job.spec.axes[name].limits
            or [float(column.min()), float(column.max())]
            for name, column in zip(self.masters, places.T, strict=True)
        ]
        return np.array(spans, dtype=float).reshape(-1, 2)

    def _about_the_old(self) -> list[Remark]:
        if self.old.unread:
            why = self.old.unread
            words = f"The new crosstalk replaces one that cannot be read: {why}"
            return [Remark.warning(words)]
        if self.old.model is None:
            return []
        words = "off while measuring: the new one replaces it."
        if self.old.active is not None:
            words = "active while measuring: the new one is old + residual."
        return [Remark.info(f"The old crosstalk was {words}")]
