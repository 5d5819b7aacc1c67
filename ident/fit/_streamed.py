"""The table fit over readings that do not fit into memory.

All that a fit needs of its readings are sums, and sums add up: over pieces of a file, over
files, over workers. Least squares takes one pass; the robust losses take one per iteration,
with the scale of the noise judged from every n-th reading, as in memory. The same steps as
`_estimate` and `_table`, without second thoughts about wild readings and without run effects.
Tables without some group of readings come out of the same passes.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..core._errors import FitError
from ..core._loss import choose_loss
from ..core._threads import one_blas_thread
from ._checks import check_extent, check_layout, check_smoothness
from ._estimate import THIN, table_prior
from ._grid import Grid
from ._information import evaluate
from ._passes import Apply, Asking, Grouping, Part, Stream
from ._streamed_asked import Estimate, Options
from ._streamed_estimate import closely, least_squares
from ._streamed_looks import (
    Count,
    Counted,
    Rule,
    TakeEvery,
    Thin,
    believed,
    first_of,
    weights_of,
)
from ._streamed_sums import ByGroup, SumByGroup
from ._types import Samples, TableFit, TableLayout


@dataclasses.dataclass(frozen=True)
class StreamedFit:
    """A table fitted to readings in pieces.

    Attributes:
        fit: The table; its arrays over readings (``residual``, ``share``, ``wild``) are
            empty.
        count: Number of readings.
        wild: How many of them are wild.
        rule: Table, in the order of the fit, and loss by which they are; None where none is.
        crowded: Nodes at which wild readings stand side by side.
        last: Table and loss by which the others counted; None: all of them in full.
        folds: By group, the table fitted to all readings but those of the group.
    """

    fit: TableFit
    count: int
    wild: int
    rule: Rule | None
    crowded: int
    last: Rule | None
    folds: Mapping[int, TableFit]

    def judged(
        self, samples: Samples
    ) -> tuple[Bool[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return which of some readings are wild, and the weight that the loss leaves each."""
        grid = Grid(self.fit.layout)
        where = grid.locate(samples)
        wild = ~believed(grid, where, samples, self.rule)
        if self.last is None:
            return wild, np.ones(len(wild))
        values, loss = self.last
        scaled = samples.error - evaluate(grid, where, values)
        scaled = scaled * np.sqrt(weights_of(samples))
        return wild, np.where(wild, 0.0, loss.share(scaled / loss.scale))


def fit_streamed(
    layout: TableLayout,
    parts: Sequence[Part],
    *,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "gauss",
    apply: Apply = map,
) -> TableFit:
    """Fit a table to readings of any number in constant memory.

    Agrees with `fit_table` on the same readings to rounding, as long as no wild readings
    stand side by side.

    Args:
        layout: Where the nodes lie.
        parts: Readings; each part may be summed on another machine. Sums are added in this
            order, so that the result does not depend on who did which.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`; ``"gauss"`` takes one pass after a first look.
        apply: How to run a function over the parts.

    Returns:
        The fit; its arrays over readings (``residual``, ``share``, ``wild``) are empty.

    Raises:
        FitError: If the readings do not determine the table or an option is unknown.
    """
    return fit_with_folds(
        layout, parts, None, smoothness=smoothness, loss=loss, apply=apply
    ).fit


def fit_with_folds(
    layout: TableLayout,
    parts: Sequence[Part],
    grouping: Grouping | None,
    *,
    smoothness: float | str | Mapping[str, float] = "auto",
    loss: str = "student",
    apply: Apply = map,
) -> StreamedFit:
    """Fit a table as `fit_streamed` does, and beside it one without each group of readings.

    The folds are those of `leave_out`: smoothness and loss are those of the whole fit.

    Args:
        layout: Where the nodes lie.
        parts: As for `fit_streamed`.
        grouping: Tells the group of each reading of a piece; None: no folds.
        smoothness: As for `fit_table`.
        loss: As for `fit_table`.
        apply: As for `fit_streamed`.

    Raises:
        FitError: If the readings do not determine a table, an option is unknown, or all
            readings are of one group.
    """
    check_layout(layout)
    check_smoothness(smoothness)
    choose_loss(loss, np.ones(1), 1.0, 1.0)
    grid = Grid(layout)
    stream = Stream(grid, parts, apply, grouping)
    options = Options(grid, table_prior(grid), smoothness, loss)
    with one_blas_thread():
        if loss == "gauss":
            whole, folds = _by_least_squares(stream, options)
        else:
            whole, folds = _robustly(stream, options)
    fit = dataclasses.replace(
        whole.fit, message=f"{whole.fit.message} Read in {stream.passes} passes."
    )
    return StreamedFit(
        fit,
        whole.count,
        whole.wild,
        whole.rule,
        whole.crowded,
        whole.last,
        {group: one.fit for group, one in folds.items() if group is not None},
    )


def _by_least_squares(
    stream: Stream, options: Options
) -> tuple[Estimate, dict[int | None, Estimate]]:
    """Return the whole fit and the folds, all of them from the sums of one pass."""
    grid = stream.grid
    first = first_of(stream.parts)
    if first is None:
        _refuse_few(0, options.prior.null)
    assert first is not None
    # Any table will do to sum about; one near the readings keeps the digits.
    centre = float(np.median(first.error))
    values = np.full((grid.slow, grid.fast), centre)
    found: ByGroup = stream.ask(SumByGroup(centre, stream.grouping)).finished()
    check_extent(grid.layout, found.extent, False)
    spread = float(np.ptp(first.error))
    whole = least_squares(options, found.without(None), values, spread)
    groups = _groups_of(stream, sorted(found.sums))
    own = options.of_fold(whole.fit)
    folds: dict[int | None, Estimate] = {
        group: least_squares(own, found.without(group), values, spread)
        for group in groups
    }
    return whole, folds


def _robustly(
    stream: Stream, options: Options
) -> tuple[Estimate, dict[int | None, Estimate]]:
    """Return the whole fit and the folds, these side by side."""
    counted: Counted = stream.ask(Count(stream.grouping))
    count = sum(counted.rows.values())
    _refuse_few(count, options.prior.null)
    check_extent(stream.grid.layout, counted.extent, False)
    groups = _groups_of(stream, counted.groups)
    looks = {
        group: _look(_thinned(counted.without(group, len(stream.parts))))
        for group in (None, *groups)
    }
    thins: dict[int | None, Thin] = stream.answer(looks)
    whole = stream.answer({None: closely(options, thins[None])})[None]
    own = options.of_fold(whole.fit)
    folds = stream.answer({group: closely(own, thins[group]) for group in groups})
    return whole, folds


def _look(wanted: TakeEvery) -> Asking[Thin]:
    """Ask for a single pass."""
    thin: Thin = yield wanted
    return thin


def _groups_of(stream: Stream, groups: Sequence[int]) -> Sequence[int]:
    if stream.grouping is None:
        return ()
    if len(groups) < 2:
        msg = "leaving out needs at least two groups of readings, found one."
        raise FitError(msg)
    return groups


def _thinned(counts: Sequence[int]) -> TakeEvery:
    """Return what asks for enough readings to judge the noise by, of those counted."""
    starts = (0, *np.cumsum(counts).tolist()[:-1])
    return TakeEvery(max(1, sum(counts) // THIN), starts)


def _refuse_few(count: int, null: int) -> None:
    if count <= null:
        msg = f"found {count} readings, expected more than {null}."
        raise FitError(msg)
