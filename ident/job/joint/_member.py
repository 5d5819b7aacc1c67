"""A fit of a group before its measurement is looked at: what all kinds have in common."""

import abc
import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...fit.joint import AbstractEffect, JointData, JointFit, Part, Temperature
from ...readings import Tables
from .._draft import AbstractDraft, AbstractOfFit
from ._recording import GroupRecording
from ._share import Share, lost

_MOST = 10_000
"""Readings that are enough to see what goes together."""


@dataclasses.dataclass(frozen=True)
class AbstractMember(AbstractOfFit):
    """One fit of a group."""

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
    def takes_constant(self) -> bool:
        """Whether its list can hold a constant error of the axis."""
        return self.fit.kind.takes_constant is not None

    @property
    def takes_line(self) -> bool:
        """Whether its list can hold a line over the position of the axis."""
        return False

    @property
    def needs_line(self) -> bool:
        """Whether it shows what is its own only beside such a line."""
        return False

    def unfit(self, recording: GroupRecording) -> str:
        """Return why these readings tell nothing of it, whatever they are; else nothing."""
        return ""

    def undetermined(self, data: JointData) -> str:
        """Return why the motion of its masters does not tell it; else nothing."""
        return ""

    def confused(
        self, members: Sequence["AbstractMember"], recording: GroupRecording
    ) -> str:
        """Return with what that no fit stands for the readings confuse it; else nothing.

        Args:
            members: All that are fitted to these readings.
            recording: What was measured.
        """
        return ""

    def may_be_written(self, part: Part, fit: JointFit) -> bool:
        """Return whether the readings tell its part of the joint fit."""
        return bool(part.determined.any()) and not lost(part, fit)

    @abc.abstractmethod
    def effect(
        self, recording: GroupRecording, left: Float[np.ndarray, " t"] | None
    ) -> AbstractEffect | None:
        """Return the effect; None where its form needs what the other effects leave.

        Args:
            recording: What was measured.
            left: Error of the axis that the other effects leave, where that is known.

        Raises:
            FitError: If the readings do not tell its form.
        """

    @abc.abstractmethod
    def draft(self, share: Share) -> AbstractDraft:
        """Return its draft.

        Raises:
            FitError: If the readings cannot carry it.
            ExchangeError: If it fits no list.
        """


def at_once(effect: AbstractEffect) -> AbstractEffect:
    """Return an effect without the lag of what it follows: linear in its values."""
    if isinstance(effect, Temperature):
        return dataclasses.replace(effect, lag=0.0)
    return effect


def few(data: JointData) -> JointData:
    """Return as many readings as are enough to see what goes together."""
    step = -(-len(data) // _MOST)
    return data.take(np.arange(0, len(data), step)) if step > 1 else data


def members_of(tables: Tables, indices: Sequence[int]) -> tuple[AbstractMember, ...]:
    """Return the fits of a group: existing lists read, keys understood.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
        MeasurementError: If the only sensor is to be taken and there is none.
    """

    def member(index: int) -> AbstractMember:
        fit = tables.job.spec.fits[index]
        return fit.kind.group.member(tables, index, fit)

    return tuple(map(member, indices))
