"""What data can tell of effects, before anything is fitted."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core import (
    FitError,
    Loss,
    Posterior,
    Problem,
    Readings,
    one_blas_thread,
    sums_of,
)
from ._confusion_words import undetermined
from ._data import JointData
from ._design import Design
from ._effect import AbstractEffect
from ._prepare import Prepared, by_axis, prepare
from ._result import Confusion, Determination, Gauge, Identifiability
from ._rules import Rules

_LIGHT = 1e-2
"""Weight of second differences, relative to the density, where no errors choose one."""


def examine_design(
    data: JointData,
    effects: Sequence[AbstractEffect],
    *,
    drift: int = 0,
    use: Bool[np.ndarray, " t"] | None = None,
) -> Identifiability:
    """Return what these rows can tell of effects, whatever was or will be measured.

    Looks at positions, directions, accelerations, temperatures, times and runs only. Of the
    errors it uses where there are any (rows without are left out); with no error of an axis
    recorded at all, every row counts: a planned measurement can be examined.

    Args:
        data: Rows, measured or planned.
        effects: What is to be fitted.
        drift: Pieces of the drift of each run, as for `fit_joint`; between their knots the
            reference is taken to wander as far as the readings of one step could just tell.
        use: Rows that may be used; None = all.

    Raises:
        FitError: If an input is missing or no row is complete.
    """
    placed = [effect.placed(data) for effect in effects]
    found: list[Determination | None] = [None] * len(placed)
    gauges: list[Gauge] = []
    confusions: list[Confusion] = []
    with one_blas_thread():
        for axis, numbers in by_axis(placed).items():
            own = [placed[number] for number in numbers]
            ready = prepare(axis, own, data, drift, use, axis in data.error)
            for number, each in zip(numbers, _determinations(ready), strict=True):
                found[number] = each
            gauges += ready.gauges
            confusions += ready.confusions
    return Identifiability(
        tuple(each for each in found if each is not None),
        tuple(gauges),
        tuple(confusions),
    )


def _determinations(ready: Prepared) -> list[Determination]:
    design, sums = ready.design, ready.sums
    problem = _light_problem(ready)
    weights = np.where(problem.optional, 0.0, _LIGHT * problem.density)
    # A walk begins as wide as what the readings of one step tell of it.
    walks = [part.kind == "wander" for part in design.named for _ in part.prior_names]
    weights = np.where(walks, problem.density, weights)
    found = problem.at(weights)
    if found is None:
        msg = f"axis {design.axis}: the rows tell nothing, the matrix is singular."
        raise FitError(msg)
    deviation = np.sqrt(variances(found, ready.rules))
    unknown, confused = undetermined(design, ready.told, sums.reached)
    deviation = np.where(confused, np.inf, deviation)
    support = touched(design, np.ones(len(design.rows), bool))
    result = []
    for number, effect in enumerate(design.effects):
        places = design.places_of(number)
        result.append(
            Determination(
                effect=effect,
                share=share_of(ready, number),
                deviation=deviation[places],
                support=support[places],
                determined=~unknown[places],
            )
        )
    return result


def _light_problem(ready: Prepared) -> Problem:
    """Return the problem of rows in which nothing was measured yet."""
    design = ready.design
    zero, rows = np.zeros(design.size), len(design.rows)
    readings = Readings(np.zeros(rows), {})
    sums, _ = sums_of(design.stack, readings, zero, Loss(), True, design.dense)
    return Problem.of(sums, zero, 1.0, ready.pinned.pins)


def variances(found: Posterior, rules: Rules) -> Float[np.ndarray, " n"]:
    """Return the variance of each unknown under the rules, per variance of one reading.

    Moving to the rule changes what is unknown: from the spread of the values as solved it
    takes what may be moved between effects, which says nothing about either.
    """
    plain = found.inverse_diagonal
    if not rules.null.shape[1]:
        return plain
    gain = rules.gain
    spread = found.factor.solve(np.ascontiguousarray(gain.T))
    inner = gain @ spread
    result = plain - 2.0 * (spread * rules.null).sum(axis=1)
    result += ((rules.null @ inner) * rules.null).sum(axis=1)
    return np.asarray(np.maximum(result, 0.0))


def touched(design: Design, active: Bool[np.ndarray, " r"]) -> Int[np.ndarray, " n"]:
    """Return the number of active readings that touch each unknown."""
    columns = design.columns
    count = np.repeat(active, np.diff(columns.indptr))
    used = (columns.data != 0) & count
    return np.bincount(columns.indices[used], minlength=design.size)


def share_of(ready: Prepared, number: int) -> float:
    """Return the information left of an effect: of its weaker law for a temperature."""
    own = [
        share
        for share, part in zip(ready.told.share, ready.design.stated, strict=True)
        if part.effect == number
    ]
    return min(own)
