"""Which samples count to begin with, and which do by what a law leaves of them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...core._loss import AbstractLoss
from ._equation import AbstractEquation
from ._equations import equation_of
from ._lanes import Lanes, Shares
from ._loss import weigh
from ._stack import Stack
from ._tables import KnotTable

_FLOOR = 1e-9
"""Smallest scale of residuals relative to the load."""
_KNOTS = 12
_PASSES = 8
_CHANGE = 0.01
"""Of a weight, that is none yet: the law asked for will weigh the samples anew."""
_HUBER = 2
"""First passes, in which no sample can pull far."""


def scout(stack: Stack, lanes: Lanes, loss: str) -> Shares:
    """Return weights of the samples under a law that can bend anywhere.

    What is wild under a free table is wild under any law, whatever shape is tried. Where
    nothing is wild in the whole recording, nothing is in a part of it.

    Args:
        stack: The equations.
        lanes: Rows that each fit uses.
        loss: Name of the loss.
    """
    whole = _of_all_rows(stack, loss)
    if lanes is stack.all_rows:
        return whole
    if whole.plain:
        return lanes.all_rows()
    full = lanes.use.copy()
    partly = (whole.full != whole.lanes.use).any(axis=1)
    which = np.flatnonzero(partly[lanes.of])
    full[which] = _scout(stack, lanes.take(which), loss).full
    return Shares(lanes, full)


def _of_all_rows(stack: Stack, loss: str) -> Shares:
    lanes, key = stack.all_rows, (loss, stack.structure.directional)
    new = [k for k, each in enumerate(stack.problems) if key not in each.scouted]
    if new:
        found = _scout(stack, lanes.take(np.array(new)), loss).full
        for k, row in zip(new, found, strict=True):
            problem = stack.problems[k]
            problem.scouted[key] = row[: len(problem.target)]
    full = lanes.use.copy()
    for row, each in zip(full, stack.problems, strict=True):
        row[: len(each.target)] = each.scouted[key]
    return Shares(lanes, full)


def _scout(stack: Stack, lanes: Lanes, loss: str) -> Shares:
    every = [each.spread.knots(_KNOTS) for each in stack.problems]
    full = lanes.use.copy()
    enough = [k for k, knots in enumerate(every) if len(set(knots)) == _KNOTS]
    which = np.flatnonzero(np.isin(lanes.of, enough))
    if not len(which):
        return lanes.all_rows()
    way = stack.structure.directional
    free = stack.with_structures([KnotTable(way, knots) for knots in every])
    equation = equation_of(free, lanes, plain=True).take(which)
    shares = reweigh(
        equation, equation.solve(equation.lanes.all_rows()).residual, loss
    )[0]
    out = (shares.full == 0.0) & (equation.lanes.use > 0.0)
    wild = out.any(axis=1) | (loss not in ("trim", "gauss"))
    partly = (shares.full != equation.lanes.use).any(axis=1)
    # Where nothing is wild under least squares, nothing is; where samples are only
    # doubted, it is near enough. Else a loss that no sample can pull far comes first.
    for some, first in ((partly & ~wild, loss), (wild, "huber")):
        own = np.flatnonzero(some)
        if len(own):
            begin = shares.take(own) if first == loss else None
            full[which[own]] = _settled(equation.take(own), loss, begin).full
    return Shares(lanes, full)


def _settled(equation: AbstractEquation, loss: str, begin: Shares | None) -> Shares:
    """Return weights that a law hardly changes, from some or by the Huber loss."""
    shares = equation.lanes.all_rows() if begin is None else begin
    lanes, found = equation.lanes, shares.full.copy()
    left = np.arange(len(found))
    for step in range(_PASSES):
        kind = "huber" if begin is None and step < _HUBER else loss
        before = shares.full
        shares = reweigh(equation, equation.solve(shares).residual, kind)[0]
        found[left] = shares.full
        change = np.abs(shares.full - before).max(axis=1)
        # A fit is over for itself: how long the others take must not change its digits.
        on = np.flatnonzero((change > _CHANGE) | (kind != loss))
        if not len(on):
            break
        left, equation, shares = left[on], equation.take(on), shares.take(on)
    return Shares(lanes, found)


def reweigh(
    equation: AbstractEquation,
    residual: Float[np.ndarray, "w s"],
    name: str,
    *,
    kept: Sequence[AbstractLoss] | None = None,
) -> tuple[Shares, list[AbstractLoss]]:
    """Return how much each row counts by what is left of it, and the losses that say so.

    Args:
        equation: The equation, for the fits that left it.
        residual: What they left.
        name: Of the loss.
        kept: Losses with scales to keep.
    """
    lanes, parameters = equation.lanes, equation.width
    count = lanes.count
    inflation = np.sqrt(count / np.maximum(count - parameters, 0.05 * count))
    floor = np.maximum(_FLOOR * equation.stack.floor, 1e-300)[lanes.of]
    return weigh(name, residual, lanes, inflation, floor, kept)
