"""Windows of a recording left out in turn, and what laws fitted without them predict there."""

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ...core._threads import one_blas_thread
from .._gather import in_group
from ._assemble import law_factors
from ._lanes import Lanes, lanes_of, side_by_side
from ._problem import Problem
from ._result import FrictionFit
from ._solve import Solved, solve_as_asked
from ._stack import alike, stack_of

_FEWEST = 30
"""Samples in motion, after filtering, that a window needs."""


@dataclasses.dataclass(frozen=True, eq=False)
class LeftOut:
    """A recording cut into stretches of time with equal shares of its motion.

    Attributes:
        problem: The equation of the whole recording, for any law.
        loss: As for `fit_inverse`.
        window: Of each row.
        keep: Which rows a fit without a window may use.
    """

    problem: Problem
    loss: str
    window: Int[np.ndarray, " s"]
    keep: Bool[np.ndarray, "w s"]

    @property
    def count(self) -> int:
        """How many windows there are."""
        return len(self.keep)

    @cached_property
    def lanes(self) -> Lanes:
        """Rows without each window in turn."""
        return self.every.take(np.arange(self.count))

    @cached_property
    def every(self) -> Lanes:
        """Rows without each window in turn, and last all rows."""
        usable = self.problem.usable
        keep = np.concatenate([self.keep, np.ones((1, len(usable)), bool)])
        return lanes_of(usable, keep)

    @cached_property
    def size(self) -> float:
        """Root mean square of the load."""
        load = self.problem.load[self.problem.usable]
        return float(np.sqrt(np.mean(load**2)))

    @cached_property
    def bounds(self) -> list[tuple[int, int]]:
        """First row of each window, and the one after its last."""
        edges = np.searchsorted(self.window, np.arange(self.count + 1)).tolist()
        return list(pairwise(edges))

    @cached_property
    def _usable(self) -> tuple[Int[np.ndarray, " w"], Int[np.ndarray, " w"]]:
        """Where windows start, and how many rows of each may be used."""
        starts = np.array([start for start, _ in self.bounds])
        usable = self.problem.usable.astype(np.int64)
        return starts, np.add.reduceat(usable, starts)

    def mean(self, square: Float[np.ndarray, " s"]) -> Float[np.ndarray, " w"]:
        """Return the mean of each window over its rows that may be used."""
        usable, (starts, count) = self.problem.usable, self._usable
        sums = np.add.reduceat(square[: len(usable)] * usable, starts)
        return np.asarray(sums / count)

    @cached_property
    def window_of_samples(self) -> Int[np.ndarray, " t"]:
        """Window of each sample of the recording: that of the nearest row."""
        centres = self.problem.lowpass.centres
        if len(centres) == len(self.problem.samples.time):
            return self.window
        middles = 0.5 * (centres[1:] + centres[:-1])
        samples = np.arange(len(self.problem.samples.time))
        return np.asarray(self.window[np.searchsorted(middles, samples)])

    def predicted(self, fit: FrictionFit) -> Float[np.ndarray, " t"]:
        """Return the friction that laws fitted without its window predict per sample.

        Where the rest of the recording does not tell the law, or its level from a constant
        load, that of the whole recording stands in.

        Args:
            fit: The law, fitted to all samples.
        """
        samples = self.problem.samples
        window = self.window_of_samples
        try:
            (fits,) = in_group(_fit_all, [(self, fit)])
        except FitError:
            fits = []
        laws: list[Float[np.ndarray, " f"] | None] = [None] * self.count
        if fits:
            moving = samples.in_motion & (window != np.arange(self.count)[:, None])
            laws = law_factors(fits, self.lanes.use, moving)
        found = np.zeros(len(window))
        told = np.array([own is not None for own in laws])
        if told.any():
            blank = np.zeros(len(fits[0].problem.structure.names))
            factors = np.stack([blank if own is None else own for own in laws])
            shapes = np.stack([each.solution.shape for each in fits])
            found = fits[0].problem.friction(window, factors, shapes)
        for unknown in np.flatnonzero(~told):
            own = window == unknown
            found[own] = 0.0
            if fit.has_law:
                found[own] = fit.band(samples.velocity[own])[0]
        return found


def _fit_all(
    asked: Sequence[tuple[LeftOut, FrictionFit]],
) -> list[list[Solved]]:
    """Return laws fitted without each window in turn, recordings of equal shape together.

    A window has no say at all in what is fitted without it.
    """
    found: dict[int, list[Solved]] = {}
    for places in alike(
        [(each.problem, (fit.structure,), each.loss) for each, fit in asked]
    ):
        group = [asked[k] for k in places]
        stack = stack_of([each.problem for each, _ in group])
        stack = stack.with_structures([fit.structure for _, fit in group])
        lanes = side_by_side([each.lanes for each, _ in group], stack.rows)
        with one_blas_thread():
            # Whether the data carry the law, all of them have said.
            about = np.stack([fit.shape for _, fit in group])
            solved = solve_as_asked(
                stack, group[0][0].loss, lanes, certain=False, about=about
            )
        for k, (_, fits) in zip(places, lanes.own, strict=True):
            found[k] = solved[fits]
    return [found[k] for k in range(len(asked))]


def left_out(problem: Problem, loss: str, windows: int) -> LeftOut:
    """Return a recording whose windows are to be left out in turn.

    Raises:
        FitError: If it is too short for so many windows.
    """
    moving = int(problem.usable.sum())
    if windows < 3 or moving < windows * _FEWEST:
        msg = (
            f"model choice: found {moving} samples in motion after filtering for {windows} "
            f"windows, expected at least 3 windows of {_FEWEST}."
        )
        raise FitError(msg)
    # Equal shares of the motion, not of the time: an axis may rest for half of it.
    share = np.cumsum(problem.usable) / moving
    window = np.minimum((share * windows).astype(np.int64), windows - 1)
    reach = len(problem.lowpass.kernel) // (2 * problem.lowpass.factor)
    keep = np.ones((windows, len(window)), bool)
    edges = np.searchsorted(window, np.arange(windows + 1)).tolist()
    for own, (start, end) in zip(keep, pairwise(edges), strict=True):
        # Rows near the window share samples with it through the filter.
        own[max(start - reach, 0) : end + reach] = False
    return LeftOut(problem, loss, window, keep)
