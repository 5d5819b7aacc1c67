"""A log against the lists: what the controller does with each compensation."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ....data.lists import ListFile
from ....data.measurements import ControllerLog
from ....models import COMPENSATIONS, Conventions
from ...exchange import ExchangeError, Reading
from ...fit import one_blas_thread
from ...kinds import kinds
from ._channel import AbstractChannel
from ._hypothesis import FAULT
from ._judge import Verdict, judge_channel
from ._lists import (
    ByAxis,
    axis_names,
    changed,
    channels_of,
    motion_of,
    number_of,
    owners,
    reports_of,
)
from ._log import LogMotion, Target
from ._search import Found, search
from ._total import drive_target, search_total

_PART = 0.1
"""Part of a cycle from which on a clock is off: a controller is late by whole ones."""

Explained = dict[tuple[int, str], tuple[AbstractChannel, Found]]
"""What explains each reported compensation, by axis and name."""


@dataclasses.dataclass(frozen=True)
class Verification:
    """What a log tells.

    Attributes:
        verdicts: One per axis and compensation.
        remarks: What the log cannot settle, one sentence each.
        conventions: Those that fit.
        settled: Names of the ones that the log settles.
    """

    verdicts: tuple[Verdict, ...]
    remarks: tuple[str, ...]
    conventions: Conventions
    settled: frozenset[str]

    @property
    def agrees(self) -> bool:
        """Whether there is anything, and all of it agrees."""
        return bool(self.verdicts) and all(one.agrees for one in self.verdicts)


# The products here are too short to share: threads would only wait for each other.
@one_blas_thread()
def verify_log(
    lists: Sequence[ListFile], log: ControllerLog, reading: Reading
) -> Verification:
    """Return what a controller does with its lists, from what it logged.

    Args:
        lists: Compensation and axis lists in any order.
        log: From `read_log`.
        reading: How the lists are read, by the rules as they are assumed.

    Raises:
        ExchangeError: If a list makes no table, an axis has two, the log lacks the
            position of a master, or has nothing of what the lists add.
    """
    names = axis_names(lists)
    motion = motion_of(log, names, reading.modulo)
    assumed = reading.conventions
    reading, owned = owners(lists, log, names, motion, reading)
    conventions = reading.conventions
    channels = channels_of(lists, motion, reading)
    reports, remarks = reports_of(log, names, channels)
    for name, rule in owned.items():
        choice = getattr(conventions, rule)
        if choice != getattr(assumed, rule):
            remarks.append(
                f"{name.capitalize()} tables stand in the list of the {choice} axis"
                f" ({rule} = {choice})."
            )

    def explained(channels: ByAxis) -> Explained:
        found: Explained = {}
        for (axis, name), report in reports.items():
            channel = channels[axis][name]
            if not report.filtered:  # the objects know no filters
                channel = changed(channel, cycles=0)
            target = Target.of(report.values, step=report.step)
            found[axis, name] = channel, search(channel, target)
        return found

    found = explained(channels)
    clock = _clock_of(found) if motion.cycle else 0.0
    if clock:
        timed = dataclasses.replace(motion, clock=clock)
        others = channels_of(lists, timed, reading)
        again = explained(others)
        assert motion.cycle is not None
        # The clock is one more thing to explain; it must be worth it.
        cost = FAULT + float(np.log(motion.rows))
        if _worth(again) + cost < _worth(found):
            found, channels = again, others
            way = "later" if clock > 0 else "earlier"
            remarks.append(
                "The offsets of this log were recorded"
                f" {1e3 * abs(clock) * motion.cycle:.1f} ms {way} than its positions;"
                " that is allowed for."
            )
    verdicts = [judge_channel(*one) for one in found.values()]
    driven: set[int] = set()
    for axis, parts in channels.items():
        told, at_drive = _sums(axis, parts, log, names, motion, set(found), remarks)
        verdicts = _merged(verdicts, told)
        if at_drive:
            driven.add(axis)
    if not verdicts:
        raise ExchangeError(
            where=str(log.source),
            found="none of the values that the lists add",
            expected="columns such as A3.cross, CROSSC::actual_offset or"
            " A3.drive_position",
        )
    found_all = _summary(verdicts, channels, driven, conventions, remarks)
    settled = found_all.settled | set(owned.values())
    return dataclasses.replace(found_all, settled=settled)


def _worth(found: Explained) -> float:
    """Return the criterion of all that was found, the smaller the better."""
    return sum(one.rivals[0].criterion for _, one in found.values())


def _clock_of(found: Explained) -> float:
    """Return how many cycles later the offsets were recorded; 0 where none are broken.

    A controller can only be late by whole cycles. A part of one that all compensations
    share is the clock of the recording, and with it what most of them share.
    """
    late: list[float] = []
    weights: list[float] = []
    for channel, one in found.values():
        # A filter of two cycles is half a cycle late: only unfiltered ones count here.
        best = next(
            (r.hypothesis for r in one.rivals if r.hypothesis.change.cycles is None),
            one.best,
        )
        rows = channel.motion.judged
        column = best.scale * channel.column(best.change)
        slope = np.gradient(column)[rows.start - best.lag : rows.stop - best.lag]
        base = column[rows.start - best.lag : rows.stop - best.lag]
        target = one.residual + one.column[rows]
        power = float(slope @ slope)
        noise = float(np.mean(np.square(one.residual)))
        if power <= 100.0 * noise:
            continue
        late.append(best.lag - float((target - base) @ slope) / power)
        weights.append(power / noise)
    if not late:
        return 0.0
    turns = 2.0 * np.pi * np.array(late)
    centre = np.average(np.exp(1j * turns), weights=weights)
    part = float(np.angle(centre)) / (2.0 * np.pi)
    apart = np.angle(np.exp(1j * turns - 2j * np.pi * part)) / (2.0 * np.pi)
    allowed = _PART + 4.0 / np.sqrt(np.array(weights))
    if abs(part) < _PART or np.any(np.abs(apart) > allowed):
        return 0.0
    whole = np.round(np.array(late) - part)
    votes = {value: np.array(weights)[whole == value].sum() for value in whole}
    return float(max(votes, key=lambda value: votes[value])) + part


def _sums(
    axis: int,
    parts: Mapping[str, AbstractChannel],
    log: ControllerLog,
    names: Mapping[str, int],
    motion: LogMotion,
    known: set[tuple[int, str]],
    remarks: list[str],
) -> tuple[list[Verdict], bool]:
    """Return verdicts from the drive position or the sum, and whether it was the drive."""
    drive = motion.drives.get(axis)
    whole = [
        one
        for one in log.offsets
        if one.compensation == "offset"
        and (one.axis is None or number_of(one.axis, names, str(log.source)) == axis)
    ]
    # A current is no position.
    parts = {n: one for n, one in parts.items() if not one.one.kind.adds_current}
    unknown = {
        name: one for name, one in parts.items() if (axis, name) not in known
    }  # fmt: skip
    if drive is None:
        if whole and unknown:
            found = search_total(parts, Target.of(whole[0].values, step=whole[0].step))
            told = [judge_channel(parts[name], found[name]) for name in unknown]
            return told, False
        return [], False
    place = motion.position(axis, "beside its drive_position")
    listed = [one.column(one.plain) for one in parts.values()]
    target, late, part = drive_target(place, drive, listed, motion.cycle is not None)
    after = round(1e3 * (late + part) * (motion.cycle or 0.0), 1)
    if after:
        remarks.append(
            f"A{axis}.drive_position comes {after:.1f} ms after A{axis}.position; that is"
            " allowed for."
        )
    late_by = dataclasses.replace(motion, clock=part)
    parts = {name: changed(one, motion=late_by) for name, one in parts.items()}
    found = search_total(parts, target)
    return [judge_channel(parts[name], one) for name, one in found.items()], True


def _merged(logged: Sequence[Verdict], summed: Sequence[Verdict]) -> list[Verdict]:
    """Return verdicts of single values, and of sums where they tell more."""
    found = {(one.axis, one.compensation): one for one in logged}
    for one in summed:
        before = found.get((one.axis, one.compensation))
        if before is None:
            found[one.axis, one.compensation] = one
        elif before.agrees and one.verdict and not one.agrees:
            text = f"logged as the list says, but at the drive {one.sentence}"
            found[one.axis, one.compensation] = dataclasses.replace(one, sentence=text)
    return list(found.values())


def _summary(
    verdicts: Sequence[Verdict],
    channels: ByAxis,
    driven: set[int],
    conventions: Conventions,
    remarks: list[str],
) -> Verification:
    values = conventions.to_dict()
    settled: dict[str, bool] = {}
    for one in verdicts:
        for name, value in one.settled.items():
            sure = name not in one.doubtful
            # A job must not run on a sign that this log cannot tell.
            if name.endswith("_sign") and not (sure and one.axis in driven):
                continue
            if sure or name not in settled:
                values[name] = value
            settled[name] = settled.get(name, False) or sure
    seen = {(one.axis, one.compensation) for one in verdicts}
    missing = [
        f"A{axis}.{name}"
        for axis, parts in channels.items()
        for name in parts
        if (axis, name) not in seen
    ]
    if missing:
        remarks.append(f"Not in this log: {', '.join(missing)}.")
    blind = sorted({one.axis for one in verdicts} - driven)
    if blind:
        which = ", ".join(f"A{axis}" for axis in blind)
        remarks.append(
            f"{which}: a log of offsets cannot tell with which sign they reach the"
            " drive; log drive_position as well, or read a dial gauge."
        )
    order = (*COMPENSATIONS, *(each.name for each in kinds()))
    verdicts = sorted(
        verdicts, key=lambda one: (one.axis, order.index(one.compensation))
    )
    return Verification(
        tuple(verdicts),
        tuple(remarks),
        Conventions.from_dict(values),
        frozenset(name for name, sure in settled.items() if sure),
    )
