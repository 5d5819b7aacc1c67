"""Noise that remembers: how much more uncertain it leaves the values than white noise.

What a reference does that is no stated drift stays in the residual, and looks to a slow effect
(a temperature, above all) like its own. The scatter of the scores of stretches of the recording,
through the solution, is the variance that the values really have (the "sandwich" of robust
statistics, clustered in time). It is compared per effect with that of the same residual in
another order. Where a drift shows and the unknowns are few enough, the variance is that under
the drift (`DriftNoise`): stretches of a short recording may be as short as its memory. Runs of
which each has a slope of its own look like one, too: where these stand says how far a drift goes
between them, and what each of them makes of a value is a score, as that of a stretch is.
"""

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from ....data.signals import last_direction
from ...core import DriftNoise, Spread, find_drift, scatter_of_sums
from ...core._regression import SINGULAR
from .._result import scatter_of_runs
from ._effect import Rank

if TYPE_CHECKING:
    from ._axis import AxisFit

_STRETCHES, _FEWEST = 24, 20
"""Of the recording, and readings of each below which nothing is judged."""
_LARGE = 1 << 18
"""Readings × unknowns up to which the drift itself is estimated."""
_DRAWS = 4
"""Other orders of the residual."""
_RUNS = 3
"""Runs at least whose scatter is that of many."""
_CHANCE = 1.8
"""Ratio of variances up to which 24 stretches differ by chance, at two deviations."""
_TURNS, _ALIKE = 3, 12.0
"""Turns of an axis at least, and mean jump of the residual there in its standard deviations, that
a drift does not show by chance."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Memory:
    """Residuals of the fit of an axis in the order in which they were taken."""

    fit: "AxisFit"

    @cached_property
    def clock(self) -> Float[np.ndarray, " r"]:
        """Instant of each reading in s; its row where one that is believed has none."""
        time, rows = self.fit.design.data.time, self.fit.design.rows
        known = time is not None and np.isfinite(time[rows[self._believed]]).all()
        return np.asarray(time[rows] if known and time is not None else rows, float)

    @cached_property
    def order(self) -> Int[np.ndarray, " r"]:
        """Order in which readings were taken."""
        return np.argsort(self.clock, kind="stable")

    @cached_property
    def pseudo(self) -> Float[np.ndarray, " r"]:
        """Pseudo-readings less what the direction of motion explains at every turn alike.

        A table for both directions leaves the backlash in the residual: that is no memory. 0 where
        a reading is not believed.
        """
        pseudo, design, order = self.fit.pseudo, self.fit.design, self.order
        position, believed = design.data.position, pseudo != 0.0
        columns = [np.ones(len(pseudo))]
        masters = {name for effect in design.effects for name in effect.masters}
        for name in sorted(masters & position.keys()):
            place = position[name][design.rows][order]
            # Where a position is not known, nothing moves.
            steps = np.nan_to_num(np.diff(place, prepend=place[:1]))
            signs = last_direction(steps, 0.0)
            stretch = np.cumsum(np.diff(signs, prepend=signs[:1]) != 0.0)
            count = np.bincount(stretch, believed[order])
            mean = np.bincount(stretch, pseudo[order]) / np.maximum(count, 1.0)
            first = np.searchsorted(stretch, np.arange(len(count)))
            jumps = np.diff(mean) * signs[first[1:]]
            if len(jumps) >= _TURNS and abs(np.mean(jumps)) > _ALIKE * np.std(jumps):
                columns.append(np.empty(len(pseudo)))
                columns[-1][order] = signs
        turns = np.column_stack(columns)
        share = np.linalg.lstsq(turns[believed], pseudo[believed], rcond=None)[0]
        return np.where(believed, pseudo - turns[:, 1:] @ share[1:], 0.0)

    def swollen(self, white: Spread, places: Int[np.ndarray, " k"] | slice) -> Spread:
        """Return variances, or the covariance, of values at some places.

        Given those under white noise.
        """
        if self.drift is None:
            return times(white, np.sqrt(self._swell[places]))
        scatter, moves = self.fit.estimate.scatter[0], self._moves[:, places]
        more = scatter_of_sums(self.drift, self.clock[self._believed], moves)
        more -= scatter * (moves.T @ moves)
        result = white + (more if white.ndim > 1 else np.diag(more))
        variance = np.diag(result) if white.ndim > 1 else result
        # What a rule holds has a variance by rounding only.
        variance = np.maximum(variance, SINGULAR * variance.max(initial=1e-300))
        swell = np.maximum(self._between_runs[places] / variance, 1.0)
        return times(result, np.sqrt(swell))

    def swell_along(self, direction: Float[np.ndarray, " r"]) -> float:
        """Return the factor of the variance of a parameter, given its direction, ≥ 1."""
        swell = 1.0
        if self._stretches:
            sums = [direction[at] @ pseudo[:, 0] for at, pseudo in self._stretches]
            at = np.concatenate([rows for rows, _ in self._stretches])
            white = np.var(self.pseudo[at]) * np.square(direction[at]).sum()
            ratio = float(np.var(sums)) / max(float(white) / _STRETCHES, 1e-300)
            swell = ratio if ratio > _CHANCE else 1.0
        if self.drift is not None and direction.any():
            column = direction[self._believed, None]
            white = self.fit.estimate.scatter[0] * np.square(column).sum()
            drifting = scatter_of_sums(self.drift, self.clock[self._believed], column)
            swell = max(swell, float(drifting[0, 0] / white))
        return swell

    @cached_property
    def drift(self) -> DriftNoise | None:
        """Noise of a recording with few unknowns, where it drifts."""
        count = len(self._believed)
        if not count or count * self.fit.design.size > _LARGE:
            return None
        columns = [self._columns]
        for lag in self.fit.lags.values():
            # What is left of a lag beside the columns, as large as they are.
            column = lag.direction[self._believed, None]
            columns.append(column / max(float(np.abs(column).max()), 1e-300))
        pseudo = self.pseudo[self._believed]
        return drift_beside(self.clock[self._believed], np.hstack(columns), pseudo)

    @cached_property
    def _stretches(
        self,
    ) -> list[tuple[Int[np.ndarray, " s"], Float[np.ndarray, "s d"]]]:
        """Rows of stretches in order of time, their residual as it is and in other orders."""
        active = self.order[self.pseudo[self.order] != 0.0]
        if len(active) < _FEWEST * _STRETCHES:
            return []
        rng = np.random.default_rng(0)
        pseudo = self.pseudo[active]
        orders = [pseudo, *(rng.permutation(pseudo) for _ in range(_DRAWS))]
        rows = np.array_split(active, _STRETCHES)
        residuals = np.array_split(np.stack(orders, axis=1), _STRETCHES)
        return list(zip(rows, residuals, strict=True))

    @cached_property
    def _swell(self) -> Float[np.ndarray, " n"]:
        """Factor of each unknown's variance that the stretches ask for, ≥ 1."""
        design = self.fit.design
        swell = np.ones(design.size)
        if not self._stretches:
            return swell
        scores = [design.columns[at].T @ pseudo for at, pseudo in self._stretches]
        changes = self.fit.estimate.posterior.factor.solve(np.hstack(scores))
        changes = self.fit.known.rules.project(changes)
        # The prior holds the sum of the scores away from zero: that is no scatter.
        spread = changes.reshape(design.size, len(scores), -1).var(axis=1)
        for part in design.components:
            ordered, *white = spread[part.places].mean(axis=0)
            # No less than white noise, and not by chance.
            if ordered > _CHANCE * np.mean(white) > 0.0:
                swell[part.places] = ordered / np.mean(white)
        return swell

    @cached_property
    def _believed(self) -> Int[np.ndarray, " s"]:
        """Readings that are believed."""
        return np.flatnonzero(self.fit.pseudo != 0.0)

    @cached_property
    def _moves(self) -> Float[np.ndarray, "s n"]:
        """How each of them moves the values where it drifts.

        That moves the mean of the runs by no more than the runs differ.
        """
        moves, runs = self._moves_under_rules, self._runs
        if not runs.shape[1]:
            return moves
        basis = scipy.linalg.orth(runs, rcond=SINGULAR)
        levels = basis @ (basis.T @ moves)
        aside = self.fit.design.aside
        effects = [effect for effect in self.fit.runs() if effect.run not in aside]
        # Those of runs by themselves; in a drift all err alike.
        apart = scatter_of_runs(effects)[0]
        most = np.square(apart * np.abs(runs.T @ moves).sum(axis=0))
        assert self.drift is not None  # asked for only then
        moved = np.diag(scatter_of_sums(self.drift, self.clock[self._believed], levels))
        kept = np.sqrt(np.minimum(most / np.maximum(moved, 1e-300), 1.0))
        return np.asarray(moves - (1.0 - kept) * levels)

    @cached_property
    def _between_runs(self) -> Float[np.ndarray, " n"]:
        """Variance of each value by what the runs make of it; 0 without several.

        Each run may have a slope of its own: that is no drift, which goes on between them.
        """
        runs = self._runs
        count = len(self.fit.design.course.runs)
        if count < _RUNS:
            return np.zeros(self.fit.design.size)
        within = runs.reshape(len(runs), count, -1).sum(axis=2)
        pseudo = self.pseudo[self._believed]
        scores = (within * pseudo[:, None]).T @ self._moves_under_rules
        return np.asarray(np.square(scores).sum(axis=0) * count / (count - 1.0))

    @cached_property
    def _columns(self) -> Float[np.ndarray, "s n"]:
        """Their columns."""
        return np.asarray(self.fit.design.columns[self._believed].toarray())

    @property
    def _runs(self) -> Float[np.ndarray, "s r"]:
        """Columns of where the runs stand."""
        return self._columns[:, self.fit.design.places_of_rank(Rank.RUNS)]

    @cached_property
    def _moves_under_rules(self) -> Float[np.ndarray, "s n"]:
        """How each of them moves the values under the rules."""
        columns = np.ascontiguousarray(self._columns.T)
        moves = self.fit.estimate.posterior.factor.solve(columns)
        return np.asarray(self.fit.known.rules.project(moves).T)


def drift_beside(
    clock: Float[np.ndarray, " s"],
    columns: Float[np.ndarray, "s k"],
    pseudo: Float[np.ndarray, " s"],
) -> DriftNoise | None:
    """Return how residuals scatter beside columns that were fitted; None where none drifts."""
    basis = scipy.linalg.orth(columns, rcond=SINGULAR)
    noise = find_drift(clock, basis, pseudo)
    return noise if noise.drift > 0.0 else None


def times(spread: Spread, factors: Float[np.ndarray, " k"]) -> Spread:
    """Return variances, or the covariance, of values times factors."""
    both = factors**2 if spread.ndim == 1 else np.outer(factors, factors)
    return np.asarray(spread * both)
