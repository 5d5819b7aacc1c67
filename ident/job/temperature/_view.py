"""The readings of a temperature fit before and after, for proof and report."""

import numpy as np

from ....models import TemperatureLine
from ._identify import Identified
from ._recording import ThermalRecording
from ._result import ThermalView


def view_of(
    recording: ThermalRecording,
    found: Identified,
    zero: float,
    line: TemperatureLine | None,
) -> ThermalView:
    """Return the complete readings with what became of them.

    Args:
        recording: What was measured.
        found: The estimate and its proof.
        zero: Temperature in °C at which nothing is corrected.
        line: What was written, read back; None: nothing, and errors stand about their
            median.
    """
    fit, readings = found.fit, recording.readings
    used = fit.used
    place = None if readings.position is None else readings.position[used]
    structure = fit.temperature[used]
    before = from_file = readings.error[used] - np.median(readings.error[used])
    if line is not None:
        still = np.full(structure.shape, zero)
        before = readings.error[used] - fit.predict(still, place)
        away = np.zeros(len(before)) if place is None else place
        from_file = before + np.asarray(line.offset(away, structure))
    row = np.arange(len(used), dtype=float)
    return ThermalView(
        time=(row if readings.time is None else readings.time)[used],
        timed=readings.time is not None,
        row=recording.rows[used],
        position=place,
        sensor=readings.temperature[used],
        structure=structure,
        before=before,
        predicted=before if line is None else found.predicted,
        from_file=from_file,
        wild=fit.wild[used],
    )
