"""Friction from simulated positions: the axis under its measured force must go where it went.

The valley of the cost is flat and kinked, and bottoms within a tenth of the cost differ by a
factor of two on another recording: the search starts from the inverse fit, holds on to it lightly
(`trust`), and ends early.

In motion only coulomb⁺ + offset and coulomb⁻ − offset are seen. Where both levels are fitted the
offset is not; `FrictionFit.gauges` says so, and the offset is chosen that makes them equal.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..core import FitError
from ._choice import WindowLaw
from ._equation import Equation, equation_of
from ._inverse import FrictionFit, assemble, fit_inverse
from ._samples import DriveSamples
from ._separable import Solution, score_covariance
from ._shooting import (
    ROUGHLY,
    TOLERANCE,
    Constraint,
    Cut,
    Found,
    Shooting,
    by_ipopt,
    by_optimistix,
    cut_windows,
    linearised,
    make_shooting,
    names_of,
    start_cost,
)
from ._structures import CoulombViscous, Stribeck

Solver = Literal["optimistix", "ipopt"]

_PIECES, _SHORTEST = 64, 40
"""Short windows, and the least samples of each, that lead from a far start to a near one."""
_MANY = 8
"""Windows from which on each counts as one independent reading of the gradient."""
_ROWS = 5000
"""Steps from which the covariance is made at most: every second one, third one, ..."""
_EDGE = 1e-4
"""Distance to a limit, as a share of the distance of both, that counts as none."""


@dataclasses.dataclass(frozen=True)
class OutputErrorFit:
    """A friction law by simulation, and how well it retraces the recording.

    Attributes:
        friction: Law, parameters and standard deviations; its residual and relative error
            are those of the force, for comparison with the inverse fit.
        free_run: RMS of measured − simulated position over all windows in mm.
        window_error: The same per window in mm.
        position_error: Measured − simulated position per step in mm.
        cost: Half the sum of its squares in mm², and of the weighted distance to the guess.
        first_cost: The same at the start.
        variance: Of a position error that counts as independent, in mm².
        trust: Weight of the guess.
        solver: Which one found it.
        constraints: Inequalities that it kept.
    """

    friction: FrictionFit
    free_run: float
    window_error: Float[np.ndarray, " w"]
    position_error: Float[np.ndarray, " t"]
    cost: float
    first_cost: float
    variance: float
    trust: float
    solver: Solver
    constraints: tuple[Constraint, ...]


def fit_output_error(
    guess: FrictionFit,
    samples: DriveSamples,
    *,
    windows: int = 1,
    free_start: bool = False,
    trust: float = 0.01,
    solver: Solver = "optimistix",
    constraints: Sequence[Constraint] = (),
) -> OutputErrorFit:
    """Fit inertia, law and offset so that the simulated axis follows the measured positions.

    Args:
        guess: The fit to start from; its kind of law and what it took as known are kept.
        samples: The recording, with positions.
        windows: Stretches simulated on their own; 1 = the whole recording as one free run.
        free_start: Whether position and velocity at the start of each window are fitted,
            which slow disturbances ask for; else they are as measured.
        trust: Weight of what the guess knew: 1 as its covariance says, 0 = not at all. A free
            run sees some combinations of parameters much better than forces do, and others
            hardly; at 0 the cost has many bottoms along one valley, as the axis sticks a
            little sooner or later, and solvers end apart. At 0.01 and 1 they agree.
        solver: ``"optimistix"`` (Levenberg-Marquardt) or ``"ipopt"``.
        constraints: ``"non-negative"``: friction falls nowhere below 0 up to the highest
            speed driven, while its parameters may have any sign; by IPOPT only. Without it
            each parameter of friction is at least 0.

    Raises:
        FitError: If the recording, the guess or the options cannot be used.
    """
    if constraints and solver != "ipopt":
        msg = (
            f"constraints: found {', '.join(constraints)} with solver {solver!r}, expected"
            " solver 'ipopt', the only one that keeps inequalities."
        )
        raise FitError(msg)
    _refuse_unsimulated(guess, samples)
    count = len(samples.time) - 1
    if not 1 <= windows <= max(count // 20, 1):
        msg = f"windows: found {windows}, expected 1 to {max(count // 20, 1)}."
        raise FitError(msg)
    equation = equation_of(samples, guess.structure, guess.known, guess.decimate)
    cut = cut_windows(samples, windows)
    shooting = make_shooting(equation, cut, _values(guess), constraints)
    shooting = _approached(equation, cut, guess, shooting)
    # A power of two: fewer compilations.
    room = 1 << (cut.windows - 1).bit_length() if free_start else 0
    starts = np.zeros((room, 2))
    variance = _variance(shooting, cut, starts)
    asked = _Asked(equation, cut, guess, variance, trust, solver, tuple(constraints))
    return asked.fit(shooting, starts)


def laws_held_out(
    fit: OutputErrorFit,
    samples: DriveSamples,
    window: Int[np.ndarray, " t"],
    loss: str = "trim",
) -> tuple[WindowLaw, ...]:
    """Return the drive found by output error without each window.

    For each window the inverse fit and the output error are repeated on the rest of the
    recording; the axis is set down anew, as measured, behind the window. Where the rest does
    not carry a fit, that of the whole recording stands in.

    Args:
        fit: The drive found in the whole recording.
        samples: The recording.
        window: Of each sample, from 0.
        loss: Of the inverse fits, as for `fit_inverse`.
    """
    whole, found = fit.friction, []
    for number in range(int(window.max()) + 1):
        rows = window != number
        try:
            guess = fit_inverse(
                samples.take(rows),
                whole.structure,
                known=whole.known,
                loss=loss,
                decimate=whole.decimate,
            )
            _refuse_unsimulated(guess, samples)
            equation = equation_of(
                samples, guess.structure, whole.known, whole.decimate
            )
            cut = cut_windows(samples, 1, rows)
            # Both solvers end in the same optimum; only inequalities need the slower one.
            solver: Solver = "ipopt" if fit.constraints else "optimistix"
            options = (fit.variance, fit.trust, solver, fit.constraints)
            asked = _Asked(equation, cut, guess, *options)
            shooting = make_shooting(equation, cut, _values(guess), fit.constraints)
            other = asked.fit(shooting, np.zeros((0, 2))).friction
        except FitError:
            other = whole
        found.append(_window_law(other if other.has_law else whole))
    return tuple(found)


def _window_law(fit: FrictionFit) -> WindowLaw:
    inertia, offset = (fit.parameters.get(name, 0.0) for name in ("inertia", "offset"))
    return WindowLaw(fit.structure, fit.factors, fit.shape, inertia, offset)


def free_run(
    fit: FrictionFit, samples: DriveSamples, windows: int = 1
) -> Float[np.ndarray, " t"]:
    """Return measured − simulated position per step in mm, each window from its measured start.

    Args:
        fit: The law, with inertia and offset.
        samples: A recording, the one fitted or another.
        windows: Stretches simulated on their own.

    Raises:
        FitError: If the law cannot be simulated or the recording holds no positions.
    """
    _refuse_unsimulated(fit, samples)
    equation = equation_of(samples, fit.structure, fit.known, fit.decimate)
    cut = cut_windows(samples, windows)
    shooting = make_shooting(equation, cut, _values(fit), ())
    residual, _, _ = linearised(shooting, shooting.guess, jnp.zeros((0, 2)))
    return np.asarray(residual)[: len(cut.window)]


def _refuse_unsimulated(guess: FrictionFit, samples: DriveSamples) -> None:
    """Refuse a law that cannot be simulated, or a recording without positions.

    Raises:
        FitError: Naming what is missing.
    """
    structure = guess.structure
    if not guess.has_law or "inertia" in guess.undetermined:
        names = ", ".join(guess.undetermined)
        msg = f"output error: the fit to start from does not know {names}."
        raise FitError(msg)
    if not isinstance(structure, CoulombViscous | Stribeck) or samples.loads:
        msg = (
            f"output error: found {structure.words}"
            + (" with further loads" if samples.loads else "")
            + ", expected Coulomb + viscous or Stribeck friction without them."
        )
        raise FitError(msg)
    if samples.position is None:
        msg = "output error: the recording holds no positions."
        raise FitError(msg)
    if guess.known.inertia is None and samples.acceleration is None:
        msg = "output error: expected a known inertia, or accelerations to start from."
        raise FitError(msg)


def _values(fit: FrictionFit) -> Float[np.ndarray, " p"]:
    return np.concatenate([fit.state, fit.shape])


def _approached(
    equation: Equation, cut: Cut, guess: FrictionFit, shooting: Shooting
) -> Shooting:
    """Return the problem with a better start, where short windows show one.

    A long run is full of kinks, as the axis sticks sooner or later and never where it did;
    short windows from measured starts are nearly smooth, and lead close from far away.
    """
    count = min(_PIECES, len(cut.window) // _SHORTEST)
    if count <= cut.windows:
        return shooting
    short = cut_windows(equation.samples, count)
    near = by_optimistix(
        make_shooting(equation, short, _values(guess), ()), np.zeros((0, 2)), ROUGHLY
    )
    margin = 1e-6 * (shooting.high - shooting.low)
    start = jnp.clip(near.values, shooting.low + margin, shooting.high - margin)
    other = dataclasses.replace(shooting, start=start)
    return other if start_cost(other) < start_cost(shooting) else shooting


def _variance(shooting: Shooting, cut: Cut, starts: Float[np.ndarray, "w 2"]) -> float:
    """Return the variance in mm² of a position error that counts as independent.

    A fit without the guess shows how large errors are; as many as they keep their sign for
    count as one.
    """
    found = by_optimistix(shooting, starts, ROUGHLY)
    error = found.residual[: len(cut.window)][cut.compared]
    turns = int((np.diff(np.sign(error - error.mean())) != 0).sum())
    return float(error @ error) / (turns + 1)


@dataclasses.dataclass(frozen=True)
class _Asked:
    """A fit that is asked for: recording, guess, and options of `OutputErrorFit`."""

    equation: Equation
    cut: Cut
    guess: FrictionFit
    variance: float
    trust: float
    solver: Solver
    constraints: tuple[Constraint, ...]

    def fit(
        self, shooting: Shooting, starts: Float[np.ndarray, "w 2"]
    ) -> OutputErrorFit:
        """Return what the solver finds.

        Raises:
            FitError: If it finds nothing that can be simulated.
        """
        shooting = dataclasses.replace(shooting, root=jnp.asarray(self._root()))
        if self.solver == "ipopt":
            found = by_ipopt(shooting, starts, self.constraints)
        else:
            found = by_optimistix(shooting, starts, TOLERANCE)
        if not np.isfinite(found.cost):
            msg = f"output error: {self.solver} found no law that can be simulated."
            raise FitError(msg)
        window, error = self.cut.window, found.residual[: len(self.cut.window)]
        squares = np.bincount(window, error**2, self.cut.windows)
        counts = np.bincount(window, self.cut.compared, self.cut.windows)
        missing = {
            name: reason
            for name, reason in self.guess.undetermined.items()
            if name not in self.guess.names
        }
        solution = self._solution(shooting, found)
        return OutputErrorFit(
            friction=assemble(
                self.equation, solution, missing, f"output error ({self.solver})"
            ),
            free_run=float(np.sqrt(squares.sum() / counts.sum())),
            window_error=np.sqrt(squares / np.maximum(counts, 1)),
            position_error=error,
            cost=found.cost,
            first_cost=float(start_cost(shooting)),
            variance=self.variance,
            trust=self.trust,
            solver=self.solver,
            constraints=self.constraints,
        )

    def _root(self) -> Float[np.ndarray, "10 10"]:
        """Return the root of the precision of the guess, in the unit of position errors."""
        covariance = self.guess.state_covariance
        spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        values, ways = np.linalg.eigh(covariance / spread / spread[:, None])
        seen = values > 1e-10 * values.max()
        weight = self.trust * self.variance / np.where(seen, values, np.inf)
        root = np.zeros((10, 10))
        root[: len(values), : len(values)] = np.sqrt(weight)[:, None] * ways.T / spread
        return root

    def _solution(self, shooting: Shooting, found: Found) -> Solution:
        """Return where the solver ended as a solution of the equation of forces."""
        equation, size = self.equation, len(names_of(self.equation))
        count = size - len(equation.structure.shapes)
        factors, shape = found.values[:count], found.values[count:size]
        design, used = equation.design(shape), equation.usable
        residual = equation.target - design @ factors
        covariance, _ = self._covariance(found, size)
        tangents = equation.tangents(shape, factors)
        low, high = np.asarray(shooting.low), np.asarray(shooting.high)
        edge = _EDGE * (high - low)
        outside = (found.values < low + edge) | (found.values > high - edge)
        return Solution(
            factors=factors,
            shape=shape,
            columns=np.hstack([design, tangents]),
            prior=np.zeros((count, count)),
            covariance=covariance,
            null=np.zeros((count, 0)),
            residual=residual,
            share=used.astype(float),
            # Of Gaussian noise this is the standard deviation.
            scale=1.4826 * float(np.median(np.abs(residual[used]))),
            converged=found.converged,
            at_bound=outside[count:size],
        )

    def _covariance(
        self, found: Found, size: int
    ) -> tuple[Float[np.ndarray, "p p"], int]:
        """Return the covariance of what was fitted, and the lag of errors that resemble.

        The guess came from the same samples: it narrows nothing, and only keeps the inverse
        finite.
        """
        cut, steps = self.cut, len(self.cut.window)
        slopes = found.slopes[:steps, :size].copy()
        if len(found.starts):
            _project_starts(slopes, found.start_slopes[:steps], cut)
        scores = slopes * found.residual[:steps, None]
        if cut.windows >= _MANY:
            sums = np.stack(
                [np.bincount(cut.window, each, cut.windows) for each in scores.T]
            )
            inner, lag = sums @ sums.T * cut.windows / (cut.windows - 1), 0
        else:
            thin = max(1, steps // _ROWS)
            inner, lag = score_covariance(scores[::thin], cut.window[::thin])
            inner, lag = thin**2 * inner, thin * lag
        held = found.slopes[steps:, :size]
        matrix = slopes.T @ slopes + held.T @ held
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        inverse = np.linalg.pinv(
            matrix / np.outer(scale, scale), rcond=1e-10, hermitian=True
        )
        inverse = inverse / np.outer(scale, scale)
        return np.asarray(inverse @ inner @ inverse.T), lag


def _project_starts(
    slopes: Float[np.ndarray, "t p"], start_slopes: Float[np.ndarray, " t"], cut: Cut
) -> None:
    """Take from the slopes what the fitted start of each window stands in for."""
    bounds = np.append(np.flatnonzero(cut.begins), len(slopes))
    for begin, end in itertools.pairwise(bounds):
        at = slice(begin, end)
        starts = np.stack([cut.compared[at].astype(float), start_slopes[at]], axis=1)
        slopes[at] -= starts @ np.linalg.lstsq(starts, slopes[at], rcond=None)[0]
