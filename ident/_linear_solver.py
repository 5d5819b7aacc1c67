"""The factor of the estimator as a lineax solver: a band with a dense border, on the host."""

from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, PyTree

from .core import ArrowFactor, one_blas_thread

_ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))
"""Root that a direction without information leaves of one of unit information."""


@final
class Arrow(eqx.Module):
    """A symmetric matrix: a band, and beside it rows that couple to everything."""

    band: Float[Array, "n w"]
    """Lower band by columns: ``[j, d]`` is element ``(j + d, j)``."""
    cross: Float[Array, "m n"]
    """Border rows over the band."""
    border: Float[Array, "m m"]
    """Border over itself."""

    def __matmul__(self, values: Float[Array, " u"]) -> Float[Array, " u"]:
        """Return the product with a vector."""
        n, width = self.band.shape
        first, last = values[:n], values[n:]
        at = jnp.arange(n)[:, None] + jnp.arange(width)[None, :]
        top = jnp.zeros(n).at[at].add(self.band * first[:, None], mode="drop")
        beyond = first.at[at[:, 1:]].get(mode="fill", fill_value=0.0)
        top += jnp.sum(self.band[:, 1:] * beyond, axis=1) + self.cross.T @ last
        return jnp.concatenate([top, self.cross @ first + self.border @ last])


State = tuple[Array, Array, Array, Array]
"""`ArrowFactor` of the matrix in units of its diagonal, and these units."""


@final
class ArrowCholesky(lx.AbstractLinearSolver[State]):  # type: ignore[misc]
    """Cholesky factor of a positive definite operator, by LAPACK on the host.

    As `lineax.Cholesky`; with ``options={"matrix": Arrow(...)}`` in time and memory of a
    band. Derivatives of any order, forward and reverse, are those of `lineax.linear_solve`.
    The solution is NaN where the matrix has no factor.
    """

    def init(
        self, operator: lx.AbstractLinearOperator, options: dict[str, Any]
    ) -> State:
        """Factorise the operator, or the matrix among the options, which is the same."""
        if not lx.is_positive_semidefinite(operator):
            msg = "ArrowCholesky: found no positive_semidefinite_tag, expected it"
            raise ValueError(msg)
        matrix = options.get("matrix")
        if matrix is None:
            dense = operator.as_matrix()
            none = jnp.zeros((0, 1)), jnp.zeros((len(dense), 0))
            matrix = Arrow(*none, dense)
        parts = jax.lax.stop_gradient((matrix.band, matrix.cross, matrix.border))
        size = jnp.concatenate([parts[0][:, 0], jnp.diag(parts[2])])
        unit = jnp.where(size > 0, 1.0 / jnp.sqrt(jnp.where(size > 0, size, 1.0)), 1.0)
        shapes = jax.eval_shape(lambda: (parts[0], parts[1].T, parts[2]))
        found: tuple[Array, Array, Array] = jax.pure_callback(
            _factorised, shapes, *parts, unit, vmap_method="sequential"
        )
        return (*found, unit)

    def compute(
        self, state: State, vector: PyTree[Array], options: dict[str, Any]
    ) -> tuple[PyTree[Array], lx.RESULTS, dict[str, Any]]:
        """Solve for one right-hand side."""
        del options
        *factor, unit = state
        right, unflatten = ravel_pytree(vector)
        shape = jax.eval_shape(lambda: right)
        found = jax.pure_callback(
            _solved, shape, *factor, unit * right, vmap_method="sequential"
        )
        return unflatten(unit * found), lx.RESULTS.successful, {}

    def transpose(
        self, state: State, options: dict[str, Any]
    ) -> tuple[State, dict[str, Any]]:
        """Return the state of the transposed operator: it is symmetric."""
        return state, options

    def conj(
        self, state: State, options: dict[str, Any]
    ) -> tuple[State, dict[str, Any]]:
        """Return the state of the conjugate operator: it is real."""
        return state, options

    def assume_full_rank(self) -> bool:
        """Whether only regular operators are solved."""
        return True


def _factorised(*arrays: Any) -> tuple[np.ndarray, ...]:
    """Return the factor of a matrix in units of its diagonal; NaN where it has none."""
    band, cross, border, unit = (np.array(each) for each in arrays)
    n, width = band.shape
    inner, outer = unit[:n], unit[n:]
    for k in range(min(width, n)):
        band[: n - k, k] *= inner[: n - k] * inner[k:]
    cross *= np.outer(outer, inner)
    border *= np.outer(outer, outer)
    with one_blas_thread():
        found = ArrowFactor.of(band, cross, border)
    if found is not None:
        roots = np.concatenate([found.band[:, 0], np.diag(found.schur)])
        if roots.min(initial=1.0) > _ROUNDING * np.sqrt(len(unit)):
            return found.band, found.cross, found.schur
    return tuple(
        np.full(shape, np.nan) for shape in (band.shape, cross.T.shape, border.shape)
    )


def _solved(*arrays: Any) -> np.ndarray:
    """Return the solution by a factor; NaN where there is none."""
    *parts, right = (np.asarray(each) for each in arrays)
    factor = ArrowFactor(*parts)
    if not np.isfinite(factor.band[:, 0]).all() or not np.isfinite(factor.schur).all():
        return np.full(right.shape, np.nan)
    with one_blas_thread():
        return np.asarray(factor.solve(right))
