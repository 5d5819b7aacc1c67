"""The clock of a recording: sample time, jitter, jumps, continuous segments."""

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float

from ._errors import SignalError, check_lengths
from ._noise import NORMAL
from ._order import median

_JUMP = 0.5
"""Share of the sample time by which a step must differ to be a jump, at least."""
_JITTER = 6.0
"""Robust standard deviations of the steps by which it must differ besides."""
_SHUFFLED = 1.0 / 3.0
"""Share of steps back from which on samples are in no order, and nothing moves."""

_KINDS = {
    "gap": ("gap", "gaps"),
    "back": ("jump back", "jumps back"),
    "repeat": ("repeated time", "repeated times"),
    "short": ("short step", "short steps"),
}


@dataclasses.dataclass(frozen=True)
class Jump:
    """A step of the clock that is none of a sample.

    Attributes:
        row: First sample behind it.
        step: Seconds from the sample before.
        kind: ``gap`` (samples are missing), ``back``, ``repeat`` (the same time twice)
            or ``short``.
    """

    row: int
    step: float
    kind: str


@dataclasses.dataclass(frozen=True)
class Clock:
    """How the times of a recording run.

    Attributes:
        sample_time: Usual step in s.
        jitter: Standard deviation of the steps about it in s, jumps aside.
        jumps: In order.
        segments: Rows between jumps; together they are all rows.
        statement: All this in words.
    """

    sample_time: float
    jitter: float
    jumps: tuple[Jump, ...]
    segments: tuple[slice, ...]
    statement: str

    @property
    def uniform(self) -> bool:
        """Whether steps within segments are equal to 5 % of the sample time."""
        return self.jitter <= 0.05 * self.sample_time


def read_clock(time: Float[np.ndarray, " t"]) -> Clock:
    """Return how times in s run, and where they jump.

    A step counts as a jump where it differs from the usual one (the median) by half of
    it, and by more than six robust standard deviations of all steps: recorders that
    alternate between 10 and 12 ms do not jump.

    Raises:
        SignalError: If there are fewer than three times, none rises or many go back.
    """
    check_lengths("clock", time.size, least=3)
    steps = time[1:] - time[:-1]
    rising = steps > 0.0
    check_lengths("rising steps of the clock", int(rising.sum()), least=1)
    back = int(np.count_nonzero(steps < 0.0))
    if back > _SHUFFLED * steps.size:
        what, found = "clock", f"{back} of {steps.size} steps that go back"
        raise SignalError(what, found, "samples in the order of their times")
    usual = median(steps[rising])
    deviation = np.abs(steps - usual)
    spread = NORMAL * median(deviation[rising])
    bound = max(_JUMP * usual, _JITTER * spread)
    even = deviation <= bound
    rows = 1 + np.flatnonzero(~(even & rising))
    regular = steps[even]
    # The result of `np.std`, a call of which takes longer than all the rest here.
    about = regular - regular.sum() / max(regular.size, 1)
    jitter = math.sqrt((about * about).sum() / max(regular.size, 1))
    jumps = tuple(
        Jump(int(row), float(steps[row - 1]), _kind(float(steps[row - 1]), usual))
        for row in rows
    )
    ends = [0, *rows.tolist(), time.size]
    segments = tuple(slice(a, b) for a, b in itertools.pairwise(ends))
    return Clock(usual, jitter, jumps, segments, _words(usual, jumps))


def _kind(step: float, usual: float) -> str:
    if step > usual:
        return "gap"
    if step > 0.0:
        return "short"
    return "repeat" if step == 0.0 else "back"


def _words(usual: float, jumps: tuple[Jump, ...]) -> str:
    rate = f"one sample every {1e3 * usual:.4g} ms"
    if not jumps:
        return f"{rate}, without a jump"
    counts = []
    for kind, (singular, plural) in _KINDS.items():
        count = sum(jump.kind == kind for jump in jumps)
        if count:
            counts.append(f"{count} {singular if count == 1 else plural}")
    worst = max(jumps, key=lambda jump: abs(jump.step - usual))
    largest = f"the largest of {worst.step:.4g} s before sample {worst.row + 1}"
    return f"{rate}, with {', '.join(counts)}; {largest}"
