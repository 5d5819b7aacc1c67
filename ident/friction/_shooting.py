"""The output-error problem: a recording simulated, and its two solvers.

The residual is measured − simulated position. `by_optimistix` minimises its square by
`optimistix.LevenbergMarquardt`, limits kept by a transformation; `by_ipopt` by IPOPT, where
limits are constraints and inequalities may be added.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Literal, final

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from ...models import StribeckFriction
from ..core import least_squares_ipopt
from ._equation import Equation
from ._samples import DriveSamples
from ._simulate import Drive, Excitation, padded, travel
from ._structures import WAYS, Stribeck

Constraint = Literal["non-negative"]

CANONICAL = (
    "inertia",
    "offset",
    *("coulomb_positive", "coulomb_negative"),
    *("viscous_positive", "viscous_negative"),
    *("drop_positive", "drop_negative"),
    *("stribeck_velocity", "stribeck_shape"),
)
"""What every drive is made of, the last two as logarithms; shared, known or fitted."""
TOLERANCE, ROUGHLY = 3e-3, 0.1
"""Change of the residuals, relative to their size, at which a search ends.

The relative gain of cost is its square: 1e-5, and 1e-2 where only a start is sought.
"""
_STEPS = 80
_IPOPT_TOLERANCE, _IPOPT_STEPS = 1e-3, 50
"""IPOPT ends where the cost stands still by 1e-7 of itself, as kinks leave a gradient."""
_SLOW = 0.1
"""Share of the highest speed below which a piece of recording is taken to begin at rest."""
_INERTIA = 1e3
"""Largest factor between the inertia and that of the guess."""
_LEVEL = 10.0
"""Largest friction, as a multiple of the largest force of the recording."""
_INSIDE = 1e-4
"""Distance from its limits at which a parameter starts, as a share of their distance."""
_SPEEDS = 32
"""Speeds per direction at which an inequality on friction is kept."""


@final
class Shooting(eqx.Module):
    """The problem as arrays: lengths padded, room for all parameters whatever is fitted.

    So recordings and laws share compiled functions. Positions are in mm.

    Attributes:
        excitation: What drives the axis, window by window.
        target: Position at the end of each step, from that at the start of its window.
        compared: Steps whose end is compared.
        window: Of each step.
        constant: Parameters of `CANONICAL` where nothing is fitted.
        mixing: Their derivatives by what is fitted.
        low: Least values.
        high: Largest values.
        start: Values to start from, inside of these.
        scale: Size of a step of each.
        guess: Values that `root` is about.
        root: Root of the precision of the guess, in mm per unit of a value.
        fastest: Highest speed driven in mm/s.
    """

    excitation: Excitation
    target: Float[Array, " t"]
    compared: Bool[Array, " t"]
    window: Int[Array, " t"]
    constant: Float[Array, " 10"]
    mixing: Float[Array, "10 10"]
    low: Float[Array, " 10"]
    high: Float[Array, " 10"]
    start: Float[Array, " 10"]
    scale: Float[Array, " 10"]
    guess: Float[Array, " 10"]
    root: Float[Array, "10 10"]
    fastest: Float[Array, ""]

    def drive(self, values: Float[Array, " 10"]) -> Drive:
        """Return the drive that fitted values stand for."""
        full = self.constant + self.mixing @ values
        coulomb, viscous, drop = full[2:4], full[4:6], full[6:8]
        velocity, exponent = jnp.exp(full[8:])
        law = StribeckFriction(coulomb, coulomb + drop, velocity, exponent, viscous)
        return Drive(full[0], full[1], law)

    def bounded(self, free: Float[Array, " 10"]) -> Float[Array, " 10"]:
        """Return values within limits of numbers without; 0 is the start, with unit slope."""
        half, middle = 0.5 * (self.high - self.low), 0.5 * (self.high + self.low)
        place = (self.start - middle) / half
        rate = self.scale / (half * (1.0 - place**2))
        return middle + half * jnp.tanh(jnp.arctanh(place) + rate * free)

    def residual(
        self, values: Float[Array, " 10"], starts: Float[Array, "w 2"]
    ) -> Float[Array, " r"]:
        """Return measured − simulated positions, then how far the values are from the guess.

        Args:
            values: What is fitted.
            starts: What the start of each window adds to position and velocity as measured;
                empty where it adds nothing.
        """
        excitation, target = self.excitation, self.target
        if len(starts):
            place, velocity = starts[self.window].T
            target = target - place
            excitation = eqx.tree_at(
                lambda each: each.velocity, excitation, excitation.velocity + velocity
            )
        error = target - travel(self.drive(values), excitation)
        left = jnp.where(self.compared, error, 0.0)
        return jnp.concatenate([left, self.root @ (values - self.guess)])

    @property
    def start_scale(self) -> Float[Array, " 2"]:
        """Size of a step of the position and of the velocity at the start of a window."""
        speed = 1e-2 * self.fastest
        return jnp.stack([speed * self.excitation.step, speed])


@dataclasses.dataclass(frozen=True)
class Found:
    """Where a solver ended.

    Attributes:
        values: What was fitted.
        starts: What the start of each window adds, where that was fitted.
        residual: `Shooting.residual`.
        slopes: Its derivative by the values.
        start_slopes: By a common change of all initial velocities.
        steps: Of the solver.
        converged: Whether it says so.
    """

    values: Float[np.ndarray, " 10"]
    starts: Float[np.ndarray, "w 2"]
    residual: Float[np.ndarray, " r"]
    slopes: Float[np.ndarray, "r 10"]
    start_slopes: Float[np.ndarray, " r"]
    steps: int
    converged: bool

    @property
    def cost(self) -> float:
        """Half the sum of squares in mm²."""
        return 0.5 * float(self.residual @ self.residual)


@dataclasses.dataclass(frozen=True)
class Cut:
    """A recording in windows, step by step; a step leads from a sample to the next.

    Attributes:
        begins: Steps that a window begins with.
        window: Of each step.
        compared: Steps within one piece, of rows that count.
    """

    begins: Bool[np.ndarray, " t"]
    window: Int[np.ndarray, " t"]
    compared: Bool[np.ndarray, " t"]

    @property
    def windows(self) -> int:
        """How many windows there are."""
        return int(self.window[-1]) + 1


def cut_windows(
    samples: DriveSamples, windows: int, rows: Bool[np.ndarray, " t"] | None = None
) -> Cut:
    """Return a recording in windows; each piece, and each stretch of rows, begins anew.

    Args:
        samples: The recording.
        windows: How many of equal length, where no piece ends.
        rows: Samples that count; all where left out.
    """
    count = len(samples.time) - 1
    use = np.ones(count + 1, bool) if rows is None else rows
    begins = np.diff(np.arange(count) * windows // count, prepend=-1) > 0
    begins[1:] |= (np.diff(samples.piece[:-1]) > 0) | (use[1:-1] > use[:-2])
    compared = (samples.piece[1:] == samples.piece[:-1]) & use[1:] & use[:-1]
    return Cut(begins, np.cumsum(begins) - 1, compared)


def make_shooting(
    equation: Equation,
    cut: Cut,
    values: Float[np.ndarray, " p"],
    constraints: Sequence[Constraint],
) -> Shooting:
    """Return the output-error problem of a recording with positions.

    Args:
        equation: That of its forces, under a law that can be simulated.
        cut: Its windows.
        values: Of the guess: factors, then logarithms of the shape.
        constraints: Inequalities that will be kept.
    """
    samples = equation.samples
    assert samples.position is not None
    force = equation.known.gain * samples.current[:-1]
    first = np.flatnonzero(cut.begins)
    target = samples.position[1:] - samples.position[first][cut.window]
    return Shooting(
        excitation=Excitation(
            jnp.asarray(padded(force)),
            jnp.asarray(padded(cut.begins)),
            jnp.asarray(padded(_begun(samples)[:-1])),
            jnp.asarray(samples.cycle),
        ),
        target=jnp.asarray(padded(target)),
        compared=jnp.asarray(padded(cut.compared)),
        window=jnp.asarray(padded(cut.window)),
        root=jnp.zeros((len(CANONICAL), len(CANONICAL))),
        fastest=jnp.asarray(np.abs(samples.velocity).max()),
        **_parametrised(equation, values, float(np.abs(force).max()), constraints),
    )


def names_of(equation: Equation) -> tuple[str, ...]:
    """Return what is fitted: factors, then shape."""
    structure = equation.structure
    return (*equation.fixed_names, *structure.names, *structure.shapes)


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


def _parametrised(
    equation: Equation,
    values: Float[np.ndarray, " p"],
    largest: float,
    constraints: Sequence[Constraint],
) -> dict[str, Array]:
    """Return the parameters of a drive as functions of what is fitted, with limits.

    Nothing but the offset may push, and nothing weighs nothing.
    """
    size, structure, known = len(CANONICAL), equation.structure, equation.known
    constant, mixing = np.zeros(size), np.zeros((size, size))
    constant[0], constant[1] = known.inertia or 0.0, known.offset or 0.0
    if isinstance(structure, Stribeck) and structure.exponent is not None:
        constant[9] = np.log(structure.exponent)
    start, scale = np.zeros(size), np.ones(size)
    low, high = np.full(size, -1.0), np.ones(size)
    start[: len(values)] = values
    limits = iter(structure.bounds(equation.speed_range).T)
    fastest = float(equation.speed.max())
    for place, name in enumerate(names_of(equation)):
        ways = [name] if name in CANONICAL else [name + way for way in WAYS]
        mixing[[CANONICAL.index(each) for each in ways], place] = 1.0
        size_of = largest / (fastest if name.startswith("viscous") else 1.0)
        if name in structure.shapes:
            low[place], high[place] = next(limits)
        elif name == "inertia":
            low[place], high[place] = start[place] / _INERTIA, start[place] * _INERTIA
            scale[place] = start[place]
        else:
            signed = name == "offset" or "non-negative" in constraints
            high[place] = _LEVEL * size_of
            low[place] = -high[place] if signed else 0.0
            scale[place] = max(abs(start[place]), 1e-2 * size_of)
    inside = np.minimum(_INSIDE * (high - low), 0.1 * scale)
    arrays = {
        "constant": constant,
        "mixing": mixing,
        "low": low,
        "high": high,
        "start": np.clip(start, low + inside, high - inside),
        "scale": scale,
        "guess": start,
    }
    return {name: jnp.asarray(each) for name, each in arrays.items()}


def by_optimistix(
    shooting: Shooting, starts: Float[np.ndarray, "w 2"], tolerance: float
) -> Found:
    """Return where Levenberg and Marquardt's method ends.

    Args:
        shooting: The problem.
        starts: What starts of windows add at the beginning; empty where they are measured.
        tolerance: `TOLERANCE` or `ROUGHLY`.
    """
    given = jnp.asarray(starts), jnp.asarray(tolerance)
    values, ended, steps, converged = _levenberg_marquardt(shooting, *given)
    return _ended(shooting, values, ended, int(steps), bool(converged))


@eqx.filter_jit
def _levenberg_marquardt(
    shooting: Shooting, starts: Float[Array, "w 2"], tolerance: Float[Array, ""]
) -> tuple[Array, Array, Array, Array]:
    first = shooting.residual(shooting.start, starts)
    size = jnp.sqrt(jnp.mean(first**2))
    unit = jnp.where(jnp.isfinite(size) & (size > 0), size, 1.0)

    def parts(free: tuple[Array, Array], given: Shooting) -> tuple[Array, Array]:
        return given.bounded(free[0]), starts + free[1] * given.start_scale[None]

    def residual(free: tuple[Array, Array], given: Shooting) -> Array:
        return given.residual(*parts(free, given)) / unit

    # A traced tolerance: a rough search shares the compilation of a fine one.
    limit: Any = tolerance
    solver: Any = optx.LevenbergMarquardt(
        limit, limit, norm=optx.rms_norm, linear_solver=lx.QR()
    )
    still = (jnp.zeros_like(shooting.start), jnp.zeros_like(starts))
    found: Any = optx.least_squares(
        residual, solver, still, shooting, max_steps=_STEPS, throw=False
    )
    converged = jnp.asarray(found.result == optx.RESULTS.successful)
    return *parts(found.value, shooting), found.stats["num_steps"], converged


def by_ipopt(
    shooting: Shooting,
    starts: Float[np.ndarray, "w 2"],
    constraints: Sequence[Constraint],
) -> Found:
    """Return where IPOPT ends; arguments as of `by_optimistix` and `make_shooting`."""
    begin = np.asarray(shooting.start)
    # What nothing depends on is held.
    idle = ~np.asarray(shooting.mixing).any(axis=0)
    free = np.full(starts.size, np.inf)
    found = least_squares_ipopt(
        _residual,
        np.concatenate([begin, starts.ravel()]),
        shooting,
        lower=np.append(np.where(idle, begin, shooting.low), -free),
        upper=np.append(np.where(idle, begin, shooting.high), free),
        inequality=_levels if "non-negative" in constraints else None,
        tolerance=_IPOPT_TOLERANCE,
        max_steps=_IPOPT_STEPS,
    )
    values, ended = _parted(jnp.asarray(found.values))
    return _ended(shooting, values, ended, found.steps, found.converged)


def _parted(
    point: Float[Array, " x"],
) -> tuple[Float[Array, " 10"], Float[Array, "w 2"]]:
    return point[: len(CANONICAL)], point[len(CANONICAL) :].reshape(-1, 2)


def _residual(point: Float[Array, " x"], shooting: Shooting) -> Float[Array, " r"]:
    return shooting.residual(*_parted(point))


def _levels(point: Float[Array, " x"], shooting: Shooting) -> Float[Array, " g"]:
    """Return friction of both directions at speeds from rest to the highest one driven."""
    law = shooting.drive(_parted(point)[0]).law
    share = jnp.concatenate([jnp.zeros(1), jnp.geomspace(1e-4, 1.0, _SPEEDS - 1)])
    speed, ahead = shooting.fastest * share, jnp.ones(_SPEEDS)
    return jnp.concatenate([law.level(speed, ahead), law.level(speed, -ahead)])


def _ended(
    shooting: Shooting, values: Array, starts: Array, steps: int, converged: bool
) -> Found:
    residual, slopes, start_slopes = linearised(shooting, values, starts)
    return Found(
        values=np.asarray(values),
        starts=np.asarray(starts),
        residual=np.asarray(residual),
        slopes=np.asarray(slopes),
        start_slopes=np.asarray(start_slopes),
        steps=steps,
        converged=converged,
    )


@eqx.filter_jit
def linearised(
    shooting: Shooting, values: Float[Array, " 10"], starts: Float[Array, "w 2"]
) -> tuple[Float[Array, " r"], Float[Array, "r 10"], Float[Array, " r"]]:
    """Return the residual, its slopes by the values, and by all initial velocities at once."""

    def of(change: Float[Array, " 11"]) -> Array:
        moved: Shooting = eqx.tree_at(
            lambda each: each.excitation.velocity,
            shooting,
            shooting.excitation.velocity + change[-1],
        )
        found: Array = moved.residual(values + change[:-1], starts)
        return found

    still = jnp.zeros(len(values) + 1)
    residual, along = jax.linearize(of, still)
    slopes: Array = jax.vmap(along, out_axes=1)(jnp.eye(len(still)))
    return residual, slopes[:, :-1], slopes[:, -1]


@eqx.filter_jit
def start_cost(shooting: Shooting) -> Float[Array, ""]:
    """Return half the sum of squares at the start, windows begun as measured, in mm²."""
    residual = shooting.residual(shooting.start, jnp.zeros((0, 2)))
    return jnp.asarray(0.5 * jnp.vdot(residual, residual))
