"""A fitted table in display units, over one master or two, and what is said of it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...job import TableResult
from .._scale import Scale, count, grouped, number, place


@dataclasses.dataclass(frozen=True)
class Fitted:
    """One branch of a fitted table; arrays over a plane are ``[j, i]`` with j along master 2.

    Attributes:
        masters: Names of the masters.
        nodes: Positions per master in mm.
        direction: ±1, or 0 for a table that serves both.
        value: Error in µm.
        sd: Its standard deviation in µm.
        support: Readings that touch the node; 0 = not measured.
    """

    masters: tuple[str, ...]
    nodes: tuple[Float[np.ndarray, " _n"], ...]
    direction: int
    value: Float[np.ndarray, "*n"]
    sd: Float[np.ndarray, "*n"]
    support: Int[np.ndarray, "*n"]

    @property
    def measured(self) -> Bool[np.ndarray, "*n"]:
        """Nodes that at least one reading touches."""
        return self.support > 0

    def where(self, index: int) -> str:
        """Return the place of a node, by its flat index, in words."""
        at = reversed(np.unravel_index(index, self.value.shape))
        every = zip(self.masters, self.nodes, at, strict=True)
        return ", ".join(f"{name} = {place(nodes[k])}" for name, nodes, k in every)

    def runs(self, start: str, scale: Scale) -> str:
        """Return between which values the error runs, where it is measured if anywhere."""
        value, known = self.value.ravel(), self.measured.ravel()
        among = np.flatnonzero(known) if known.any() else np.arange(value.size)
        ends = [int(among[pick(value[among])]) for pick in (np.argmin, np.argmax)]
        low, high = (
            f"{number(value[k])} {scale.error} ({self.where(k)} {scale.position})"
            for k in ends
        )
        return f"{start} runs from {low} to {high}."


def branches_of(fit: TableResult, scale: Scale) -> tuple[Fitted, ...]:
    """Return a fitted table in display units; errors, not list entries."""
    own, masters = fit.fit, tuple(fit.masters)
    nodes = tuple(own.layout.nodes)
    shape = (own.layout.branches, *(len(each) for each in reversed(nodes)))
    arrays = (
        np.reshape(own.values, shape) * scale.factor,
        np.reshape(own.standard_deviation, shape) * scale.factor,
        np.reshape(own.support, shape),
    )
    directions = (1, -1) if own.layout.branches == 2 else (0,)
    return tuple(
        Fitted(masters, nodes, *row) for row in zip(directions, *arrays, strict=True)
    )


def say_empty(branches: Sequence[Fitted], mark: str) -> str:
    """Return how many nodes are not measured, and how they are marked."""
    empty = sum(int((~one.measured).sum()) for one in branches)
    if not empty:
        return f"All {count(sum(one.value.size for one in branches), 'node')} are measured."
    return (
        f"{count(empty, 'node is', 'nodes are')} not measured ({mark}): their value is an"
        " assumption drawn from the neighbours."
    )


def say_drawn(drawn: int, total: int) -> str:
    """Return how many readings are drawn, where these are not all."""
    if drawn >= total:
        return ""
    return f" {grouped(drawn)} of {grouped(total)} readings are drawn."
