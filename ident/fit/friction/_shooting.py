"""The output-error problem: windows of a recording, simulated, against the position measured."""

import abc
import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from ...core._errors import FitError
from ._axis import CANONICAL
from ._problem import Problem
from ._samples import DriveSamples
from ._structure import WAYS
from ._structures import CoulombViscous, Stribeck

_SLOW = 0.1
"""Share of the highest speed below which a piece of recording is taken to begin at rest."""
_SMALLEST_INERTIA = 1e-3
"""Least inertia, as a share of the one to start from."""


@dataclasses.dataclass(frozen=True)
class Shooting:
    """What is simulated, from where, and what is compared.

    Attributes:
        names: What is fitted, in the order of `Problem.fixed_names`, factors, shape.
        start: Values to start from.
        low: Least values allowed.
        high: Largest values allowed.
        constant: Canonical parameters at 0 of what is fitted.
        mixing: Derivative of the canonical parameters with respect to what is fitted.
        force: Load over the step that begins with each sample, in load units.
        target: Position at the end of that step, in mm.
        compared: Which steps end in a sample of the same piece.
        window: Window of each step, from 0.
        first: Whether a window begins with it.
        position: At the start of each window, as measured, in mm.
        velocity: At the start of each window, as measured, in mm/s.
        step: Time from sample to sample in s.
        free_start: Whether position and velocity at the start of each window are fitted too.
        centre: Values that the belief is about.
        belief: Precision of what was known beforehand, times the variance of a position that
            counts as independent, in mm² per squared parameter.
    """

    names: tuple[str, ...]
    start: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    constant: Float[np.ndarray, " 9"]
    mixing: Float[np.ndarray, "9 p"]
    force: Float[np.ndarray, " t"]
    target: Float[np.ndarray, " t"]
    compared: Bool[np.ndarray, " t"]
    window: Int[np.ndarray, " t"]
    first: Bool[np.ndarray, " t"]
    position: Float[np.ndarray, " w"]
    velocity: Float[np.ndarray, " w"]
    step: float
    free_start: bool
    centre: Float[np.ndarray, " p"]
    belief: Float[np.ndarray, "p p"]

    @property
    def windows(self) -> int:
        """How many windows there are."""
        return len(self.position)


@dataclasses.dataclass(frozen=True)
class Shot:
    """Where a solver ended.

    Attributes:
        values: What was fitted.
        position: At the start of each window in mm.
        velocity: At the start of each window in mm/s.
        cost: Half the sum of squared position errors in mm².
        first_cost: The same where it started.
        residual: Position measured − simulated per step in mm; 0 where nothing is compared.
        slopes: Derivative of the simulated position with respect to what was fitted.
        start_slopes: With respect to the velocity at the start of the window.
        passes: Simulations of the whole recording.
        converged: Whether the solver says so.
    """

    values: Float[np.ndarray, " p"]
    position: Float[np.ndarray, " w"]
    velocity: Float[np.ndarray, " w"]
    cost: float
    first_cost: float
    residual: Float[np.ndarray, " t"]
    slopes: Float[np.ndarray, "t p"]
    start_slopes: Float[np.ndarray, " t"]
    passes: int
    converged: bool


class AbstractSolver(abc.ABC):
    """What can solve an output-error problem."""

    @property
    @abc.abstractmethod
    def words(self) -> str:
        """Name for reports."""

    @abc.abstractmethod
    def solve(self, shooting: Shooting) -> Shot:
        """Return parameters that bring the simulated positions closest to the measured."""


def make_shooting(
    problem: Problem,
    factors: Float[np.ndarray, " k"],
    shape: Float[np.ndarray, " s"],
    windows: int,
    free_start: bool,
) -> Shooting:
    """Return the output-error problem of a recording, started from the given law.

    Raises:
        FitError: If the law cannot be simulated or the recording holds no positions.
    """
    structure, samples = problem.structure, problem.samples
    if not isinstance(structure, (CoulombViscous, Stribeck)) or samples.loads:
        msg = (
            f"output error: found {structure.words}"
            + (" with further loads" if samples.loads else "")
            + ", expected Coulomb + viscous or Stribeck friction without them."
        )
        raise FitError(msg)
    if isinstance(structure, Stribeck) and structure.shape != 2.0:
        msg = f"output error: found exponent {structure.shape}, expected 2."
        raise FitError(msg)
    if samples.position is None:
        msg = "output error: the recording holds no positions."
        raise FitError(msg)
    if problem.known.inertia is None and samples.acceleration is None:
        msg = "output error: expected a known inertia, or accelerations to start from."
        raise FitError(msg)
    piece = samples.piece
    count = len(piece) - 1
    if not 1 <= windows <= max(count // 20, 1):
        msg = f"windows: found {windows}, expected 1 to {max(count // 20, 1)}."
        raise FitError(msg)
    window = np.arange(count) * windows // count
    breaks = np.concatenate([[True], (np.diff(window) > 0) | (np.diff(piece[:-1]) > 0)])
    window = np.cumsum(breaks) - 1
    names = (*problem.fixed_names, *structure.names, *structure.shapes)
    constant, mixing = _mixing(problem, names)
    start = np.concatenate([factors, shape])
    low, high = _bounds(problem, names, start)
    return Shooting(
        names=names,
        start=np.clip(start, low, high),
        low=low,
        high=high,
        constant=constant,
        mixing=mixing,
        force=problem.known.gain * samples.current[:-1],
        target=samples.position[1:],
        compared=piece[1:] == piece[:-1],
        window=window,
        first=breaks,
        position=samples.position[:-1][breaks],
        velocity=_begun(samples)[:-1][breaks],
        step=samples.cycle,
        free_start=free_start,
        centre=np.clip(start, low, high),
        belief=np.zeros((len(names), len(names))),
    )


def _begun(samples: DriveSamples) -> Float[np.ndarray, " t"]:
    """Return the velocities to start from.

    A recording that begins slowly began at rest: what a filter makes of its very edge is
    less reliable than that, and an error of the first velocity moves the whole free run.
    """
    velocity = samples.velocity.copy()
    first = np.flatnonzero(np.diff(samples.piece, prepend=-1))
    slow = np.abs(velocity[first]) < _SLOW * np.abs(velocity).max()
    velocity[first[slow]] = 0.0
    return velocity


def _mixing(problem: Problem, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return canonical parameters as constant + mixing @ what is fitted."""
    constant, mixing = np.zeros(len(CANONICAL)), np.zeros((len(CANONICAL), len(names)))
    known = problem.known
    constant[0] = known.inertia if known.inertia is not None else 0.0
    constant[1] = known.offset if known.offset is not None else 0.0
    for place, name in enumerate(names):
        if name == "stribeck_velocity":
            mixing[CANONICAL.index("log_stribeck_velocity"), place] = 1.0
        elif name in CANONICAL:
            mixing[CANONICAL.index(name), place] = 1.0
        else:
            for way in WAYS:
                mixing[CANONICAL.index(name + way), place] = 1.0
    return constant, mixing


def _bounds(
    problem: Problem, names: tuple[str, ...], start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return limits: nothing but the offset may push, and nothing weighs nothing."""
    low, high = np.zeros(len(names)), np.full(len(names), np.inf)
    shape_low, shape_high = problem.structure.bounds(problem.speed)
    for place, name in enumerate(names):
        if name == "offset":
            low[place] = -np.inf
        elif name == "inertia":
            low[place] = _SMALLEST_INERTIA * abs(start[place])
        elif name == "stribeck_velocity":
            low[place], high[place] = shape_low[0], shape_high[0]
    return low, high
