"""What a drive recorded, looked over and ready to fit."""

import contextlib
import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import maximum_filter1d

from ....data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    RoleValues,
    derive_motion,
    filled_in,
    on_even_clock,
    recorded_motion,
)
from ....data.signals import (
    Motion,
    SignalError,
    examine,
    filtered_motion,
    read_clock,
    without_spikes,
)
from ...friction import DriveSamples
from ...job.result._result import Remark
from ...readings import Tables
from .keys import Spec

_NO_LIST = (
    "no motion",
    "one direction",
    "sign of the current unknown",
    "held at a limit",
)
"""Shortcomings with which a list would be a guess."""
_SHARE = 0.3
"""Of the sample rate, up to which a motion is derived: friction changes with the speed at
once, so that a smoothed ramp shows another law."""
_BRIDGED = 4
"""Samples missed in a row that are filled in at most."""
_APART, _SAME = 10.0, 0.05
"""s between recordings of one fit, and the share that their sample times may differ by."""
_SLOWER, _WITHIN, _KEPT, _UNSURE = 10.0, 1.0, 0.2, 10.0
"""A slower filter, of the bandwidth of the usual one; periods of it within which a speed is kept,
and its change in one of them; deviations of the usual velocity below which that one is unsure."""
_FINE = 1e-4
"""Median noise of a recorded velocity, as a share of the highest, that is none."""
_SURE = 0.999
"""Probability from which on a current that opposes the motion is turned round."""


@dataclasses.dataclass(frozen=True)
class DriveRecording:
    """One recording of a drive.

    Attributes:
        samples: For the estimators; the current drives the motion, whatever its sign was.
        commanded: Position in mm or °: commanded where that was recorded.
        unit: Of the current as the file states it; empty for raw drive units.
        unsure: Why no list may be made of it, or nothing.
        remarks: What the user must know.
    """

    samples: DriveSamples
    commanded: Float[np.ndarray, " t"]
    unit: str
    unsure: str
    remarks: tuple[Remark, ...]


def read_drive(tables: Tables, fit: Spec) -> DriveRecording:
    """Return the recording of a friction fit.

    Raises:
        MeasurementError: If a role is missing, several measurements differ in sample time or
            units, the motion cannot be derived, or no sample tells of kinetic friction.
    """
    axis = fit.axis
    recorded = [tables.measured(name, axis) for name in fit.sources]
    parts = [filled_in(part, _BRIDGED)[0] for part in recorded]
    measured = _one_after_another(parts)
    dropped = sum(part.rows for part in parts) - sum(part.rows for part in recorded)
    source = str(measured.source)
    role = f"{axis}.current"
    purpose = f"for the friction fit of {axis}"
    current, spikes = without_spikes(
        np.asarray(measured.require(role, purpose), dtype=float)
    )
    measured = on_even_clock(measured, axis, share=_SHARE)
    motion = _motion(measured, axis)
    spec = tables.job.spec.axes[axis]
    unit = "mm" if spec.kind == "linear" else "°"
    examined = examine(motion, current, unit=unit)
    if not examined.usable.any():
        words = examined.findings[0].sentence if examined.findings else "nothing moves"
        raise MeasurementError(source, words)
    turned = examined.polarity.sign == -1 and examined.polarity.confidence >= _SURE
    nominal = measured.get(f"{axis}.position")
    commanded = motion.position if nominal is None else np.asarray(nominal, dtype=float)
    noisy = f"{axis}.encoder" in measured.values or f"{axis}.actual" in measured.values
    smoothed = None
    if noisy and nominal is not None:
        with contextlib.suppress(SignalError, MissingRole):
            smoothed = filtered_motion(motion.time, commanded, cutoff=motion.bandwidth)
    samples = DriveSamples(
        time=motion.time,
        velocity=motion.velocity,
        current=-current if turned else current,
        acceleration=motion.acceleration,
        position=motion.position,
        instrument_velocity=None if smoothed is None else smoothed.velocity,
        instrument_acceleration=None if smoothed is None else smoothed.acceleration,
        moving=examined.usable,
        unit=unit,
    )
    remarks = [Remark.info(words) for words in measured.remarks]
    remarks += [
        Remark.warning(finding.sentence)
        for finding in examined.findings
        if finding.kind not in _NO_LIST
        and not (turned and finding.kind == "current opposes the motion")
        # Between several recordings of one fit it jumps in any case.
        and (finding.kind != "clock jumps" or len(motion.clock.jumps) >= len(parts))
    ]
    if dropped:
        words = (
            f"{dropped} samples that the recorder dropped, of {measured.rows}, were filled in"
            " from those beside them."
        )
        remarks.append(Remark.info(words))
    if spikes:
        words = (
            f"{spikes} of {len(current)} readings of the current lie far from those beside"
            " them, as faults of a transmission do: they were left out."
        )
        remarks.append(Remark.warning(words))
    if turned:
        words = (
            "The recorded current was turned round, as torque feedback is ([001] p.74):"
            f" {examined.polarity.statement}."
        )
        remarks.append(Remark.info(words))
    faults = [f.sentence for f in examined.findings if f.kind in _NO_LIST]
    return DriveRecording(
        samples=samples,
        commanded=commanded,
        unit=measured.units.get(role, ""),
        unsure=" ".join(faults),
        remarks=tuple(remarks),
    )


def _one_after_another(parts: Sequence[Measurement]) -> Measurement:
    """Return several recordings as one, whose clock jumps from each to the next."""
    first = parts[0]
    if len(parts) == 1:
        return first
    shared = [r for r in first.values if all(r in part.values for part in parts)]
    columns: dict[str, list[np.ndarray]] = {role: [] for role in shared}
    end = step = 0.0
    for part in parts:
        clock = np.asarray(part.require("time", "for several recordings"), dtype=float)
        own = read_clock(clock).sample_time
        step = step or own
        if abs(own - step) > _SAME * step:
            words = f"found {1e3 * own:.4g} ms a sample, expected {1e3 * step:.4g} ms"
            raise MeasurementError(str(part.source), f"{words} as in {first.name}")
        for role in shared:
            found, expected = part.units.get(role), first.units.get(role)
            if found != expected:
                words = f"{role}: found {found}, expected {expected} as in {first.name}"
                raise MeasurementError(str(part.source), words)
            columns[role].append(np.asarray(part.values[role]))
        columns["time"][-1] = clock - clock[0] + end
        end += float(clock[-1] - clock[0]) + _APART
    values = {role: np.concatenate(column) for role, column in columns.items()}
    remarks = dict.fromkeys(words for part in parts for words in part.remarks)
    return dataclasses.replace(
        first,
        values=RoleValues(values),
        rows=sum(part.rows for part in parts),
        lines=np.concatenate([part.lines for part in parts]),
        remarks=tuple(remarks),
    )


def _motion(measured: Measurement, axis: str) -> Motion:
    """Return the motion as recorded where that is as fine as a derived one, or derived."""
    motion = derive_motion(measured, axis, share=_SHARE)
    recorded = (
        recorded_motion(measured, axis, name) for name in ("velocity", "acceleration")
    )
    fast, hard = (None if v is None else np.asarray(v, float) for v in recorded)
    if fast is None:
        return _creeping(motion, measured, axis)
    if hard is None:
        top, noise = float(np.abs(fast).max()), float(np.max(motion.velocity_noise))
        apart = np.abs(fast - motion.velocity)[np.abs(fast) > _FINE * top]
        coarse = not apart.size or float(np.median(apart)) > max(noise, _FINE * top)
        if coarse or (np.diff(motion.time) <= 0.0).any():
            return _creeping(motion, measured, axis)
        hard = np.gradient(fast, motion.time)
    return dataclasses.replace(motion, velocity=fast, acceleration=hard)


def _creeping(motion: Motion, measured: Measurement, axis: str) -> Motion:
    """Return a motion with a slower filter where an axis creeps at a speed that it keeps.

    There the wide one, which ramps need, shows the steps of the encoder and not the speed.
    """
    try:
        slow = derive_motion(measured, axis, cutoff=motion.bandwidth / _SLOWER)
    except MeasurementError:  # too short for it
        return motion
    window = 1 + 2 * max(round(_WITHIN / slow.bandwidth / motion.step), 1)
    change = maximum_filter1d(np.abs(slow.acceleration), window) / slow.bandwidth
    speed, certain = np.abs(slow.velocity), 5.0 * slow.velocity_noise
    kept = slow.settled & motion.settled & (speed > certain) & (change < _KEPT * speed)
    kept &= speed < _UNSURE * np.asarray(motion.velocity_noise)
    return dataclasses.replace(
        motion,
        velocity=np.where(kept, slow.velocity, motion.velocity),
        acceleration=np.where(kept, slow.acceleration, motion.acceleration),
        velocity_noise=np.where(kept, slow.velocity_noise, motion.velocity_noise),
    )
