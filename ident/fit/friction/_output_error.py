"""Friction from simulated positions: the axis under its measured force must go where it went."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float

from ...core._errors import FitError
from ...core._loss import GaussLoss
from ._assemble import assemble
from ._covariance import score_covariance
from ._marquardt import WINDOWS, Marquardt
from ._problem import Problem, make_problem
from ._result import FrictionFit
from ._samples import DriveSamples, check_samples
from ._separable import Solution
from ._shooting import AbstractSolver, Shooting, Shot, make_shooting
from ._solve import Solved

_SHORTEST = 40
"""Samples of the shortest windows that lead to a start."""
_ROUGHLY = 1e-2
"""Relative gain at which the fit that only sizes the errors ends."""
_WINDOWS = 8
"""Windows from which on each counts as one independent reading of the gradient."""


@dataclasses.dataclass(frozen=True)
class OutputErrorFit:
    """A friction law by simulation, and how well it retraces the recording.

    Attributes:
        friction: Law, parameters and standard deviations; its residual and relative error
            are those of the force, for comparison with the inverse fit.
        free_run: RMS of measured − simulated position over all windows in mm.
        window_error: The same per window in mm.
        position_error: Measured − simulated position per step in mm.
        cost: Half the sum of its squares in mm², and of what the guess knew (``trust``).
        first_cost: The same at the start.
        solver: Who found it.
    """

    friction: FrictionFit
    free_run: float
    window_error: Float[np.ndarray, " w"]
    position_error: Float[np.ndarray, " t"]
    cost: float
    first_cost: float
    solver: str


def fit_output_error(
    guess: FrictionFit,
    samples: DriveSamples,
    *,
    windows: int = 1,
    free_start: bool = False,
    trust: float = 0.01,
    solver: AbstractSolver | None = None,
) -> OutputErrorFit:
    """Fit inertia, law and offset so that the simulated axis follows the measured positions.

    Start from the inverse fit: the valley is flat and kinked, and several bottoms within a
    tenth of the cost differ by a factor of two on another recording.

    Args:
        guess: The fit to start from (`FrictionFit.state`, `FrictionFit.shape`); its structure
            and what it took as known are kept.
        samples: The recording, with positions.
        windows: Stretches simulated on their own; 1 = the whole recording as one free run.
        free_start: Whether position and velocity at the start of each window are fitted,
            which slow disturbances ask for; else they are as measured.
        trust: Weight of what the guess knew: 1 as its covariance says, 0 = not at all. A free
            run sees some combinations of parameters much better than forces do, and others
            hardly; without the guess it wanders along these. Then the cost has many bottoms
            along one valley, as the axis sticks a little sooner or later: on EMPS at 0,
            `Marquardt` ends in one 2 % above that of `Ipopt` and does not leave it however
            long it goes on. With the guess (0.01, 1) both end in the same one.
        solver: `Marquardt` where left out, or `Ipopt`.

    Raises:
        FitError: If the recording or the guess cannot be used.
    """
    check_samples(samples)
    if guess.law is None or "inertia" in guess.undetermined:
        names = ", ".join(guess.undetermined)
        msg = f"output error: the fit to start from does not know {names}."
        raise FitError(msg)
    chosen = Marquardt() if solver is None else solver
    problem = make_problem(samples, guess.structure, guess.known, guess.decimate)
    shooting = make_shooting(problem, guess.state, guess.shape, windows, free_start)
    shooting = _approached(problem, guess, shooting)
    if trust > 0:
        shooting = dataclasses.replace(
            shooting, belief=trust * _belief(guess, shooting)
        )
    shot = chosen.solve(shooting)
    if not np.isfinite(shot.cost):
        msg = f"output error: {chosen.words} found no law that can be simulated."
        raise FitError(msg)
    squares = np.bincount(shooting.window, shot.residual**2, shooting.windows)
    counts = np.bincount(shooting.window, shooting.compared, shooting.windows)
    solution = _solution(problem, shooting, shot)
    return OutputErrorFit(
        friction=assemble(
            Solved(problem, solution, {}), f"output error ({chosen.words})"
        ),
        free_run=float(np.sqrt(squares.sum() / counts.sum())),
        window_error=np.sqrt(squares / np.maximum(counts, 1)),
        position_error=shot.residual,
        cost=shot.cost,
        first_cost=shot.first_cost,
        solver=chosen.words,
    )


def _approached(problem: Problem, guess: FrictionFit, shooting: Shooting) -> Shooting:
    """Return the problem with a better start, where short windows show one.

    A long run is full of kinks, as the axis sticks sooner or later and never where it did;
    short windows from measured starts are nearly smooth, and lead close from far away.
    """
    count = min(WINDOWS, len(shooting.force) // _SHORTEST)
    if count <= shooting.windows:
        return shooting
    short = make_shooting(problem, guess.state, guess.shape, count, False)
    if short.windows > WINDOWS:
        return shooting
    found = Marquardt(_ROUGHLY).solve(short).values
    other = dataclasses.replace(shooting, start=found)
    once = Marquardt(max_passes=1)
    if once.solve(other).cost < once.solve(shooting).cost:
        return other
    return shooting


def _belief(guess: FrictionFit, shooting: Shooting) -> Float[np.ndarray, "p p"]:
    """Return the precision of the guess in the unit of squared position errors.

    How large position errors are, a first fit without the guess tells; as many positions as
    the error keeps its sign for count as one.
    """
    error = Marquardt(_ROUGHLY).solve(shooting).residual
    turns = int((np.diff(np.sign(error - error.mean())) != 0).sum())
    scale = float(error @ error) / (turns + 1)
    spread = np.sqrt(np.diag(guess.state_covariance))
    inner = guess.state_covariance / spread / spread[:, None]
    inverse = np.linalg.pinv(inner, rcond=1e-10, hermitian=True)
    return np.asarray(scale * inverse / spread / spread[:, None])


def free_run(
    fit: FrictionFit, samples: DriveSamples, windows: int = 1
) -> Float[np.ndarray, " t"]:
    """Return measured − simulated position per step in mm, each window from its measured start.

    Args:
        fit: The law, with inertia and offset.
        samples: A recording, the one fitted or another.
        windows: Stretches simulated on their own.
    """
    check_samples(samples)
    problem = make_problem(samples, fit.structure, fit.known, fit.decimate)
    shooting = make_shooting(problem, fit.state, fit.shape, windows, False)
    return Marquardt(max_passes=1).solve(shooting).residual


def _solution(problem: Problem, shooting: Shooting, shot: Shot) -> Solution:
    """Return the shot as the solution of the equation it belongs to."""
    count = len(problem.fixed_names) + len(problem.structure.names)
    factors, shape = shot.values[:count], shot.values[count:]
    design = problem.design(shape)
    residual = problem.target - design @ factors
    used = problem.usable
    spread = 1.4826 * float(np.median(np.abs(residual[used])))
    slopes = _beside_starts(shooting, shot) if shooting.free_start else shot.slopes
    scores = slopes * shot.residual[:, None]
    if shooting.windows >= _WINDOWS:
        sums = np.stack(
            [np.bincount(shooting.window, each, shooting.windows) for each in scores.T]
        )
        inner, lag = sums @ sums.T * shooting.windows / (shooting.windows - 1), 0
    else:
        thin = max(1, len(scores) // 5000)
        inner, lag = score_covariance(scores[::thin], shooting.window[::thin])
        inner, lag = thin**2 * inner, thin * lag
    # What the guess knew came from the same samples: it narrows nothing, and the slopes of
    # the belief only keep the inverse finite.
    matrix = slopes.T @ slopes + shooting.belief
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / size / size[:, None], rcond=1e-10, hermitian=True)
    inverse = inverse / size / size[:, None]
    tangents = problem.tangents(shape, factors)
    full = np.concatenate([design, tangents], axis=1)[used]
    return Solution(
        factors=factors,
        shape=shape,
        covariance=inverse @ inner @ inverse.T,
        null=np.zeros((count, 0)),
        column_size=np.sqrt(np.mean(full**2, axis=0)),
        residual=residual,
        share=used.astype(float),
        loss=GaussLoss(max(spread, 1e-300)),
        lag=lag,
        passes=shot.passes,
        converged=shot.converged,
        at_bound=(shot.values <= shooting.low)[count:]
        | (shot.values >= shooting.high)[count:],
        weight=0.0,
    )


def _beside_starts(shooting: Shooting, shot: Shot) -> Float[np.ndarray, "t p"]:
    """Return what is left of the slopes where the start of each window follows along."""
    slopes = shot.slopes.copy()
    bounds = np.append(np.flatnonzero(shooting.first), len(slopes))
    for begin, end in itertools.pairwise(bounds):
        at = slice(begin, end)
        use = shooting.compared[at].astype(float)
        starts = np.stack([use, shot.start_slopes[at]], axis=1)
        slopes[at] -= starts @ np.linalg.lstsq(starts, slopes[at], rcond=None)[0]
    return slopes
