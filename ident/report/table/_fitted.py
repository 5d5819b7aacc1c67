"""A fitted table and its readings as the plots need them: display units, marked, binned."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...job import SampleView, TableResult
from .. import _style as style
from .._scale import Scale, count, grouped, number, spot


@dataclasses.dataclass(frozen=True)
class Fitted:
    """One branch of a fitted table; arrays over a plane are ``[j, i]`` with j along master 2.

    Attributes:
        masters: Names of the masters.
        units: Of their positions, as shown.
        nodes: Positions per master in its unit.
        direction: ±1, or 0 for a table that serves both.
        value: Error in µm.
        sd: Its standard deviation in µm.
        support: Readings that touch the node; 0 = not measured.
    """

    masters: tuple[str, ...]
    units: tuple[str, ...]
    nodes: tuple[Float[np.ndarray, " _n"], ...]
    direction: int
    value: Float[np.ndarray, "*n"]
    sd: Float[np.ndarray, "*n"]
    support: Int[np.ndarray, "*n"]

    @property
    def measured(self) -> Bool[np.ndarray, "*n"]:
        """Nodes that at least one reading touches."""
        return self.support > 0

    @property
    def labels(self) -> list[str]:
        """What stands along each master."""
        pairs = zip(self.masters, self.units, strict=True)
        return [f"{name} in {unit}" for name, unit in pairs]

    def where(self, index: int) -> str:
        """Return the place of a node, by its flat index, in words."""
        at = reversed(np.unravel_index(index, self.value.shape))
        places = [float(nodes[k]) for nodes, k in zip(self.nodes, at, strict=True)]
        return spot(self.masters, places, self.units)

    def runs(self, start: str, scale: Scale) -> str:
        """Return between which values the error runs, where it is measured if anywhere."""
        value, measured = self.value.ravel(), self.measured.ravel()
        indices = np.flatnonzero(measured) if measured.any() else np.arange(value.size)
        ends = [int(indices[pick(value[indices])]) for pick in (np.argmin, np.argmax)]
        low, high = (
            f"{number(value[k])} {scale.error} ({self.where(k)})" for k in ends
        )
        return f"{start} runs from {low} to {high}."


def branches_of(fit: TableResult, scale: Scale) -> tuple[Fitted, ...]:
    """Return a fitted table in display units; errors, not list entries."""
    table = fit.fit
    nodes = tuple(table.layout.nodes)
    shape = (table.layout.branches, *(len(line) for line in reversed(nodes)))
    arrays = (
        np.reshape(table.values, shape) * scale.factor,
        np.reshape(table.standard_deviation, shape) * scale.factor,
        np.reshape(table.support, shape),
    )
    directions = (1, -1) if table.layout.branches == 2 else (0,)
    return tuple(
        Fitted(fit.masters, fit.units, nodes, *row)
        for row in zip(directions, *arrays, strict=True)
    )


def say_empty(branches: Sequence[Fitted], mark: str) -> str:
    """Return how many nodes are not measured, and how they are marked."""
    empty = sum(int((~branch.measured).sum()) for branch in branches)
    if not empty:
        return f"All {count(sum(branch.value.size for branch in branches), 'node')} are measured."
    return (
        f"{count(empty, 'node is', 'nodes are')} not measured ({mark}): their value is"
        " assumed."
    )


def say_drawn(drawn: int, total: int) -> str:
    """Return how many readings are drawn, where these are not all."""
    if drawn >= total:
        return ""
    return f" {grouped(drawn)} of {grouped(total)} readings are drawn."


@dataclasses.dataclass(frozen=True)
class Bins:
    """Mean of the readings in slices of a quantity, with its standard error.

    Attributes:
        centre: Middle of each slice.
        count: Readings per slice; slices without readings are kept, with NaN.
        mean: In µm.
        error: Standard error of the mean in µm.
    """

    centre: Float[np.ndarray, " b"]
    count: Int[np.ndarray, " b"]
    mean: Float[np.ndarray, " b"]
    error: Float[np.ndarray, " b"]

    @property
    def beyond_chance(self) -> bool:
        """Whether a mean stands out more than that of so many slices does by chance.

        The largest of n independent normal means is expected below about sqrt(2 ln 2n)
        standard errors; one more allows for few readings per slice.
        """
        tested = (self.count >= 3) & (self.error > 0)
        usual = np.sqrt(2 * np.log(2 * max(tested.sum(), 1))) + 1.0
        return bool(np.any(np.abs(self.mean[tested]) > usual * self.error[tested]))


def readings_of(fit: TableResult, scale: Scale) -> SampleView:
    """Return the readings of a fit in display units."""
    errors = ("error", "predicted", "from_file", "predicted_sd")
    scaled = {name: getattr(fit.samples, name) * scale.factor for name in errors}
    return dataclasses.replace(fit.samples, **scaled)


def bin_means(
    where: Float[np.ndarray, " t"], value: Float[np.ndarray, " t"], slices: int
) -> Bins:
    """Return the means of ``value`` in equal slices of ``where``."""
    low, high = float(where.min()), float(where.max())
    if high <= low:
        high = low + 1.0
    edges = np.linspace(low, high, slices + 1)
    index = np.clip(np.searchsorted(edges, where, side="right") - 1, 0, slices - 1)
    size = np.bincount(index, minlength=slices)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(index, value, slices) / size
        spread = np.bincount(index, (value - mean[index]) ** 2, slices)
        error = np.sqrt(spread / np.maximum(size - 1, 1) / size)
    return Bins(style.middles(edges), size, mean, error)
