"""From measurements without and with the lists to what is wrong with them."""

import dataclasses
import math
import operator
from collections.abc import Mapping, Sequence

import numpy as np

from ....data.lists import ListFile
from ....models import Conventions
from ...exchange import InUse, Reading, expect, machine_lists
from ...kinds import kind
from ..verify import FAULT, search
from ._cases import SUSPECTED, Diagnosis, Scene, cases_of
from ._measured import Difference, Measured, difference, too_good

SURE = 0.99
"""Probability from which on a verdict is given."""

_LESS = 0.7
"""Share of what the best fault leaves of a change, below which a slope beside the list is one."""

_BENT = 0.5
"""Share of what a list adds that is no slope over its masters, from which on another is told."""

_FEWEST = 4
"""Places that an axis must have been measured at, both times."""


def diagnose(
    lists: Sequence[ListFile],
    before: Sequence[Measured],
    after: Sequence[Measured],
    reading: Reading,
    *,
    names: Mapping[int, str] | None = None,
) -> tuple[Diagnosis, ...]:
    """Return what is wrong with each compensation that was measured.

    Args:
        lists: As they were active in the second measurement.
        before: Measurements without, of all axes.
        after: Measurements with the lists active.
        reading: How the lists are read.
        names: Of the axes, for the sentences.

    Raises:
        ExchangeError: If a list makes no table, an axis has two, or no axis with a list
            was measured both times.
    """
    # What acts while another axis accelerates is no part of what tables add.
    before, after = ([one.undriven for one in each] for each in (before, after))
    loaded = machine_lists(lists).in_use(reading.conventions)
    active = [use for use in loaded if not use.kind.unseen]
    changes: dict[int, Difference] = {}
    switched: dict[tuple[int, str], int] = {}
    for axis in sorted({one.axis for one in before} & {one.axis for one in after}):
        earlier = [one for one in before if one.axis == axis]
        later = [one for one in after if one.axis == axis]
        mine = [use for use in active if use.axis == axis]
        followed = {axis}.union(*(use.masters for use in mine))
        changes[axis] = difference(earlier, later, followed)
        for use in mine:
            on = _state(use, later, True) - _state(use, earlier, False)
            switched[axis, use.name] = on
        count = len(changes[axis].change)
        words = f"{count} places of A{axis} that both measurements have"
        expect(count >= _FEWEST, "doctor", words, f"at least {_FEWEST}")
        words = f"errors of A{axis} that vary or repeat far closer than those before"
        expected = "readings of the machine: is their unit right, and their column"
        expect(not too_good(earlier, later), "doctor", words, expected)
    switched_uses = [use for use in active if switched.get((use.axis, use.name))]
    axes = ", ".join(f"A{use.axis}" for use in active) or "no axis"
    measured = ", ".join(f"A{axis}" for axis in changes) or "no axis"
    words = f"lists for {axes}; measured both times: {measured}"
    expected = "an axis with a list that was switched between the measurements"
    expect(switched_uses, "doctor", words, expected)
    scene = Scene(changes, switched, reading, names or {})
    # What a list says is the same everywhere, such as a temperature line that a PLC
    # moves, hides in the zero of the instrument; what the PLC adds looks like a fault.
    blurred, two_sided = set(), set()
    for use in switched_uses:
        channel = scene.channel(use, use.axis)
        column = channel.column(channel.plain)
        if np.ptp(column) > 0:
            scene.columns[use.axis, use.name] = column
            way = changes[use.axis].direction
            if way is not None and all(np.ptp(column[way == w]) == 0 for w in set(way)):
                two_sided.add(use)  # the flanks alone, which no temperature tells apart
        else:
            blurred.add(use.axis)

    def judged(use: InUse) -> Diagnosis:
        if use.axis not in blurred:
            return _but_for_the_machine(use, scene, _judged(use, scene, False))
        if use in two_sided:
            every = changes[use.axis].positions.values()
            return _judged(use, scene.with_free(use.axis, [*every]), False)
        return _judged(use, scene, True)

    return tuple(map(judged, switched_uses))


def driving_axes(
    lists: Sequence[ListFile], conventions: Conventions
) -> dict[int, tuple[int, ...]]:
    """Return, by axis, the axes whose acceleration moves it by a list that is switched on."""
    return {
        use.axis: use.masters[:1]  # the one that accelerates comes first
        for use in machine_lists(lists).in_use(conventions)
        if "acceleration" in use.kind.follows
    }


def _but_for_the_machine(use: InUse, scene: Scene, diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis; right where what no list adds explains more than any fault.

    An axis that has warmed up since has a slope over its own positions, a straightedge that was
    set up anew one over its masters', and a screw that wore lies apart by directions, which a
    list that knows none cannot make.
    """
    if diagnosis.verdict == "right":
        return diagnosis
    change = scene.changes[use.axis]
    linear = change.positions.keys() - scene.reading.modulo
    own, over = {use.axis} & linear, {*use.masters} & linear - {use.axis}
    column = scene.columns[use.axis, use.name]
    plain = [np.ones(len(column)), *(change.positions[each] for each in over)]
    slopes = np.stack(plain, axis=1)
    bent = column - slopes @ np.linalg.lstsq(slopes, column)[0]
    if np.std(bent) < _BENT * np.std(column):
        # Most of the list is a slope itself: one beside it may be the list turned round.
        over.clear()
    beside = [
        (scene.with_free(use.axis, [change.positions[k] for k in sorted(axes)]), words)
        for axes, words in (
            (own, "a slope that no list adds (temperature?)"),
            (over, "a slope that no list adds (the set-up of the instrument?)"),
        )
        if axes
    ]
    way, channel = change.direction, scene.channel(use, use.axis)
    between = channel.parts(channel.plain, slice(None)).change
    alike = between is None or not between.any()  # in both directions
    if way is not None and np.ptp(way) and alike:
        words = "a difference of the directions that no list adds (backlash?)"
        beside.append((scene.with_free(use.axis, [way.astype(float)]), words))

    def left(scene: Scene) -> float:
        found = search(channel, scene.target(use, use.axis))
        return float(np.median(np.abs(found.residual)))

    for freed, words in beside:
        free = _judged(use, freed, False)
        if free.verdict == "right" and left(freed) <= _LESS * left(scene):
            return dataclasses.replace(
                free, sentence=f"{free.sentence}, beside {words}"
            )
    return diagnosis


def not_judged(
    lists: Sequence[ListFile], conventions: Conventions, names: Mapping[int, str]
) -> tuple[str, ...]:
    """Return a line for each list whose effect no such measurement shows, and why."""
    return tuple(
        f"{names.get(use.axis, f'A{use.axis}')} {use.name}: not judged: {use.kind.unseen}"
        for use in machine_lists(lists).in_use(conventions)
        if use.kind.unseen
    )


def unlisted(
    lists: Sequence[ListFile],
    before: Sequence[Measured],
    after: Sequence[Measured],
    conventions: Conventions,
    names: Mapping[int, str],
) -> tuple[str, ...]:
    """Return a line for each compensation that was switched, and that no list has.

    What is stated as active is so of a measurement, which may show axes that have no such list
    beside the one that has.
    """
    known = {use.name for use in machine_lists(lists).in_use(conventions)}
    states = [
        {(one.axis, name) for one in measured for name in {*(one.active or ())} - known}
        for measured in (before, after)
    ]
    return tuple(
        f"{names.get(axis, f'A{axis}')} {name}: not judged: it was switched between the"
        " measurements (active), and none of the lists has it; give the one that does"
        for axis, name in sorted(states[0] ^ states[1])
        if not kind(name).unseen
    )


def _state(use: InUse, measured: Sequence[Measured], loaded: bool) -> int:
    """Return whether a compensation was on: as stated, else as lists are loaded."""
    stated = [table.active for table in measured if table.active is not None]
    return int(any(use.name in active for active in stated) if stated else loaded)


def _judged(use: InUse, scene: Scene, blurred: bool) -> Diagnosis:
    cases, factor, blind = cases_of(use, scene, blurred=blurred)
    # Of each word the best case, less likely beforehand where it is a fault.
    best_of: dict[str, Diagnosis] = {}
    scores: dict[str, float] = {}
    for criterion, diagnosis in sorted(cases, key=operator.itemgetter(0)):
        if best_of.setdefault(diagnosis.verdict, diagnosis) is diagnosis:
            cost = criterion - (FAULT - SUSPECTED) * (diagnosis.verdict != "right")
            scores[diagnosis.verdict] = -0.5 * cost
    total = np.logaddexp.reduce(list(scores.values()))
    by_word = {
        word: float(np.exp(likelihood - total)) for word, likelihood in scores.items()
    }
    word = max(by_word, key=lambda name: by_word[name])
    best = dataclasses.replace(best_of[word], probability=by_word[word])
    likely = by_word[word]
    if word == "other":  # which fault it is not need not be sure
        likely = 1.0 - by_word.get("right", 0.0) - by_word.get("cannot tell", 0.0)
    sure = likely >= SURE and (word == "right" or not blurred)
    if sure and word != "cannot tell" and (word != "right" or blind is None):
        return best
    unit = "°" if use.axis in scene.reading.modulo else "mm"
    return dataclasses.replace(
        best,
        verdict="cannot tell",
        value=None,
        near="",
        sentence=f"cannot tell: {_doubt(by_word, factor, blind, unit, blurred=blurred)}",
        sign=best.sign if sure else 0,
    )


def _doubt(
    shares: Mapping[str, float],
    factor: float,
    blind: float | None,
    unit: str,
    *,
    blurred: bool,
) -> str:
    """Return why nothing can be said, by the probabilities of the words.

    The factor is what fits best, of the offset that the list gives (NaN: none shows); `blind` a
    shift that these readings cannot tell from none, in the unit of lengths; blurred: another list
    of the axis adds the same at all these places.
    """
    ranked = sorted(shares, key=lambda word: -shares[word])
    if blind is not None and (ranked[0] == "right" or ranked[:2] == ["shift", "right"]):
        return (
            f"right, or shifted by up to {blind:.1f} {unit}: these readings"
            " do not show the difference; measure at more places, or with less noise"
        )
    if math.isnan(factor):
        return (
            "what the list says is the same at all these places, as is the zero of an"
            " instrument"
        )
    if ranked[0] == "cannot tell" and abs(factor) < 0.3:
        return (
            "nothing of what it says shows in any axis that was measured; is it active?"
        )
    if ranked[0] == "cannot tell":
        return (
            f"what it does is {factor:.2g} times what the list says, which"
            " no single fault explains"
        )
    if blurred and shares[ranked[0]] >= SURE:
        return (
            f"{ranked[0]} ({100 * shares[ranked[0]]:.0f} %), or what another list of the axis"
            " adds, which is the same at all these places (a temperature line): measure"
            " with that one off, or both times at one temperature"
        )
    candidates = [
        f"{word} {100 * shares[word]:.0f} %"
        for word in ranked[:3]
        if shares[word] > 0.005 and word != "cannot tell"
    ]
    return (
        f"{', '.join(candidates)}; measure again with more readings, or with less noise"
    )
