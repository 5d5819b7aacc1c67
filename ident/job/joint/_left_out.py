"""A fit of a group that its readings do not tell: named, and not written."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...proof import ErrorFigures, GateCheck, error_figures
from .._draft import AbstractDraft, Switch
from .._lists import AxisFiles
from .._load import Job
from .._output import OutFolder
from .._result import AbstractResult, Remark
from ._share import Share, in_words, lost


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class LeftOutResult(AbstractResult):
    """A fit that nothing was written of.

    Attributes:
        masters: Axes on which it depends.
        sensors: Temperatures on which it depends.
        labels: What each of its values is.
        values: In the unit of the effect; sign of the error.
        standard_deviation: Of the values; inf where the readings do not tell it.
        support: Readings that touch each value.
        determined: Whether the readings tell the value.
        share: Information that is left of it beside the other effects, 0 to 1.
        noise: Of one reading.
    """

    masters: tuple[str, ...]
    sensors: tuple[str, ...]
    labels: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    standard_deviation: Float[np.ndarray, " p"]
    support: Int[np.ndarray, " p"]
    determined: Bool[np.ndarray, " p"]
    share: float
    noise: float

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose positions it acts, where these are others than its own."""
        return tuple(name for name in self.masters if name != self.axis)

    @property
    def left_out(self) -> bool:
        """The readings do not tell it."""
        return True

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        told = np.where(self.determined, self.values, np.nan)
        return {
            "masters": list(self.masters),
            "sensors": list(self.sensors),
            "left_out": True,
            "parameters": {"labels": list(self.labels), "error": told},
            "standard_deviations": {"error": self.standard_deviation},
            "support": self.support,
            "determined": self.determined,
            "share_of_information": self.share,
            "noise": self.noise,
        }


@final
@dataclasses.dataclass(frozen=True)
class LeftOutDraft(AbstractDraft):
    """A fit that nothing is written of.

    Attributes:
        name: Of the effect.
        why: In words; empty: what the readings do not tell is said.
        share: Its part of the joint fit; None where it was not fitted at all.
    """

    name: str
    why: str = ""
    share: Share | None = None

    @property
    def compensation(self) -> str:
        return self.fit.compensation

    @property
    def switch(self) -> Switch | None:
        return None

    def prove(
        self,
        job: Job,
        folder: OutFolder,
        gate: tuple[GateCheck, ...],
        files: AxisFiles,
        written: tuple[Path, ...],
        cycles: int | None,
    ) -> LeftOutResult:
        share = self.share
        if share is None:
            return self._unfitted(job, gate, files)
        part = share.part
        before = error_figures(share.error, wild=share.wild)
        figures: Mapping[str, Any] = dict.fromkeys(
            ("before", "predicted", "from_file"), before
        )
        return LeftOutResult(
            **self.frame(job, gate, files, ()),
            error=figures,
            remarks=(Remark("error", self._words()), *share.remarks(), *files.remarks),
            files=(),
            held_out=share.recording.held_out,
            masters=part.effect.masters,
            sensors=part.effect.sensor_names,
            labels=part.labels,
            values=part.values,
            standard_deviation=part.standard_deviation,
            support=part.support,
            determined=part.determined,
            share=part.share,
            noise=share.noise,
        )

    def _unfitted(
        self, job: Job, gate: tuple[GateCheck, ...], files: AxisFiles
    ) -> LeftOutResult:
        """Return the result of a fit that there is nothing to say of but why."""
        unknown = ErrorFigures(np.nan, np.nan)
        nothing = np.zeros(0)
        return LeftOutResult(
            **self.frame(job, gate, files, ()),
            error=dict.fromkeys(("before", "predicted", "from_file"), unknown),
            remarks=(Remark("error", self._words()), *files.remarks),
            files=(),
            masters=(),
            sensors=(),
            labels=(),
            values=nothing,
            standard_deviation=nothing,
            support=np.zeros(0, dtype=np.int64),
            determined=np.zeros(0, dtype=bool),
            share=0.0,
            noise=np.nan,
        )

    def _words(self) -> str:
        if self.why or self.share is None:
            return f"The {self.name} is left out: {self.why}"
        part = self.share.part
        own = [c for c in self.share.fit.confusions if part.name in c.effects]
        if own:
            said = " ".join(dict.fromkeys(each.sentence for each in own))
            return f"The {part.name} is left out. {said}"
        missing = lost(part, self.share.fit)
        if not missing:
            return f"The {part.name} is left out: no reading reaches any of its values."
        return (
            f"The {part.name} is left out: these readings do not tell"
            f" {in_words(missing)}."
        )
