"""The thermal line that readings determine, and what readings left out say of it."""

import dataclasses

import numpy as np

from ...discover import AgainstDrift, against_drift
from ._estimate import Confusion, TemperatureFit
from ._recording import ThermalRecording
from .effect import fit_temperature
from .keys import Spec


@dataclasses.dataclass(frozen=True)
class Identified:
    """A thermal line with its proof.

    Attributes:
        fit: The estimate, in the sign of the error.
        open: Effects that the readings cannot tell apart.
        dropped: The coefficient was held constant, since only the offset is determined.
        held_out: What was left out together: ``block`` or ``run``.
        instead: What a drift of the instrument would explain as well; None where none does.
    """

    fit: TemperatureFit
    open: tuple[Confusion, ...] = ()
    dropped: bool = False
    held_out: str = "block"
    instead: AgainstDrift | None = None

    @property
    def determined(self) -> bool:
        """Whether anything may be written."""
        return self.dropped or not self.open


def identify(recording: ThermalRecording, fit: Spec) -> Identified:
    """Return the line of a recording.

    Raises:
        FitError: If the readings cannot determine what is asked for.
    """
    meet = recording.datum is None and not isinstance(fit.reference, float)
    found = fit_temperature(recording.data, recording.line, meet=meet, loss=fit.loss)
    open_pairs = found.confounded
    named = {effect for pair in open_pairs for effect in (pair.first, pair.second)}
    dropped = bool(
        open_pairs and "offset" in recording.effects and "offset" not in named
    )
    if dropped:
        # The slope and its change are one column: the offset stands apart from both.
        law = {"offset": len(found.offset.value), "coefficient": 1}
        line = dataclasses.replace(recording.line, law=law)
        found = fit_temperature(recording.data, line, meet=meet, loss=fit.loss)
    return Identified(
        fit=found,
        open=open_pairs,
        dropped=dropped,
        instead=None if open_pairs else drift_instead(recording, found),
    )


def drift_instead(
    recording: ThermalRecording, fit: TemperatureFit
) -> AgainstDrift | None:
    """Return what may be a drift of the instrument as well; None where that is settled."""
    data, used = recording.data, fit.used
    count = int(used.sum())
    clock = np.arange(count, dtype=float) if data.time is None else data.time[used]
    away = np.zeros(count)
    if recording.position is not None:
        away = recording.position[used] - recording.position[used].mean()
    columns = {
        effect: fit.temperature[used, recording.sensors.index(sensor)]
        for effect, sensor in recording.effects.items()
    }
    if "coefficient" in columns:
        warm = columns["coefficient"]
        columns["coefficient"] = (warm - warm.mean()) * away
    found = against_drift(
        clock,
        np.stack(list(columns.values()), axis=1),
        recording.error[used],
        np.stack([np.ones(count), away], axis=1),
    )
    return found if found is not None and found.doubtful else None
