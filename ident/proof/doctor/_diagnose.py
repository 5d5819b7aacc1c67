"""From measurements without and with the lists to what is wrong with them."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ....data.lists import ListFile
from ....models import Conventions
from ...exchange import ExchangeError, Increments, InUse, Ranges, machine_lists
from ._cases import Setting, cases_of
from ._measured import Difference, Measured, difference
from ._words import sentence_of

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
    conventions: Conventions,
    increment: Increments = None,
    *,
    modulo: Ranges | None = None,
    names: Mapping[int, str] | None = None,
) -> tuple[Diagnosis, ...]:
    """Return what is wrong with each compensation that was measured.

    Args:
        lists: As they were active in the second measurement.
        before: Measurements without, of all axes.
        after: Measurements with the lists active.
        conventions: Rules of the controller.
        increment: Worth of an encoder increment for lists with ``unit 0``.
        modulo: Range in ° by axis, for the axes that turn.
        names: Of the axes, for the sentences.

    Raises:
        ExchangeError: If a list makes no table, an axis has two, or no axis with a list
            was measured both times.
    """
    used = [
        one for one in machine_lists(lists).in_use(conventions) if not one.kind.unseen
    ]
    both = sorted({one.axis for one in before} & {one.axis for one in after})
    changes: dict[int, Difference] = {}
    switched: dict[tuple[int, str], int] = {}
    for axis in both:
        old = [one for one in before if one.axis == axis]
        new = [one for one in after if one.axis == axis]
        changes[axis] = difference(old, new)
        for use in used:
            if use.axis == axis:
                switched[axis, use.name] = _state(use, new, True) - _state(
                    use, old, False
                )
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
        measured = ", ".join(f"A{axis}" for axis in both) or "no axis"
        raise ExchangeError(
            where="doctor",
            found=f"lists for {axes}; measured both times: {measured}",
            expected="an axis with a list that was switched between the measurements",
        )
    setting = Setting(conventions, increment, modulo or {})
    acting = {
        (use.axis, use.name): setting.column(use, changes[use.axis]) for use in judged
    }
    # What a list says is the same everywhere, such as a temperature line that a PLC
    # moves, hides in the zero of the instrument; what the PLC adds looks like a fault.
    columns = {key: one for key, one in acting.items() if np.ptp(one) > 0}
    blurred = {axis for axis, name in acting.keys() - columns.keys()}
    found = []
    for use in judged:
        key = use.axis, use.name
        found.append(
            _judged(
                use,
                switched[key],
                changes,
                columns,
                setting,
                names or {},
                blurred=use.axis in blurred,
            )
        )
    return tuple(found)


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
    use: InUse,
    switched: int,
    changes: Mapping[int, Difference],
    columns: Mapping[tuple[int, str], Float[np.ndarray, " g"]],
    setting: Setting,
    names: Mapping[int, str],
    *,
    blurred: bool,
) -> Diagnosis:
    explained = cases_of(use, switched, changes, columns, setting)
    cases = explained.cases
    total = np.array([one.likelihood + np.log(one.prior) for one in cases])
    shares = np.exp(total - np.logaddexp.reduce(total))
    by_word: dict[str, float] = {}
    for one, share in zip(cases, shares, strict=True):
        by_word[one.word] = by_word.get(one.word, 0.0) + float(share)
    word = max(by_word, key=lambda name: by_word[name])
    first = max(
        (k for k, one in enumerate(cases) if one.word == word), key=lambda k: shares[k]
    )
    best = cases[first]
    blind = explained.blind if word == "right" else None
    told = by_word[word] >= SURE and word != "cannot tell"
    told = told and (word == "right" or not blurred)
    sure = told and blind is None
    text = sentence_of(
        word if sure else "cannot tell",
        best.value,
        best.note,
        by_word,
        explained.factor,
        blind=blind,
        unit="°" if use.axis in setting.ranges else "mm",
        axis=names.get(use.axis, f"A{use.axis}"),
        other=names.get(int(best.value or 0), f"A{best.value or 0:g}"),
    )
    return Diagnosis(
        use.axis,
        use.name,
        word if sure else "cannot tell",
        best.value if sure else None,
        by_word[word],
        text,
        best.sign if told else 0,
    )
