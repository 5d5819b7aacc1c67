"""What is known of one axis before its errors are looked at."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...core._errors import FitError
from ._confused import Told, told_by
from ._confusion_words import confusions_of
from ._data import JointData
from ._design import Design, design_of
from ._effect import AbstractEffect
from ._gauges import almost, gauges_of
from ._null import Pinned, pinned
from ._result import Confusion, Gauge
from ._rules import Rules, rules_of, with_lost
from ._sums import Information


@dataclasses.dataclass(frozen=True)
class Ground:
    """One axis as far as its numbers go: enough to fit it.

    Attributes:
        sums: Information of all usable readings.
        pinned: What nothing holds.
    """

    sums: Information
    pinned: Pinned

    @property
    def design(self) -> Design:
        """Columns."""
        return self.sums.design


@dataclasses.dataclass(frozen=True)
class Prepared:
    """One axis, ready to fit or to examine.

    Attributes:
        sums: Information of all usable readings.
        pinned: What nothing holds.
        structure: Freedoms of the sum with their rules.
        rules: Those, and what the data leave open besides.
        told: What the data tell.
        gauges: Freedoms of the sum, in words.
        confusions: What the data do not tell, in words.
    """

    sums: Information
    pinned: Pinned
    structure: Rules
    rules: Rules
    told: Told
    gauges: tuple[Gauge, ...]
    confusions: tuple[Confusion, ...]

    @property
    def design(self) -> Design:
        """Columns."""
        return self.sums.design


def ground_of(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    measured: bool,
) -> Ground:
    """Return the numbers of one axis; the arguments are those of `prepare`.

    Raises:
        FitError: If no row is complete.
    """
    design = design_of(axis, effects, data, drift, use, measured)
    sums = Information.of(design)
    return Ground(sums, pinned(sums))


def prepare(
    axis: str,
    effects: Sequence[AbstractEffect],
    data: JointData,
    drift: int,
    use: Bool[np.ndarray, " t"] | None,
    measured: bool,
) -> Prepared:
    """Return what is known of one axis before its errors are looked at.

    Args:
        axis: Compensated axis.
        effects: Its effects, nodes placed.
        data: Rows.
        drift: Pieces of the drift of each run.
        use: Rows that may be used; None = all.
        measured: Only rows with an error count.

    Raises:
        FitError: If no row is complete.
    """
    return judged(ground_of(axis, effects, data, drift, use, measured), data, drift)


def freedoms(ground: Ground, data: JointData, drift: int) -> Rules:
    """Return what may be moved between the effects, and the rules that fix it."""
    return rules_of(ground.design, data, drift, _counts(ground))


def all_rules(ground: Ground, structure: Rules) -> Rules:
    """Return the rules with those beside them for what these readings leave open."""
    lost = ground.pinned.null
    return with_lost(structure, ground.design, lost, _counts(ground))


def _counts(ground: Ground) -> Float[np.ndarray, " n"]:
    """Return how much the readings touch each unknown.

    Relative, so that functionals of different effects are alike in size.
    """
    whole = abs(ground.design.columns).sum(axis=0)
    return np.asarray(whole) / len(ground.design.rows)


def judged(
    ground: Ground, data: JointData, drift: int, like: Prepared | None = None
) -> Prepared:
    """Return what the readings tell of the effects.

    Args:
        ground: Numbers.
        data: All rows.
        drift: Pieces of the drift of each run.
        like: The same effects and rows with other lags: their freedoms are the same.
    """
    design, sums = ground.design, ground.sums
    structure = freedoms(ground, data, drift) if like is None else like.structure
    told = told_by(sums, structure)
    return Prepared(
        sums=sums,
        pinned=ground.pinned,
        structure=structure,
        rules=all_rules(ground, structure),
        told=told,
        gauges=(*gauges_of(design, structure), *_almost(design, told)),
        confusions=confusions_of(design, told, sums.reached),
    )


def alike(like: Prepared, ground: Ground) -> Prepared | None:
    """Return what was found with more rows of the same, where the unknowns are the same."""
    same = like.design.knots == ground.design.knots
    if not same or like.design.size != ground.design.size:
        return None
    return dataclasses.replace(like, sums=ground.sums, pinned=ground.pinned)


def _almost(design: Design, told: Told) -> list[Gauge]:
    return [almost(pair.parts[0], pair.parts[1], design) for pair in told.nearly]


def by_axis(effects: Sequence[AbstractEffect]) -> dict[str, list[int]]:
    """Return the numbers of the effects of each compensated axis.

    Raises:
        FitError: If there is none, or the same one twice.
    """
    if not effects:
        msg = "found no effects, expected one at least."
        raise FitError(msg)
    result: dict[str, list[int]] = {}
    names: set[str] = set()
    for number, effect in enumerate(effects):
        if effect.name in names:
            msg = f"found the {effect.name} twice, expected each effect once."
            raise FitError(msg)
        names.add(effect.name)
        result.setdefault(effect.axis, []).append(number)
    return result
