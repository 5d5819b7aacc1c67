"""What a person must know of a thermal line, and what the readings do not tell."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...discover import AgainstDrift, against_drift, heat_or_drift
from ...job.result._result import Remark
from .fit import Effect, Lag, Meeting, TemperatureFit

if TYPE_CHECKING:
    from ._draft import TemperatureDraft

_ONE_WAY = 0.95
"""Correlation of temperature and time from which nothing but the clock may be seen."""
_SAME_COURSE = 0.999
"""Correlation of two sensors from which on either does for the other."""
_FEW = 8.0
_HOT = 200.0
"""°C that no structure of a machine tool reaches."""
_EFFECTS: Mapping[Effect, str] = {
    "level": "level of the error",
    "offset": "temperature at the offset",
    "slope": "slope over the position",
    "slope change": "change of that slope",
}
_MEETINGS: Mapping[Meeting, str] = {
    "met": "The lines meet at {at:.5g} mm ± {sure:.2g} mm",
    "given": "It was given",
    "parallel": "The lines do not change their slope, so they meet nowhere",
    "unsure slope": "The lines hardly change their slope, so they meet nowhere",
    "two sensors": "Two sensors move offset and slope, so the lines do not meet",
    "too far": "The lines are nearly parallel",
    "too few": "Too few readings to find where the lines meet",
    "not one point": "The lines of the temperatures do not meet in one point",
    "uncertain": "Where the lines meet is uncertain by {sure:.2g} mm",
}
_UNSURE: tuple[Meeting, ...] = ("not one point", "uncertain")
"""What a person should know before the line is used."""
_SIGN = Remark.warning(
    "Whether the controller adds the line or takes it off is the least certain sign of"
    " all (S-43: the manual reads its coefficients off a deviation). Warm the machine,"
    " compare V.A.TEMP_COMP_CURR and the drive bus with axcomp simulate, and measure once"
    " before relying on it."
)


def remarks_of(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return everything that the report has to say of a fit."""
    recording, fit = draft.recording, draft.found
    yield from recording.remarks
    yield from _undetermined(draft)
    if not fit.moving and draft.determined:
        yield Remark.warning(
            "No effect of the temperature shows beyond chance: laws that follow it"
            " predict readings left out no better. Nothing is written."
        )
    if fit.meeting != "given":
        level = "warning" if fit.meeting in _UNSURE else "info"
        yield Remark(level, _meeting_words(fit))
    for lag in fit.lags:
        level = "warning" if lag.sensor_late else "info"
        yield Remark(level, _lag_words(lag, fit.sensors[lag.sensor]))
    wild, missed = int(fit.wild.sum()), int((~fit.used).sum())
    if wild:
        yield Remark.warning(f"{wild} wild readings were left out.")
    if missed:
        yield Remark.info(f"{missed} readings were missed or incomplete.")
    yield from _not_told(draft)
    hottest = float(np.max(recording.temperature[fit.used]))
    if hottest > _HOT:
        yield Remark.warning(
            f"A sensor reads {hottest:.4g} °C: where the column is in kelvin, state"
            ' unit = "K".',
        )
    if draft.written:
        yield from _state(draft)
        if "temperature_sign" not in draft.job.verified:
            yield _SIGN


def _undetermined(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return which effects the readings confuse, and what becomes of them."""
    left = " Neither is written."
    if draft.dropped:
        left = (
            " The coefficient is left out; the offset over the temperature is determined"
            " and written."
        )
    for pair in draft.found.confounded:
        first, second = _EFFECTS[pair.first], _EFFECTS[pair.second]
        yield Remark.error(
            f"These readings cannot tell the {first} from the {second}:"
            f" their correlation is {pair.correlation:.4f}.{left}"
            f" Measure {draft.axis} at all positions per temperature."
        )


def _meeting_words(fit: TemperatureFit) -> str:
    """Return whether the lines of all temperatures meet, and where the reference is."""
    sure = fit.meeting_deviation
    words = _MEETINGS[fit.meeting].format(at=fit.reference, sure=sure or 0.0)
    if not fit.intersects:
        words += f": the reference is {fit.reference:.4g} mm"
    return f"{words}.".replace("-", "−")


def _lag_words(lag: Lag, name: str) -> str:
    """Return what a lag means for the machine."""
    if lag.sensor_late:
        return (
            f"The structure is ahead of {name}: the sensor sits where it warms late. No"
            " filter undoes that; a sensor closer to the source would."
        )
    if not lag.applied:
        return f"No lag between {name} and the structure shows."
    low, high = lag.interval
    span = f"95 %: {low:.3g} to {high:.3g} s" if high > low else "given"
    return (
        f"The structure follows {name} with a time constant of"
        f" {lag.time_constant:.3g} s ({span}), by which the PLC filters the sensor."
    )


def _not_told(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return what these readings cannot say, however well they fit."""
    recording, fit, axis = draft.recording, draft.found, draft.axis
    if fit.coefficient is None:
        why = f"The error was measured at one position of {axis}"
        if recording.carriers is not None:
            why = f"The coefficient of {axis} was not asked for"
        yield Remark.warning(
            f"{why}: how the error grows along the axis is not known, and the same"
            " correction acts everywhere."
        )
    yield from _alike(draft)
    if recording.datum is not None and "offset" in recording.effects:
        yield Remark.warning(
            f"The instrument was set to zero at {recording.datum:g} mm (datum): a"
            " shift of the whole axis is not seen, and only the growth from there"
            " is corrected."
        )
    from scipy.stats import rankdata  # takes long to load

    used, clock = fit.used, recording.data.time
    row = (np.arange(len(used), dtype=float) if clock is None else clock)[used]
    for sensor in dict.fromkeys(recording.effects.values()):
        warmth = recording.data.temperature[sensor][used]
        if warmth.std() > 0 and row.std() > 0:
            # Ranks: a warm-up is a curve over the time, and still one way.
            alike = float(np.corrcoef(rankdata(row), rankdata(warmth))[0, 1])
            if abs(alike) > _ONE_WAY:
                way = "rose" if alike > 0 else "fell"
                yield Remark.warning(
                    f"{sensor!r} only {way} while measuring"
                    f" (rank correlation with time {alike:.2f}): whatever else changed"
                    " with time is taken for the temperature. A measurement over"
                    " warming and cooling tells them apart."
                )
    instead = _instead(draft)
    if instead is not None and instead.doubtful:
        # The words of `discover`, which says so of the same readings.
        effect, sensor = next(iter(recording.effects.items()))
        heat = f"temperature {effect} of {axis} by {sensor}"
        what, remedy = heat_or_drift(heat, axis)
        size = f"{1e3 * instead.rms:.2g} µm rms"
        yield Remark.warning(
            f"The data cannot tell: {what} ({size}). {remedy} What is written takes all"
            " of it for the temperature."
        )
    if fit.independent < _FEW and fit.noise.drift > 0:
        yield Remark.warning(
            f"The residuals drift over {fit.noise.time_constant / 60:.3g} minutes:"
            f" the {int(used.sum())} readings tell no more than"
            f" {max(fit.independent, 1):.0f} independent ones would."
        )


def _instead(draft: "TemperatureDraft") -> AgainstDrift | None:
    """Return what a drift of the instrument would explain as well; None where none can."""
    recording, fit = draft.recording, draft.found
    if fit.confounded:
        return None
    used, time, place = fit.used, recording.data.time, recording.position
    count = int(used.sum())
    clock = np.arange(count, dtype=float) if time is None else time[used]
    away = np.zeros(count) if place is None else place[used] - place[used].mean()
    columns = {
        effect: fit.temperature[used, fit.sensors.index(sensor)]
        for effect, sensor in recording.effects.items()
    }
    if "coefficient" in columns:
        warm = columns["coefficient"]
        columns["coefficient"] = (warm - warm.mean()) * away
    return against_drift(
        clock,
        np.stack(list(columns.values()), axis=1),
        recording.error[used],
        np.stack([np.ones(count), away], axis=1),
    )


def _alike(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return a warning where two sensors changed in the same way."""
    effects, warm = draft.recording.effects, draft.recording.data.temperature
    names = [effects[key] for key in ("offset", "coefficient") if key in effects]
    if len(set(names)) < 2:
        return
    both = np.stack([warm[name] for name in names])
    both = both[:, np.isfinite(both).all(axis=0)]
    if both.shape[1] < 3 or not np.ptp(both, axis=1).all():
        return
    alike = float(np.corrcoef(both)[0, 1])
    if abs(alike) >= _SAME_COURSE:
        yield Remark.warning(
            f"{names[0]} and {names[1]} changed alike (correlation {alike:.4f}): that the"
            f" offset follows {names[0]} and the coefficient {names[1]} is the choice of"
            " the job, these readings cannot tell it. Measure once while they differ."
        )


def _state(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return where the law is zero, and what stays for the tables."""
    recording, fit, zero = draft.recording, draft.found, draft.zero
    wished = recording.line.reference_temperature
    far = {
        fit.sensors[law.sensor]: float(np.clip(zero, *law.temperature[[0, -1]]))
        for law in fit.moving
    }
    if any(abs(warm - wished) > 0.05 for warm in far.values()):
        at = " and ".join(f"{name} at {warm:.4g} °C" for name, warm in far.items())
        yield Remark.info(
            f"Nothing is corrected with {at}, measured next to the reference of"
            f" {wished:g} °C, which was not measured itself."
        )
    if recording.carriers:
        words = f"What {recording.line.axis} shows at {zero:.4g} °C is held by the"
        words += f" {' and the '.join(recording.carriers)} of the same group."
        yield Remark.info(words)
        return
    words = (
        f"What {recording.line.axis} shows at {zero:.4g} °C belongs to its tables, not to"
        " this law"
    )
    if fit.coefficient is not None and recording.carriers is None:
        slope = 1e6 * float(fit.coefficient.at(np.array([zero]))[0])
        words += f" (a slope of {slope:+.4g} µm/m among it)".replace("-", "−")
        words += (
            ". A leadscrew table that was measured warmer holds a part of this"
            " law as well: measure tables with this law active, or at that temperature"
        )
    yield Remark.info(words + ".")
