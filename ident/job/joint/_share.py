"""What one fit of a group gets of the joint fit: its part, and what the others leave.

A fit that its readings do not tell is left out: named, and not written.
"""

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Bool, Float

from ...fit.joint import JointFit, Part
from ...proof import ErrorFigures, error_figures
from .._draft import AbstractDraft
from ..result._result import STAGES, AbstractResult, Remark, some_of
from ._recording import GroupRecording

if TYPE_CHECKING:
    from ..write._lists import AxisFiles
    from ._group import IdentifiedGroup


MOST = 4
"""Values that are named one by one."""
_FEW = 0.05
"""Share of the readings up to which it is no matter that they are left out."""
TOGETHER = "Identified "
"""How the remark begins that says with what a fit was identified."""


@dataclasses.dataclass(frozen=True)
class Share:
    """The part of a member of a joint fit, by its number, with the readings that show it."""

    group: "IdentifiedGroup"
    number: int

    @property
    def recording(self) -> GroupRecording:
        """What was measured."""
        return self.group.recording

    @property
    def fit(self) -> JointFit:
        """The joint fit."""
        return self.group.fit

    @property
    def part(self) -> Part:
        """Its part of that."""
        return self.fit.parts[self.number]

    @property
    def constant(self) -> float:
        """In mm or °, what its table takes over of the axis's datum."""
        return self.group.datum[0][self.number]

    @cached_property
    def drifted(self) -> float:
        """What the mean of the drifts of all runs may be off by, in mm or °; 0 without one."""
        data, runs = self.recording.data, self.fit.runs.get(self.axis, ())
        if not self.recording.drift or not runs:
            return 0.0
        both = [self.fit.predict(data, runs=on)[self.axis] for on in (True, False)]
        return float(np.std((both[0] - both[1])[self.rows]) / np.sqrt(len(runs)))

    @property
    def predicted(self) -> Float[np.ndarray, " t"]:
        """Error of each reading less the whole sum as fitted without it."""
        return self.group.held_out[self.axis]

    @property
    def beside(self) -> tuple[int, ...]:
        """Numbers of the other members on the same axis."""
        same = [k for k, p in enumerate(self.group.parts) if p.effect.axis == self.axis]
        return tuple(k for k in same if k != self.number)

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of those of them that are tables and are written."""
        group = self.group
        return tuple(
            group.parts[k].name
            for k in self.beside
            if group.members[k].kind.table and group.written[k]
        )

    @property
    def axis(self) -> str:
        """The compensated axis."""
        return self.part.effect.axis

    @property
    def rows(self) -> Bool[np.ndarray, " t"]:
        """Readings of the axis that have all that the whole sum needs."""
        return np.asarray(
            np.isfinite(self.fit.residual[self.axis]) & np.isfinite(self.predicted)
        )

    @property
    def error(self) -> Float[np.ndarray, " t"]:
        """Error per used reading that all other effects leave, its own and runs included.

        A drift that the job allows for is the instrument's, and taken off.
        """
        data = self.recording.data
        fitted = self.fit.predict(data, runs=self.recording.drifting)[self.axis]
        left = (data.error[self.axis] - fitted)[self.rows]
        return np.asarray(left + self.part.contribution[self.rows] + self.constant)

    @property
    def noise(self) -> float:
        """Standard deviation of one reading in mm or °."""
        return float(self.fit.noise[self.axis])

    @property
    def wild(self) -> Bool[np.ndarray, " t"]:
        """Used readings that the loss rejected outright."""
        return np.asarray(self.fit.wild[self.axis][self.rows])

    @property
    def why_undetermined(self) -> str:
        """Why nothing is written of it, in words."""
        why = [c.sentence for c in self.fit.confusions if self.part.name in c.effects]
        if why:
            return " ".join(dict.fromkeys(why))
        missing = undetermined_values(self.part, self.fit)
        if not missing:
            return "no reading reaches any of its values."
        return f"these readings do not tell {some_of(missing, MOST)}."

    def remarks(self) -> list[Remark]:
        """Return what was taken for granted, and what the figures of this fit are.

        What is to be said of the readings of a named group, the group says once.
        """
        group = self.group.name
        if not group:
            return [*self.recording.remarks]
        beside = ", ".join(self.group.parts[k].name for k in self.beside)
        words = (
            f"{TOGETHER}together with {beside} (group {group!r}): the error before"
            " is what these leave of the readings, and what is predicted or left from"
            " the file is the rest of the whole sum."
            if beside
            else f"{TOGETHER}in group {group!r}, alone on {self.axis}."
        )
        said = [*self._unlisted(), *self._wandering(), *self._incomplete()]
        return [Remark.info(words), *said]

    def _wandering(self) -> Iterator[Remark]:
        """Yield that the constant rests on the mean of a drift, where it is large."""
        if self.constant and self.drifted > self.noise:
            known = self.group.members[self.number].small(self.drifted)
            yield Remark.warning(
                "The instrument drifted: the constant of this list is the error at the mean of"
                f" the drift, known to {known}. With a datum the zero lies where the axis is to"
                " be right."
            )

    def _unlisted(self) -> Iterator[Remark]:
        """Yield what these figures take off that stands in no list."""
        group = self.group
        parts = [group.parts[k] for k in self.beside if not group.written[k]]
        if parts:
            sums = np.sum([part.contribution[self.rows] for part in parts], axis=0)
            names = " and ".join(part.name for part in parts)
            size = group.members[self.number].small(float(np.std(sums)))
            remain = f"its {size} rms remain on the machine"
            if any(undetermined_values(part, group.fit) for part in parts):
                remain = "how much of it remains on the machine no reading tells"
            yield Remark.warning(
                f"These figures take the {names} off, which stands in no list: {remain}."
            )

    def _incomplete(self) -> Iterator[Remark]:
        """Yield how many readings lack something that the group follows."""
        read = int(np.isfinite(self.recording.data.error[self.axis]).sum())
        if missed := read - int(np.count_nonzero(self.rows)):
            yield Remark(
                "warning" if missed > _FEW * read else "info",
                f"{missed} of {read} readings of {self.axis} were left out: they lack a value"
                " that the group follows (a position, a temperature).",
            )


def undetermined_values(part: Part, fit: JointFit) -> tuple[str, ...]:
    """Return the values, in words, that readings reach and cannot tell.

    A node that no reading reaches, or that only its neighbours in the same table hide, is
    a gap, which the prior fills.
    """
    named = any(part.name in confusion.effects for confusion in fit.confusions)
    if part.effect.table_effect is not None and not named:
        return ()
    missing = np.flatnonzero(~part.determined & np.isinf(part.standard_deviation))
    return tuple(part.effect.labels[int(k)] for k in missing)


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class LeftOutResult(AbstractResult):
    """A fit that nothing was written of.

    Attributes:
        part: Its part of the joint fit; None where it was not fitted at all.
        noise: Of one reading.
    """

    part: Part | None
    noise: float

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose positions it acts, where these are others than its own."""
        masters = () if self.part is None else self.part.effect.masters
        return tuple(name for name in masters if name != self.axis)

    @property
    def left_out(self) -> bool:
        """The readings do not tell it."""
        return True

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        part, none = self.part, np.zeros(0)
        effect = None if part is None else part.effect
        values = none
        if part is not None:
            values = np.where(part.determined, part.values, np.nan)
        return {
            "masters": effect.masters if effect else (),
            "sensors": effect.sensor_names if effect else (),
            "left_out": True,
            "parameters": {"labels": effect.labels if effect else (), "error": values},
            "standard_deviations": {"error": part.standard_deviation if part else none},
            "support": part.support if part else none,
            "determined": part.determined if part else none,
            "share_of_information": part.share if part else 0.0,
            "noise": self.noise,
        }


@final
@dataclasses.dataclass(frozen=True)
class LeftOutDraft(AbstractDraft):
    """A fit that nothing is written of.

    Attributes:
        why: In words; empty: what the readings do not tell is said.
        share: Its part of the joint fit; None where it was not fitted at all.
    """

    why: str = ""
    share: Share | None = None

    @property
    def written(self) -> bool:
        return False

    @property
    def name(self) -> str:
        return self.fit.name if self.share is None else self.share.part.name

    def prove(self, done: "AxisFiles") -> LeftOutResult:
        share = self.share
        frame: dict[str, Any] = self.frame(done) | {"conventions": ()}
        figures, remarks = ErrorFigures(np.nan, np.nan), list[Remark]()
        why = self.why
        if share is not None:
            figures = error_figures(share.error, wild=share.wild)
            remarks, why = share.remarks(), why or share.why_undetermined
        words = f"The {self.name} is left out: {why}"
        return LeftOutResult(
            **frame,
            error=dict.fromkeys(STAGES, figures),
            remarks=(Remark.error(words), *remarks),
            held_out="block" if share is None else share.recording.held_out,
            part=None if share is None else share.part,
            noise=np.nan if share is None else share.noise,
        )
