"""The fit of a stack: robust passes at given weights of the prior, and their evidence.

The loop sees readings through sums only, so that readings in memory and a stream of pieces
take the same way: a pass returns sums about an estimate, they give the next estimate.
"""

import dataclasses
from collections.abc import Callable
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float

from ._evidence import Spread, View, choose_weights, spread_of
from ._loss import FREEDOMS, LOSSES, WILD, Loss, choose_loss
from ._posterior import Posterior, Problem
from ._readings import NOT_DETERMINED, FitError, Readings, Vector
from ._stack import Matrix, Stack
from ._sums import Sums, loop_axes, sums_of

_PASSES, _SEARCHES = 60, 6
"""Robust passes and searches for the evidence, at most."""
_ENDED, _NEAR, _FIRST = 0.005, 0.03, 0.25
"""Last move of the predictions, in their typical deviation, at which passes end: at the last
weights, at others, and at those that passes begin with, which are nobody's choice."""
_SAME = 0.05
"""Change of the values, in typical deviations, that asks for no new weights."""
_FROZEN = 4
"""Passes after which the tails of the loss stay: chosen for ever, they go in circles."""
_CHANGED = 1e-4
"""Share of readings that change sides and ask for a new matrix."""
_DEAR = 1000
"""Unknowns from which on their effective number is found for new weights only."""
_FURTHEST = 9.0
"""Moves by which a pass may begin ahead of where the last one ended."""
_UNLIKELY = 0.05
"""Share of wild readings from which on the fit begins once more, from least squares."""
_PLENTY = 10.0
"""Readings per unknown from which on they judge each other, without their neighbours."""
_FEWEST = 3.0
"""Degrees of freedom of the noise at least, that Student's t has a variance."""
_SPARE = 0.02
"""Share of the readings that must be left beside the unknowns to judge the noise by."""
_CROWDED = 0.6
"""Unknowns per reading from which on residuals do not say which readings are wild."""
_FOLLOWS = (
    "The table follows every reading; the noise was judged by the smoothness that the "
    "readings suggest."
)

Pass = Callable[[Vector, Loss, Sums | None], Sums]
"""Returns the sums of all readings about an estimate, their matrix that of former ones or new."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Estimate:
    """Where the fit of a stack ended.

    Attributes:
        posterior: Of all unknowns.
        loss: By which readings counted in the last pass.
        about: Estimate about which that pass was.
        converged: Whether nothing moved any more.
        stated: Whether the weights of the prior were given, and not found by evidence.
    """

    posterior: Posterior
    loss: Loss
    about: Vector
    converged: bool
    stated: bool = False

    @property
    def values(self) -> Vector:
        """Of all unknowns."""
        return self.posterior.values

    @property
    def centre(self) -> Vector:
        """Estimate about which pseudo-readings are taken; least squares knows no other."""
        return self.values if self.loss == Loss() else self.about

    def pseudo(self, residual: Float[np.ndarray, " t"]) -> Float[np.ndarray, " t"]:
        """Return pseudo-readings of residuals about `centre`, 0 where one is not believed."""
        share = self.loss.share(residual / self.loss.scale)
        return np.asarray(share * residual / self.posterior.problem.gain)

    @property
    def noise(self) -> float:
        """Standard deviation of a reading, wild readings left out."""
        times = self.posterior.problem.times
        if self.follows:
            return float(np.sqrt(self.scatter[0] / times))
        count, _, _, square, good = self.posterior.problem.sums.tally
        if self.loss == Loss():
            square, good = self.posterior.residual_square, count
        free = self._spare * times * good / max(count, 1.0)
        return float(np.sqrt(square / max(free, 1e-9)))

    @property
    def _spare(self) -> float:
        """Readings that are left beside the unknowns."""
        return self.posterior.problem.count - self.posterior.used

    @property
    def follows(self) -> bool:
        """Whether stated weights let every node follow its own reading."""
        needed = max(_FEWEST, _SPARE * self.posterior.problem.count)
        return self.stated and self._spare < needed

    @cached_property
    def scatter(self) -> tuple[float, float]:
        """Variance of a pseudo-reading, and its degrees of freedom.

        Stated weights say nothing about the noise: it is taken from the residuals, or, where
        those say nothing either, from the weights that the evidence would have.
        """
        post = self.posterior
        if self.stated and not self.follows:
            return post.residual_square / self._spare, self._spare
        chosen = choose_weights(post.problem) if self.follows else None
        return (chosen or post).variance, post.problem.degrees

    def spread(self, view: View) -> Spread:
        """Return the variances, or the covariance, of some values.

        Beside the noise of the readings they know what else was estimated: smoothness
        (`spread_of`), noise (Student's t), and which readings count (`Loss.unevenness`).
        """
        post, (variance, degrees) = self.posterior, self.scatter
        squares = variance * view(post)[1] if self.stated else spread_of(post, view)
        degrees = max(degrees, _FEWEST)
        share = post.used / max(post.problem.count, 1.0)
        uneven = 1.0 + self.loss.unevenness * share
        return np.asarray(squares * degrees / (degrees - 2.0) * uneven**2)

    def alike(self, times: float) -> "Estimate":
        """Return what the same readings tell where only one in so many is news.

        Errors that readings share are no news: weights chosen for each reading by itself follow
        them. Weights that were stated stay.

        Raises:
            FitError: If so few readings determine nothing.
        """
        post = self.posterior
        problem = dataclasses.replace(post.problem, times=times * post.problem.times)
        fewer = problem.at(post.weights) if self.stated else choose_weights(problem)
        return dataclasses.replace(self, posterior=_known(fewer))

    def message(self, count: int) -> str:
        """Return one sentence or more on how the fit of so many readings went."""
        wild = count - round(float(self.posterior.problem.sums.tally[0]))
        used = f"{count} readings, {self.posterior.used:.1f} effective parameters."
        noun = "wild reading was" if wild == 1 else "wild readings were"
        rejected = f"{wild} {noun} left out." if wild > 0 else ""
        care = "The iterations did not settle; treat the result with care."
        fitted = _FOLLOWS if self.follows else used
        clauses = (fitted, rejected, "" if self.converged else care)
        return " ".join(filter(None, clauses))


def memory(stack: Stack, readings: Readings, columns: Matrix | None = None) -> Pass:
    """Return the pass over readings in memory; their design is made once, or known before."""
    if columns is None and loop_axes(stack, readings) is None:
        columns = stack.matrix(readings)

    def over(theta: Vector, loss: Loss, former: Sums | None) -> Sums:
        return sums_of(stack, readings, theta, loss, former, columns)[0]

    return over


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Passes:
    """The fit of a stack: passes over the readings in turn with the search for the weights.

    Attributes:
        stack: Effects.
        over: Pass over the readings.
        loss: ``"student"``, ``"huber"``, ``"trim"`` or ``"gauss"``; stated weights that leave too
            few readings beside the unknowns to tell wild ones make it least squares.
        weights: Weights of the prior for a problem; None: by evidence.
        floor: Smallest scale of residuals to believe in, in mm or °.
        pins: Precision by which unknowns are held that nothing else determines.
        rough: Whether to end at the first search for the evidence: a fit on the way to another.
    """

    stack: Stack
    over: Pass
    loss: str
    weights: Callable[[Problem], Vector] | None = None
    floor: float = 1e-12
    pins: Vector | None = None
    rough: bool = False

    def run(
        self, start: Vector | None = None, near: Estimate | None = None
    ) -> Estimate:
        """Alternate passes and searches until neither moves the values.

        Begins at constant unknowns, or zero, or at a fit of nearly the same readings.

        Raises:
            FitError: If the readings do not determine the unknowns or the loss is unknown.
        """
        if self.loss not in LOSSES:
            msg = f"loss: found {self.loss!r}, expected 'student', 'huber', 'trim' or 'gauss'."
            raise FitError(msg)
        if near is not None and near.loss != Loss():
            matrix = self.over(near.values, near.loss, None)
            problem = Problem.of(matrix, near.values, pins=self.pins)
            post = near.posterior
            weights = post.weights if self.weights is None else self.weights(problem)
            post = _known(problem.at(weights))
            return self._robust(post, float(matrix.tally[0]), searches=1)
        theta = np.zeros(self.stack.size) if start is None else start
        matrix = self.over(theta, Loss(), None)
        crowded = self.stack.size > _CROWDED * float(matrix.tally[0])
        if self.loss == "gauss" or (self.weights is not None and crowded):
            post = self._least_squares(matrix, theta)
            if self.loss == "gauss" or post.used > _CROWDED * post.problem.count:
                return Estimate(post, Loss(), theta, True, self.weights is not None)
        # Far from the table every residual is large: believe all, the hopeless ones less.
        size, count = matrix.sizes
        scale = choose_loss("gauss", size, 1.0, self.floor, count).scale
        tolerant = self.over(theta, Loss(scale, corner=WILD), matrix)
        problem = Problem.of(tolerant, theta, pins=self.pins)
        total = float(matrix.tally[0])
        try:
            first = self._robust(_known(problem.at(self._light(problem))), total)
        except FitError:
            first = None  # a run so far off that none of its readings is believed
        if first is not None:
            few = total - float(first.posterior.problem.count) <= _UNLIKELY * total
            if self.weights is not None or self.rough or (first.converged and few):
                return first
        # A first table too smooth takes a bend for wild readings: least squares bends.
        try:
            other = self._robust(self._least_squares(matrix, theta), total)
        except FitError:
            if first is None:
                raise
            return first  # so far off that a node lost all of its readings
        if first is None or (other.converged and not first.converged):
            return other
        more = other.posterior.problem.count > first.posterior.problem.count
        return other if more and other.noise < 0.5 * first.noise else first

    def _least_squares(self, matrix: Sums, theta: Vector) -> Posterior:
        problem = Problem.of(matrix, theta, pins=self.pins)
        # About the values themselves the sums keep all their digits.
        values = _known(problem.at(self._light(problem))).values
        problem = Problem.of(matrix.moved(values - theta), values, pins=self.pins)
        if self.weights is None:
            return _known(choose_weights(problem))
        return _known(problem.at(self.weights(problem)))

    def _robust(self, post: Posterior, active: float, searches: int = 0) -> Estimate:
        """Pass until nothing moves; ``active`` readings made the matrix of the posterior."""
        inflation = self._inflation(post)
        freedoms: tuple[float, ...] = FREEDOMS
        matrix, loss, about = post.problem.sums, Loss(), post.values
        sums = self.over(about, Loss(), matrix)
        converged = False
        trail: list[tuple[Vector, Vector]] = []
        for number in range(_PASSES):
            about = _ahead(trail, post)
            size, count = sums.sizes
            loss = choose_loss(self.loss, size, inflation, self.floor, count, freedoms)
            if number >= _FROZEN:
                freedoms = (loss.freedom,)
            # With the same readings at work the matrix and its factor stay as they are.
            final = self.weights is not None or (searches > 0 and not self.rough)
            tolerance = _ENDED if final else _NEAR if searches else _FIRST
            sums = self.over(about, loss, matrix)
            changed = abs(float(sums.tally[0]) - active) / max(active, 1.0)
            full = changed > _CHANGED
            if full:
                matrix = sums = self.over(about, loss, None)
                active = float(sums.tally[0])
            factor = None if full else post.factor
            gain = max(float(sums.tally[1] / max(sums.tally[0], 1.0)), 0.1)
            problem = Problem.of(sums, about, gain, self.pins)
            weights = post.weights if self.weights is None else self.weights(problem)
            post = _known(problem.at(weights, factor))
            trail = [*trail[-1:], (about, post.values - about)]
            step = self._step(post)
            moved = self._moved(sums, post.values - about)
            converged = moved <= tolerance * step
            limit = 1 if self.rough else _SEARCHES
            if converged and self.weights is None and searches < limit:
                before = post.values
                post = _known(choose_weights(problem, post if searches else None))
                searches += 1
                trail = []
                converged = self._moved(sums, post.values - before) <= _SAME * step
            if converged:
                break
            if not trail or (full and self.stack.size < _DEAR):
                inflation = self._inflation(post)
        return Estimate(post, loss, about, converged, self.weights is not None)

    def _moved(self, sums: Sums, change: Vector) -> float:
        """Return by how much predictions of the readings change, root mean square."""
        square = float(change @ sums.apply(change)) / max(float(sums.tally[0]), 1.0)
        return float(np.sqrt(max(square, 0.0)))

    def _step(self, post: Posterior) -> float:
        """Return the typical standard deviation of a prediction, without any prior."""
        share = min(self.stack.size / max(post.problem.count, 1.0), 1.0)
        return float(np.sqrt(max(post.variance, self.floor**2) * share))

    def _inflation(self, post: Posterior) -> float:
        """Return the factor that undoes the shrinkage of residuals by the unknowns."""
        count = post.problem.count
        # The exact number is dear on a large table, where it hardly matters.
        used = float(self.stack.size) if count >= 20 * self.stack.size else post.used
        return float(np.sqrt(count / max(count - used, 0.05 * count)))

    def _light(self, problem: Problem) -> Vector:
        if self.weights is not None:
            return self.weights(problem)
        plenty = problem.count >= _PLENTY * self.stack.size
        second = problem.density * (1e-2 if plenty else 1.0)
        return np.where(problem.stack.optional, 0.0, second)


def _ahead(trail: list[tuple[Vector, Vector]], post: Posterior) -> Vector:
    """Return where the next pass begins: where passes of a steady rate would come to rest.

    By the secant of the last two (A. C. Aitken, Proc. R. Soc. Edinburgh 46, 1926), measured
    by what the readings see of it. Passes that swing about their end come to rest, too.

    Args:
        trail: Where each pass at the present weights began, and how far it went; the last two.
        post: Where the last one ended.
    """
    if len(trail) < 2:
        return post.values
    (sooner, first), (later, last) = trail
    change = last - first
    apply = post.problem.sums.apply
    response = apply(change)
    share = float(last @ response) / max(float(change @ response), 1e-300)
    ahead = min(share, 1.0) * (later - sooner + change)
    # A loss that believes nothing pulls evenly from any distance: its passes have no end.
    squares = (float(step @ apply(step)) for step in (ahead, last))
    size, reach = (float(np.sqrt(max(square, 0.0))) for square in squares)
    part = min(1.0, _FURTHEST * reach / max(size, 1e-300))
    return np.asarray(post.values - ahead * part)


def _known(post: Posterior | None) -> Posterior:
    if post is None:
        raise FitError(NOT_DETERMINED)
    return post
