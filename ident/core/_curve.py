"""Curves: columns that depend on a few non-linear parameters, and polylines as columns.

The linear parameters are eliminated, the others searched by `scipy.optimize.least_squares`:
the designs change their length with every fold and log, so that a compiled search would spend
its time on compiling.

Source: L. Kaufman, A variable projection method for solving separable nonlinear least squares
problems, BIT 15, 1975.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import least_squares

from ...models import Setpoints
from ._errors import FitError
from ._readings import filled
from ._regression import (
    SINGULAR,
    Regression,
    refuse_confounded,
    regress,
    with_covariance,
)

_ROUNDS = 30
"""Searches of the shapes between robust fits of the factors, at most."""
_ENDED = 1e-3
"""Last move of any fitted value, in deviations of the noise, at which they end."""
_PLACES, _NODES = 1 << 12, 12
"""Places up to which nodes are filled up to so many: compiled code serves again."""


@jax.jit
def _shares(nodes: Float[Array, " n"], places: Float[Array, " t"]) -> Array:
    return Setpoints(nodes).stencil(places).matrix()


def node_shares(
    places: Float[np.ndarray, " t"], nodes: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "t n"]:
    """Return the share of each node at each place, NaN where that is NaN.

    Those of all laws of `axcomp.models` over given points: linear between, the ends held.
    """
    count, size, known = len(places), len(nodes), np.isfinite(places)
    # Held here, since further nodes stand behind the last one.
    held = np.clip(np.where(known, places, nodes[0]), nodes[0], nodes[-1])
    # Many places outweigh a compilation, and their columns the memory.
    room = max(size, _NODES if count <= _PLACES else 0)
    more = nodes[-1] + max(1.0, abs(nodes[-1])) * np.arange(1, room - size + 1)
    line = jnp.asarray(np.concatenate([nodes, more]))
    result = np.array(_shares(line, jnp.asarray(filled(held))))[:count, :size]
    result[~known] = np.nan
    return result


def regress_curve(
    columns_at: Callable[[Float[np.ndarray, " s"]], Float[np.ndarray, "t k"]],
    target: Float[np.ndarray, " t"],
    start: Float[np.ndarray, " s"],
    *,
    width: Float[np.ndarray, " s"],
    bounds: tuple[Float[np.ndarray, " s"], Float[np.ndarray, " s"]],
    time: Float[np.ndarray, " t"] | None = None,
) -> tuple[Float[np.ndarray, " s"], Regression]:
    """Return non-linear parameters of columns, and the regression at their best values.

    Args:
        columns_at: Columns per reading for values of the non-linear parameters.
        target: Readings.
        start: Of these parameters, inside the bounds.
        width: Step to both sides for the derivative of the columns: small against their
            curvature, large against the noise in them.
        bounds: Lowest and highest values.
        time: As for `regress`.

    Returns:
        The parameters, and the regression with one coefficient per column, then one per
        parameter: its deviation is that of the parameter, its value is the parameter's.

    Raises:
        FitError: If columns and parameters cannot be separated.
    """
    size = columns_at(start).shape[1] + len(start)
    if len(target) <= size:
        msg = f"{len(target)} readings for {size} unknowns, expected more."
        raise FitError(msg)

    def slopes(
        shapes: Float[np.ndarray, " s"], linear: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "t s"]:
        """Return the change of the fit with each non-linear parameter."""
        result = np.empty((len(target), len(width)))
        for k, step in enumerate(np.diag(width)):
            ends = [columns_at(shapes + sign * step) for sign in (1.0, -1.0)]
            result[:, k] = (ends[0] - ends[1]) @ linear / (2.0 * width[k])
        return result

    def search(
        near: Float[np.ndarray, " s"],
        aim: Float[np.ndarray, " t"],
        good: Bool[np.ndarray, " t"],
    ) -> Float[np.ndarray, " s"]:
        """Return the shapes that come nearest to pseudo-readings, the factors eliminated."""

        def project(shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            basis, triangle = np.linalg.qr(columns_at(shapes)[good])
            linear = np.linalg.lstsq(triangle, basis.T @ aim[good], rcond=SINGULAR)[0]
            return basis, linear

        def cost(shapes: np.ndarray) -> np.ndarray:
            basis, _ = project(shapes)
            return np.asarray(aim[good] - basis @ (basis.T @ aim[good]))

        def change(shapes: np.ndarray) -> np.ndarray:
            basis, linear = project(shapes)
            steep = slopes(shapes, linear)[good]
            return np.asarray(basis @ (basis.T @ steep) - steep)

        # Stubs of SciPy know a name for the derivative only.
        solver: Any = least_squares
        found = solver(cost, near, change, bounds=bounds, x_scale="jac")
        return np.asarray(found.x)

    factors = partial(regress, target=target, quick=True)
    shapes = np.clip(start, *bounds)
    found = factors(columns_at(shapes))
    for _ in range(_ROUNDS):
        before = found.residual
        shapes = search(shapes, target - before + found.pseudo, ~found.wild)
        found = factors(columns_at(shapes))
        move = float(np.abs(found.residual - before).max())
        if move <= _ENDED * found.noise.white:
            break
    else:
        found = dataclasses.replace(found, converged=False)
    steep = slopes(shapes, found.coefficients)
    design = np.hstack([columns_at(shapes), steep])
    refuse_confounded(design)
    known, scale = np.ones(len(target)), np.sqrt(np.square(design).sum(axis=0))
    count = design.shape[1]
    found = dataclasses.replace(
        found,
        coefficients=np.concatenate([found.coefficients, shapes]),
        covariance=np.zeros((count, count)),
        independent=np.full(count, float(len(target))),
        undetermined=np.zeros(count, bool),
    )
    return shapes, with_covariance(found, design / scale, scale, known, time)
