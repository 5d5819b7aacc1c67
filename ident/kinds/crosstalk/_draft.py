"""The crosstalk of one axis, fitted: judged, written into its list, read back."""

import dataclasses
import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float

from ....data.lists import Value
from ....models import Crosstalk, LegacyCrosstalk
from ..._recording import JointData
from ...exchange._units import LIST_UNITS
from ...job._draft import AbstractDraft, Foreseen
from ...job._gating import leaves_what_was_predicted, spread_over
from ...job.result._result import Remark, staged
from ...proof import GateCheck, error_figures, reversal_dynamics
from ._events import added_by, cut_events, held_shares
from ._result import SHORT, CrosstalkResult, remarks_of
from .effect import CrosstalkFit, full_offsets
from .entries import crosstalk_from_list, entries_of_crosstalk
from .keys import Spec

if TYPE_CHECKING:
    from ...job.write._lists import AxisFiles
    from .plan import CrosstalkPlan

_RINGS = 0.05
"""Share of an event that its list may leave where a filtered acceleration rings, and is held."""
_STEPS = 60
"""Steps along each adaptation axis by which the surface is looked at."""
_RESOLUTION = 41
"""Places along each adaptation axis at which the workspace is looked at."""


@final
@dataclasses.dataclass(frozen=True)
class CrosstalkDraft(AbstractDraft):
    """A fitted crosstalk.

    Attributes:
        plan: What was asked for, and the crosstalk of the list that is there.
        found: The estimate.
        log: What it saw, its delay taken off.
        remarks: What was taken for granted while reading.
        delay: By how much the error follows the acceleration, in s; taken off.
    """

    fit: Spec
    plan: "CrosstalkPlan"
    found: CrosstalkFit
    log: JointData
    remarks: tuple[Remark, ...]
    delay: float = 0.0

    @property
    def masters(self) -> tuple[str, ...]:
        """Names of its adaptation axes."""
        return self.found.effect.adaptation

    @functools.cached_property
    def model(self) -> Crosstalk | None:
        """The list that is written as the controller runs it; None: nothing is written."""
        found, cycles, model = self.found, self.fit.n_cycles, None
        if found.significant and found.complete.any():
            model = found.compensation()
        if model is None:
            return None
        if cycles is None:
            listing, entry = self.lists.compensation, f"{self.kind.prefix}.n_cycles"
            cycles = spread_over(self.job, _steps(model)[2], listing, entry)
        return dataclasses.replace(model, cycles=cycles)

    @property
    def written(self) -> bool:
        return self.model is not None

    @property
    def converged(self) -> bool:
        return self.found.converged

    @property
    def needs(self) -> str:
        if not self.masters:
            return "Works from start-up on"
        verb = "is" if len(self.masters) == 1 else "are"
        return f"Works once {' and '.join(self.masters)} {verb} referenced"

    @property
    def _masters(self) -> tuple[int, ...]:
        """Numbers of the axes that it acts over, the accelerating one first."""
        axes = self.job.spec.axes
        return tuple(axes[name].number for name in self.found.effect.masters)

    def entries(self) -> dict[str, Value]:
        assert self.model is not None  # it is written
        return {**entries_of_crosstalk(self.model, self._masters), **self.manual_entry}

    @property
    def foreseen(self) -> Foreseen:
        value, predicted = self.found.events.value, self.found.predicted
        # Beyond the specified acceleration the list takes off a part; without a list nothing
        # changes.
        left = value - self.taken * self.written * (value - predicted)
        return Foreseen(value, left, self.found.events.wild)

    @functools.cached_property
    def taken(self) -> Float[np.ndarray, " n"]:
        """Part of each event that the list can take off."""
        events = self.found.events
        if self.job.conventions.crosstalk_above != "hold":
            return np.ones(len(events))
        return held_shares(self.log, self.found.effect, events)

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        model, limits = self.model, self.job.spec.gate
        assert model is not None  # it is written
        full, turns, jump = _steps(model)
        points, sizes = np.asarray(model.surface.points), np.abs(full)

        def at(test: int) -> str:
            pairs = zip(self.masters, points[test], strict=True)
            words = ", ".join(f"{name} = {value:g}" for name, value in pairs)
            return f" at {words}" if words else ""

        row, test = np.unravel_index(sizes.argmax(), sizes.shape)
        turn = "where the master turns under full acceleration"
        turn += at(int(turns.max(axis=0).argmax()))
        cycle_time = self.job.spec.controller.cycle_time
        fast, hard = reversal_dynamics(jump, model.cycles, cycle_time)
        step = f"if the acceleration of the master steps, spread over {model.cycles} cycles"
        lines = [
            ("max_correction", sizes.max(), "mm", f"{SHORT[row]}{at(int(test))}"),
            ("max_reversal", turns.max(), "mm", turn),
            ("max_velocity", fast, "mm/s", step),
            ("max_acceleration", hard, "mm/s²", step),
        ]
        if self.masters:
            steepest, along = max(self._slopes(model))
            where, feed = f"along {along} under full acceleration", limits.feed / 60.0
            lines += [
                ("max_slope", 1e3 * steepest, "µm/mm", where),
                ("max_velocity by position", steepest * feed, "mm/s", where),
            ]
        old = self.plan.old if self.plan.masters == self._masters else None
        if limits.max_change is not None and old is not None:
            change = np.abs(full - full_offsets(old, model)).max()
            lines.append(
                ("max_change", change, "mm", "against the list that was there")
            )
        left, rms = self._left_by(model), error_figures(self.found.events.value).rms
        spare = 1.0 / LIST_UNITS + _RINGS * rms
        return (
            *(limits.check(*line) for line in lines),
            leaves_what_was_predicted(
                left, self.foreseen, spare, "mm", "over all accelerations"
            ),
        )

    def _slopes(self, model: Crosstalk) -> Iterator[tuple[float, str]]:
        """Yield the steepest slope under full acceleration along each adaptation axis."""
        points = np.asarray(model.surface.points)
        lines = np.linspace(points.min(axis=0), points.max(axis=0), _STEPS + 1)
        grid = _places(lines)
        four = full_offsets(model, model, grid.reshape(-1, grid.shape[-1]))
        four = four.reshape(4, *grid.shape[:-1])
        steps = zip(self.masters, lines[1] - lines[0], strict=True)
        for axis, (name, step) in enumerate(steps, start=1):
            rise = float(np.max(np.abs(np.diff(four, axis=axis))))
            yield (rise / float(step) if step > 0 else 0.0, name)

    def prove(self, done: "AxisFiles") -> CrosstalkResult:
        fit, log, listing, read = self.found, self.log, done.compensation, None
        if self.written and listing is not None:
            read = crosstalk_from_list(listing, self.job.conventions)
        residual = self._left_by(read)
        before, predicted, wild = self.foreseen
        return CrosstalkResult(
            **self.frame(done),
            error=staged(before, predicted, residual, wild),
            remarks=tuple(remarks_of(self, done.gates[self.index])),
            held_out="event",
            model=self.model,
            written=fit.kept & self.written,
            coverage=self.coverage,
            fit=fit,
            from_file=residual,
            time=log.clock_for(fit.effect.name)[fit.events.start],
        )

    def _left_by(
        self, model: Crosstalk | LegacyCrosstalk | None
    ) -> Float[np.ndarray, " n"]:
        """Return what a list leaves of each event in mm, cut out of the log once more.

        What acted already is in the log.
        """
        log, form, acting = self.log, self.found.effect, self.found.active
        error = log.error[self.axis]
        if model is not None:
            error = error + added_by(model, log, form)
            if acting is not None:
                error = error - added_by(acting, log, form)
        log = dataclasses.replace(log, error={self.axis: error})
        return cut_events(log, form).value

    @functools.cached_property
    def coverage(self) -> float:
        """Share of the workspace that lies among the tests, 0 to 1; 0 without a list.

        The adaptation axes go from one software limit to the other, else as measured.
        """
        spans = []
        for name in self.masters:
            place = self.log.position[name]
            limits = self.job.spec.axes[name].limits
            spans.append(limits or [float(place.min()), float(place.max())])
        if not spans or self.model is None:
            return float(self.written)
        low, high = np.array(spans, dtype=float).T
        places = _places(np.linspace(low, high, _RESOLUTION)).reshape(-1, len(spans))
        return float(np.mean(np.asarray(self.model.covers(places))))


def _steps(
    model: Crosstalk,
) -> tuple[Float[np.ndarray, "4 p"], Float[np.ndarray, "2 p"], float]:
    """Return in mm what a list adds at each test, its jumps at turns, and the largest jump.

    Under full acceleration, rows as `BRANCHES`. Where the master turns the sign of the
    acceleration stays; the largest jump is that where the acceleration steps at will.
    """
    full = full_offsets(model, model)
    turns = np.abs(full[[0, 2]] - full[[3, 1] if model.by_speed else [1, 3]])
    sizes = full, full[:2] - full[2:], turns
    return full, turns, max(float(np.abs(size).max(initial=0.0)) for size in sizes)


def _places(lines: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "..."]:
    """Return all places that the lines of each axis make, the axes last."""
    return np.stack(np.meshgrid(*lines.T, indexing="ij"), axis=-1)
