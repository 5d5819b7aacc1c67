"""What was measured for a backlash: readings at standstill, or a trace in motion."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import MeasurementError, wrap_degrees
from ....data.signals import aligned_error, encoder_spline, estimate_instrument
from ...job.result._result import Remark
from ...readings import Tables, Wanted, read_joined
from ._trace import fit_backlash_trace
from .effect import BacklashFit, fit_backlash
from .keys import Spec

_GROUPS = 5
_ROWS = 50
"""Fewer tell nothing of a delay."""
_REACH = 0.1
"""Share of the travel, to each side of a reversal, that a trace is judged by."""
_FARTHEST = 2.0
"""mm or °: more on each side tells no more of a backlash."""


@dataclasses.dataclass(frozen=True)
class Sides:
    """Readings about the mean of both directions: one each, or two per reversal of a trace.

    Attributes:
        position: Of each in mm or °.
        direction: ±1.
        before: Half the reversal error, with the scatter of the reading, in mm or °.
        wild: Which the loss rejected.
        group: What is held out together.
        by_run: Whether the groups are runs.
    """

    position: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    group: Int[np.ndarray, " t"]
    by_run: bool = False


@dataclasses.dataclass(frozen=True)
class Recording:
    """Readings of an axis from both directions, or a trace over its reversals.

    Attributes:
        position: In mm or °.
        error: Actual − commanded (trace: reference − encoder) in mm or °.
        direction: ±1 per reading; None for a trace.
        run: Cycle of each reading, or None.
        time: In s, or None.
        reach: Travel on both sides of a reversal that a trace is judged by.
        rotary: Lengths are angles.
        slices: Rows of each measurement; none for a trace.
        remarks: What was taken for granted.
    """

    position: Float[np.ndarray, " t"]
    error: Float[np.ndarray, " t"]
    direction: Int[np.ndarray, " t"] | None
    run: Int[np.ndarray, " t"] | None
    time: Float[np.ndarray, " t"] | None
    reach: float
    rotary: bool
    slices: Mapping[str, slice]
    remarks: tuple[Remark, ...]

    @property
    def moving(self) -> bool:
        """Whether this is a trace in motion."""
        return self.direction is None

    def fit(self, loss: str, keep: np.ndarray | None = None) -> BacklashFit:
        """Return the backlash of all readings, or of those for which ``keep`` is true.

        Raises:
            FitError: If they do not determine it.
        """
        rows = np.ones(len(self.error), dtype=bool) if keep is None else keep
        if self.direction is None:
            assert self.time is not None  # a trace has it
            return fit_backlash_trace(
                self.time[rows], self.position[rows], self.error[rows],
                reach=self.reach, loss=loss,
            )  # fmt: skip
        return fit_backlash(
            self.position[rows],
            self.error[rows],
            self.direction[rows],
            run=None if self.run is None else self.run[rows],
            time=None if self.time is None else self.time[rows],
            loss=loss,
        )

    def in_unit(self, words: str) -> str:
        """Return words in thousandths of a degree where the axis turns."""
        return words.replace(" µm", " × 0.001°") if self.rotary else words

    def sides(self, found: BacklashFit) -> Sides:
        """Return the readings, or reversals, that a fit to them rests on."""
        way = self.direction
        if way is None:
            turns = found.reversals
            way = np.tile(np.array([1, -1]), len(turns))
            # Each reversal gives one width: half of it to either side.
            width = np.repeat([turn.width for turn in turns], 2)
            place = np.repeat([turn.position for turn in turns], 2)
            group = np.repeat(np.arange(len(turns)), 2)
            wild = np.repeat(found.wild, 2)
            return Sides(place, way, -0.5 * way * width, wild, group)
        before = found.residual - 0.5 * way * found.width
        if self.run is not None and len(np.unique(self.run)) > 1:
            return Sides(self.position, way, before, found.wild, self.run, by_run=True)
        # Whole targets: those that stay must still be approached from both sides.
        _, place = np.unique(np.round(self.position, 6), return_inverse=True)
        group = np.asarray(place.reshape(-1) % _GROUPS)
        return Sides(self.position, way, before, found.wild, group)


def read_recording(tables: Tables, fit: Spec) -> Recording:
    """Return the readings of a backlash fit, all its measurements joined.

    Raises:
        MeasurementError: If a role is missing, the directions cannot be told, or a value
            cannot be used.
    """
    name = fit.sources[0]
    measured = tables.measured(name, fit.axis, (fit.axis,))
    encoder = measured.get(f"{fit.axis}.encoder")
    actual = measured.get(f"{fit.axis}.actual")
    time = measured.get("time")
    if encoder is not None and actual is not None and time is not None:
        if len(fit.sources) > 1:
            reason = "found a trace in motion among several measurements, expected one"
            raise MeasurementError(str(measured.source), reason)
        return _trace(encoder, actual, time, tables.job.spec.axes[fit.axis].kind)
    wanted = Wanted((fit.axis,), "needed", lengths=True)
    found = read_joined(tables, fit, wanted)
    assert found.direction is not None  # `read_joined` refuses it otherwise
    return Recording(
        position=found.positions[:, 0],
        error=found.error,
        direction=found.direction.astype(np.int64),
        run=found.run,
        time=found.time,
        reach=0.0,
        rotary=tables.job.spec.axes[fit.axis].kind != "linear",
        slices=found.slices,
        remarks=tuple(map(Remark.info, found.remarks)),
    )


def _trace(
    encoder: np.ndarray, actual: np.ndarray, time: np.ndarray, kind: str
) -> Recording:
    position = np.asarray(encoder, dtype=float)
    error, time = np.asarray(actual - position, dtype=float), np.asarray(time, float)
    late = ""
    clock = estimate_instrument(time, position, actual) if time.size >= _ROWS else None
    if clock is not None and clock.determined:
        # Reversals alone, at one speed, would take the delay for a part of the backlash.
        aligned = aligned_error(time, position, actual, clock)
        spline = encoder_spline(time, position)
        if spline is not None:
            position = np.asarray(spline(aligned.instants))
        time, error = aligned.instants, aligned.error
        late = (
            f" {clock.statement[:1].upper()}{clock.statement[1:]}; that is taken off."
        )
    if kind != "linear":
        error = wrap_degrees(error)
    travel = float(np.ptp(position))
    reach = min(_REACH * travel, _FARTHEST)
    return Recording(
        position=position,
        error=error,
        direction=None,
        run=None,
        time=time,
        reach=reach,
        rotary=kind != "linear",
        slices={},
        remarks=(
            Remark.info(
                "The axis was moving: the error is that of the reference against the"
                f" encoder, over {reach:.3g} mm (or °) on both sides of each reversal."
                f"{late}"
            ),
        ),
    )
