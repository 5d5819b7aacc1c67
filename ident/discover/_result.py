"""What was found in the measurements of a machine."""

import dataclasses
from collections.abc import Mapping
from typing import Literal

Verdict = Literal["the kernel cannot express this", "the data cannot tell"]


@dataclasses.dataclass(frozen=True)
class Found:
    """A compensation that the measurements ask for.

    Attributes:
        compensation: As the job file calls it.
        axis: Axis to compensate.
        masters: Other axes that it depends on; of crosstalk first the one that
            accelerates, then those whose positions adapt it.
        sensor: Temperature that it follows; None where there is none, or two.
        share: Of the mean square of the error (or of the current), 0 to 1.
        rms: Contribution in mm, ° or the unit of the current.
        stability: Share of the resamples in which it was selected.
        unit: Of `rms`.
        keys: What the job file says of it beyond axis and measurement.
        group: Name of the fits that overlap with it, or None.
        sentence: In words.
    """

    compensation: str
    axis: str
    masters: tuple[str, ...]
    sensor: str | None
    share: float
    rms: float
    stability: float
    unit: str
    keys: Mapping[str, object]
    group: str | None
    sentence: str


@dataclasses.dataclass(frozen=True)
class Rejected:
    """A compensation that was looked for and is not needed, or could not be seen."""

    compensation: str
    axis: str
    masters: tuple[str, ...]
    sensor: str | None
    reason: str


@dataclasses.dataclass(frozen=True)
class Unexplained:
    """Structure that no compensation takes away, or that several could.

    Attributes:
        axis: Whose error (or current) shows it.
        what: Short name.
        masters: Other axes that it depends on.
        rms: Its size in mm, ° or the unit of the current.
        share: Of the mean square of the error (or the current), 0 to 1.
        unit: Of `rms`.
        verdict: Why it stays.
        sentence: In words.
    """

    axis: str
    what: str
    masters: tuple[str, ...]
    rms: float
    share: float
    unit: str
    verdict: Verdict
    sentence: str


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
    """What a machine asks for; ranked by share within each axis."""

    axes: tuple[AxisSummary, ...]
    found: tuple[Found, ...]
    rejected: tuple[Rejected, ...]
    unexplained: tuple[Unexplained, ...]
    drifts: tuple[Drift, ...] = ()

    @property
    def told(self) -> bool:
        """Whether the data tell apart all that they show."""
        return all(each.verdict != "the data cannot tell" for each in self.unexplained)
