"""Windows of a recording left out in turn, and what laws fitted without them predict there."""

import dataclasses
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from .._errors import FitError
from .._threads import one_blas_thread
from ._assemble import friction_at
from ._lanes import Lanes, lanes_of
from ._problem import Problem
from ._result import FrictionFit
from ._solve import Solved, solve_problem
from ._structure import AbstractStructure

_FEWEST = 30
"""Samples in motion, after filtering, that a window needs."""


@dataclasses.dataclass(frozen=True, eq=False)
class LeftOut:
    """A recording cut into stretches of time with equal shares of its motion.

    Attributes:
        problem: The equation of the whole recording, for any law.
        loss: As for `fit_inverse`.
        window: Of each row.
        lanes: Rows without each window in turn, and last all rows.
        found: What laws gave that were fitted already.
    """

    problem: Problem
    loss: str
    window: Int[np.ndarray, " s"]
    lanes: Lanes
    found: dict[AbstractStructure, list[Solved]]

    @property
    def count(self) -> int:
        """How many windows there are."""
        return len(self.lanes) - 1

    def fits(
        self, structure: AbstractStructure, *, certain: bool = False
    ) -> list[Solved]:
        """Return a law fitted without each window in turn, and last to all rows.

        Args:
            structure: Kind of law.
            certain: All covariances are wanted, and not only that of the last one where
                the law has parameters in words.
        """
        known = self.found.get(structure)
        if known is None or (certain and not all(one.certain for one in known)):
            wanted = [certain] * self.count + [certain or structure.in_words]
            self.found[structure] = solve_problem(
                self.problem.with_structure(structure),
                self.loss,
                self.lanes,
                certain=wanted,
            )
        return self.found[structure]

    @cached_property
    def out(self) -> Float[np.ndarray, "w s"]:
        """Share of each row in the mean over the window that a fit does without."""
        rows = (self.window == np.arange(self.count)[:, None]) & self.lanes.usable
        return np.asarray(rows / rows.sum(axis=1, keepdims=True))

    @property
    def window_of_samples(self) -> Int[np.ndarray, " t"]:
        """Window of each sample of the recording: that of the nearest row."""
        centres = self.problem.lowpass.centres
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
        found = np.zeros(len(window))
        try:
            with one_blas_thread():
                fits = self.fits(fit.structure, certain=True)
        except FitError:
            fits = []
        for number in range(self.count):
            own = window == number
            velocity = samples.velocity[own]
            friction = None
            if fits:
                friction = friction_at(
                    fits[number],
                    self.lanes.use[number] > 0,
                    samples.in_motion & ~own,
                    velocity,
                )
            if friction is None and fit.law is not None:
                friction = fit.band(velocity)[0]
            if friction is not None:
                found[own] = friction
        return found


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
    keep = np.ones((windows + 1, len(window)), bool)
    for number in range(windows):
        # Rows near the window share samples with it through the filter.
        near = np.convolve(window == number, np.ones(2 * reach + 1), mode="same") > 0.5
        keep[number] = ~near
    return LeftOut(problem, loss, window, lanes_of(problem.usable, keep), {})
