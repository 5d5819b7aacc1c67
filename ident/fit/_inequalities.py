"""What the written values of a table keep: the most probable values that do, by IPOPT."""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, Literal, final

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from ..core import FitError
from ._types import Array, Samples, TableFit

Constraint = Literal["monotone", "non-negative"]
"""The entries of the list turn back nowhere along a master; none of them is below zero."""


def most_probable(
    words: Sequence[str],
    entries: Array,
    nodes: Sequence[Float[np.ndarray, " _n"]],
    moves: Any,
    precision: Any,
) -> Float[np.ndarray, " u"]:
    """Return the most probable move of unknowns with which entries keep words, by IPOPT.

    Args:
        words: Of `Constraint`.
        entries: As they are where nothing moves, shaped like the table: they tell which way it
            goes.
        nodes: Positions along each master, master 1 first.
        moves: What each entry changes by with each unknown, sparse.
        precision: Of the unknowns, sparse: they move as little as possible in its metric.

    Raises:
        FitError: If nothing keeps them.
    """
    from .._ipopt import quadratic_ipopt  # takes long to load

    unit: Any = sp.eye_array(entries.size, format="csr")
    number = np.arange(entries.size).reshape(entries.shape)
    kept_rows = [unit] if "non-negative" in words else []
    for axis, sign in _signs(entries, nodes) if "monotone" in words else ():
        later, earlier = (np.delete(number, end, axis) for end in (0, -1))
        flips = sp.diags_array(np.broadcast_to(sign, later.shape).ravel())
        kept_rows.append(flips @ (unit[later.ravel()] - unit[earlier.ravel()]))
    rows = sp.csr_array(sp.vstack(kept_rows))
    solution = quadratic_ipopt(precision, rows @ moves, rows @ entries.ravel())
    if not solution.converged:
        msg = (
            f"constraints: found none that is {' and '.join(words)}, IPOPT ended as "
            f"'{solution.status}'"
        )
        raise FitError(msg)
    return solution.values


def kept(
    words: Sequence[str], entries: Array, nodes: Sequence[Float[np.ndarray, " _n"]]
) -> Array:
    """Return entries exactly within words, but for rounding; see `most_probable`."""
    result = np.maximum(entries, 0) if "non-negative" in words else entries
    for axis, sign in _signs(entries, nodes) if "monotone" in words else ():
        rising = np.maximum.accumulate(result, axis)
        falling = np.flip(np.maximum.accumulate(np.flip(result, axis), axis), axis)
        result = np.where(sign > 0, rising, falling)
    return result


def _signs(
    entries: Array, nodes: Sequence[Float[np.ndarray, " _n"]]
) -> Iterator[tuple[int, Array]]:
    """Return the axis of the array over each master, and ±1: its line rises there, or falls."""
    table_axes = tuple(range(-len(nodes), 0))
    for k, places in enumerate(nodes):
        centred = (places - places.mean()).reshape(-1, *[1] * k)
        line = np.sum(centred * entries, axis=table_axes, keepdims=True)
        yield -1 - k, np.where(line < 0.0, -1.0, 1.0)


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Inequalities:
    """What the entries of a list keep, which follow from the values of a fit.

    Attributes:
        words: Of `Constraint`.
        sign: Of an entry against the error.
        start: What a table that acted while measuring adds to each entry, in mm or °.
        zero: Shares of the unknowns in what the datum takes off all values; 0 without one.
    """

    words: tuple[Constraint, ...]
    sign: int
    start: Array
    zero: Float[np.ndarray, " n"]

    def keep(self, fit: TableFit, samples: Samples) -> TableFit:
        """Return `most_probable` with the residuals of its samples; its folds keep them as well."""
        best, table = self.most_probable(fit), fit.layout
        nodes, shares = table.design(samples.readings)
        change = table.to_values(best.values - fit.values)[nodes] * shares
        residual = fit.residual - change.sum(axis=1)
        return dataclasses.replace(best, residual=residual, keeps=self.most_probable)

    def most_probable(self, fit: TableFit) -> TableFit:
        """Return the fit with the most probable values that keep them.

        They move as little as possible in the metric of the posterior, effects of runs with
        them; standard deviations stay those of the fit without.

        Raises:
            FitError: If nothing keeps them.
        """
        assert fit.estimate is not None  # a fit, not one of its folds made bare
        post, table = fit.estimate.posterior, fit.layout
        values = table.to_values(fit.values)
        entries = self.start + self.sign * (fit.values - self.zero @ values)
        count, size = len(table.place), len(post.values)
        zero = sp.csr_array(np.pad(self.zero, (0, size - table.size))[None])
        common = sp.csr_array(np.ones((count, 1))) @ zero
        move = most_probable(
            self.words, entries, fit.layout.nodes,
            self.sign * (sp.csr_array(sp.eye_array(size))[table.place] - common),
            post.problem.precision(post.weights),
        )  # fmt: skip
        change = table.to_table(move[: table.size])
        return dataclasses.replace(fit, values=fit.values + change)
