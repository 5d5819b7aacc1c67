"""What data can tell of effects, before anything is fitted."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from ...core._errors import FitError
from ...core._threads import one_blas_thread
from ._confusion_words import undetermined
from ._data import JointData
from ._effect import AbstractEffect
from ._prepare import Prepared, by_axis, prepare
from ._problem import JointProblem, solve_joint
from ._result import Confusion, Determination, Gauge, Identifiability
from ._spread import variances

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
    logs = ready.weights.start(_LIGHT)
    zero = np.zeros(design.size)
    problem = JointProblem(sums, ready.weights, ready.pinned.pins, zero, zero, 0.0, 1)
    solution = solve_joint(problem, logs)
    if solution is None:
        msg = f"axis {design.axis}: the rows tell nothing, the matrix is singular."
        raise FitError(msg)
    deviation = np.sqrt(variances(solution, ready.rules))
    unknown, confused = undetermined(design, ready.told, sums.reached)
    deviation = np.where(confused, np.inf, deviation)
    support = touched(ready)
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


def touched(ready: Prepared) -> np.ndarray:
    """Return the number of active readings that touch each unknown."""
    sums = ready.sums
    columns = sums.design.columns
    count = np.repeat(sums.active, np.diff(columns.indptr))
    used = (columns.data != 0) & count
    return np.bincount(columns.indices[used], minlength=sums.design.size)


def share_of(ready: Prepared, number: int) -> float:
    """Return the information left of an effect: of its weaker law for a temperature."""
    own = [
        share
        for share, part in zip(ready.told.share, ready.design.stated, strict=True)
        if part.effect == number
    ]
    return min(own)
