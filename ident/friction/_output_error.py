"""Friction from simulated positions: the axis under its measured force must go where it went.

The valley of the cost is flat and kinked, and bottoms within a tenth of the cost differ by a
factor of two on another recording: the search starts from the inverse fit, holds on to it lightly
(`trust`), and ends early.
"""

import dataclasses
from collections.abc import Sequence
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..core import FitError, rooted
from ._equation import Equation, record
from ._inverse import fit_equation
from ._result import FrictionFit, score_covariance
from ._samples import DriveSamples
from ._simulate import (
    COUNT,
    PARAMETERS,
    ROUGHLY,
    TOLERANCE,
    Constraint,
    Excitation,
    Problem,
    Solver,
    linearised,
    padded,
    residual_of,
    solve,
)
from ._structures import SUFFIXES, CoulombViscous, Stribeck
from ._weights import Rows, weigh

_PIECES, _SHORTEST = 64, 40
"""Short windows, and the least samples of each, that lead from a far start to a near one."""
_ROWS = 5000
"""Steps from which the covariance is made at most: every second one, third one, ..."""
_SLOW = 0.1
"""Share of the highest speed below which a piece of recording is taken to begin at rest."""
_INERTIA = (1e-3, 1e3)
"""Least and largest inertia, as multiples of that of the guess."""
_LEVEL = 10.0
"""Largest friction, as a multiple of the largest force of the recording."""
_EDGE = 1e-4
"""Distance to a limit, as a share of the distance of both, that counts as none."""


@dataclasses.dataclass(frozen=True)
class OutputErrorFit:
    """A friction law by simulation, and how well it retraces the recording.

    Attributes:
        friction: Law, parameters and standard deviations; its residual is of the force.
        free_run: RMS of measured − simulated position in mm.
        cost: Half the sum of its squares in mm², and of the weighted distance to the guess.
        task: What was asked for.
    """

    friction: FrictionFit
    free_run: float
    cost: float
    task: "_Task"


def fit_output_error(
    guess: FrictionFit,
    samples: DriveSamples,
    *,
    trust: float = 0.01,
    solver: Solver = "optimistix",
    constraints: Sequence[Constraint] = (),
) -> OutputErrorFit:
    """Fit inertia, law and offset so that the simulated axis follows the measured positions.

    Args:
        guess: The fit to start from; its kind of law and a known inertia are kept.
        samples: The recording, with positions; each piece is a free run.
        trust: Weight of what the guess knew: 1 as its covariance says, 0 = not at all: then
            the cost has many bottoms along one valley, and solvers end apart.
        solver: ``"optimistix"`` (Levenberg-Marquardt) or ``"ipopt"``.
        constraints: ``"non-negative"``: friction falls nowhere below 0 up to the highest
            speed driven, while its parameters may have any sign; without it each of them is
            at least 0. ``"monotone"``: it falls nowhere over the speed. By IPOPT only.

    Raises:
        FitError: If the recording, the guess or the options cannot be used.
    """
    if constraints and solver != "ipopt":
        msg = (
            f"constraints: found {', '.join(constraints)} with solver {solver!r}, expected"
            " solver 'ipopt', the only one that keeps inequalities."
        )
        raise FitError(msg)
    task = _Task(guess, samples, trust, solver, tuple(constraints))
    start = _approached(task)
    # A fit without the guess shows how large errors are; as many as they keep their sign
    # for count as one.
    state, _ = solve(task.problem, start, ROUGHLY)
    residual, (_, run, compared) = task.residual(state), task.runs
    error = residual[: len(run)][compared]
    changes = int((np.diff(np.sign(error - error.mean())) != 0).sum())
    variance = float(error @ error) / (changes + 1)
    found = dataclasses.replace(task, variance=variance).fit(state)
    # The valley is kinked, and tangents at its bottom tell little of its width: how far the
    # forces alone led from here says more.
    law = found.friction
    apart = np.concatenate([law.state - guess.state, law.shape - guess.shape])
    doubt = np.asarray(law.state_covariance + np.outer(apart, apart))
    return dataclasses.replace(found, friction=dataclasses.replace(law, given=doubt))


def laws_held_out(
    fit: OutputErrorFit, window: Int[np.ndarray, " t"], loss: str = "trim"
) -> tuple[FrictionFit, ...]:
    """Return the drive found by output error without each window: `state` and `shape` alone.

    For each window both fits are repeated on the rest of the recording; the axis is set down
    anew behind it. Where the rest does not carry a fit, that of the whole recording stands in.

    Args:
        fit: The drive found in the whole recording.
        window: Of each sample, from 0.
        loss: Of the inverse fits, as for `choose_law`.
    """
    whole, laws = fit.friction, []
    # Both solvers end in the same optimum; only inequalities need the slower one.
    solver: Solver = "ipopt" if fit.task.constraints else "optimistix"
    factor = whole.equation.recording.factor
    for number in range(int(window.max()) + 1):
        rows, law = window != number, whole
        try:
            rest = record(fit.task.samples.take(rows), whole.inertia, factor)
            guess = fit_equation(Equation(rest, whole.structure), weigh(rest, loss))
            task = dataclasses.replace(fit.task, guess=guess, rows=rows, solver=solver)
            # Of many bottoms along the valley, one that is no worse than that of all.
            starts = task.guessed, dataclasses.replace(task, guess=whole).guessed
            other = task.fit(min(starts, key=task.misfit)).friction
            law = other if other.has_law else whole
        except FitError:
            pass
        laws.append(dataclasses.replace(whole, state=law.state, shape=law.shape))
    return tuple(laws)


@dataclasses.dataclass(frozen=True, eq=False)
class _Task:
    """A recording as free runs, and the fit that is asked for.

    A step leads from a sample to the next; each piece of the recording is a run.

    Attributes:
        guess: A fit whose law can be simulated.
        samples: The recording, with positions.
        trust: See `fit_output_error`, as for solver and constraints.
        variance: Of a position error that counts as independent, in mm².
        rows: Samples that count, each stretch of them a run; all where left out.
        windows: Stretches of equal length that begin anew as well.

    Raises:
        FitError: If the law cannot be simulated or the recording has no positions.
    """

    guess: FrictionFit
    samples: DriveSamples
    trust: float
    solver: Solver
    constraints: tuple[Constraint, ...]
    variance: float = 0.0
    rows: Bool[np.ndarray, " t"] | None = None
    windows: int = 1

    def __post_init__(self) -> None:
        guess, samples, msg = self.guess, self.samples, ""
        known = isinstance(guess.structure, CoulombViscous | Stribeck)
        if not guess.has_law or "inertia" in guess.undetermined:
            names = ", ".join(guess.undetermined)
            msg = f"output error: the fit to start from does not know {names}."
        elif samples.loads or not known:
            loads = " with further loads" if samples.loads else ""
            msg = (
                f"output error: found {guess.structure.words}{loads}, expected Coulomb +"
                " viscous or Stribeck friction without them."
            )
        elif samples.position is None:
            msg = "output error: the recording holds no positions."
        if msg:
            raise FitError(msg)

    @cached_property
    def equation(self) -> Equation:
        """That of the forces."""
        factor = self.guess.equation.recording.factor
        recording = record(self.samples, self.guess.inertia, factor)
        return Equation(recording, self.guess.structure)

    @cached_property
    def runs(
        self,
    ) -> tuple[Bool[np.ndarray, " s"], Int[np.ndarray, " s"], Bool[np.ndarray, " s"]]:
        """Whether a run begins with a step, the run of each, and which ends are compared.

        Compared are steps within one piece, of samples that count.
        """
        count, piece = len(self.samples.time) - 1, self.samples.piece
        use = np.ones(count + 1, bool) if self.rows is None else self.rows
        begins = np.diff(np.arange(count) * self.windows // count, prepend=-1) > 0
        begins[1:] |= (np.diff(piece[:-1]) > 0) | (use[1:-1] > use[:-2])
        compared = (np.diff(piece) == 0) & use[1:] & use[:-1]
        return begins, np.cumsum(begins) - 1, compared

    @property
    def names(self) -> tuple[str, ...]:
        """What is fitted: factors, then shape."""
        structure = self.guess.structure
        return (*self.equation.fixed_names, *structure.names, *structure.shapes)

    @property
    def guessed(self) -> Float[np.ndarray, " 10"]:
        """Values of the guess."""
        values = np.concatenate([self.guess.state, self.guess.shape])
        return np.pad(values, (0, COUNT - len(values)))

    def residual(self, values: Float[np.ndarray, " 10"]) -> Float[np.ndarray, " r"]:
        """Return the residuals at some values."""
        return np.asarray(residual_of(jnp.asarray(values), self.problem))

    def misfit(self, values: Float[np.ndarray, " 10"]) -> float:
        """Return their size."""
        return float(np.linalg.norm(self.residual(values)))

    @cached_property
    def problem(self) -> Problem:
        """The problem in arrays: the parameters as functions of what is fitted."""
        structure, samples, limits = self.guess.structure, self.samples, self._limits()
        constant, mixing = np.zeros(COUNT), np.zeros((COUNT, COUNT))
        constant[0] = self.guess.inertia or 0.0
        if isinstance(structure, Stribeck) and structure.exponent is not None:
            constant[9] = np.log(structure.exponent)
        for place, name in enumerate(self.names):
            keys = [name] if name in PARAMETERS else [name + end for end in SUFFIXES]
            mixing[[PARAMETERS.index(key) for key in keys], place] = 1.0
        # What begins slowly began at rest: what a filter makes of the very edge is less
        # reliable than that, and an error of the first velocity moves the whole free run.
        velocity, fastest = samples.velocity.copy(), np.abs(samples.velocity).max()
        first = np.flatnonzero(np.diff(samples.piece, prepend=-1))
        velocity[first[np.abs(velocity[first]) < _SLOW * fastest]] = 0.0
        begins, run, compared = self.runs
        steps = samples.current[:-1], begins, velocity[:-1]
        inputs = jax.tree.map(jnp.asarray, [*map(padded, steps), samples.cycle])
        assert samples.position is not None
        target = samples.position[1:] - samples.position[:-1][begins][run]
        # Root of the precision of the guess, in the unit of position errors.
        root, precision = rooted(self.guess.state_covariance)[0], np.zeros_like(mixing)
        precision[: root.shape[1], : len(root)] = root.T
        precision *= np.sqrt(self.trust * self.variance)
        arrays = padded(target), padded(compared), constant, mixing, limits
        about = self.guessed, precision, fastest
        return Problem(
            Excitation(*inputs), *jax.tree.map(jnp.asarray, (*arrays, *about))
        )

    def _limits(self) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, " 10"]]:
        """Return limits: nothing but the offset may push, and nothing weighs nothing."""
        equation, guess = self.equation, self.guessed
        low, high = np.full(COUNT, -1.0), np.ones(COUNT)
        largest = _LEVEL * float(np.abs(self.samples.current[:-1]).max())
        shapes = iter(equation.bounds.T)
        for place, name in enumerate(self.names):
            if name in equation.structure.shapes:
                low[place], high[place] = next(shapes)
            elif name == "inertia":
                low[place], high[place] = guess[place] * np.array(_INERTIA)
            else:
                signed = name == "offset" or "non-negative" in self.constraints
                viscous = name.startswith("viscous")
                unit = float(equation.recording.speed.max()) if viscous else 1.0
                low[place], high[place] = -largest / unit * signed, largest / unit
        return low, high

    def fit(self, start: Float[np.ndarray, " 10"]) -> OutputErrorFit:
        """Return what the solver finds.

        Raises:
            FitError: If it finds nothing that can be simulated.
        """
        task = TOLERANCE, self.solver, self.constraints
        values, converged = solve(self.problem, start, *task)
        arrays = linearised(jnp.asarray(values), self.problem)
        residual, slopes = (np.asarray(array) for array in arrays)
        _, run, compared = self.runs
        error, cost = residual[: len(run)], 0.5 * float(residual @ residual)
        if not np.isfinite(cost):
            msg = f"output error: {self.solver} found no law that can be simulated."
            raise FitError(msg)
        equation, size = self.equation, len(self.names)
        count = size - len(equation.structure.shapes)
        factors, shape = values[:count], values[count:size]
        used = equation.recording.usable
        right = np.hstack([equation.columns(shape), equation.slopes(shape, factors)])
        rows = Rows(used[:, None] * right, right, equation.recording.target)
        thin = max(1, len(error) // _ROWS)
        scores = (slopes[: len(error), :size] * error[:, None])[::thin]
        inner = score_covariance(scores, run[::thin])
        # The guess came from the same samples: it narrows nothing, and only keeps the
        # inverse finite.
        root, _ = rooted(slopes[:, :size].T @ slopes[:, :size])
        inverse = thin * root @ root.T
        low, high = (np.asarray(array) for array in self.problem.limits)
        edge = _EDGE * (high - low)
        reasons, names = self.guess.undetermined.items(), self.guess.names
        missing = {name: reason for name, reason in reasons if name not in names}
        law = FrictionFit(
            equation=equation,
            state=factors,
            shape=shape,
            rows=rows,
            share=used.astype(float),
            prior=equation.penalty,
            converged=converged,
            at_bound=((values < low + edge) | (values > high - edge))[count:size],
            missing=missing,
            method=f"output error ({self.solver})",
            given=np.asarray(inverse @ inner @ inverse.T),
        )
        free_run = float(np.sqrt(error @ error / compared.sum()))
        return OutputErrorFit(law, free_run, cost, self)


def _approached(task: _Task) -> Float[np.ndarray, " 10"]:
    """Return a better start than the guess, where short windows show one.

    A long run is full of kinks, as the axis sticks sooner or later; short ones have few.
    """
    (_, run, _), guess = task.runs, task.guessed
    count = min(_PIECES, len(run) // _SHORTEST)
    if count <= run[-1] + 1:
        return guess
    short = dataclasses.replace(task, windows=count, constraints=())
    near = solve(short.problem, guess, ROUGHLY)[0]
    return min((guess, near), key=task.misfit)
