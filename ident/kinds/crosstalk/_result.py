"""What a job found of the crosstalk from one axis to another."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...job._result import AbstractResult
from .effect import BRANCHES, CrosstalkFit, CrosstalkReadings


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class CrosstalkResult(AbstractResult):
    """The crosstalk of an axis; errors of events are those at full acceleration, in mm.

    Attributes:
        master: Axis that accelerates.
        adaptation: Axes on whose positions it depends.
        points: Of the written tests in mm, shape ``(p, k)``.
        entries: Written entries in mm by row of `BRANCHES`, with the sign of the list;
            no tests where nothing is written.
        standard_deviation: Of the entries.
        support: Events that touch each entry.
        cycles: Of the sin² filter on the values (P-COMP-00064).
        coverage: Share of the workspace that the tests cover, 0 to 1.
        workspace: From where to where each adaptation axis goes in mm.
        fit: The estimate behind it with its events (sign of the error).
        predicted: What the list fitted to other events leaves of each event.
        from_file: What the written file, read back, leaves of each event.
        readings: The log from which the events are cut.
        added: What the written list adds in each row of the log in mm.
    """

    master: str
    adaptation: tuple[str, ...]
    points: Float[np.ndarray, "p k"]
    entries: Float[np.ndarray, "4 p"]
    standard_deviation: Float[np.ndarray, "4 p"]
    support: Int[np.ndarray, "4 p"]
    cycles: int
    coverage: float
    workspace: Float[np.ndarray, "k 2"]
    fit: CrosstalkFit
    predicted: Float[np.ndarray, " n"]
    from_file: Float[np.ndarray, " n"]
    readings: CrosstalkReadings
    added: Float[np.ndarray, " t"]

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose motion it acts."""
        return (self.master, *self.adaptation)

    @property
    def before(self) -> Float[np.ndarray, " n"]:
        """Error that each event shows."""
        return self.fit.of_events("value")

    @property
    def wild(self) -> Bool[np.ndarray, " n"]:
        """Events that contradict the others."""
        return self.fit.of_events("wild").astype(bool)

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        fit = self.fit
        names = [name.replace(" ", "_") for name in BRANCHES]
        return {
            "master": self.master,
            "adaptation": list(self.adaptation),
            "parameters": {
                "mode": fit.mode,
                "acceleration": fit.acceleration,
                "deceleration": fit.deceleration,
                "velocity_dependent": fit.velocity_dependent,
                "n_cycles": self.cycles,
                "positions": self.points,
                "table": dict(zip(names, self.entries, strict=True)),
            },
            "standard_deviations": {
                "table": dict(zip(names, self.standard_deviation, strict=True))
            },
            "support": dict(zip(names, self.support, strict=True)),
            "measured": {
                "positions": fit.points,
                "error": dict(zip(names, fit.values, strict=True)),
                "complete": fit.complete,
            },
            "noise": dict(zip(names, fit.noise, strict=True)),
            "coverage": self.coverage,
            "events": [
                {
                    "time": self.readings.time[event.start],
                    "kind": BRANCHES[event.branch],
                    "positions": event.positions,
                    "peak": event.peak,
                    "error": event.value,
                    "standard_deviation": event.standard_deviation,
                    "predicted": predicted,
                    "from_file": left,
                    "wild": event.wild,
                }
                for event, predicted, left in zip(
                    fit.events, self.predicted, self.from_file, strict=True
                )
            ],
            "choice": [dataclasses.asdict(score) for score in fit.scores],
        }
