"""The output-error problem through CasADi and IPOPT: the same simulation, limits as constraints."""

import dataclasses
from collections.abc import Mapping
from typing import Any, final

import casadi as ca
import numpy as np
from jaxtyping import Float

from ._axis import CANONICAL, SUBSTEPS
from ._shooting import AbstractSolver, Shooting, Shot

_OPTIONS = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    # Limits hold exactly: a start on one must not be pushed away from it.
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.mu_strategy": "adaptive",
}


def _after(given: Mapping[str, Any], old: Any, force: Any, small: float) -> Any:
    """Return the velocity after one substep; see `_axis._after` for the rule."""
    gain, push = small / given["inertia"], force - given["offset"]
    ahead = ca.if_else(old == 0, push, old) > 0
    sign = ca.if_else(ahead, 1.0, -1.0)

    def side(name: str, here: Any) -> Any:
        return ca.if_else(here, given[name + "_positive"], given[name + "_negative"])

    decay = ca.exp(-((old * ca.exp(-given["log_stribeck_velocity"])) ** 2))
    rate = sign * push - side("coulomb", ahead) - side("drop", ahead) * decay
    speed = sign * old + gain * rate
    goes_on = speed > 0
    onward = speed / (1.0 + gain * side("viscous", ahead))
    # Both branches are evaluated: what is not meant must stay finite.
    left = ca.if_else(
        goes_on, 0.0, speed / ca.if_else(goes_on, -1.0, ca.fmin(rate, -1e-300))
    )
    rate_back = -sign * push - side("coulomb", 1 - ahead) - side("drop", 1 - ahead)
    back = left * rate_back / (1.0 + left * side("viscous", 1 - ahead))
    turned = ca.if_else(rate_back > 0, -back, 0.0)
    return sign * ca.if_else(goes_on, onward, turned)


def _step_function(shooting: Shooting) -> Any:
    """Return one sample's step: way, velocity and their derivatives, window by window."""
    count = len(shooting.names)
    width = count + 1
    state = ca.SX.sym("state", 2 + 2 * width)
    values = ca.SX.sym("values", count)
    force, first, begin = ca.SX.sym("force"), ca.SX.sym("first"), ca.SX.sym("begin")
    canonical = ca.DM(shooting.constant) + ca.DM(shooting.mixing) @ values
    given: dict[str, Any] = dict(zip(CANONICAL, ca.vertsplit(canonical), strict=True))
    small = shooting.step / SUBSTEPS

    way = ca.if_else(first, 0.0, state[0])
    velocity = ca.if_else(first, begin, state[1])
    way_slopes = ca.if_else(first, 0.0, state[2 : 2 + width])
    last = ca.DM([0.0] * count + [1.0])
    slopes = ca.if_else(first, last, state[2 + width :])
    for _ in range(SUBSTEPS):
        old = ca.SX.sym("old")
        new = _after(given, old, force, small)
        by_old = ca.substitute(ca.jacobian(new, old), old, velocity)
        by_values = ca.substitute(ca.jacobian(new, values), old, velocity).T
        slopes = by_old * slopes + ca.vertcat(by_values, 0.0)
        velocity = ca.substitute(new, old, velocity)
        way = way + small * velocity
        way_slopes = way_slopes + small * slopes
    after = ca.vertcat(way, velocity, way_slopes, slopes)
    return ca.Function("step", [state, force, first, begin, values], [after])


@dataclasses.dataclass(frozen=True)
class _Programme:
    """The problem in scaled variables: parameters, then starts of windows where free."""

    shooting: Shooting
    scale: Float[np.ndarray, " x"]
    start: Float[np.ndarray, " x"]
    low: Float[np.ndarray, " x"]
    high: Float[np.ndarray, " x"]
    evaluate: Any
    """x → cost, gradient, Gauss-Newton matrix, residual, slopes."""


def _programme(shooting: Shooting) -> _Programme:
    count, windows = len(shooting.names), shooting.windows
    start, low, high = shooting.start, shooting.low, shooting.high
    if shooting.free_start:
        begun = np.concatenate([shooting.position, shooting.velocity])
        free = np.full(len(begun), np.inf)
        start = np.concatenate([start, begun])
        low, high = np.concatenate([low, -free]), np.concatenate([high, free])
    # IPOPT takes every variable for one of size 1.
    scale = np.where(np.abs(start) > 0, np.abs(start), 1.0)
    scaled = ca.MX.sym("scaled", len(start))
    point = scaled * ca.DM(scale)
    values = point[:count]
    position, velocity = ca.MX(shooting.position), ca.MX(shooting.velocity)
    if shooting.free_start:
        position, velocity = point[count : count + windows], point[count + windows :]
    steps, width = len(shooting.force), count + 1
    index = [int(each) for each in shooting.window]
    run = _step_function(shooting).mapaccum("run", steps)
    states = run(
        ca.DM.zeros(2 + 2 * width),
        ca.DM(shooting.force).T,
        ca.DM(shooting.first.astype(float)).T,
        ca.reshape(velocity[index], 1, steps),
        ca.repmat(values, 1, steps),
    )
    use = ca.DM(shooting.compared.astype(float))
    travel = ca.reshape(position[index], steps, 1) + states[0, :].T
    residual = use * (ca.DM(shooting.target) - travel)
    slopes = ca.repmat(use, 1, width) * states[2 : 2 + width, :].T
    full = slopes[:, :count]
    off = values - ca.DM(shooting.centre)
    pull = ca.DM(shooting.belief) @ off
    size = len(start)
    believed = ca.DM(size, size)
    believed[:count, :count] = ca.DM(shooting.belief)
    if shooting.free_start:
        member = ca.DM.triplet(
            list(range(steps)), index, ca.DM.ones(steps), steps, windows
        )
        by_velocity = ca.diag(slopes[:, count]) @ ca.MX(member)
        full = ca.horzcat(full, ca.diag(ca.MX(use)) @ ca.MX(member), by_velocity)
        pull = ca.vertcat(pull, ca.DM.zeros(2 * windows))
    cost = 0.5 * (ca.dot(residual, residual) + ca.dot(off, pull[:count]))
    gradient = (pull - full.T @ residual) * ca.DM(scale)
    spread = ca.diag(ca.DM(scale))
    matrix = ca.densify(spread @ (full.T @ full + believed) @ spread)
    evaluate = ca.Function(
        "evaluate",
        [scaled],
        [cost, ca.densify(gradient), matrix, residual, slopes],
    )
    return _Programme(shooting, scale, start, low, high, evaluate)


@final
@dataclasses.dataclass(frozen=True)
class Ipopt(AbstractSolver):
    """Interior point with Gauss-Newton curvature; limits are constraints of the programme.

    Attributes:
        tolerance: Relative change of the cost that counts as none, several times in a row.
        max_passes: Iterations at most.
    """

    tolerance: float = 1e-6
    max_passes: int = 200

    @property
    def words(self) -> str:
        """Name for reports."""
        return "IPOPT"

    def solve(self, shooting: Shooting) -> Shot:
        """See `AbstractSolver`."""
        programme = _programme(shooting)
        size = len(programme.start)
        x, p = ca.MX.sym("x", size), ca.MX.sym("p", 0)
        weight, none = ca.MX.sym("weight"), ca.MX.sym("none", 0)
        begin = programme.start / programme.scale
        first_cost = float(programme.evaluate(begin)[0])
        # The size of the cost must not decide when IPOPT is content.
        unit = max(first_cost, 1e-300)
        cost, gradient, matrix, _, _ = programme.evaluate(x)
        gradients = ca.Function("nlp_grad_f", [x, p], [cost / unit, gradient / unit])
        curvature = ca.Function(
            "nlp_hess_l", [x, p, weight, none], [ca.triu(weight * matrix / unit)]
        )
        options: dict[str, Any] = {
            **_OPTIONS,
            "ipopt.max_iter": self.max_passes,
            "ipopt.acceptable_iter": 3,
            "ipopt.acceptable_tol": 1e6,
            "ipopt.acceptable_obj_change_tol": self.tolerance,
            "grad_f": gradients,
            "hess_lag": curvature,
        }
        problem: dict[str, Any] = {"x": x, "p": p, "f": cost / unit}
        solver = ca.nlpsol("solver", "ipopt", problem, options)
        found = solver(
            x0=begin,
            lbx=programme.low / programme.scale,
            ubx=programme.high / programme.scale,
        )
        stats = solver.stats()
        point = np.asarray(found["x"]).ravel()
        cost, _, _, residual, slopes = programme.evaluate(point)
        count, windows = len(shooting.names), shooting.windows
        ended = point * programme.scale
        position, velocity = shooting.position, shooting.velocity
        if shooting.free_start:
            position, velocity = (
                ended[count : count + windows],
                ended[count + windows :],
            )
        return Shot(
            ended[:count],
            position,
            velocity,
            float(cost),
            first_cost,
            np.asarray(residual).ravel(),
            np.asarray(slopes)[:, :count],
            np.asarray(slopes)[:, count],
            int(stats["iter_count"]),
            bool(stats["success"]),
        )
