"""A log against the lists: what the controller does with each compensation.

Also by sums alone: the position on the drive bus, or the sum of all offsets.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence, Set

import numpy as np

from ....data.lists import ListFile
from ....data.measurements import ControllerLog
from ....models import COMPENSATIONS, Conventions
from ...exchange import Reading, expect
from ...fit import one_blas_thread
from ...kinds import kinds
from ._channel import AbstractChannel
from ._hypothesis import FAULT, SCALES
from ._judge import Verdict, judge_channel
from ._lists import (
    ByAxis,
    Numbering,
    changed,
    channels_of,
    motion_of,
    numbering,
    owners,
    reports_of,
)
from ._log import FLOOR, LogMotion, Target, drive_target, way_of_counting
from ._search import Found, search

_PART = 0.1
"""Part of a cycle from which on a clock is off: a controller is late by whole ones."""

_SWEEPS = 4
"""Most rounds over the parts of a sum; two are the rule."""


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
        return bool(self.verdicts) and all(verdict.agrees for verdict in self.verdicts)


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
    number = numbering(lists, str(log.source))
    motion = motion_of(log, number, reading.modulo)
    assumed = reading.conventions
    reading, owned = owners(lists, log, number, motion, reading)
    conventions = reading.conventions
    channels = channels_of(lists, motion, reading)
    reports, remarks = reports_of(log, number, channels)
    for name, rule in owned.items():
        owner = getattr(conventions, rule)
        if owner != getattr(assumed, rule):
            remarks.append(
                f"{name.capitalize()} tables stand in the list of the {owner} axis"
                f" ({rule} = {owner})."
            )

    def explained(channels: ByAxis) -> dict[tuple[int, str], Found]:
        fitted_parts = dict[tuple[int, str], Found]()
        for (axis, name), report in reports.items():
            channel = channels[axis][name]
            if not report.filtered:  # the objects know no filters
                channel = changed(channel, cycles=0)
            target = Target.of(report.values, step=report.step)
            fitted_parts[axis, name] = search(channel, target)
        return fitted_parts

    searches = explained(channels)
    clock = _clock_of(searches.values()) if motion.cycle else 0.0
    if clock:
        timed = dataclasses.replace(motion, clock=clock)
        timed_channels = channels_of(lists, timed, reading)
        timed_searches = explained(timed_channels)
        assert motion.cycle is not None
        # The clock is one more thing to explain; it must be worth it.
        cost = FAULT + float(np.log(motion.rows))
        plain, timely = (
            sum(fitted.rivals[0].criterion for fitted in found.values())
            for found in (searches, timed_searches)
        )
        if timely + cost < plain:
            searches, channels = timed_searches, timed_channels
            direction = "later" if clock > 0 else "earlier"
            remarks.append(
                "The offsets of this log were recorded"
                f" {1e3 * abs(clock) * motion.cycle:.1f} ms {direction} than its positions;"
                " that is allowed for."
            )
    # Only the drive tells with which sign.
    verdicts = [judge_channel(fitted, signed=False) for fitted in searches.values()]
    for axis, parts in channels.items():
        summed = _sums(axis, parts, log, number, motion, set(searches), remarks)
        verdicts = _merged(verdicts, summed)
    found = "none of the values that the lists add"
    expected = "columns such as A3.cross, CROSSC::actual_offset or A3.drive_position"
    expect(verdicts, str(log.source), found, expected)
    driven = channels.keys() & motion.drives.keys()
    summary = _summary(verdicts, channels, driven, conventions, remarks)
    fixed = summary.settled | set(owned.values())
    return dataclasses.replace(summary, settled=fixed)


def _clock_of(searches: Iterable[Found]) -> float:
    """Return how many cycles later the offsets were recorded; 0 where none are broken.

    A controller can only be late by whole cycles. A part of one that all compensations
    share is the clock of the recording, and with it what most of them share.
    """
    found: list[tuple[float, float]] = []
    for fitted in searches:
        # A filter of two cycles is half a cycle late: only unfiltered ones count here.
        hypothesis = next(
            (r.hypothesis for r in fitted.rivals if r.hypothesis.change.cycles is None),
            fitted.best,
        )
        channel, rows = fitted.channel, fitted.channel.motion.judged
        column = hypothesis.scale * channel.column(hypothesis.change)
        earlier = slice(rows.start - hypothesis.lag, rows.stop - hypothesis.lag)
        slope, base = np.gradient(column)[earlier], column[earlier]
        target = fitted.residual + fitted.column[rows]
        power = float(slope @ slope)
        # A log may be exact to its digits.
        noise = max(float(np.mean(np.square(fitted.residual))), FLOOR**2)
        if power <= 100.0 * noise:
            continue
        lag = hypothesis.lag - float((target - base) @ slope) / power
        found.append((lag, power / noise))
    if not found:
        return 0.0
    lags, weights = np.array(found).T
    turns = 2.0 * np.pi * lags
    centre = np.average(np.exp(1j * turns), weights=weights)
    part = float(np.angle(centre)) / (2.0 * np.pi)
    deviation = np.angle(np.exp(1j * turns - 2j * np.pi * part)) / (2.0 * np.pi)
    allowed = _PART + 4.0 / np.sqrt(weights)
    if abs(part) < _PART or np.any(np.abs(deviation) > allowed):
        return 0.0
    cycles = np.round(lags - part)
    votes = {value: weights[cycles == value].sum() for value in cycles}
    return float(max(votes, key=lambda value: votes[value])) + part


def _sums(
    axis: int,
    parts: Mapping[str, AbstractChannel],
    log: ControllerLog,
    number: Numbering,
    motion: LogMotion,
    logged: set[tuple[int, str]],
    remarks: list[str],
) -> list[Verdict]:
    """Return verdicts from the position at the drive, else from the sum."""
    drive = motion.drives.get(axis)
    sums = [one for one in log.offsets if one.compensation == "offset"]
    sums = [one for one in sums if one.axis is None or number(one.axis) == axis]
    # A current is no position.
    parts = {k: c for k, c in parts.items() if not c.one.kind.adds_current}
    if not parts:
        return []
    unknown = [name for name in parts if (axis, name) not in logged]
    if drive is None:
        if not (sums and unknown):
            return []
        total = Target.of(sums[0].values, step=sums[0].step)
        totals = search_total(parts, total)
        return [judge_channel(totals[name], signed=False) for name in unknown]
    place = motion.position(axis, "beside its drive_position")
    way, turned = way_of_counting(place, drive), ""
    if way < 0:
        drive = -drive
        remarks.append(
            f"A{axis}.drive_position counts the other way round than A{axis}.position; that"
            " is allowed for."
        )
    elif not way:
        move = f"move A{axis} by a few mm or ° in the log"
        turned = f", or the drive counts the other way: {move}"
        remarks.append(
            f"A{axis}.drive_position does not show which way the drive counts, and so no"
            f" sign is settled: {move}."
        )
    listed = [channel.column(channel.plain) for channel in parts.values()]
    target, lag, part = drive_target(place, drive, listed, motion.cycle is not None)
    delay = round(1e3 * (lag + part) * (motion.cycle or 0.0), 1)
    if delay:
        remarks.append(
            f"A{axis}.drive_position comes {delay:.1f} ms after A{axis}.position; that is"
            " allowed for."
        )
    late_by = dataclasses.replace(motion, clock=part)
    parts = {name: changed(channel, motion=late_by) for name, channel in parts.items()}
    found = search_total(parts, target).values()
    return [judge_channel(fitted, bool(way), turned) for fitted in found]


def _signs(verdict: Verdict) -> dict[str, int | str]:
    """Return the signs that a verdict tells."""
    return {k: rule for k, rule in verdict.settled.items() if k.endswith("_sign")}


def _contradicts(single: Verdict, summed: Verdict) -> bool:
    """Return whether a sum is not as listed, where its part is, or has another sign."""
    if not single.verdict:
        return False
    if single.agrees:
        return bool(summed.verdict) and not summed.agrees
    logged, driven = ("sign" in verdict.verdict for verdict in (single, summed))
    return bool(_signs(summed)) and logged != driven


def _merged(logged: Sequence[Verdict], summed: Sequence[Verdict]) -> list[Verdict]:
    """Return verdicts of single values with the sign of sums, and of sums where they differ."""
    merged = {(verdict.axis, verdict.compensation): verdict for verdict in logged}
    hidden = not any(verdict.verdict for verdict in summed)
    for verdict in summed:
        key = verdict.axis, verdict.compensation
        single = merged.get(key)
        if single is None:
            merged[key] = verdict
        elif single.agrees and hidden and verdict.absent:
            text = (
                "logged as the list says, but the drive_position shows nothing of it: not"
                " active, or a displayed position, which has it removed"
            )
            merged[key] = dataclasses.replace(
                single, verdict=(), value=(), sentence=text
            )
        elif _contradicts(single, verdict):
            how = "as the list says" if single.agrees else "with the other sign"
            text = f"logged {how}, but at the drive {verdict.sentence}"
            merged[key] = dataclasses.replace(verdict, sentence=text)
        else:
            signs = _signs(verdict)
            rules = {**single.settled, **signs}
            doubtful = single.doubtful | (verdict.doubtful & signs.keys())
            merged[key] = dataclasses.replace(single, settled=rules, doubtful=doubtful)
    return list(merged.values())


def _summary(
    verdicts: Sequence[Verdict],
    channels: ByAxis,
    driven: Set[int],
    conventions: Conventions,
    remarks: list[str],
) -> Verification:
    assumed, values = conventions.to_dict(), conventions.to_dict()
    sure: dict[str, dict[int | str, list[int]]] = {}
    for verdict in reversed(verdicts):  # of doubtful values the first one counts
        # A job must not run on a sign that this log cannot tell.
        doubtful = verdict.doubtful & verdict.settled.keys() - _signs(verdict).keys()
        values |= {name: verdict.settled[name] for name in doubtful}
    for verdict in verdicts:
        for name in verdict.settled.keys() - verdict.doubtful:
            ways = sure.setdefault(name, {})
            ways.setdefault(verdict.settled[name], []).append(verdict.axis)
    fixed = frozenset(name for name, ways in sure.items() if len(ways) == 1)
    for name, ways in sorted(sure.items()):
        if name in fixed:
            values[name] = next(iter(ways))
        else:  # one file holds for all axes: no value of it would be right for each
            values[name] = assumed[name]
            words = " but ".join(
                f"{value} on {', '.join(f'A{axis}' for axis in axes)}"
                for value, axes in ways.items()
            )
            remarks.append(
                f"The axes contradict each other: {name} = {words}. It is not settled."
            )
    judged = {(verdict.axis, verdict.compensation) for verdict in verdicts}
    every = [(axis, name) for axis, parts in channels.items() for name in parts]
    missing = [f"A{axis}.{name}" for axis, name in every if (axis, name) not in judged]
    if missing:
        remarks.append(f"Not in this log: {', '.join(missing)}.")
    currents = {kind.name: kind for kind in kinds() if kind.adds_current}
    lengths = {each.axis for each in verdicts if each.compensation not in currents}
    blind = sorted(lengths - driven)
    for name in sorted({each.compensation for each in verdicts} & currents.keys()):
        own = filter(lambda rule: rule.startswith(currents[name].conventions), assumed)
        signs = " and ".join(rule for rule in own if rule.endswith("_sign"))
        remarks.append(
            "No log of a current tells whether the drive adds it with the right sign. Where it"
            f" does, what the controller itself asks for falls with the list on: then write {signs}"
            " with its present value under [verified] into the conventions file of the machine."
        )
    if blind:
        axes = ", ".join(f"A{axis}" for axis in blind)
        remarks.append(
            f"{axes}: a log of offsets cannot tell with which sign they reach the"
            " drive; log drive_position as well, or read a dial gauge."
        )
    order = (*COMPENSATIONS, *(kind.name for kind in kinds()))
    verdicts = sorted(verdicts, key=lambda v: (v.axis, order.index(v.compensation)))
    rules = Conventions.from_dict(values)
    return Verification(tuple(verdicts), tuple(remarks), rules, fixed)


def search_total(
    channels: Mapping[str, AbstractChannel], target: Target
) -> dict[str, Found]:
    """Return what explains each part of a sum, the others taken out of it.

    Starts from the factors of faults nearest to what a joint fit of all parts says, then looks
    at one part after the other until none changes.
    """
    columns = {name: fitted.column(fitted.plain) for name, fitted in channels.items()}
    rows = next(iter(channels.values())).motion.judged
    if names := [name for name, column in columns.items() if np.ptp(column[rows]) > 0]:
        free = [target.free_of(columns[name])[rows] for name in names]
        design, values = np.stack(free, axis=1), target.values[rows]
        factors = np.linalg.lstsq(design, values, rcond=None)[0]
        sizes = np.array([*SCALES])
        for name, factor in zip(names, factors, strict=True):
            columns[name] = columns[name] * sizes[np.argmin(np.abs(sizes - factor))]
    parts: dict[str, Found] = {}
    for _ in range(_SWEEPS):
        changed = False
        for name, channel in channels.items():
            others = [column for key, column in columns.items() if key != name]
            remainder = target.but(target.values - np.sum(others, axis=0))
            start = [parts[name].best] if name in parts else []
            fitted = search(channel, remainder, start)
            changed |= name not in parts or parts[name].best != fitted.best
            parts[name], columns[name] = fitted, fitted.column
        if not changed or len(channels) == 1:
            break
    return parts
