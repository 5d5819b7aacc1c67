"""Least squares by CasADi and IPOPT: limits and inequalities as constraints.

The second solver of the library beside optimistix, and the only one that takes
inequalities. The residual is a JAX function; IPOPT sees cost, gradient and Gauss-Newton
matrix of it through callbacks on the host.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, final

import casadi as ca
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float

from .core import FitError

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


Units = tuple[Any, float, Any]
"""Of the values, of the cost and of each inequality: in these IPOPT sees the problem."""


def one_vector(inequalities: Any) -> Float[Array, " g"]:
    """Return what is kept at or above zero, an array or a tree of them, as one vector.

    Raises:
        FitError: If it holds truth values, which are never below zero, or no numbers.
    """
    leaves = [jnp.asarray(each) for each in jax.tree.leaves(inequalities)]
    if wrong := [each.dtype for each in leaves if each.dtype.kind not in "iuf"]:
        found = "truth values" if wrong[0].kind == "b" else str(wrong[0])
        msg = (
            f"constraints: found {found}, expected numbers that are kept at or above "
            "zero: 1.5 - m.slope for m.slope <= 1.5"
        )
        raise FitError(msg)
    return jnp.concatenate([jnp.zeros(0), *map(jnp.ravel, leaves)])


def _no_margins(values: Float[Array, " x"], args: Any) -> Float[Array, " g"]:
    """Return nothing to be kept above zero."""
    return jnp.zeros(0)


# The functions are static: it compiles once, whatever their arguments.
@eqx.filter_jit
def _evaluated(
    residual: VectorFunction,
    inequality: VectorFunction,
    args: Any,
    units: Units,
    x: Float[Array, " x"],
) -> tuple[Array, ...]:
    """Return cost, gradient, Gauss-Newton matrix, inequalities and their slopes."""
    unit, cost, size = units

    def off(x: Float[Array, " x"]) -> Float[Array, " r"]:
        scaled: Float[Array, " r"] = residual(unit * x, args) / cost**0.5
        return scaled

    def margins(x: Float[Array, " x"]) -> Float[Array, " g"]:
        scaled: Float[Array, " g"] = inequality(unit * x, args) / size
        return scaled

    r, design = off(x), jax.jacfwd(off)(x)
    return (
        0.5 * r @ r,
        design.T @ r,
        design.T @ design,
        margins(x),
        jax.jacfwd(margins)(x),
    )


@eqx.filter_jit
def _curvature(
    inequality: VectorFunction,
    args: Any,
    units: Units,
    x: Float[Array, " x"],
    dual: Float[Array, " g"],
) -> tuple[Float[Array, "x x"]]:
    """Return the second derivative of the inequalities, weighted by their multipliers."""
    unit, _, size = units

    def weighted(x: Float[Array, " x"]) -> Float[Array, ""]:
        return jnp.dot(dual / size, inequality(unit * x, args))

    return (jax.jacfwd(jax.grad(weighted))(x),)


class _Callback(ca.Callback):
    """A function on the host as CasADi calls it, once for each new argument.

    What it raises is kept for the caller.
    """

    def __init__(
        self,
        name: str,
        function: Callable[..., Sequence[Any]],
        takes: Sequence[int],
        gives: Sequence[tuple[int, int]],
    ) -> None:
        super().__init__()
        self._function, self._takes, self._gives = function, takes, gives
        self._last: tuple[bytes, list[ca.DM]] = b"", []
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
            given = [jnp.ravel(np.asarray(each)) for each in arguments]
            at = b"".join(each.tobytes() for each in given)
            if at != self._last[0]:
                found = self._function(*given)
                self._last = at, [ca.DM(np.asarray(each)) for each in found]
            return self._last[1]
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
        FitError: If a lower limit lies above its upper one.
        Exception: Whatever residual or inequality raise. A failed solve is a value:
            `IpoptSolution.status`.
    """
    count = len(start)
    lower = np.broadcast_to(np.asarray(lower, np.float64), (count,))
    upper = np.broadcast_to(np.asarray(upper, np.float64), (count,))
    if np.any(lower > upper):
        at = int(np.argmax(lower > upper))
        msg = f"the lower limit {lower[at]} of value {at} lies above its upper one {upper[at]}"
        raise FitError(msg)
    start = np.clip(np.asarray(start, np.float64), lower, upper)
    margins = inequality or _no_margins
    problem = partial(_evaluated, residual, margins, args)
    first = [np.asarray(x) for x in problem((1.0, 1.0, 1.0), jnp.asarray(start))]
    if not all(np.isfinite(each).all() for each in first):
        return IpoptSolution(start, 0, "not_finite")
    # A step of one changes the residual by its size at the start.
    begin, norms = float(first[0]), np.sqrt(np.diag(first[2]))
    natural, length = np.where(start != 0, np.abs(start), 1.0), (2.0 * begin) ** 0.5
    natural[norms > 0] = (length or 1.0) / norms[norms > 0]
    unit = np.where(upper > lower, np.minimum(natural, upper - lower), natural)
    steep = np.linalg.norm(first[4] * unit, axis=1)
    units, rows = (unit, begin or 1.0, np.where(steep > 0, steep, 1.0)), len(steep)
    shapes = [(1, 1), (count, 1), (count, count), (rows, 1), (rows, count)]
    evaluate = _Callback("evaluate", partial(problem, units), [count], shapes)
    curved = partial(_curvature, margins, args, units)
    bend = _Callback("bend", curved, [count, rows], [(count, count)])
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
    limits = {"lbx": lower / unit, "ubx": upper / unit}
    found = solver(x0=start / unit, lbg=0.0, ubg=np.inf, **limits)
    for callback in (evaluate, bend):
        if callback.raised is not None:
            raise callback.raised
    stats = solver.stats()
    values = np.clip(np.asarray(found["x"]).ravel() * unit, lower, upper)
    status = _STATUS.get(stats["return_status"], "failed")
    return IpoptSolution(values, int(stats["iter_count"]), status)


def quadratic_ipopt(
    matrix: Any, slopes: Any, margins: Float[np.ndarray, " g"]
) -> IpoptSolution:
    r"""Minimise $\frac12 x^T P x$ subject to $S x + m \ge 0$, by IPOPT.

    Sparse throughout: a plane of 10⁴ nodes takes some seconds.

    Args:
        matrix: $P$, sparse and positive definite.
        slopes: $S$, sparse.
        margins: $m$; where none is below zero the solution is zero.
    """
    count, unit = matrix.shape[0], -float(margins.min(initial=0.0))
    if not unit > 0.0:
        return IpoptSolution(np.zeros(count), 0, "converged")
    x = ca.MX.sym("x", count)
    # The more unknowns there are, the less each of them costs.
    scaled = matrix * (count / matrix.diagonal().mean())
    weights, rows = (ca.DM(sp.csc_matrix(each)) for each in (scaled, slopes))
    problem = {"x": x, "f": 0.5 * ca.dot(x, weights @ x), "g": rows @ x}
    options = {key: value for key, value in _OPTIONS.items() if key != "no_nlp_grad"}
    options |= {"ipopt.hessian_constant": "yes", "ipopt.jac_d_constant": "yes"}
    options |= {"ipopt.tol": 1e-9}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    found = solver(x0=0.0, lbg=-margins / unit, ubg=np.inf)
    stats = solver.stats()
    status = _STATUS.get(stats["return_status"], "failed")
    values = unit * np.asarray(found["x"]).ravel()
    return IpoptSolution(values, int(stats["iter_count"]), status)
