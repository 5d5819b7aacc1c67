r"""An axis in motion: a mass with friction under a measured force, and its sensitivities.

$m\,\dot v = f - o - \mathrm{sign}(v)\,F(|v|)$ in semi-implicit steps: viscous friction acts at
the new velocity, dry friction against the old one until the axis stops; for what is left of the
step it sticks or sets off the other way. The path is continuous in every parameter.

The derivative is written by hand (`jax.custom_jvp`): all steps are linearised at once, and the
tangents follow a linear recursion, 25 times faster than differentiation through the loop.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, Literal, final

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, Bool, Float

from ...models import FrictionCompensation, StribeckFriction
from .._ipopt import VectorFunction, least_squares_ipopt
from ..core import filled
from ._samples import Trace

Solver = Literal["optimistix", "ipopt"]
Constraint = Literal["monotone", "non-negative"]

PARAMETERS = (
    "inertia",
    "offset",
    *("coulomb_positive", "coulomb_negative"),
    *("viscous_positive", "viscous_negative"),
    *("drop_positive", "drop_negative"),
    *("stribeck_velocity", "stribeck_shape"),
)
"""What every drive is made of, the last two as logarithms; shared, known or fitted."""
COUNT = len(PARAMETERS)
TOLERANCE, ROUGHLY = 3e-3, 0.1
"""Change of the residuals, relative to their size, at which a search ends; the gain of cost is
its square. Roughly: where only a start is sought."""
_IPOPT_TOLERANCE = 1e-3
"""IPOPT ends where the cost stands still by 1e-7 of itself, as kinks leave a gradient."""
_STEPS, _IPOPT_STEPS = 80, 300
_INSIDE = 1.0 - 1e-6
"""Farthest place of a start between its limits, which are at −1 and 1."""
_SPEEDS = 32
"""Speeds per direction at which an inequality on friction is kept."""
_SHORTEST = 16384
"""Steps that every compiled simulation has room for."""
_TINY = 1e-300
LOOKAHEADS = 5
"""How many look-aheads the controller has: 0 to 4 cycles."""
_ANY_LAW = StribeckFriction(*np.ones(5))

Numbers = Float[Array, " 10"]
"""`PARAMETERS`, or what is fitted of them."""
Steps = Float[Array, " t"]
"""A number for each time step."""


@final
class Drive(eqx.Module):
    """An axis under a force: what is fitted.

    Attributes:
        inertia: Force per mm/s² of acceleration, positive.
        offset: Constant load in force units.
        law: Friction; `StribeckFriction.viscous` must not be so negative that it turns the
            inertia of a step round.
    """

    inertia: Float[Array, ""]
    offset: Float[Array, ""]
    law: StribeckFriction


@final
class Excitation(eqx.Module):
    """What drives the axis, time step by time step.

    Attributes:
        force: Held over each step, in force units.
        begins: Whether the axis is set down anew before the step.
        velocity: With which it is set down there, in mm/s; elsewhere without meaning.
        step: Length of the steps in s.
    """

    force: Steps
    begins: Bool[Array, " t"]
    velocity: Steps
    step: Float[Array, ""]


def padded(values: np.ndarray) -> np.ndarray:
    """Return values with zeros (or False) behind, up to a power of two and at least 16 384."""
    length = max(_SHORTEST, 1 << (len(values) - 1).bit_length())
    return np.concatenate([values, np.zeros(length - len(values), values.dtype)])


@jax.custom_jvp
def travel(drive: Drive, excitation: Excitation) -> Steps:
    """Return how far the axis is at the end of each step from where it was set down, in mm.

    Differentiable (forward) with respect to the drive, the forces and the velocities.
    """
    return _way(*_velocities(drive, excitation), excitation)


@travel.defjvp
def _travel_jvp(
    primals: tuple[Drive, Excitation], tangents: tuple[Drive, Excitation]
) -> tuple[Steps, Steps]:
    drive, excitation = primals
    half, begins = 0.5 * excitation.step, excitation.begins
    first, second = _velocities(drive, excitation)

    def linearised(old: Array) -> tuple[Array, Array]:
        """Return the slope of the new velocity by the old one, and its other change."""
        force, ones = excitation.force, jnp.ones_like(old)
        _, slope = jax.jvp(lambda v: _half_step(drive, v, force, half), (old,), (ones,))
        given, moved = (drive, force), (tangents[0], tangents[1].force)
        _, change = jax.jvp(lambda d, f: _half_step(d, old, f, half), given, moved)
        return slope, change

    def follow(velocity: Array, inputs: tuple[Array, ...]) -> tuple[Array, Array]:
        begins, set_down, slope, change = inputs
        velocity = slope * jnp.where(begins, set_down, velocity) + change
        return velocity, velocity

    before = jnp.where(begins, excitation.velocity, jnp.roll(second, 1))
    slope, change = linearised(before)
    next_slope, next_change = linearised(first)
    set_down = tangents[1].velocity
    steps = (begins, set_down, slope * next_slope, next_slope * change + next_change)
    ends = lax.scan(follow, jnp.zeros(()), steps)[1]
    middles = slope * jnp.where(begins, set_down, jnp.roll(ends, 1)) + change
    return _way(first, second, excitation), _way(middles, ends, excitation)


def _velocities(drive: Drive, excitation: Excitation) -> tuple[Steps, Steps]:
    """Return the velocities at the middle and the end of each step."""
    half = 0.5 * excitation.step

    def advance(
        velocity: Array, inputs: tuple[Array, Array, Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        force, begins, set_down = inputs
        velocity = jnp.where(begins, set_down, velocity)
        first = _half_step(drive, velocity, force, half)
        second = _half_step(drive, first, force, half)
        return second, (first, second)

    # A law takes arrays: a step is one of a single element.
    columns = excitation.force, excitation.begins, excitation.velocity
    steps = jax.tree.map(lambda column: column[:, None], columns)
    first, second = lax.scan(advance, jnp.zeros(1), steps)[1]
    return first[:, 0], second[:, 0]


def _way(middle: Steps, end: Steps, excitation: Excitation) -> Steps:
    """Return the way since each run began, by velocities at the middle and end of steps."""
    way = jnp.cumsum(0.5 * excitation.step * (middle + end))
    number = jnp.arange(len(way))
    run = lax.cummax(jnp.where(excitation.begins, number, 0))
    return way - jnp.where(run > 0, way[run - 1], 0.0)


def _half_step(
    drive: Drive, before: Steps, force: Steps, half: Float[Array, ""]
) -> Steps:
    """Return the velocities after half a time step each."""
    law = drive.law
    dry = eqx.tree_at(lambda law: law.viscous, law, jnp.zeros(()))
    viscous = jnp.broadcast_to(law.viscous, (2,))
    gain, push = half / drive.inertia, force - drive.offset
    forward = jnp.where(before == 0, push, before) > 0
    sign = jnp.where(forward, 1.0, -1.0)
    rate = sign * push - dry.level(jnp.abs(before), sign)
    # Speed in the old direction at the end, were friction to go on in its direction.
    speed = sign * before + gain * rate
    goes_on = speed > 0
    onward = speed / (1.0 + gain * jnp.where(forward, viscous[0], viscous[1]))
    # Stopped on the way: the rest of the time is left for the other direction.
    time = speed / jnp.where(goes_on, -1.0, jnp.minimum(rate, -_TINY))
    back_rate = -sign * push - dry.level(jnp.zeros_like(before), -sign)
    back = time * back_rate / (1.0 + time * jnp.where(forward, viscous[1], viscous[0]))
    turned = jnp.where(back_rate > 0, -back, 0.0)
    return sign * jnp.where(goes_on, onward, turned)


@final
class Problem(eqx.Module):
    """The problem as arrays: lengths padded, room for all parameters whatever is fitted.

    So recordings and laws share compiled functions. Positions are in mm.

    Attributes:
        excitation: What drives the axis, run by run.
        target: Position at the end of each step, from that at the start of its run.
        compared: Steps whose end is compared.
        constant: The parameters where nothing is fitted.
        mixing: Their derivatives by what is fitted.
        limits: Least and largest values.
        guess: Values that `root` is about.
        root: Root of the precision of the guess, in mm per unit of a value.
        fastest: Highest speed driven in mm/s.
    """

    excitation: Excitation
    target: Steps
    compared: Bool[Array, " t"]
    constant: Numbers
    mixing: Float[Array, "10 10"]
    limits: tuple[Numbers, Numbers]
    guess: Numbers
    root: Float[Array, "10 10"]
    fastest: Float[Array, ""]

    def drive(self, values: Numbers) -> Drive:
        """Return the drive that fitted values stand for."""
        full = self.constant + self.mixing @ values
        coulomb, viscous, drop = full[2:4], full[4:6], full[6:8]
        velocity, exponent = jnp.exp(full[8:])
        law = StribeckFriction(coulomb, coulomb + drop, velocity, exponent, viscous)
        return Drive(full[0], full[1], law)


def _residual(values: Numbers, problem: Problem) -> Float[Array, " r"]:
    """Return measured − simulated positions, then how far the values are from the guess."""
    error = problem.target - travel(problem.drive(values), problem.excitation)
    residual = jnp.where(problem.compared, error, 0.0)
    return jnp.concatenate([residual, problem.root @ (values - problem.guess)])


@lru_cache
def _inequality(constraints: tuple[Constraint, ...]) -> VectorFunction | None:
    """Return what constraints keep at or above zero; the same function for the same ones."""

    def margins(values: Numbers, problem: Problem) -> Float[Array, " g"]:
        """Of friction in both directions, from rest to the highest speed driven."""
        share = jnp.concatenate([jnp.zeros(1), jnp.geomspace(1e-4, 1.0, _SPEEDS - 1)])
        speed, level = problem.fastest * share, problem.drive(values).law.level
        levels = jnp.stack([level(speed, way * jnp.ones(_SPEEDS)) for way in (1, -1)])
        kinds = {"monotone": jnp.diff(levels).ravel(), "non-negative": levels.ravel()}
        return jnp.concatenate([kinds[word] for word in constraints])

    return margins if constraints else None


residual_of = eqx.filter_jit(_residual)


@eqx.filter_jit
def linearised(
    values: Numbers, problem: Problem
) -> tuple[Float[Array, " r"], Float[Array, "r 10"]]:
    """Return the residual and its derivatives."""
    residual, along = jax.linearize(lambda x: _residual(x, problem), values)
    return residual, jax.vmap(along, out_axes=1)(jnp.eye(COUNT))


@eqx.filter_jit
def _levenberg_marquardt(
    start: Numbers, problem: Problem, tolerance: Float[Array, ""]
) -> tuple[Numbers, Bool[Array, ""]]:
    """Return values, and whether they converged.

    Values stay inside their limits by tanh; steps of one change the residual by its size.
    """
    low, high = problem.limits
    half = 0.5 * (high - low)
    place = jnp.clip((start - low) / half - 1.0, -_INSIDE, _INSIDE)
    first, slopes = linearised(low + half * (1.0 + place), problem)
    length, norms = jnp.linalg.norm(first), jnp.linalg.norm(slopes, axis=0)
    unit = jnp.where(norms > 0.0, length / jnp.where(norms > 0.0, norms, 1.0), half)
    step = jnp.minimum(unit, 2.0 * half) / (half * (1.0 - place**2))
    scale: Float[Array, ""] = jnp.sqrt(jnp.sum(problem.compared)) / length

    def values(free: Numbers) -> Numbers:
        return low + half * (1.0 + jnp.tanh(jnp.arctanh(place) + step * free))

    def residual(free: Numbers, problem: Problem) -> Float[Array, " r"]:
        return _residual(values(free), problem) * scale

    # A traced tolerance: a rough search shares the compilation of a fine one.
    limit: Any = tolerance
    solver: Any = optx.LevenbergMarquardt(
        limit, limit, norm=optx.rms_norm, linear_solver=lx.QR()
    )
    optimum: Any = optx.least_squares(
        residual, solver, jnp.zeros_like(start), problem, max_steps=_STEPS, throw=False
    )
    converged = jnp.asarray(optimum.result == optx.RESULTS.successful)
    return values(optimum.value), converged


def solve(
    problem: Problem,
    start: Float[np.ndarray, " 10"],
    tolerance: float,
    solver: Solver = "optimistix",
    constraints: Sequence[Constraint] = (),
) -> tuple[Float[np.ndarray, " 10"], bool]:
    """Return where a solver ends, and whether it converged.

    Only IPOPT keeps constraints; optimistix has the tolerance `TOLERANCE` or `ROUGHLY`.
    """
    if solver == "ipopt":
        low, high = (np.asarray(array) for array in problem.limits)
        optimum = least_squares_ipopt(
            _residual,
            start,
            problem,
            lower=low,
            upper=high,
            inequality=_inequality(tuple(constraints)),
            tolerance=_IPOPT_TOLERANCE,
            max_steps=_IPOPT_STEPS,
        )
        return optimum.values, optimum.converged
    arguments = jnp.asarray(start), problem, jnp.asarray(tolerance)
    values, converged = _levenberg_marquardt(*arguments)
    return np.asarray(values), bool(converged)


@jax.jit
def _shares(
    position: Steps, velocity: Steps, distance: Float[Array, ""]
) -> Float[Array, "l t"]:
    # Only its rules for the change of direction matter, not its law.
    models = [FrictionCompensation(_ANY_LAW, n, distance) for n in range(LOOKAHEADS)]
    shares = [model.shares(model.start(), position, velocity)[0] for model in models]
    return jnp.abs(jnp.stack(shares))


def share_of(
    position: Trace, velocity: Trace
) -> Callable[[float], Float[np.ndarray, "l t"]]:
    """Return how much of the friction a controller gives by the distance after reversals.

    A row per look-ahead and an entry per cycle (`FrictionCompensation.shares`).
    """
    # It stands still behind the end.
    motion = jnp.asarray(filled(position, _SHORTEST)), jnp.asarray(padded(velocity))

    @lru_cache(maxsize=64)
    def share(distance: float) -> Float[np.ndarray, "l t"]:
        shares = _shares(*motion, jnp.asarray(distance))
        return np.asarray(shares)[:, : len(position)]

    return share
