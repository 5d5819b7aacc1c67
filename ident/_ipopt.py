"""Least squares by CasADi and IPOPT: limits and inequalities as constraints.

The second solver of the library beside optimistix, and the only one that takes
inequalities. The residual is a JAX function; IPOPT sees cost, gradient and Gauss-Newton
matrix of it through callbacks on the host.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Literal, final

import casadi as ca
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

VectorFunction = Callable[[Float[Array, " x"], Any], Float[Array, " r"]]
"""``function(values, args)``, traced by JAX: a residual, or inequalities."""

_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "show_eval_warnings": False,
    "no_nlp_grad": True,  # it would differentiate the callbacks
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    # Limits hold exactly: a start on one must not be pushed over it.
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.honor_original_bounds": "yes",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.nlp_scaling_method": "none",  # the problem is scaled here
}


IpoptStatus = Literal[
    "converged", "acceptable", "max_steps", "infeasible", "not_finite", "failed"
]
"""How a solve ended; acceptable: the cost stands still above the tolerance."""

_STATUS: dict[str, IpoptStatus] = {
    "Solve_Succeeded": "converged",
    "Solved_To_Acceptable_Level": "acceptable",
    "Search_Direction_Becomes_Too_Small": "acceptable",
    "Feasible_Point_Found": "acceptable",
    "Maximum_Iterations_Exceeded": "max_steps",
    "Infeasible_Problem_Detected": "infeasible",
    "Invalid_Number_Detected": "not_finite",
}


@final
@dataclasses.dataclass(frozen=True)
class IpoptSolution:
    """What IPOPT returns.

    Attributes:
        values: The solution, inside its limits.
        steps: Iterations taken.
        status: How the solve ended.
    """

    values: Float[np.ndarray, " x"]
    steps: int
    status: IpoptStatus

    @property
    def converged(self) -> bool:
        """Whether the solve ended at a solution."""
        return self.status in ("converged", "acceptable")


# The function is static: it compiles once, whatever its arguments.
@eqx.filter_jit
def _linearised(
    function: VectorFunction, values: Float[Array, " x"], args: Any
) -> tuple[Float[Array, " r"], Float[Array, "r x"]]:
    return function(values, args), jax.jacfwd(function)(values, args)


@eqx.filter_jit
def _curvature(
    function: VectorFunction,
    values: Float[Array, " x"],
    args: Any,
    dual: Float[Array, " g"],
) -> Float[Array, "x x"]:
    """Return the second derivative of ``dual @ function``."""

    def weighted(x: Float[Array, " x"]) -> Float[Array, ""]:
        return jnp.dot(dual, function(x, args))

    curvature: Float[Array, "x x"] = jax.jacfwd(jax.grad(weighted))(values)
    return curvature


@dataclasses.dataclass
class _Problem:
    """The problem in variables of size one, ``values = unit * x``, with a cost of one."""

    residual: VectorFunction
    inequality: VectorFunction | None
    args: Any
    unit: Float[np.ndarray, " x"]
    cost_unit: float = 1.0
    size: Float[np.ndarray, " g"] | float = 1.0
    """Unit of each inequality."""
    at: bytes = b""

    def look(self, x: Float[np.ndarray, " x"]) -> None:
        """Evaluate everything at x, unless it was the last point that was evaluated."""
        if x.tobytes() == self.at:
            return
        values = jnp.asarray(self.unit * x)
        found = _linearised(self.residual, values, self.args)
        self.r, self.jacobian = map(np.asarray, found)
        self.g, self.slopes = np.zeros(0), np.zeros((0, len(x)))
        if self.inequality is not None:
            found = _linearised(self.inequality, values, self.args)
            self.g, self.slopes = map(np.asarray, found)
        self.cost = 0.5 * float(self.r @ self.r)
        parts = (self.r, self.jacobian, self.g, self.slopes)
        self.finite = all(bool(np.isfinite(each).all()) for each in parts)
        self.at = x.tobytes()

    def scale(
        self, start: Float[np.ndarray, " x"], width: Float[np.ndarray, " x"]
    ) -> None:
        """Take units in which a step of one changes the residual by its size at the start."""
        norms = np.linalg.norm(self.jacobian, axis=0)
        natural = np.where(start != 0, np.abs(start), 1.0)
        length = (2.0 * self.cost) ** 0.5 or 1.0
        unit = np.where(norms > 0, length / np.where(norms > 0, norms, 1.0), natural)
        self.unit = np.minimum(unit, np.where(width > 0, width, np.inf))
        self.cost_unit, self.at = self.cost or 1.0, b""
        rows = np.linalg.norm(self.slopes * self.unit, axis=1)
        self.size = np.where(rows > 0, rows, 1.0)

    def evaluate(self, x: Float[np.ndarray, " x"]) -> list[Any]:
        """Return cost, gradient, Gauss-Newton matrix, inequalities and their slopes."""
        self.look(x)
        scaled, cost = self.jacobian * self.unit, self.cost_unit
        slopes = (self.slopes * self.unit).T / self.size
        gradient, matrix = scaled.T @ self.r / cost, scaled.T @ scaled / cost
        return [self.cost / cost, gradient, matrix, self.g / self.size, slopes.T]

    def bend(
        self, x: Float[np.ndarray, " x"], dual: Float[np.ndarray, " g"]
    ) -> list[Any]:
        """Return the curvature of the inequalities, weighted by their multipliers."""
        bend = np.zeros((len(x), len(x)))
        if self.inequality is not None and np.any(dual):
            at, weights = jnp.asarray(self.unit * x), jnp.asarray(dual / self.size)
            bend = np.asarray(_curvature(self.inequality, at, self.args, weights))
        return [bend * np.outer(self.unit, self.unit)]


class _Callback(ca.Callback):
    """A function on the host as CasADi calls it; what it raises is kept for the caller."""

    def __init__(
        self,
        name: str,
        function: Callable[..., list[Any]],
        takes: Sequence[int],
        gives: Sequence[tuple[int, int]],
    ) -> None:
        super().__init__()
        self._function, self._takes, self._gives = function, takes, gives
        self.raised: BaseException | None = None
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._takes)

    def get_n_out(self) -> int:
        return len(self._gives)

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._takes[i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._gives[i])

    def eval(self, arguments: Any) -> Any:
        try:
            found = self._function(*(np.asarray(each).ravel() for each in arguments))
            return [ca.DM(np.asarray(each)) for each in found]
        except BaseException as error:  # CasADi would print it and go on
            self.raised = error
            return [ca.DM.ones(*shape) * np.nan for shape in self._gives]


def least_squares_ipopt(
    residual: VectorFunction,
    start: Float[np.ndarray, " x"],
    args: Any = None,
    *,
    lower: Float[np.ndarray, " x"] | float = -np.inf,
    upper: Float[np.ndarray, " x"] | float = np.inf,
    inequality: VectorFunction | None = None,
    tolerance: float = 1e-10,
    max_steps: int = 500,
) -> IpoptSolution:
    r"""Minimise $\frac12 |r(x)|^2$ subject to limits and $g(x) \ge 0$, by IPOPT.

    Curvature is that of Gauss and Newton, with the exact one of the inequalities.

    Args:
        residual: ``residual(values, args)``, a JAX function. It compiles once per function
            and shape: pass data by `args`, not by a closure.
        start: Where the search begins; it is moved inside the limits.
        args: Whatever residual and inequality need; its arrays are traced.
        lower: Least values; −∞ where there is none.
        upper: Largest values.
        inequality: ``inequality(values, args)``, a JAX function kept at or above zero.
        tolerance: Largest scaled gradient, violation and complementarity at a solution,
            where the cost begins at one and a unit step changes the residual by its size.
        max_steps: Iterations at most.

    Raises:
        ValueError: If a lower limit lies above its upper one.
        Exception: Whatever residual or inequality raise. A failed solve is a value:
            `IpoptSolution.status`.
    """
    count = len(start)
    lower = np.broadcast_to(np.asarray(lower, np.float64), (count,))
    upper = np.broadcast_to(np.asarray(upper, np.float64), (count,))
    if np.any(lower > upper):
        at = int(np.argmax(lower > upper))
        msg = f"the lower limit {lower[at]} of value {at} lies above its upper one {upper[at]}"
        raise ValueError(msg)
    start = np.clip(np.asarray(start, np.float64), lower, upper)
    problem = _Problem(residual, inequality, args, np.ones(count))
    problem.look(start)
    if not problem.finite:
        return IpoptSolution(start, 0, "not_finite")
    problem.scale(start, upper - lower)
    rows = len(problem.g)
    shapes = [(1, 1), (count, 1), (count, count), (rows, 1), (rows, count)]
    evaluate = _Callback("evaluate", problem.evaluate, [count], shapes)
    bend = _Callback("bend", problem.bend, [count, rows], [(count, count)])
    x, p = ca.MX.sym("x", count), ca.MX.sym("p", 0)
    share, dual = ca.MX.sym("share"), ca.MX.sym("dual", rows)
    cost, gradient, matrix, g, slopes = evaluate(x)
    curvature = share * matrix + (bend(x, dual) if rows else 0.0)
    options = _OPTIONS | {
        "grad_f": ca.Function("grad_f", [x, p], [cost, gradient]),
        "jac_g": ca.Function("jac_g", [x, p], [g, slopes]),
        "hess_lag": ca.Function("hess_lag", [x, p, share, dual], [ca.triu(curvature)]),
        "ipopt.tol": tolerance,
        "ipopt.max_iter": max_steps,
        "ipopt.acceptable_iter": 3,
        "ipopt.acceptable_tol": 1e4 * tolerance,
        "ipopt.acceptable_obj_change_tol": 1e-4 * tolerance,
    }
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "p": p, "f": cost, "g": g}, options)
    limits = {"lbx": lower / problem.unit, "ubx": upper / problem.unit}
    found = solver(x0=start / problem.unit, lbg=0.0, ubg=np.inf, **limits)
    for callback in (evaluate, bend):
        if callback.raised is not None:
            raise callback.raised
    stats = solver.stats()
    values = np.clip(np.asarray(found["x"]).ravel() * problem.unit, lower, upper)
    status = _STATUS.get(stats["return_status"], "failed")
    return IpoptSolution(values, int(stats["iter_count"]), status)
