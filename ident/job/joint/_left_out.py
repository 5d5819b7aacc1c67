"""A fit of a group that its readings do not tell: named, and not written."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...proof import ErrorFigures, error_figures
from .._draft import AbstractDraft, Written
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
    def written(self) -> bool:
        return False

    @property
    def needs(self) -> str:
        return ""

    def prove(self, done: Written) -> LeftOutResult:
        share = self.share
        if share is None:
            # There is nothing to say of it but why.
            nothing = np.zeros(0)
            own: dict[str, Any] = {
                "masters": (),
                "sensors": (),
                "labels": (),
                "values": nothing,
                "standard_deviation": nothing,
                "support": nothing.astype(np.int64),
                "determined": nothing.astype(bool),
                "share": 0.0,
                "noise": np.nan,
            }
            figures, remarks = ErrorFigures(np.nan, np.nan), list[Remark]()
        else:
            part = share.part
            own = {
                "held_out": share.recording.held_out,
                "masters": part.effect.masters,
                "sensors": part.effect.sensor_names,
                "labels": part.labels,
                "values": part.values,
                "standard_deviation": part.standard_deviation,
                "support": part.support,
                "determined": part.determined,
                "share": part.share,
                "noise": share.noise,
            }
            figures = error_figures(share.error, wild=share.wild)
            remarks = share.remarks()
        frame = self.frame(done) | {"conventions": ()}
        return LeftOutResult(
            **frame,
            **own,
            error=dict.fromkeys(("before", "predicted", "from_file"), figures),
            remarks=(Remark.error(self._words()), *remarks, *done.files.remarks),
            files=(),
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
