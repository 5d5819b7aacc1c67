"""What goes in and what comes out: readings of a machine, and what they ask for."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from ...data.errors import FoundError
from .._recording import CHANNELS, Columns, JointData, stacked

Verdict = Literal["the kernel cannot express this", "the data cannot tell"]


class DiscoverError(FoundError):
    """Measurements in which no compensation can be looked for."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Observed(JointData):
    """Readings of a machine; NaN = not measured in this row, no key = never.

    Time may be None: the rows then only have an order.

    Attributes:
        run: Number of the run or set-up of each row.
        source: Number of the measurement of each row: each has a zero of its own.
        current: In the unit of the drive, by axis.
        rotary: Axes whose positions are angles.
        modulo: Range of the axes that go round.
    """

    run: Int[np.ndarray, " t"]  # pyright: ignore[reportGeneralTypeIssues]
    source: Int[np.ndarray, " t"]
    current: Columns = dataclasses.field(default_factory=dict)
    rotary: frozenset[str] = frozenset()
    modulo: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)

    channels = (*CHANNELS, "current")

    @property
    def clock(self) -> Float[np.ndarray, " t"]:
        """Instants, those between known ones where one was missed; without, the row numbers."""
        number = np.arange(len(self), dtype=float)
        finite = np.isfinite(number if self.time is None else self.time)
        if self.time is None or not finite.any():
            return number
        return np.asarray(np.interp(number, number[finite], self.time[finite]))

    def unit(self, axis: str) -> str:
        """Return the unit of positions and errors of an axis."""
        return "°" if axis in self.rotary else "mm"


def stack(parts: Sequence[Observed]) -> Observed:
    """Return the rows of recordings, one at least, one after the other.

    Runs and sources stay apart, and each clock starts where the one before has ended.
    """
    counts = [len(part) for part in parts]
    owner = np.repeat(np.arange(len(parts)), counts)

    def numbered(labels: Sequence[np.ndarray]) -> Int[np.ndarray, " t"]:
        pairs = np.stack([owner, np.concatenate(labels)])
        return np.unique(pairs, axis=1, return_inverse=True)[1].reshape(-1)

    clocks, start = [], 0.0
    for part in parts:
        clocks.append(part.clock - part.clock.min(initial=np.inf) + start)
        start = float(clocks[-1].max(initial=start)) + 1.0
    return Observed(
        time=None if any(p.time is None for p in parts) else np.concatenate(clocks),
        clock_number=None,
        own_zero=None,
        run=numbered([part.run for part in parts]),
        source=numbered([part.source for part in parts]),
        rotary=frozenset().union(*(part.rotary for part in parts)),
        modulo={key: span for part in parts for key, span in part.modulo.items()},
        **{channel: stacked(parts, channel, counts) for channel in Observed.channels},
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """What an error (or a current) shows.

    Attributes:
        axis: Whose error (or current) shows it.
        masters: Other axes that it depends on; of crosstalk first the one that
            accelerates, then those whose positions adapt it.
        rms: Contribution in mm, ° or the unit of the current.
        share: Of the mean square of the error (or the current), 0 to 1.
        unit: Of `rms`.
        sentence: In words.
    """

    axis: str
    masters: tuple[str, ...]
    rms: float
    share: float
    unit: str
    sentence: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Found(Finding):
    """A compensation that the measurements ask for.

    Attributes:
        compensation: As the job file calls it.
        sensor: Temperature that it follows; None where there is none, or two.
        stability: Share of the resamples in which it was selected.
        keys: What the job file says of it beyond axis and measurement.
        group: Name of the fits that overlap with it, or None.
    """

    compensation: str
    sensor: str | None
    stability: float
    keys: Mapping[str, object]
    group: str | None

    @property
    def sensors(self) -> tuple[str, ...]:
        """Temperatures that it follows."""
        sensors = self.keys.get("sensors")
        if isinstance(sensors, Mapping):
            return tuple(dict.fromkeys(map(str, sensors.values())))
        return () if self.sensor is None else (self.sensor,)


@dataclasses.dataclass(frozen=True)
class Rejected:
    """A compensation that was looked for and is not needed, or could not be seen."""

    compensation: str
    axis: str
    masters: tuple[str, ...]
    sensor: str | None
    reason: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class Unexplained(Finding):
    """Structure that no compensation takes away, or that several could.

    Attributes:
        what: Short name.
        verdict: Why it stays.
    """

    what: str
    verdict: Verdict


@dataclasses.dataclass(frozen=True)
class Drift:
    """A slow change of the error in time that nothing that was found explains.

    Attributes:
        axis: Whose error shows it.
        source: Number of the measurement in which it does.
        pieces: Straight pieces in time that follow it, for the fit to allow for.
        rms: In mm or ° about its mean.
        unit: Of `rms`.
        sentence: In words.
    """

    axis: str
    source: int
    pieces: int
    rms: float
    unit: str
    sentence: str


@dataclasses.dataclass(frozen=True)
class AxisSummary:
    """The error (or current) of one axis as a whole.

    Attributes:
        axis: Its name.
        channel: ``error`` or ``current``.
        rows: Readings.
        rms: Before anything is taken away.
        noise: Scatter about all that was found.
        unit: Of both.
    """

    axis: str
    channel: str
    rows: int
    rms: float
    noise: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Discovery:
    """What a machine asks for; ranked by share within each axis.

    Attributes:
        axes: Errors and currents as they are.
        found: Compensations that are needed.
        rejected: Compensations that are not, or could not be seen.
        unexplained: What stays, or what several could explain.
        drifts: Slow changes in time.
    """

    axes: tuple[AxisSummary, ...]
    found: tuple[Found, ...] = ()
    rejected: tuple[Rejected, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    drifts: tuple[Drift, ...] = ()

    @classmethod
    def of(cls, parts: "Sequence[Discovery]") -> "Discovery":
        """Return the findings of several axes and drives one after the other."""
        names = [field.name for field in dataclasses.fields(cls)]
        entries = [[e for part in parts for e in getattr(part, name)] for name in names]
        return cls(*map(tuple, entries))

    @property
    def confused(self) -> tuple[Unexplained, ...]:
        """What the data show and cannot tell apart."""
        doubt: Verdict = "the data cannot tell"
        return tuple(part for part in self.unexplained if part.verdict == doubt)
