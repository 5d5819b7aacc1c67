"""A fit before its measurement is looked at, alone or in a group: what all kinds have in common."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ..readings import Tables
from ._draft import AbstractDraft, AbstractOfFit, Leftovers

if TYPE_CHECKING:
    from ..fit.joint import AbstractEffect, JointData, JointFit, Part
    from .joint._recording import GroupRecording
    from .joint._share import Share


_ALONE = "found in a group, expected it alone"


@dataclasses.dataclass(frozen=True)
class AbstractPlan(AbstractOfFit):
    """A planned fit: its existing lists read, its keys understood.

    What is asked of a fit in a group follows `alone`; a kind that has no part in one leaves
    it as it is.
    """

    @abc.abstractmethod
    def alone(self, tables: Tables, left: Leftovers) -> AbstractDraft:
        """Fit it to its own measurements, as if there was no other.

        Args:
            tables: Measurements of the job.
            left: What earlier fits leave of them.

        Raises:
            JobError: If the readings do not suit.
            FitError: If they do not determine the fit.
            ExchangeError: If the result fits no list.
        """

    @property
    def positions(self) -> tuple[str, ...]:
        """Axes whose positions it uses."""
        return ()

    @property
    def without_position(self) -> str:
        """What a job may ask for where no position was recorded, to end a sentence."""
        return ""

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

    def unfit(self, recording: "GroupRecording") -> str:
        """Return why these readings tell nothing of it, whatever they are; else nothing."""
        return ""

    def undetermined(self, data: "JointData") -> str:
        """Return why the motion of its masters does not tell it; else nothing."""
        return ""

    def confused(
        self, members: Sequence["AbstractPlan"], recording: "GroupRecording"
    ) -> str:
        """Return with what that no fit stands for the readings confuse it; else nothing.

        Args:
            members: All that are fitted to these readings.
            recording: What was measured.
        """
        return ""

    def may_be_written(self, part: "Part", fit: "JointFit") -> bool:
        """Return whether the readings tell its part of the joint fit."""
        from .joint._share import lost  # takes long to load

        return bool(part.determined.any()) and not lost(part, fit)

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "AbstractEffect | None":
        """Return the effect; None where its form needs what the other effects leave.

        Args:
            recording: What was measured.
            left: Error of the axis that the other effects leave, where that is known.

        Raises:
            FitError: If the readings do not tell its form.
        """
        raise self.refusal(_ALONE)

    def draft(self, share: "Share") -> AbstractDraft:
        """Return its draft.

        Raises:
            FitError: If the readings cannot carry it.
            ExchangeError: If it fits no list.
        """
        raise self.refusal(_ALONE)

    def left_out(self, why: str, share: "Share | None" = None) -> AbstractDraft:
        """Return what stands for it where its readings do not tell it: the rest is written.

        Args:
            why: In words; empty: what the readings do not tell is said.
            share: Its part of the joint fit; None where it was not fitted at all.
        """
        from .joint import LeftOutDraft  # takes long to load

        return LeftOutDraft(self.job, self.index, self.fit, why, share)


def plan_of(tables: Tables, index: int) -> AbstractPlan:
    """Return the plan of a fit of the job.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
    """
    fit = tables.job.spec.fits[index]
    return fit.kind.planner.plan(tables, index, fit)
