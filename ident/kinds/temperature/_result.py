"""What a job found of the thermal line of an axis, and what must be known of it."""

import dataclasses
from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import legvander

from ...core import FitError, node_shares, regress
from ...job.result._result import AbstractResult, Expectation, Remark, wild_remark
from ...readings import IN_SHOP, SHOP
from ._law import RATE, ThermalLaw
from ._line import Lag, Law, Meeting, TemperatureFit, Warmth

if TYPE_CHECKING:
    from ._draft import TemperatureDraft
    from .keys import Spec

_ONE_WAY = 0.95
"""Rank correlation of temperature and time from which few readings tell nothing but the clock."""
_SAME_COURSE = 0.999
"""Correlation of two sensors from which on either does for the other."""
_SURE, _SLIGHT = 4.0, 2.0
"""Deviations of a drift, and scatter of a reading, from which on there is one."""
_LESS = 0.98
"""Of the scatter beside a lag: where a drift without any leaves less, it is likelier."""
_TOLD, _LARGE = 2.0, 3.0
"""Standard deviations that tell a law from none; and how many times the noise of a reading a
list of one that is not told may be off, before it is refused."""
_AT, _SEVERAL, _PART, _WANDERS = 0.01, 8, 0.1, 0.4
"""Share of the travel about a datum that is the datum; readings there that tell how they move;
share of all that the readings show; and share of their variance that neighbours in time leave."""
_FEW = 8.0
_QUICK = 60.0
"""s in which no machine warms, and behind a sensor of which none is."""
_MEETINGS: Mapping[Meeting, str] = {
    "met": "The lines meet at {at:.5g} mm ± {sure:.2g} mm",
    "parallel": "The lines hardly change their slope, so they meet nowhere",
    "two sensors": "Two sensors move offset and slope, so the lines do not meet, and no"
    " reference is stated where what the second one measures is clamped (reference = … in mm:"
    " elsewhere the offset has to follow both)",
    "not one point": "The lines of the temperatures do not meet in one point",
    "uncertain": "Where the lines meet is uncertain, and far from what was measured",
    "no offset": "No offset is fitted, and no reference is stated where the axis stays at all"
    " temperatures (reference = … in mm, or a sensor of the offset, too)",
}
_UNSURE: set[Meeting] = {"two sensors", "not one point", "uncertain", "no offset"}
"""What a person should know before the line is used."""
_BENDS, _BENT = 4, 2.0
"""Highest order of a growth that bends along the axis; scatter of a reading from which on it is
told."""
_FILTER = 3.0
"""Samples up to which a lag says nothing of the unit of the time."""
_RULE = "temperature_sign"
_SIGN = Remark.warning(
    "Whether the controller adds the line or takes it off is the least certain sign of"
    " all (S-43: the manual reads its coefficients off a deviation). Warm the machine,"
    " compare V.A.TEMP_COMP_CURR and the drive bus with axcomp simulate, and measure once"
    " before relying on it."
)


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class TemperatureResult(AbstractResult):
    """The thermal line of an axis.

    Errors are one per complete reading, against the state at the temperature where nothing is
    corrected: what the axis shows there belongs to its tables.

    Attributes:
        reference: Position where the line turns, in mm (P-AXIS-00272).
        zero: Temperature in °C at which nothing is corrected.
        law: As written; None where nothing is.
        fit: The estimate as it stands, with its readings.
        cycles: Of the sin² filter (P-AXIS-00275).
        before: Error in mm.
        predicted: Error left under the line fitted to the other blocks of time.
        from_file: Error left under the files as written, by the controller's rules.
    """

    reference: float
    zero: float
    law: ThermalLaw | None
    fit: TemperatureFit
    cycles: int
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]

    def unsettled(self, settled: Collection[str]) -> tuple[Remark, ...]:
        known = _RULE in settled
        return tuple(one for one in self.remarks if not (known and one == _SIGN))

    @property
    def subject(self) -> str:
        whole = super().subject
        rest = f"{whole} beside what it shows at {self.zero:.4g} °C"
        return rest if self.group is None else whole

    @property
    def expectation(self) -> Expectation | None:
        """The largest correction of the written line at a place that was measured."""
        correction, places = self.from_file - self.before, self.fit.position
        row = int(np.argmax(np.abs(correction)))
        return Expectation(
            {} if places is None else {self.axis: float(places[row])},
            None,
            float(correction[row]),
            self.unit,
            temperatures={k: float(at[row]) for k, at in self.fit.structure.items()},
        )

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        fit, law = self.fit, self.law
        slope, slope_deviation = fit.offset.slope
        return {
            "parameters": {
                "position_0": self.reference,
                "temperature_0": self.zero,
                "table": None if law is None else law.columns,
                "intersects": fit.meeting == "met",
                "meeting": fit.meeting,
                "n_cycles": self.cycles,
                "rate": RATE,
                "offset": _law(fit.offset, 1.0),
                "coefficient": _law(fit.coefficient, 1e6),
                "offset_per_kelvin": slope,
                "lags": [
                    {**vars(lag), "interval": lag.interval, "applied": lag.applied}
                    for lag in fit.lags
                ],
            },
            "standard_deviations": {
                "table": None if law is None else law.deviations,
                "position_0": fit.reference_deviation,
                "offset_per_kelvin": slope_deviation,
            },
            "support": dict(zip(fit.line.labels, fit.support, strict=True)),
            "noise": fit.noise.white,
            "drift": fit.noise.drift,
            "drift_time": fit.noise.time_constant,
            "independent": fit.independent,
            "converged": fit.converged,
            "wild": int(fit.wild.sum()),
            "missed": fit.missed,
        }


def _law(law: Law | None, factor: float) -> Any:
    """Return a law of the error: its sensor, nodes in °C, values in mm or µm/m."""
    if law is None:
        return None
    return {
        "sensor": law.sensor,
        "kind": law.kind,
        "temperature": law.temperature,
        "error": factor * law.value,
        "standard_deviation": factor * law.deviation_at(law.temperature),
    }


def remarks_of(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return everything that the report has to say of a fit."""
    fit = draft.found
    yield from draft.share.remarks()
    if draft.confounded:
        yield Remark.error(
            f"{draft.confounded} The coefficient is left out; the offset over the temperature is"
            " determined and written."
        )
    if not fit.moving and asks_for_none(draft.fit):
        yield Remark.warning(
            "The law that is asked for is constant: it follows no temperature, and nothing"
            " is written. Leave law out, and it is chosen on readings held out."
        )
    elif not fit.moving:
        yield Remark.warning(
            "No effect of the temperature shows beyond chance: laws that follow it"
            " predict readings left out no better. Nothing is written."
        )
    if fit.meeting != "given":
        level = "warning" if fit.meeting in _UNSURE else "info"
        yield Remark(level, _meeting_words(fit))
    for lag in fit.lags:
        if lag.applied or (draft.fit.lag == "auto" and fit.data.time is not None):
            yield Remark.info(_lag_words(lag))
    yield from _too_quick(draft)
    yield from _too_hot(draft)
    if wild := int(fit.wild.sum()):
        yield wild_remark(wild, fit.wild.size, draft.fit.loss)
    if fit.missed:
        yield Remark.info(f"{fit.missed} readings were missed or incomplete.")
    yield from _undetermined(draft)
    yield from _bent(draft)
    if draft.written:
        yield from _state(draft)
        if _RULE not in draft.job.verified:
            yield _SIGN


def asks_for_none(fit: "Spec") -> bool:
    """Whether a job asks for laws that follow no temperature."""
    return set((fit.law or {}).values()) == {"constant"}


def _meeting_words(fit: TemperatureFit) -> str:
    """Return whether the lines of all temperatures meet, and where the reference is."""
    deviation = fit.reference_deviation or 0.0
    words = _MEETINGS[fit.meeting].format(at=fit.reference, sure=deviation)
    if fit.meeting != "met":
        words += f": the reference is {fit.reference:.4g} mm"
    return f"{words}.".replace("-", "−")


def _lag_words(lag: Lag) -> str:
    """Return what a lag means for the machine."""
    if not lag.applied:
        return f"No lag between {lag.sensor} and the structure shows."
    low, high = lag.interval
    span = f"95 %: {low:.3g} to {high:.3g} s" if high > low else "given"
    return (
        f"The structure follows {lag.sensor} with a time constant of"
        f" {lag.time_constant:.3g} s ({span}), by which the PLC filters the sensor. At its"
        " start the program takes the structure to be as warm as the sensor: after a loss of"
        f" power on a warm machine the law is right {3 * lag.time_constant:.3g} s later."
    )


def _too_quick(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return a doubt of the unit of the time, where all happens faster than in any machine."""
    fit = draft.found
    if fit.data.time is None or not fit.moving:
        return
    spans = {"The measurement lasts": float(np.ptp(fit.data.time))}
    if draft.fit.lag == "auto":
        # A lag of a few samples is what takes the noise of a sensor off.
        least = _FILTER * float(np.median(np.diff(np.unique(fit.data.time))))
        spans |= {
            f"The lag behind {g.sensor} is": g.time_constant
            for g in fit.lags
            if g.time_constant > least
        }
    for words, span in spans.items():
        if 0.0 < span < _QUICK:
            yield Remark.warning(
                f"{words} {span:.3g} s, and machines take minutes to warm: is the time in"
                ' minutes or hours? State its unit then (time = { column = …, unit = "min" }).'
            )
            return


def _too_hot(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return a doubt of the unit of a temperature that is never one of a room."""
    fit = draft.found
    for sensor in dict.fromkeys(law.sensor for law in fit.moving):
        least = float(np.nanmin(fit.data.temperature[sensor]))
        if least > SHOP[1]:
            words = f"{sensor} never shows less than {least:.4g} °C, {IN_SHOP}."
            yield Remark.warning(words)


def _undetermined(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return what these readings cannot say, however well they fit."""
    fit, axis, effects = draft.found, draft.axis, draft.fit.effects
    if fit.coefficient is None:
        yield Remark.warning(
            f"The coefficient of {axis} was not asked for: how the error grows along the"
            " axis is not known, and the same correction acts everywhere."
        )
    yield from _alike(fit)
    datum = draft.plan.datum
    if datum is not None and (moved := _moved_at(fit, datum)):
        yield Remark.error(
            f"The instrument was set to zero at {datum:g} mm (datum), and its readings there move"
            f" by {1e3 * moved:.2g} µm while the temperature changes: it was set once, and not"
            ' anew at each temperature. State remove = "offset" in place of datum.'
        )
    elif datum is not None and (effects is None or "offset" in effects):
        yield Remark.warning(
            f"The instrument was set to zero at {datum:g} mm (datum): a"
            " shift of the whole axis is not seen, and only the growth from there"
            " is corrected."
        )
    yield from _vague(draft)
    if not draft.confounded:
        yield from _or_drift(fit)
    if fit.independent < _FEW and fit.noise.drift > 0:
        advice = ""
        if fit.data.time is not None and draft.fit.group is None:
            advice = (
                " Where the instrument may be what drifts, state drift = 6 of the measurement and"
                " a group of this fit: lag and law are then found beside it."
            )
        yield Remark.warning(
            f"The residuals drift: the {len(fit.error)} readings tell no more than"
            f" {max(fit.independent, 1):.0f} independent ones would.{advice}"
        )


def _moved_at(fit: TemperatureFit, datum: float) -> float:
    """Return how far in mm readings at a datum move in time; 0 where they only scatter."""
    place = fit.position
    if place is None:
        return 0.0
    here = np.abs(place - datum) <= _AT * np.ptp(place)
    error = fit.error[here & ~fit.wild]
    if len(error) < _SEVERAL:
        return 0.0
    white = 0.5 * float(np.mean(np.diff(error) ** 2))
    large = np.std(error) > _PART * np.std(fit.error)
    return float(np.ptp(error)) if large and white < _WANDERS * np.var(error) else 0.0


def _vague(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return the laws that may as well be none, and whose list would move the axis far."""
    fit, axis = draft.found, draft.axis
    reach = max(float(np.abs(draft.places - draft.position).max()), 1e-9)
    for name, law in fit.laws.items():
        (slope, deviation), length = law.slope, reach if name == "coefficient" else 1.0
        doubt = deviation * float(np.ptp(law.temperature)) * length
        if abs(slope) >= _TOLD * deviation or doubt <= _LARGE * fit.noise.white:
            continue
        size, unit = (1e6, "µm/m per K") if name == "coefficient" else (1e3, "µm per K")
        yield Remark.error(
            f"The {name} of {axis} over {law.sensor} is {size * slope:.3g} ±"
            f" {size * deviation:.2g} {unit}: these readings do not tell it from none, and a"
            f" list of it may be off by {1e3 * doubt:.2g} µm. Let the temperature rise and fall"
            " more than once, while the axis goes over all of its travel each time, or leave"
            f' it out (law = {{ {name} = "constant" }}).'
        )


def _or_drift(fit: TemperatureFit) -> Iterator[Remark]:
    """Return which effect a drift of the instrument would explain as well, and what one does."""
    count, clock, place = len(fit.error), fit.data.order, fit.position
    distance = np.zeros(count) if place is None else place - place.mean()
    columns = {k: fit.structure[sensor] for k, sensor in fit.line.sensors.items()}
    if "coefficient" in columns:
        change = columns["coefficient"] - columns["coefficient"].mean()
        columns["coefficient"] = change * distance
    nuisance = np.stack([np.ones(count), distance], axis=1)
    from ...discover import against_drift, heat_or_drift  # takes long to load

    # All together, then each for itself: how the axis grows says nothing of its shift.
    together = [[*columns], *([effect] for effect in columns if len(columns) > 1)]
    for effects in together:
        heat = np.stack([columns[effect] for effect in effects], axis=1)
        others = [columns[effect] for effect in columns if effect not in effects]
        beside = np.column_stack([nuisance, *others])
        comparison = against_drift(clock, heat, fit.error, beside)
        if comparison is None:
            from scipy.stats import rankdata  # takes long to load

            # Too few readings for a drift beside it: one way up or down is like one.
            first = rankdata(fit.structure[fit.sensors[0]])
            correlation = np.corrcoef(rankdata(clock), first)[0, 1]
            doubtful, rms = abs(float(correlation)) > _ONE_WAY, float(np.std(fit.error))
        else:
            part, rms = len(effects) < len(columns), comparison.rms
            doubtful = comparison.doubtful_part if part else comparison.doubtful
        if doubtful:
            # The words of `discover`, which says so of the same readings.
            effect, axis = effects[0], fit.line.axis
            name = f"temperature {effect} of {axis} by {fit.line.sensors[effect]}"
            words, remedy = heat_or_drift(name, axis)
            yield Remark.warning(
                f"The data cannot tell: {words} ({1e3 * rms:.2g} µm rms). {remedy} What is"
                " written takes all of it for the temperature."
            )
            return
    yield from _drifted(fit, clock, distance)


def _drifted(
    fit: TemperatureFit,
    clock: Float[np.ndarray, " t"],
    distance: Float[np.ndarray, " t"],
) -> Iterator[Remark]:
    """Return that the error drifted beside the temperature, if it did, and by how much.

    By the instant of each reading, and the distance of its position from the mean in mm. A lag
    looks much like a drift: without any, a drift may leave less.
    """
    sound = ~fit.wild & np.isfinite(fit.error)
    span = (clock - clock.mean()) / (float(np.ptp(clock)) or 1.0)
    lagged = any(lag.applied for lag in fit.lags)
    left, drifts = [], []  # with the lags as fitted, then without any
    for warm in (fit.structure, fit.data.temperature)[: 1 + lagged]:
        changes = [warm[name] - warm[name].mean() for name in fit.sensors]
        change = np.column_stack([*changes, *_bends(fit, warm)])
        columns = [span[:, None], np.ones((len(span), 1)), distance[:, None]]
        columns += [change, change * distance[:, None]]
        try:
            found = regress(np.hstack(columns)[sound], fit.error[sound])
        except FitError:  # too few readings, or one that follows from the others
            return
        drifts.append((found.coefficients[0], found.standard_deviation[0]))
        left.append(float(np.std(found.residual[~found.wild])))
    drift, sd = drifts[0]
    if lagged and left[1] < _LESS * left[0]:
        drift, sd = drifts[1]
    if abs(drift) > max(_SURE * sd, _SLIGHT * min(left)):
        yield Remark.warning(
            f"Beside the temperature the error drifted by {1e3 * abs(drift):.2g} µm over the"
            " measurement: a part of that is in the law and in its lag. State the drift of"
            " the instrument (drift = … in a group), or measure for a shorter time."
        )


def _bends(fit: TemperatureFit, warm: Warmth) -> Iterator[Float[np.ndarray, "t n"]]:
    """Yield the functions of each temperature by which its laws are no straight lines."""
    for name in fit.sensors:
        nodes = [law.temperature for law in fit.laws.values() if law.sensor == name]
        if any(len(each) > 2 for each in nodes):
            yield node_shares(warm[name], max(nodes, key=len))[:, 1:-1]


def _bent(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return that the axis does not grow in proportion to the distance, and how far a line errs.

    By Legendre polynomials over the measured range; what is the same at all temperatures is
    the tables'.
    """
    fit, place = draft.found, draft.found.position
    if place is None or not np.ptp(place):
        return
    order = min(_BENDS, len(np.unique(place.round(2))) - 1)
    ends = place.min(), np.ptp(place)
    still = legvander(2.0 * (place - ends[0]) / ends[1] - 1.0, order)
    sensor = fit.line.sensors.get("coefficient", fit.sensors[0])
    warm = fit.structure[sensor]
    change = (warm - warm.mean())[:, None]
    sound = ~fit.wild & np.isfinite(fit.error)
    try:
        columns = np.hstack([change * still, still])
        found = regress(columns[sound], fit.error[sound], time=fit.data.order[sound])
    except FitError:  # fewer readings than that
        return
    share = np.linspace(-1.0, 1.0, 21)
    bends = legvander(share, order)[:, 2:]
    curve = bends @ found.coefficients[2 : order + 1]
    spread = bends @ found.covariance[2 : order + 1, 2 : order + 1] @ bends.T
    worst = int(np.argmax(np.abs(curve)))
    most = float(abs(curve[worst]) * np.abs(change).max())
    sure = abs(curve[worst]) > _SURE * np.sqrt(spread[worst, worst])
    if sure and most > _BENT * float(np.std(found.residual[~found.wild])):
        at = ends[0] + 0.5 * (share[worst] + 1.0) * ends[1]
        yield Remark.warning(
            f"{draft.axis} does not grow in proportion to the distance: a line, which is all that"
            f" the controller has, is off by up to {1e3 * most:.2g} µm about {draft.axis} ="
            f" {at:.4g}. Look at how scale and guides are held; take the temperature of the part"
            " of the axis that is worked on."
        )


def _alike(fit: TemperatureFit) -> Iterator[Remark]:
    """Return a warning where two sensors changed in the same way."""
    if len(fit.sensors) < 2:
        return
    first, second = fit.sensors
    courses = [fit.data.temperature[name] for name in fit.sensors]
    correlation = float(np.corrcoef(courses[0], courses[1])[0, 1])
    if abs(correlation) >= _SAME_COURSE:
        yield Remark.warning(
            f"{first} and {second} changed alike (correlation {correlation:.4f}): that the"
            f" offset follows {first} and the coefficient {second} is the choice of"
            " the job, these readings cannot tell it. Measure once while they differ."
        )


def _state(draft: "TemperatureDraft") -> Iterator[Remark]:
    """Return where the law is zero, and what stays for the tables."""
    fit, zero = draft.found, draft.zero
    wished, ends = fit.line.reference_temperature, [0, -1]
    nearest = {law.sensor: np.clip(zero, *law.temperature[ends]) for law in fit.moving}
    if any(abs(warm - wished) > 0.05 for warm in nearest.values()):
        at = " and ".join(f"{name} at {warm:.4g} °C" for name, warm in nearest.items())
        yield Remark.info(
            f"Nothing is corrected with {at}, measured next to the reference of"
            f" {wished:g} °C, which was not measured itself."
        )
    shown = f"What {draft.axis} shows at {zero:.4g} °C"
    if draft.share.tables:
        tables = " and the ".join(draft.share.tables)
        yield Remark.info(f"{shown} is held by the {tables} of the same group.")
        return
    words = f"{shown} belongs to its tables, not to this law."
    if fit.coefficient is not None and not draft.share.group.name:
        words += (
            " A leadscrew table that was measured warmer holds a part of this law as well:"
            " measure tables with this law active, or at that temperature."
        )
    yield Remark.info(words)
