"""Which compensations a machine asks for, axis by axis and drive by drive."""

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from ..core import one_blas_thread
from ._columns import Columns
from ._data import (
    AxisSummary,
    DiscoverError,
    Discovery,
    Found,
    Observed,
    Rejected,
    Unexplained,
)
from ._select import STABLE, Selection, choose_heat, select_terms
from ._terms import HEAT, PUSHES, Kind, Need, Term, compose
from ._unexplained import (
    Confusion,
    amount,
    drifts,
    heat_or_drift,
    look_for_confusion,
    ripples,
    sensors_alike,
    stays,
    wandering_runs,
)
from ._view import Channel, candidates_of, late_terms, view_of

_LEAST = 20
"""Readings of an axis, below which nothing can be told from chance."""
_WORTH_WORDS = 0.5
"""Standard deviations of a reading below which what stays is not spoken of."""
_SLOW = 2e-3
"""Share of the fastest speed below which friction is not kinetic."""
_MOVING = 200
"""Readings of a moving drive, below which its friction is not looked for."""
_EVEN = 0.05
"""Spread of the speeds, relative to their mean, below which there is but one."""


def discover(
    observed: Observed,
    axes: tuple[str, ...],
    *,
    source: str = "job",
    progress: Callable[[str], None] | None = None,
) -> Discovery:
    """Return which compensations the measurements of a machine ask for.

    Terms of every compensation and of what the controller has none for are fitted together to
    the error of each axis; those that come back in resamples and are large enough are named.

    Args:
        observed: All that was measured.
        axes: Names of all axes of the machine.
        source: For messages.
        progress: Called with what goes on.

    Raises:
        DiscoverError: If there is no error and no current of any axis, or too little.
    """
    channels: tuple[Channel, ...] = ("error", "current")
    parts: list[Discovery] = []
    with one_blas_thread():
        for channel, axis in itertools.product(channels, axes):
            values = getattr(observed, channel).get(axis, np.zeros(0))
            count = int(np.isfinite(values).sum())
            if channel == "error" and 0 < count < _LEAST:
                words_of = f"{count} readings of the error of {axis}"
                raise DiscoverError(source, words_of, f"at least {_LEAST}")
            if count and progress is not None:
                progress(f"examining the {channel} of {axis}")
            if count:
                parts.append(examine(observed, channel, axis, axes))
    if not parts:
        expected = "an error or a current of at least one axis"
        raise DiscoverError(source, "no measured error and no current", expected)
    return Discovery.of(parts)


def examine(
    observed: Observed, channel: Channel, axis: str, axes: tuple[str, ...]
) -> Discovery:
    """Return which compensations the error, or the current, of an axis, one of all, asks for."""
    rows: Bool[np.ndarray, " t"] | str = np.isfinite(getattr(observed, channel)[axis])
    if channel == "current":
        rows = _moving_rows(observed, axis)
    if isinstance(rows, str):
        reason = f"could not be looked for: {rows}"
        return Discovery((), rejected=(Rejected("friction", axis, (), None, reason),))
    view = view_of(observed, axis, rows, channel)
    terms, heat, absent = candidates_of(view, axes)
    columns = Columns(view)
    if heat:
        terms += choose_heat(columns, terms, heat)
    chosen = select_terms(columns, terms)
    further = list(late_terms(view, axes, chosen.terms))
    if further:
        revised = select_terms(columns, [*chosen.terms, *further], terms)
        if any(term in further for term in revised.terms):
            chosen = revised
    turning = [name for name in axes if view.goes_round(name)]
    composed = compose({t: chosen.size_of([t])[0] for t in chosen.terms}, turning)
    needs = [need for need in composed if need.compensation is not None]
    confusion = look_for_confusion(chosen, needs, heat)
    doubts = list(_doubts(chosen, confusion, needs))
    doubtful = {need for need, _ in doubts}
    rejected = [*_rejected(chosen, needs, confusion), *absent]
    drift, warm = confusion.drift, [n for n in needs if n.terms == confusion.heat]
    if drift is not None and drift.slight and not drift.known:
        doubtful.update(warm)
        reason = "no more than a drift of the instrument, which changes alike"
        rejected += [Rejected("temperature", axis, (), n.sensor, reason) for n in warm]
    certain = [need for need in needs if need not in doubtful]
    wanders = tuple(drifts(chosen))
    if wanders and confusion.shift is not None:
        # A fit that knows of the drift gives the shift to it.
        certain = [need.growth_alone() if need in warm else need for need in certain]
    # A fit of a group knows of the drift, even if it is the only one.
    group = axis if len(certain) > 1 or wanders else None
    records = [_found(chosen, need, group) for need in certain]
    records.sort(key=lambda entry: -entry.share)
    unexplained = [entry for _, entry in doubts]
    for need in composed:
        rms, share = chosen.size_of(need.terms)
        if need.compensation is None and rms > _WORTH_WORDS * chosen.noise:
            text = f"{need.words.removesuffix('.')} ({amount(chosen, rms)} rms)."
            label = need.lead.words
            unexplained.append(stays(chosen, label, need.masters, rms, text, share))
    unexplained += [*wandering_runs(chosen), *ripples(chosen)]
    size = float(np.sqrt(chosen.square))
    summary = AxisSummary(axis, channel, int(rows.sum()), size, chosen.noise, view.unit)
    return Discovery(
        (summary,), tuple(records), tuple(rejected), tuple(unexplained), wanders
    )


def _found(chosen: Selection, need: Need, group: str | None) -> Found:
    """Return a compensation that the error asks for."""
    name, axis = str(need.compensation), chosen.view.axis
    rms, share = chosen.size_of(need.terms)
    along = f" over {' and '.join(need.masters)}" if need.masters else ""
    if need.lead.kind in PUSHES:
        along = f" from {need.masters[0]}"
    sentence = f"{name} of {axis}{along}: {amount(chosen, rms)} rms,"
    sentence += f" {share:.0%} of the {chosen.view.channel}. {need.words}"
    keys, pivot = dict(need.keys), chosen.pivot(need.terms)
    if pivot is not None:
        keys["reference"] = pivot
    stability = float(min(chosen.frequency[chosen.index(need.terms)]))
    return Found(
        axis=axis, masters=need.masters, rms=rms, share=share, unit=chosen.view.unit,
        sentence=sentence.strip(), compensation=name, sensor=need.sensor,
        stability=stability, keys=keys, group=group,
    )  # fmt: skip


def _doubts(
    chosen: Selection, confusion: Confusion, needs: Sequence[Need]
) -> Iterator[tuple[Need | None, Unexplained]]:
    """Yield what several could explain, with the compensation that it would be."""

    def cannot_tell(
        names: Sequence[str], masters: Sequence[str], rms: float, remedy: str
    ) -> Unexplained:
        label = " or ".join(names)
        text = f"The data cannot tell: {label} ({amount(chosen, rms)} rms). {remedy}"
        return stays(chosen, label, masters, rms, text, verdict="the data cannot tell")

    for need, others in confusion.others.items():
        names = [need.lead.words, *(other.words for other in others)]
        lines = [other for other in others if other.kind is Kind.LINE]
        if "masters" in need.keys and lines:
            # A plane gives way to the lines that suffice.
            contained = [term for term in need.terms if term.kind is Kind.LINE]
            names = [term.words for term in dict.fromkeys([*contained, *lines])]
        masters = [*need.masters, *(name for other in others for name in other.masters)]
        rms, remedy = chosen.size_of(need.terms)[0], _remedy(need, others)
        yield need, cannot_tell(names, masters, rms, remedy)
    drift, heat = confusion.drift, confusion.heat
    heated = next((other for other in needs if other.terms == heat), None)
    if drift is not None and drift.doubtful and heated not in confusion.others:
        label, remedy = heat_or_drift(heat[0].words, chosen.view.axis)
        yield heated, cannot_tell([label], (), drift.rms, remedy)
    if confusion.shift is not None and heated not in confusion.others:
        shift, rms = confusion.shift
        label, remedy = heat_or_drift(shift.words, chosen.view.axis)
        yield None, cannot_tell([label], (), rms, remedy)
    for need in needs:
        alike = sensors_alike(chosen, need)
        if alike and need not in confusion.others:
            names = [f"temperature of {chosen.view.axis} by {name}" for name in alike]
            remedy = f"{' and '.join(alike)} changed alike; measure once while they do"
            rms, _ = chosen.size_of(need.terms)
            yield need, cannot_tell(names, (), rms, f"{remedy} not, as after a pause.")
    if chosen.view.channel == "current":
        law = needs[0] if needs else None
        for label, remedy in _undetermined_friction(chosen, law is not None):
            rms = max((chosen.size_of([term])[0] for term in chosen.terms), default=0.0)
            yield law, cannot_tell([label], (), rms, remedy)


def _remedy(need: Need, others: Sequence[Term]) -> str:
    axis = need.lead.axis
    if Kind.SPEED in {other.kind for other in others}:
        return f"Measure {axis} at another feed too, or at standstill."
    if need.lead.kind in HEAT or others[0].kind in HEAT:
        return "Measure once more at another temperature, in another order of places."
    axes = {*(need.masters or (axis,)), *others[0].masters}
    names = " and ".join(sorted(axes))
    if len(axes) > 1:
        return f"{names} went together; move them one without the other."
    return f"Measure with other motions of {names}."


def _rejected(
    chosen: Selection, needs: Sequence[Need], confusion: Confusion
) -> Iterator[Rejected]:
    """Yield the compensations that are not there, and why each is not."""
    axis, names = chosen.view.axis, {need.compensation for need in needs}
    pushing = {need.masters[0] for need in needs if need.lead.kind in PUSHES}
    used = {term for need in needs for term in need.terms}
    used |= {term for others in confusion.others.values() for term in others}
    frequency = dict(zip(chosen.design.terms, chosen.frequency.tolist(), strict=True))
    likely = confusion.drift is not None and confusion.drift.imitated
    reasons: dict[tuple[str, tuple[str, ...], str | None], str] = {}
    for term in chosen.looked:
        name, share = term.facts.compensation, frequency.get(term, 0.0)
        # What an axis has once, whatever it is over, is spoken of once.
        if name is None or term in used or (len(term.masters) != 1 and name in names):
            continue
        if term.kind in PUSHES and term.masters[0] in pushing:
            continue
        reason = f"nothing of it in the {chosen.view.channel}"
        if likely and term in confusion.heat:
            reason = "a drift of the instrument explains the same"
        elif term in confusion.hidden:
            reason = "cannot be seen beside what was found: they change together"
        elif share >= STABLE:
            reason = "no more of it than chance gives, or than others explain"
        elif share > 0:
            reason = f"seen in {share:.0%} of the resamples only"
        reasons.setdefault((name, term.masters, term.sensor), reason)
    for (name, masters, sensor), reason in reasons.items():
        yield Rejected(name, axis, masters, sensor, reason)


def _moving_rows(observed: Observed, axis: str) -> Bool[np.ndarray, " t"] | str:
    """Return the rows in which a drive moves, or why there are none."""
    for channel in ("velocity", "acceleration", "position"):
        if axis not in getattr(observed, channel):
            return f"no {channel} of {axis} was recorded, nor time to derive it from"
    velocity = observed.velocity[axis]
    finite = np.isfinite(observed.current[axis] + velocity)
    finite &= np.isfinite(observed.acceleration[axis] + observed.position[axis])
    if not finite.any():
        return f"current and motion of {axis} were never recorded together"
    rows = finite & (np.abs(velocity) > _SLOW * np.max(np.abs(velocity[finite])))
    if rows.sum() < _MOVING:
        return f"{axis} moves in {rows.sum()} readings of its current only"
    return np.asarray(rows)


def _undetermined_friction(chosen: Selection, law: bool) -> Iterator[tuple[str, str]]:
    """Yield what the motion of a drive cannot tell apart, and what to record."""
    axis, velocity = chosen.view.axis, chosen.view.data.velocity[chosen.view.axis]
    speeds = np.abs(velocity)
    cruise = speeds[speeds > 0.5 * speeds.max()]
    one_speed = np.mean(speeds > 0.9 * speeds.max()) > 0.97
    if len(np.unique(np.sign(velocity))) < 2:
        remedy = f"{axis} moves in one direction only. Record both."
        yield f"friction or constant load of {axis}", remedy
    elif law and one_speed and np.std(cruise) < _EVEN * np.mean(cruise):
        speed = float(np.mean(cruise))
        remedy = f"{axis} moves at {speed:.3g}/s only. Record other speeds too."
        yield f"Coulomb or viscous friction of {axis}", remedy
