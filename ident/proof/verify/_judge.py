"""From what the search found to a verdict in the words of the interface."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ._channel import AbstractChannel
from ._hypothesis import RULES, Hypothesis, fault_words, joined, other_rules
from ._log import RESOLUTION
from ._search import EQUAL, Found, independent_of

SETTLED = 2.0 * math.log(1000.0)
"""Difference of criteria from which on a convention is settled: odds of 1000 to 1."""

_BLOCK = 64
"""Rows over which noise is averaged out before what is left is called systematic."""

_IDLE = 0.05
"""Share of rows without any offset from which on it may have been switched off meanwhile."""
_TIMES = {"lag", "filter"}
"""Faults that a log which is too coarse makes up."""
_FEWEST, _LEAST = 5, 3
"""Rows of a log, and rows near a node, that tell of it."""
_SURE, _FAR = 3.0, 6.0
"""Deviations of a mean near a node from which on it is told, and contradicts."""
_NOTHING = 0.1
"""Share of what a list says that is none of it, where it is no unit."""
_REVERSED = 0.5
"""Share of the difference of a table's directions from which on it is missing, or there twice."""
_ROUGH = 0.25
"""Share of an offset that may be left unexplained before it is said not to agree."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a controller does with one compensation of one axis.

    Attributes:
        axis: Logical number.
        compensation: As in a job file.
        verdict: ``agrees``, or the faults; empty where the log cannot tell.
        value: Of each word: factor; mm or °; cycles; None where there is none. Of
            ``agrees``: mm or ° within which it does.
        sentence: For the person at the machine.
        settled: Values of the conventions that fit.
        doubtful: Of these, the ones that the log does not settle.
        absent: Nothing is added.
    """

    axis: int
    compensation: str
    verdict: tuple[str, ...]
    value: tuple[float | None, ...]
    sentence: str
    settled: Mapping[str, int | str]
    doubtful: frozenset[str] = frozenset()
    absent: bool = False

    @property
    def agrees(self) -> bool:
        """Whether the controller does what the lists say."""
        return self.verdict == ("agrees",)


def judge_channel(result: Found, signed: bool, turned: str = "") -> Verdict:
    """Return the verdict on one compensation.

    Args:
        result: What explains it.
        signed: Whether what was explained tells the sign that it has at the drive.
        turned: What may as well be the reason of an opposite sign; empty: nothing.
    """
    channel, best, faults = result.channel, result.rivals[0], result.faults
    identity = channel.axis, channel.compensation

    def verdict(found: Mapping[str, float | None], sentence: str) -> Verdict:
        words, sizes = (*found,), (*found.values(),)
        return Verdict(*identity, words, sizes, sentence, *settled(result, signed))

    def silent(sentence: str) -> Verdict:
        return Verdict(*identity, (), (), sentence, {})

    rows = channel.motion.judged
    count = len(result.residual)
    if count < _FEWEST:
        return silent(f"the log cannot tell: {count} rows, expected {_FEWEST} or more")
    if float(np.max(np.abs(channel.column(channel.plain)[rows]))) <= 1e-6:
        words = "on this motion the list adds nothing that changes"
        return silent(f"the log cannot tell: {words}")
    added = float(np.max(np.abs(result.column[rows])))
    idle = best.hypothesis.is_free and abs(best.hypothesis.scale) <= _NOTHING
    if channel.one.kind.adds_current:
        # Logged in amperes it is a small part of what the list says, and all that is logged.
        left = float(np.max(np.abs(result.residual)))
        idle = idle and left > _NOTHING * added
    if idle or added <= RESOLUTION or result.nothing < best.criterion - EQUAL:
        # Digits of a drive's position follow any table a little, turned and shifted.
        text = "nothing is added: not active, or not logged"
        return dataclasses.replace(silent(text), absent=True)
    unexplained = systematic(result.residual)
    if channel.motion.time is None:
        # Rows stand in any order: neighbours say nothing of noise.
        unexplained = float(np.sqrt(np.mean(np.square(result.residual))))
    size = float(np.sqrt(np.mean(np.square(result.column[rows]))))
    limit = max(_ROUGH * size, 1e-4)
    if result.nothing < best.criterion + EQUAL and unexplained <= limit:
        return silent("the log cannot tell: what is added is lost in its noise")
    whole_text = fault_words(best.hypothesis, channel)
    if unexplained > limit:
        logged = result.residual + result.column[rows]
        whole = max(unexplained, float(np.sqrt(np.mean(np.square(logged)))))
        left_over, effect = _size_of(channel, unexplained), _size_of(channel, whole)
        text = f"not explained: {left_over} of {effect} follow no rule that was tried"
        if faults and unexplained < whole:
            text += f" (nearest: {whole_text})"
        still = np.abs(logged) < RESOLUTION / 100.0
        if still.mean() > _IDLE and channel.acting is None:
            text += (
                f"; {100.0 * still.mean():.0f} % of the rows hold exactly 0: where it was"
                " switched meanwhile, log one state only"
            )
        return silent(text)
    if reversal := reversal_words(result, 0.0 if channel.two_way else _ROUGH * size):
        return silent(f"not explained: {reversal}")
    named_rules = [
        f"{name} = {value}"
        for name, value in other_rules(best.hypothesis.change, channel.plain).items()
        if name not in RULES
    ]
    rules = f" with {joined(named_rules)}" if named_rules else ""
    equals, unseen = _equals(result), _unseen(result)
    tail = f"; this log does not show {joined(unseen)}" if unseen else ""
    worst = worst_of(result)
    if not faults and worst.beyond(_ROUGH * size):
        return silent(
            f"not explained: {_size_of(channel, worst.left)} near {worst.where}, as if an"
            " entry there were another; elsewhere it agrees"
        )
    if not faults:
        left = worst.left if worst.left > _SURE * worst.noise else 0.0
        left = max(unexplained, left)
        tolerance = max(1e-4, math.ceil(left * 1e4 - 1e-6) / 1e4)
        text = f"agrees within {_size_of(channel, tolerance)}{rules}"
        agreed: dict[str, float | None] = {"agrees": tolerance}
        for hypothesis in equals:
            text += f"; as well explained: {fault_words(hypothesis, channel)}"
            agreed |= dict.fromkeys(hypothesis.faults(channel))
        return verdict(agreed, text if equals else text + tail)
    if channel.coarse and faults.keys() & _TIMES:
        told = {word: size for word, size in faults.items() if word not in _TIMES}
        words = f"the log cannot tell when it comes: {channel.coarse}"
        named = [fault_words(best.hypothesis, channel, told)] if told else []
        return verdict(told, "; ".join([*named, words]))
    text = whole_text + rules + (turned if "sign" in faults else "")
    for hypothesis in equals:
        text += f", or as well {fault_words(hypothesis, channel)}"
        faults |= hypothesis.faults(channel) | faults
    return verdict(faults, text + _looks_alike(result, {*faults}) + tail)


def _equals(result: Found) -> list[Hypothesis]:
    """Return hypotheses of other faults that explain the log as well as the best one."""
    best, *others = result.rivals
    known_faults, equals = [{*result.faults}], list[Hypothesis]()
    for rival in others:
        words = {*rival.hypothesis.faults(result.channel)}
        if rival.criterion > best.criterion + EQUAL or not words:
            continue
        if not any(words >= fewer for fewer in known_faults):
            known_faults.append(words)
            equals.append(rival.hypothesis)
    return equals


def _looks_alike(result: Found, named: set[str]) -> str:
    """Return what would look like a delay, or like a filter, as the end of a sentence.

    On a smooth table both do the same, and which of them is the simpler story says
    nothing of the controller.
    """
    (best, *others), faults, channel = result.rivals, {*result.faults}, result.channel
    for rival in others if _TIMES & faults else ():
        words = {*rival.hypothesis.faults(channel)}
        if words ^ faults == _TIMES and rival.misfit <= best.misfit + EQUAL:
            if text := fault_words(rival.hypothesis, channel, _TIMES - named):
                return f"; on this table it looks the same when {text}"
    return ""


def _unseen(result: Found) -> list[str]:
    """Return what could be otherwise without being seen in this log."""
    (best, *worse), channel = result.rivals, result.channel
    differences = [
        best.hypothesis.apart(rival.hypothesis)
        for rival in worse
        if rival.misfit < best.misfit + EQUAL
    ]
    # Whatever factor and lag go with them.
    essential = [names - {"lag", "scale", "is_free"} for names in differences]
    filtered = channel.cycles_under(channel.conventions) > 1
    two = len(channel.ways) == 2
    questions = {
        "edge": ("what happens beyond the table", {"edge"} in differences),
        "swapped": ("which master is which", two and {"masters"} in essential),
        "lag": ("how late it comes", {"lag"} in differences),
        "filter": ("the length of the filter", {"cycles"} in essential and filtered),
    }
    return [
        text
        for word, (text, is_open) in questions.items()
        if is_open and word not in result.faults
    ]


def settled(result: Found, signed: bool) -> tuple[dict[str, int | str], frozenset[str]]:
    """Return the conventions that fit, a sign among them or not, and the unsettled ones.

    A table that lies elsewhere settles its sign alone, since not every rule is tried there; one
    with any other factor settles nothing.
    """
    channel, best = result.channel, result.rivals[0]
    elsewhere, any_factor = best.hypothesis.change.is_shifted, best.hypothesis.is_free
    assumed, edge = channel.conventions.to_dict(), channel.edge_rule
    sign = f"{channel.compensation}_sign"

    def rule(hypothesis: Hypothesis, name: str) -> int | str:
        conventions = hypothesis.change.conventions
        if name == sign:
            return int(assumed[sign]) * (1 if hypothesis.scale > 0 else -1)
        if name == edge:
            return hypothesis.change.edge or channel.edge(conventions)
        value: int | str = getattr(conventions, name)
        return value

    values: dict[str, int | str] = {}
    doubtful: set[str] = set()
    for name in filter(assumed.__contains__, (*channel.relevant, sign, edge)):
        chosen = rule(best.hypothesis, name)
        opposed = [
            rival.criterion
            for rival in result.rivals
            if rule(rival.hypothesis, name) not in (chosen, "line")
        ]
        if chosen == "line" or not opposed:
            continue
        values[name] = chosen
        unsure = any_factor or (elsewhere and name != sign)
        if unsure or min(opposed) - best.criterion < SETTLED:
            doubtful.add(name)
    if not signed:
        values.pop(sign, None)
    return values, frozenset(doubtful)


@dataclasses.dataclass(frozen=True)
class Worst:
    """What is left most near any node of a table.

    Attributes:
        left: In mm or °.
        noise: Deviation of that.
        where: The place, in words.
    """

    left: float = 0.0
    noise: float = 0.0
    where: str = ""

    def beyond(self, limit: float) -> bool:
        """Return whether it is more than a limit, and no noise."""
        return self.left > max(limit, _FAR * self.noise)


def worst_of(result: Found, readings: Float[np.ndarray, " e"] | None = None) -> Worst:
    """Return what is left most near any node: over a whole log one wrong entry hardly shows.

    `readings` are how many each row that is judged is the mean of; None: one each.
    """
    from scipy.ndimage import mean, median

    channel = result.channel
    masters = channel.masters[-len(channel.ways) :]
    if not channel.ways or not masters:
        return Worst()
    motion, rows = channel.motion, channel.motion.judged
    places = [motion.position(axis, "to judge the table")[rows] for axis in masters]
    cells = [
        np.rint((place - way.low) / way.step)
        for place, way in zip(places, channel.ways, strict=True)
    ]
    _, first, cell = np.unique(
        np.stack(cells, axis=1), axis=0, return_index=True, return_inverse=True
    )
    weight = np.ones(len(cell)) if readings is None else readings
    labels = cell.reshape(-1)
    count = np.bincount(labels, weight)
    if np.max(count) < _LEAST:
        return Worst()
    # Of readings the median: a wild one is no entry.
    middle = mean if readings is None else median
    left = np.abs(middle(result.residual, labels, np.arange(len(count))))
    scatter = np.abs(result.residual - np.median(result.residual)) * np.sqrt(weight)
    noise = max(1.4826 * float(np.median(scatter)), RESOLUTION) / np.sqrt(
        np.maximum(count, 1.0)
    )
    worst = int(np.argmax(np.where(count >= _LEAST, left / noise, 0.0)))
    words = (
        f"{motion.name(axis)} = {way.low + way.step * line[first[worst]]:.4g}"
        for axis, way, line in zip(masters, channel.ways, cells, strict=True)
    )
    return Worst(float(left[worst]), float(noise[worst]), ", ".join(words))


def reversal_words(result: Found, least: float) -> str:
    """Return what is left between the directions of motion, in words; empty: no more than chance.

    Of a table with a column for each direction that is their difference, which may be missing or
    there once more; of any other a step. `least` is how large it must be at the rows, as an rms in
    mm or °.
    """
    channel, change, rows = result.channel, result.best.change, result.rows
    motion = channel.motion
    if not channel.ways or not {channel.axis} & {*motion.directions, *motion.positions}:
        return ""
    judged = np.arange(motion.rows)[motion.judged]
    residual = result.residual[np.isin(judged, rows)]
    if channel.two_way:
        other = dataclasses.replace(change, turned=not change.turned)
        half = (
            0.5 * result.best.scale * (channel.column(change) - channel.column(other))
        )
    else:
        half = channel.share(change) - 0.5
    half = half[rows] - np.mean(half[rows])
    power = float(half @ half)
    if not power:
        return ""
    factor = float(half @ residual) / power
    rest = residual - factor * half
    samples = independent_of(channel, rows, rest)
    noise = max(float(np.std(rest)), RESOLUTION) / math.sqrt(samples)
    left = abs(factor) * math.sqrt(power / len(rows))
    if left <= max(least, _FAR * noise):
        return ""
    between = _size_of(channel, 2.0 * left)
    if not channel.two_way:
        return f"{between} lie between the directions, which this table does not tell apart"
    if factor <= -_REVERSED:
        return (
            f"{between} are missing between the directions, as if one column of the table"
            " served both"
        )
    if factor >= _REVERSED:
        return (
            f"{between} too many lie between the directions, as if the backlash were"
            " compensated twice"
        )
    return ""


def systematic(residual: Float[np.ndarray, " r"]) -> float:
    """Return the rms of what is left in mm or ° once noise is averaged out."""
    count = len(residual) // _BLOCK
    if count < 4:
        return float(abs(np.mean(residual)))
    blocks = residual[: count * _BLOCK].reshape(count, _BLOCK)
    means = blocks.mean(axis=1)
    noise = float(np.mean(np.var(blocks, axis=1, ddof=1))) / _BLOCK
    return math.sqrt(max(0.0, float(np.mean(np.square(means))) - noise))


def _size_of(channel: AbstractChannel, length: float) -> str:
    if channel.one.kind.adds_current:
        return f"{length:.2g} drive units"
    if channel.axis in channel.motion.ranges:
        return f"{length:.4f}°"
    return f"{1e3 * length:.1f} µm"
