"""The table fit as a differentiable function: node values from readings, nothing else.

For researchers who differentiate through a fit, and the fast path where only the values
are wanted. Robust weights, evidence and standard deviations are the business of `fit_table`.
"""

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from ...models import _precision as _precision  # 64 bits, before any array
from ..core._errors import FitError
from ..core._threads import one_blas_thread
from ._conjugate import conjugate_solve
from ._estimate import table_prior
from ._grid import Grid, Located
from ._information import Normal, evaluate
from ._logs import fixed_smoothness
from ._plane_sums import sums_of
from ._posterior import solve
from ._problem import Problem
from ._types import Samples, TableLayout

_LARGE = 1e7
"""Operations of a band factor from which conjugate gradients are tried first."""

Given = Any
"""A NumPy array, a JAX array, a tracer, or JAX's own wrapper of a NumPy array."""


def fit_values(
    layout: TableLayout,
    positions: Float[ArrayLike, "t d"],
    error: Float[ArrayLike, " t"],
    *,
    smoothness: float | Mapping[str, float],
    branch: np.ndarray | None = None,
    weight: Float[ArrayLike, " t"] | None = None,
) -> Float[Array, "..."]:
    r"""Return the node values that minimise the penalised squares, differentiably.

    $\hat\theta = (X^T W X + P)^{-1} X^T W e$ with the stencil $X$ of the controller's
    interpolation. Derivatives with respect to positions, error and weight are exact (implicit
    function theorem; a position at a node takes the slope of the cell that begins there).
    Works under `jax.grad`, `jax.vjp`, `jax.jit` and, one by one, `jax.vmap`.

    Args:
        layout: Where the nodes lie.
        positions: Input positions in mm or °, shape ``(t, d)``.
        error: Readings in mm or °, shape ``(t,)``.
        smoothness: As for `fit_table`, but not ``"auto"``; `TableFit.smoothness` will do.
        branch: 0 or 1 per reading for a table with two branches.
        weight: Known weights, shape ``(t,)``.

    Returns:
        Node values of shape `TableLayout.shape` in mm or °.

    Raises:
        FitError: If the readings do not determine the table.
    """
    setup = _Setup(
        layout,
        smoothness,
        None if branch is None else np.asarray(branch, np.int64).tobytes(),
    )
    known = None if weight is None else _plain(weight)
    return _fit(setup, _plain(positions), _plain(error), known)


@dataclasses.dataclass(frozen=True, eq=False)
class _Setup:
    """What is not differentiated; compared by identity, so that it may be static."""

    layout: TableLayout
    smoothness: float | Mapping[str, float]
    branches: bytes | None

    def samples(self, positions: Given, error: Given, weight: Given) -> Samples:
        branch = (
            None if self.branches is None else np.frombuffer(self.branches, np.int64)
        )
        known = None if weight is None else np.asarray(weight)
        return Samples(np.asarray(positions), np.asarray(error), branch, known)


def _plain(value: ArrayLike) -> ArrayLike:
    """Leave traced and NumPy arrays as they are; everything else becomes an array."""
    return (
        value if isinstance(value, jax.Array | np.ndarray) else np.asarray(value, float)
    )


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _fit(setup: _Setup, positions: Given, error: Given, weight: Given) -> Array:
    result, _ = _forward(setup, positions, error, weight)
    return result


def _forward(
    setup: _Setup, positions: Given, error: Given, weight: Given
) -> tuple[Array, tuple[Given, ...]]:
    shape = _shape(setup.layout.shape)
    arguments = (positions, error, weight)
    if any(isinstance(value, Tracer) for value in arguments):
        call = partial(_values_on_host, setup)
        values = jax.pure_callback(call, shape, *arguments, vmap_method="sequential")
    else:
        values = jnp.asarray(_values_on_host(setup, *arguments))
    return values, (positions, error, weight, values)


def _backward(
    setup: _Setup, kept: tuple[Given, ...], slope: Array
) -> tuple[Array, Array, Array | None]:
    shapes = tuple(None if value is None else _shape(value.shape) for value in kept[:3])
    result: tuple[Array, Array, Array | None] = jax.pure_callback(
        partial(_slopes_on_host, setup), shapes, *kept, slope, vmap_method="sequential"
    )
    return result


def _shape(shape: tuple[int, ...]) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, jnp.float64)  # type: ignore[no-untyped-call]


_fit.defvjp(_forward, _backward)


def _values_on_host(
    setup: _Setup, positions: Given, error: Given, weight: Given
) -> Float[np.ndarray, "..."]:
    samples = setup.samples(positions, error, weight)
    grid = Grid(setup.layout)
    with one_blas_thread():
        values = _solved(grid, setup.smoothness, *sums_of(grid, samples))
        return grid.to_table(values)


def _slopes_on_host(
    setup: _Setup,
    positions: Given,
    error: Given,
    weight: Given,
    values: Given,
    slope: Given,
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return the slopes by the adjoint: one more solve with the same matrix.

    With λ = A⁻¹·slope, table λ(x) and residual r: dE/de = w·λ(x), dE/dw = λ(x)·r and
    dE/dx = w·(λ'(x)·r − λ(x)·θ'(x)).
    """
    samples = setup.samples(positions, error, weight)
    known = np.ones(len(samples.error)) if weight is None else np.asarray(weight)
    grid = Grid(setup.layout)
    with one_blas_thread():
        normal, _ = sums_of(grid, samples)
        # The repeated end of a ring is the same unknown as its beginning.
        pull = np.asarray(slope, float)
        right = np.array(grid.from_table(pull))
        if setup.layout.periodic:
            right[0] += pull.T[-1] if setup.layout.branches == 2 else pull[-1]
        adjoint = _solved(grid, setup.smoothness, normal, right)
    place = grid.locate(samples)
    table = grid.from_table(np.asarray(values))
    along, here = evaluate(grid, place, adjoint), evaluate(grid, place, table)
    residual = samples.error - here
    result = np.zeros(positions.shape)
    for axis in range(positions.shape[1]):
        steep_adjoint = _steepness(grid, samples.positions, place, adjoint, axis)
        steep_table = _steepness(grid, samples.positions, place, table, axis)
        result[:, axis] = known * (steep_adjoint * residual - along * steep_table)
    return result, known * along, None if weight is None else along * residual


def _steepness(
    grid: Grid, positions: np.ndarray, located: Located, values: np.ndarray, axis: int
) -> Float[np.ndarray, " t"]:
    """Return the slope of a table along one axis at the readings; 0 where the edge is held."""
    nodes = np.asarray(grid.layout.nodes[axis], float)
    slow = axis == grid.slow_column
    index, name = (located.l, "u") if slow else (located.s, "v")
    ends = [
        evaluate(
            grid,
            dataclasses.replace(located, **{name: np.full(len(index), end)}),
            values,
        )
        for end in (0.0, 1.0)
    ]
    width = nodes[index + 1] - nodes[index] if len(nodes) > 1 else np.inf
    inside = (positions[:, axis] >= nodes[0]) & (positions[:, axis] < nodes[-1])
    steep = (ends[1] - ends[0]) / width
    return np.where(inside | grid.layout.periodic, steep, 0.0)


def _solved(
    grid: Grid,
    smoothness: float | Mapping[str, float],
    normal: Normal,
    vector: Float[np.ndarray, "l s"],
) -> Float[np.ndarray, "l s"]:
    prior = table_prior(grid)
    weights = fixed_smoothness(smoothness, normal.density, grid)
    if grid.planar and grid.size * grid.fast**2 > _LARGE:
        values = conjugate_solve(normal, prior, weights, vector)
        if values is not None:
            return values
    problem = Problem(
        normal=normal,
        prior=prior,
        vector=vector,
        square=0.0,
        count=1,
        values=np.zeros_like(vector),
        effects=np.zeros(0),
    )
    posterior = solve(problem, weights)
    if posterior is None:
        msg = "the readings do not determine the table: the normal matrix is singular."
        raise FitError(msg)
    return posterior.values
