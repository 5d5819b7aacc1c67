"""From measurements without and with the lists to what is wrong with them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ....data.lists import ListFile
from ....models import Conventions
from ...exchange import ExchangeError, InUse, Reading, machine_lists
from ..verify import fault_words
from ._cases import Case, Scene, cases_of
from ._measured import Difference, Measured, difference

SURE = 0.99
"""Probability from which on a verdict is given."""

_FEWEST = 4
"""Places that an axis must have been measured at, both times."""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """What is wrong with one compensation of one axis.

    Attributes:
        axis: Logical number.
        compensation: As in a job file.
        verdict: ``right``, ``sign``, ``unit``, ``shift``, ``wrong axis``, ``twice`` or
            ``cannot tell``.
        value: Factor of the offset; shift in mm or °; number of the other axis; None
            where there is none.
        probability: Of the verdict, given that one of them is true.
        sentence: For the person at the machine.
        sign: 1 where the list surely acts with the sign that it has, right or shifted,
            −1 where surely with the opposite one; 0 where neither is sure.
    """

    axis: int
    compensation: str
    verdict: str
    value: float | None
    probability: float
    sentence: str
    sign: int = 0

    def as_tree(self) -> dict[str, Any]:
        """Return it as result.json has it."""
        return {
            "verdict": self.verdict,
            "value": self.value,
            "probability": self.probability,
            "sign": self.sign,
            "sentence": self.sentence,
        }


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
    loaded = machine_lists(lists).in_use(reading.conventions)
    used = [one for one in loaded if not one.kind.unseen]
    changes: dict[int, Difference] = {}
    switched: dict[tuple[int, str], int] = {}
    for axis in sorted({one.axis for one in before} & {one.axis for one in after}):
        old = [one for one in before if one.axis == axis]
        new = [one for one in after if one.axis == axis]
        changes[axis] = difference(old, new)
        for use in used:
            if use.axis == axis:
                on = _state(use, new, True) - _state(use, old, False)
                switched[axis, use.name] = on
        if len(changes[axis].change) < _FEWEST:
            raise ExchangeError(
                where="doctor",
                found=f"{len(changes[axis].change)} places of A{axis} that both"
                " measurements have",
                expected=f"at least {_FEWEST}",
            )
    judged = [use for use in used if switched.get((use.axis, use.name))]
    if not judged:
        axes = ", ".join(f"A{one.axis}" for one in used) or "no axis"
        measured = ", ".join(f"A{axis}" for axis in changes) or "no axis"
        raise ExchangeError(
            where="doctor",
            found=f"lists for {axes}; measured both times: {measured}",
            expected="an axis with a list that was switched between the measurements",
        )
    scene = Scene(changes, switched, reading)
    # What a list says is the same everywhere, such as a temperature line that a PLC
    # moves, hides in the zero of the instrument; what the PLC adds looks like a fault.
    blurred = set()
    for use in judged:
        column = scene.column(use, use.axis)
        if np.ptp(column) > 0:
            scene.columns[use.axis, use.name] = column
        else:
            blurred.add(use.axis)
    return tuple(
        _judged(use, scene, names or {}, blurred=use.axis in blurred) for use in judged
    )


def not_judged(
    lists: Sequence[ListFile],
    conventions: Conventions,
    names: Mapping[int, str] | None = None,
) -> tuple[str, ...]:
    """Return a line for each list whose effect no such measurement shows, and why."""
    known = names or {}
    return tuple(
        f"{known.get(one.axis, f'A{one.axis}')} {one.name}: not judged: {one.kind.unseen}"
        for one in machine_lists(lists).in_use(conventions)
        if one.kind.unseen
    )


def _state(use: InUse, measured: Sequence[Measured], loaded: bool) -> int:
    """Return whether a compensation was on: as stated, else as lists are loaded."""
    stated = frozenset[str]().union(*(one.active for one in measured))
    return int(use.name in stated if stated or not loaded else True)


def _judged(
    use: InUse, scene: Scene, names: Mapping[int, str], *, blurred: bool
) -> Diagnosis:
    cases, factor, blind = cases_of(use, scene)
    total = np.array([one.likelihood + np.log(one.prior) for one in cases])
    shares = np.exp(total - np.logaddexp.reduce(total)).tolist()
    by_word: dict[str, float] = {}
    for one, share in zip(cases, shares, strict=True):
        by_word[one.word] = by_word.get(one.word, 0.0) + share
    word = max(by_word, key=lambda name: by_word[name])
    best = max(
        zip(shares, cases, strict=True), key=lambda one: (one[1].word == word, one[0])
    )[1]
    blind = blind if word == "right" else None
    told = by_word[word] >= SURE and word != "cannot tell"
    told = told and (word == "right" or not blurred)
    verdict = word if told and blind is None else "cannot tell"
    unit = "°" if use.axis in scene.reading.modulo else "mm"
    sentence = f"cannot tell: {_doubt(by_word, factor, blind, unit)}"
    if verdict != "cannot tell":
        axis, other = (names.get(n, f"A{n}") for n in (use.axis, best.axis or 0))
        sentence = _sentence(verdict, best, unit, axis, other)
    return Diagnosis(
        axis=use.axis,
        compensation=use.name,
        verdict=verdict,
        value=None if verdict == "cannot tell" else best.value,
        probability=by_word[word],
        sentence=sentence,
        sign=best.sign if told else 0,
    )


def _sentence(verdict: str, best: Case, unit: str, axis: str, other: str) -> str:
    """Return the sentence on a compensation that a verdict is given on.

    Args:
        verdict: Word of the interface.
        best: Explanation that it stands for.
        unit: Of lengths.
        axis: Name of the axis.
        other: Name of the axis on which it acts instead, if it does.
    """
    value = best.value or 0.0
    if verdict == "right":
        return "right: the list adds what it says"
    if verdict != "wrong axis":
        words = fault_words(verdict, value, unit)
        if verdict == "sign" and value != -1.0:
            words += f" and {-value:g} times as large"
        return words
    if best.axis is not None:
        return f"acts on {other} instead of {axis}"
    if best.follows_another:
        return "follows another master: masters swapped"
    return (
        f"does nothing to {axis}: it acts on another axis, follows another master, or"
        " is not active"
    )


def _doubt(
    shares: Mapping[str, float], factor: float, blind: float | None, unit: str
) -> str:
    """Return why nothing can be said.

    Args:
        shares: Probability by word.
        factor: What fits best, of the offset that the list gives.
        blind: Shift that these readings cannot tell from none, in the unit of lengths.
        unit: Of lengths.
    """
    if blind is not None:
        return (
            f"right, or shifted by up to {blind:.1f} {unit}: these readings"
            " do not show the difference; measure at more places, or with less noise"
        )
    likely = sorted(shares, key=lambda word: -shares[word])
    if likely[0] == "cannot tell" and abs(factor) < 0.3:
        return "it does nothing to any axis that was measured; is it active?"
    if likely[0] == "cannot tell":
        return (
            f"what it does is {factor:.2g} times what the list says, which"
            " no single fault explains"
        )
    named = [
        f"{word} {100 * shares[word]:.0f} %"
        for word in likely[:3]
        if shares[word] > 0.005 and word != "cannot tell"
    ]
    return f"{', '.join(named)}; measure again with more readings, or with less noise"
