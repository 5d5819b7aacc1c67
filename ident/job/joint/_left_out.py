"""A fit of a group that its readings do not tell: named, and not written."""

import dataclasses
from typing import Any, final

import numpy as np

from ...fit.joint import Part
from ...proof import ErrorFigures, error_figures
from .._draft import AbstractDraft, Written
from .._result import AbstractResult, Remark
from ._share import Share, in_words, lost


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
        part = self.part
        if part is None:
            parameters: dict[str, Any] = {"labels": [], "error": []}
        else:
            told = np.where(part.determined, part.values, np.nan)
            parameters = {"labels": list(part.labels), "error": told}
        return {
            "masters": [] if part is None else list(part.effect.masters),
            "sensors": [] if part is None else list(part.effect.sensor_names),
            "left_out": True,
            "parameters": parameters,
            "standard_deviations": {
                "error": [] if part is None else part.standard_deviation
            },
            "support": [] if part is None else part.support,
            "determined": [] if part is None else part.determined,
            "share_of_information": 0.0 if part is None else part.share,
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

    @property
    def needs(self) -> str:
        return ""

    def prove(self, done: Written) -> LeftOutResult:
        share = self.share
        frame: dict[str, Any] = self.frame(done) | {"conventions": ()}
        figures, remarks = ErrorFigures(np.nan, np.nan), list[Remark]()
        if share is not None:
            figures = error_figures(share.error, wild=share.wild)
            remarks = share.remarks()
        return LeftOutResult(
            **frame,
            error=dict.fromkeys(("before", "predicted", "from_file"), figures),
            remarks=(Remark.error(self._words()), *remarks, *done.files.remarks),
            files=(),
            held_out="block" if share is None else share.recording.held_out,
            part=None if share is None else share.part,
            noise=np.nan if share is None else share.noise,
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
