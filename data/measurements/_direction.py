"""From which side each target was approached, where the file does not say it.

In a standard cycle of ISO 230-2 the axis runs through the targets and back, and passes
beyond the last one before it returns: the last target is read twice, once from each
side.
"""

import dataclasses
from collections import Counter

import numpy as np
from jaxtyping import Float, Int

from ..signals import travel_direction
from ._convert import runs_against
from ._errors import DirectionUnknown, MeasurementError
from ._measurement import Measurement
from ._moving import is_log

_RESTARTS = 0.01
"""Share of rows (one in any case) in which a clock that goes back begins anew; in more, and rows
have no order."""


@dataclasses.dataclass(frozen=True)
class Directions:
    """Direction of approach per row, and how it was found.

    Attributes:
        values: +1 (towards larger positions) or −1 per row.
        source: ``column``, ``order of the targets`` or ``time``.
        remarks: What had to be taken for granted, one sentence each.
    """

    values: Int[np.ndarray, " t"]
    source: str
    remarks: tuple[str, ...] = ()


def derive_direction(measurement: Measurement, axis: str) -> Int[np.ndarray, " t"]:
    """Return the direction of approach, +1 or −1, per row; see `explain_direction`."""
    return explain_direction(measurement, axis).values


def explain_direction(measurement: Measurement, axis: str) -> Directions:
    """Return the direction of approach of each row and how it was found.

    The direction column where there is one. Else the order of the targets within each
    run (by time where there is a time): a target is approached in the direction of the
    last change of target; where a run turns and the target is read twice as often as
    the others, the second half belongs to the way back; the first target of a run,
    which nothing precedes, is approached in the direction in which the run goes on (the
    axis starts from beyond it). A recording of a motion, in which hardly a position
    comes back or rows follow each other within half a second, has the direction of motion
    by time.

    Raises:
        DirectionUnknown: With what to give, where it cannot be told.
        MeasurementError: If the column says the opposite of how the positions follow each
            other.
        MissingRole: If there is neither a direction nor a position of the axis.
    """
    role = f"{axis}.direction"
    if role in measurement.values:
        stated = measurement.values[role].astype(np.int64)
        _refuse_contradiction(measurement, axis, stated)
        return Directions(stated, "column")
    position = measurement.require(f"{axis}.position", "to derive the direction")
    run, time = measurement.get("run"), measurement.get("time")
    finder, valid = _Finder(measurement, axis), np.isfinite(position)
    if not valid.any() or np.ptp(position[valid]) == 0.0:
        reason = "all positions are equal"
        raise finder.unknown(reason)
    groups = _groups(finder, run, time, position.size)
    values = np.zeros(position.size, dtype=np.int64)
    # Recorded motion: positions hardly come back, or rows follow each other fast. Targets
    # come back, or there are runs.
    places = np.unique(position[valid]).size
    fresh = 2 * places > int(valid.sum()) > 20
    moving = run is None and time is not None and (fresh or is_log(measurement, axis))
    for group in groups:
        rows = group[valid[group]]
        path = position[rows]
        values[rows] = finder.motion(path) if moving else finder.targets(path, rows)
        # Where no position was read the axis is taken to go on as before.
        before = np.maximum.accumulate(np.where(valid[group], np.arange(len(group)), 0))
        values[group] = values[group[np.maximum(before, np.argmax(valid[group]))]]
    source = "time" if moving else "order of the targets"
    return Directions(values, source, tuple(dict.fromkeys(finder.remarks)))


def _refuse_contradiction(
    measurement: Measurement, axis: str, stated: Int[np.ndarray, " t"]
) -> None:
    position = measurement.get(f"{axis}.position")
    run, time = measurement.get("run"), measurement.get("time")
    if position is None or not (wrong := runs_against(position, stated, run, time)):
        return
    whole = run is None or len(wrong) == len(np.unique(run))
    runs = "" if whole else f"in run {', '.join(map(str, wrong))} "
    reason = (
        f"found {runs}'{axis}.direction' + where '{axis}.position' goes down from row to row and −"
        " where it goes up, expected one way of counting: state sign = -1 of the column"
        " that counts the other way than the axis (columns), or give the time of the rows"
        " where the newest one comes first"
    )
    raise MeasurementError(str(measurement.source), reason)


def _groups(
    finder: "_Finder", run: np.ndarray | None, time: np.ndarray | None, rows: int
) -> list[Int[np.ndarray, " _"]]:
    """Return the rows of each run in the order of measurement."""
    order = np.arange(rows)
    if run is None:
        if time is not None:
            _refuse_restart(finder, time)
        return [order if time is None else np.argsort(time, kind="stable")]
    groups = [order[run == number] for number in dict.fromkeys(run.tolist())]
    if time is not None:
        return [rows[np.argsort(time[rows], kind="stable")] for rows in groups]
    if (blocks := _passes_one_way(finder, run)) is not None:
        return blocks
    for group in groups:
        if group[-1] - group[0] + 1 != group.size:
            reason = (
                f"rows of run {run[group[0]]} stand between those of other runs, so "
                "their order is not that of the measurement"
            )
            raise finder.unknown(reason)
    return groups


def _passes_one_way(
    finder: "_Finder", run: np.ndarray
) -> list[Int[np.ndarray, " _"]] | None:
    """Return the rows of each pass where all runs forward stand above all runs back, or None."""
    starts = np.flatnonzero(np.diff(run) != 0) + 1
    blocks = np.split(np.arange(run.size), starts)
    if len(blocks) != 2 * len(np.unique(run)):
        return None
    position = finder.measurement.require(f"{finder.axis}.position", "")
    ways = [_way_of(position[rows]) for rows in blocks]
    for number in np.unique(run):
        if {
            w for w, rows in zip(ways, blocks, strict=True) if run[rows[0]] == number
        } != {-1, 1}:
            return None
    return blocks


def _way_of(path: Float[np.ndarray, " n"]) -> int:
    """Return ±1 for positions that only rise or fall, else 0."""
    steps = np.unique(np.sign(np.diff(path)))
    return int(steps[0]) if len(steps) == 1 else 0


def restart_of(
    time: Float[np.ndarray, " t"], run: Int[np.ndarray, " t"] | None = None
) -> int | None:
    """Return the row in which a clock begins anew, or None: by it rows of both would be mixed.

    Args:
        time: In s, NaN = not known. Where it goes back in many rows, rows have no order; where
            all that follows is earlier, the newest rows come first.
        run: Of each row: a clock that begins anew with each run does so in many rows.
    """
    known = np.flatnonzero(np.isfinite(time))
    back = np.flatnonzero(np.diff(time[known]) < 0) + 1
    each = run is not None and bool(
        (run[known[back]] != run[known[np.maximum(back, 1) - 1]]).all()
    )
    if not each and back.size > max(1.0, _RESTARTS * known.size):
        return None
    parts = np.split(time[known], back)
    for start, earlier, later in zip(back, parts, parts[1:], strict=False):
        if later.max() > earlier.min():
            return int(known[start])
    return None


def _refuse_restart(finder: "_Finder", time: Float[np.ndarray, " t"]) -> None:
    """Raise where the clock begins anew."""
    if (row := restart_of(time)) is not None:
        reason = (
            f"the time goes back in line {finder.measurement.lines[row]}: these are"
            " two recordings, or rows written twice"
        )
        raise finder.unknown(reason)


class _Finder:
    """Directions along one run; collects remarks."""

    def __init__(self, measurement: Measurement, axis: str) -> None:
        self.measurement, self.axis = measurement, axis
        self.remarks: list[str] = []

    def unknown(self, reason: str) -> DirectionUnknown:
        """Return the error that says why, and what to give."""
        advice = (
            f"give '{self.axis}.direction' (+1 or -1 per row), or the rows in the "
            "order of measurement with a 'run' or 'time' column"
        )
        sentence = f"direction of {self.axis} cannot be derived: {reason}; {advice}"
        return DirectionUnknown(str(self.measurement.source), sentence)

    def motion(self, path: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Return the sign of the last motion; at rest it is held."""
        steps = np.diff(path)
        if not steps.any():
            reason = "the axis never moves"
            raise self.unknown(reason)
        if steps[0] == 0.0:
            self.remarks.append(
                "Rows before the first motion are taken in its direction."
            )
        signs = travel_direction(path)
        if not signs.any():
            reason = "the axis goes no further than its position flickers"
            raise self.unknown(reason)
        return signs

    def targets(
        self, path: Float[np.ndarray, " n"], rows: Int[np.ndarray, " n"]
    ) -> Int[np.ndarray, " n"]:
        """Return the direction of approach per reading of one run of targets."""
        starts = np.flatnonzero(np.diff(path, prepend=np.nan) != 0.0)
        if starts.size < 2:
            reason = f"a run has only one target ({path[0]:g})"
            raise self.unknown(reason)
        sizes = np.diff(np.append(starts, path.size))
        steps = np.sign(np.diff(path[starts])).astype(np.int64)
        arrive = np.concatenate([steps[:1], steps])  # first: as the run goes on
        leave = np.concatenate([steps, steps[-1:]])
        self.remarks.append(
            "The first target of each run is taken as approached in the direction in "
            "which the run goes on."
        )
        returns = _idle_returns(path[starts], steps)
        if returns.size:
            arrive[returns] = leave[returns]
            self.remarks.append(
                "Steps back over several targets are taken as returns without a "
                "reading; the next target counts as the start of a new pass."
            )
        usual = self._usual_size(sizes, arrive, leave, returns)
        ends = {0, sizes.size - 1}
        signs = np.empty(path.size, dtype=np.int64)
        for block, (start, size) in enumerate(zip(starts, sizes, strict=True)):
            signs[start : start + size] = arrive[block]
            turns = arrive[block] != leave[block]
            if not turns and block not in ends:
                continue
            if turns and size == 2 * usual:  # from both sides, with an overrun between
                signs[start + usual : start + size] = leave[block]
            elif size != usual:
                line = self.measurement.lines[rows[start]]
                where = "where the run turns" if turns else "at an end of the run"
                reason = (
                    f"line {line}: target {path[start]:g}, {where}, is read {size} "
                    f"times in a row and the others {usual} times"
                )
                raise self.unknown(reason)
        return signs

    def _usual_size(
        self,
        sizes: np.ndarray,
        arrive: np.ndarray,
        leave: np.ndarray,
        returns: np.ndarray,
    ) -> int:
        """Return how often a target is read per pass, as is usual away from turns."""
        inner = arrive == leave
        inner[[0, -1]] = False
        inner[returns] = False
        chosen = sizes[inner] if inner.any() else sizes[[0, -1]]
        counts = Counter(chosen.tolist()).most_common()
        return int(min(size for size, count in counts if count == counts[0][1]))


def _idle_returns(
    visited: Float[np.ndarray, " b"], steps: Int[np.ndarray, " _"]
) -> Int[np.ndarray, " _"]:
    """Return the blocks that begin a new pass after a return without readings.

    A sawtooth: every pass runs from neighbour to neighbour in one direction, and only the
    jumps back, over at least one target, run in the other.
    """
    place = np.unique(visited, return_inverse=True)[1].astype(np.int64)
    jumps = np.diff(place)
    far = np.abs(jumps) > 1
    if not far.any() or far.all():
        return np.array([], dtype=np.int64)
    forward = np.unique(steps[~far])
    if forward.size != 1 or np.any(steps[far] == forward[0]):
        return np.array([], dtype=np.int64)
    return np.flatnonzero(far) + 1
