"""The thermal line that readings determine, and what readings left out say of it."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from ...discover import AgainstDrift, against_drift
from ...fit import FitError
from ._choice import BLOCKS, FOLDS
from ._recording import ThermalRecording
from .effect import (
    Confusion,
    LawKey,
    TemperatureFit,
    ThermalReadings,
    fit_temperature,
)
from .keys import Spec

LawPair = Literal["auto"] | tuple[LawKey, LawKey]


@dataclasses.dataclass(frozen=True)
class Identified:
    """A thermal line with its proof.

    Attributes:
        fit: The estimate, in the sign of the error.
        open: Effects that the readings cannot tell apart.
        dropped: The coefficient was held constant, since only the offset is determined.
        predicted: Error of each used reading in mm less what the other blocks say of it.
        held_out: What was left out together: ``block`` or ``run``.
        instead: What a drift of the instrument would explain as well; None where none does.
    """

    fit: TemperatureFit
    predicted: Float[np.ndarray, " u"]
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
    law: LawPair = "auto"
    if fit.law is not None:
        law = (
            fit.law.get("offset", "constant"),
            fit.law.get("coefficient", "constant"),
        )
    found = _line(recording, fit, recording.readings, law)
    open_pairs = found.confounded
    named = {effect for pair in open_pairs for effect in (pair.first, pair.second)}
    dropped = bool(
        open_pairs and "offset" in recording.effects and "offset" not in named
    )
    if dropped:
        # The slope and its change are one column: the offset stands apart from both.
        found = _line(
            recording, fit, recording.readings, (len(found.offset.value), "constant")
        )
    predicted = _held_out(recording, fit, found)
    instead = None if open_pairs else drift_instead(recording, found)
    return Identified(
        fit=found,
        predicted=predicted,
        open=open_pairs,
        dropped=dropped,
        instead=instead,
    )


def drift_instead(
    recording: ThermalRecording, fit: TemperatureFit
) -> AgainstDrift | None:
    """Return what may be a drift of the instrument as well; None where that is settled."""
    readings, used = recording.readings, fit.used
    count = int(used.sum())
    clock = np.arange(count, dtype=float)
    if readings.time is not None:
        clock = readings.time[used]
    away = np.zeros(count)
    if readings.position is not None:
        away = readings.position[used] - readings.position[used].mean()
    columns = {
        "offset": fit.temperature[used, recording.effects.get("offset", 0)],
        "coefficient": fit.temperature[used, recording.effects.get("coefficient", 0)],
    }
    columns["coefficient"] = (
        columns["coefficient"] - columns["coefficient"].mean()
    ) * away
    found = against_drift(
        clock,
        np.stack([columns[effect] for effect in recording.effects], axis=1),
        readings.error[used],
        np.stack([np.ones(count), away], axis=1),
    )
    return found if found is not None and found.doubtful else None


def _line(
    recording: ThermalRecording,
    fit: Spec,
    readings: ThermalReadings,
    law: LawPair,
    lag: float | Literal["auto", "none"] | None = None,
) -> TemperatureFit:
    offset = recording.effects.get("offset")
    reference = "intersection" if fit.reference is None else fit.reference
    if recording.datum is not None and "coefficient" in recording.effects:
        # The instrument was set to zero there: what the offset does, nobody saw.
        offset, reference = None, recording.datum
    if lag is None:
        lag = fit.lag if readings.time is not None else "none"
    return fit_temperature(
        readings,
        offset_sensor=offset,
        coefficient_sensor=recording.effects.get("coefficient"),
        law=law,
        reference=reference,
        lag=lag,
        loss=fit.loss,
        names=recording.sensors,
    )


def _held_out(
    recording: ThermalRecording, fit: Spec, found: TemperatureFit
) -> Float[np.ndarray, " u"]:
    """Return errors less the line fitted to the other blocks.

    The law, its number of nodes and its lags are those of the whole; everything else is
    fitted anew.
    """
    used = np.flatnonzero(found.used)
    clock = recording.readings.time
    order = used if clock is None else used[np.argsort(clock[used], kind="stable")]
    rank = np.empty(len(found.used), dtype=np.int64)
    rank[order] = np.arange(len(order))
    groups = rank[used] * BLOCKS // len(used) % FOLDS
    part = recording.readings.take(found.used)
    structure = found.temperature[found.used]
    part = dataclasses.replace(part, temperature=structure)
    coefficient = found.coefficient
    law = (
        len(found.offset.value),
        1 if coefficient is None else len(coefficient.value),
    )
    predicted = np.array(part.error, dtype=float)
    for group in np.unique(groups):
        out = groups == group
        try:
            other = _line(recording, fit, part.take(~out), law, lag="none")
        except FitError:
            # What is left tells nothing of this law: neither does the prediction.
            predicted[out] -= np.median(part.error[~out])
            continue
        place = None if part.position is None else part.position[out]
        predicted[out] -= other.predict(structure[out], place)
    return predicted
