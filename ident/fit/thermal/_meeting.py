"""The virtual intersection: where the lines of all temperatures meet."""

from collections.abc import Callable

import numpy as np

from ...core._errors import FitError
from ...core._regression import Regression
from ._choice import Score, held_out
from ._laws import Shape, hats
from ._line import Data, Line, fit_line, fit_linear, laid_out

_SURE = 3.0
"""Deviations by which the coefficient must change for the lines to meet somewhere."""
_PARALLEL = 1e3
"""Distance of the intersection, in measured ranges, from which on there is none."""


def find_meeting(
    line: Line,
    found: Regression,
    data: Data,
    score: Score | None,
    loss: str,
    free: tuple[int, ...],
) -> tuple[tuple[Line, Regression, bool] | None, str]:
    """Return the fit with a constant offset where the lines meet, or None and why not."""
    nodes = len(line.nodes[0])
    slopes = line.value[nodes:]
    place = f"the reference is {line.reference:.4g} mm"
    if len(slopes) < 2:
        return (
            None,
            f"The lines do not change their slope, so they meet nowhere: {place}.",
        )
    part = slice(nodes, len(line.value))
    span = slopes[-1] - slopes[0]
    pick = np.zeros(len(slopes))
    pick[0], pick[-1] = -1.0, 1.0
    deviation = float(np.sqrt(max(pick @ found.covariance[part, part] @ pick, 0.0)))
    if span == 0 or abs(span) < _SURE * deviation:
        return (
            None,
            f"The lines hardly change their slope, so they meet nowhere: {place}.",
        )
    if data.sensors[0] not in (None, data.sensors[1]) and nodes > 1:
        return (
            None,
            f"Two sensors move offset and slope, so the lines do not meet: {place}.",
        )
    theta, warm = data.structure(line.lags)
    offset = hats(theta, line.nodes[0]) @ line.value[:nodes]
    slope = hats(warm, line.nodes[1]) @ slopes
    rise = slope - slope.mean()
    start = line.reference - float(rise @ (offset - offset.mean())) / float(rise @ rise)
    if abs(start - line.reference) > _PARALLEL * float(np.ptp(data.position)):
        return None, f"The lines are nearly parallel: {place}."
    begin = laid_out(data, Shape(1, len(slopes)), start, line.lags)
    if begin is None:
        return None, f"Too few readings to find where the lines meet: {place}."
    begin, _, _ = fit_line(begin, data.thinned(), loss, True, free, quick=True)
    meeting = fit_line(begin, data, loss, True, free)
    if nodes > 1 and not _as_good(meeting[0], line, data.thinned(), score, loss):
        return None, f"The lines of the temperatures do not meet in one point: {place}."
    where = meeting[0].reference
    sure = float(meeting[1].standard_deviation[len(meeting[0].value)])
    if not sure < max(10.0 * float(np.ptp(data.position)), abs(where)):
        return None, f"Where the lines meet is uncertain by {sure:.2g} mm: {place}."
    return meeting, f"The lines meet at {where:.5g} mm ± {sure:.2g} mm."


def _as_good(
    meeting: Line, line: Line, data: Data, score: Score | None, loss: str
) -> bool:
    """Tell whether lines through one point predict as well as lines that are free."""
    scale = score.scale if score is not None else None
    if scale is None:
        left = data.error - line.predict(data)
        scale = max(1.4826 * float(np.median(np.abs(left))), 1e-9)

    def maker(start: Line, walk: Callable[[Line, Data], Line]) -> Score | None:
        def make(part: Data) -> Line | None:
            try:
                return walk(start, part)
            except FitError:
                return None

        return held_out(data, make, scale)

    def through_one_point(start: Line, part: Data) -> Line:
        return fit_line(start, part, loss, True, (), quick=True)[0]

    one = maker(meeting, through_one_point)
    other = maker(line, lambda start, part: fit_linear(start, part, loss))
    return one is not None and (other is None or not one.worse_than(other))
