"""A fit of a group before its measurement is looked at: what all kinds have in common."""

import abc
import dataclasses

import numpy as np
from jaxtyping import Float

from ...fit.joint import AbstractEffect
from .._draft import AbstractDraft, AxisLists
from .._fit_schema import FitSpec
from .._load import Job
from ._recording import GroupRecording
from ._share import Share


@dataclasses.dataclass(frozen=True)
class AbstractMember(abc.ABC):
    """One fit of a group.

    Attributes:
        index: Of the fit in the job.
        lists: What the axis has already.
    """

    index: int
    lists: AxisLists

    @property
    @abc.abstractmethod
    def spec(self) -> FitSpec:
        """Its specification."""

    @property
    def axis(self) -> str:
        """The compensated axis."""
        return self.spec.axis

    @property
    def name(self) -> str:
        """Compensation and axis, for messages."""
        return f"{self.spec.compensation} of {self.axis}"

    @property
    def positions(self) -> tuple[str, ...]:
        """Axes whose positions it uses."""
        return ()

    @property
    def turning(self) -> tuple[str, ...]:
        """Axes whose direction of motion it uses."""
        return ()

    @property
    def accelerating(self) -> tuple[str, ...]:
        """Axes whose velocity and acceleration it uses."""
        return ()

    @property
    def sensors(self) -> tuple[str, ...]:
        """Temperatures that it uses."""
        return ()

    @property
    def holds_constant(self) -> bool:
        """Whether its list can hold a constant error of the axis."""
        return False

    def unfit(self, recording: GroupRecording) -> str:
        """Return why these readings tell nothing of it, whatever they are; else nothing."""
        return ""

    @abc.abstractmethod
    def effect(
        self,
        job: Job,
        recording: GroupRecording,
        left: Float[np.ndarray, " t"] | None,
    ) -> AbstractEffect | None:
        """Return the effect; None where its form needs what the other effects leave.

        Args:
            job: The job.
            recording: What was measured.
            left: Error of the axis that the other effects leave, where that is known.

        Raises:
            FitError: If the readings do not tell its form.
        """

    @abc.abstractmethod
    def draft(self, job: Job, share: Share) -> AbstractDraft:
        """Return its draft.

        Raises:
            FitError: If the readings cannot carry it.
            ExchangeError: If it fits no list.
        """
