"""Curves: columns that depend on a few non-linear parameters, and polylines as columns.

The linear parameters are eliminated, the others searched by `scipy.optimize.least_squares`:
the designs change their length with every fold and log, so that a compiled search would spend
its time on compiling.

Source: L. Kaufman, A variable projection method for solving separable nonlinear least squares
problems, BIT 15, 1975.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from ...models import Setpoints
from ._errors import FitError
from ._factor import SINGULAR
from ._regression import (
    Regression,
    fit_columns,
    least_scale,
    refuse_confounded,
    with_covariance,
)

_TRIALS, _ROUNDS = 8, 60
"""Evaluations of a curve in each round, and rounds at most; the next one goes on from there."""
TIGHT, LOOSE = 1e-3, 1e-2
"""Last move of any fitted value, in scales, at which the rounds end."""
_SIZES, _NODES = (1 << 10, 1 << 12), 12
"""Rows are filled up to these, beyond to powers of two, and nodes up to so many: compiled code
serves again."""


@jax.jit
def _shares(nodes: Float[Array, " n"], places: Float[Array, " t"]) -> Array:
    return Setpoints(nodes).stencil(places).matrix()


def filled(rows: Float[np.ndarray, "t *k"]) -> Float[Array, "n *k"]:
    """Return rows with the last one repeated up to a length that compiled code knows."""
    count = len(rows)
    further = 1 << max(count - 1, 0).bit_length()
    length = next((each for each in _SIZES if count <= each), further)
    more = np.repeat(rows[-1:], length - count, axis=0)
    return jnp.asarray(np.concatenate([rows, more]))


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
    room = max(size, _NODES if count <= _SIZES[-1] else 0)
    more = nodes[-1] + max(1.0, abs(nodes[-1])) * np.arange(1, room - size + 1)
    line = jnp.asarray(np.concatenate([nodes, more]))
    result = np.array(_shares(line, filled(held)))[:count, :size]
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
    names: Sequence[str] = (),
    loss: str = "student",
    quick: bool = False,
) -> tuple[Float[np.ndarray, " s"], Regression]:
    """Return non-linear parameters of columns, and the regression at their best values.

    Rounds of the robust regression for given parameters, and of the parameters that fit its
    pseudo-readings.

    Args:
        columns_at: Columns per reading for values of the non-linear parameters.
        target: Readings.
        start: Of these parameters, inside the bounds.
        width: Step to both sides for the derivative of the columns: small against their
            curvature, large against the noise in them.
        bounds: Lowest and highest values.
        time: As for `regress`.
        names: Of the columns, then of the parameters.
        loss: As for `regress`.
        quick: As for `regress`.

    Returns:
        The parameters, and the regression with one coefficient per column, then one per
        parameter: its deviation is that of the parameter, its value is the parameter's.

    Raises:
        FitError: If columns and parameters cannot be separated.
    """
    known, floor = np.ones(len(target)), least_scale(target)
    shapes = np.clip(start, *bounds)
    columns = columns_at(shapes)
    size = columns.shape[1] + len(start)
    if len(target) <= size:
        msg = f"{len(target)} readings for {size} unknowns, expected more."
        raise FitError(msg)
    refuse_confounded(columns, names)

    def slopes(
        shapes: Float[np.ndarray, " s"], linear: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, "t s"]:
        """Return the change of the fit with each non-linear parameter."""
        result = np.empty((len(target), len(width)))
        for k, step in enumerate(np.diag(width)):
            ends = [columns_at(shapes + sign * step) for sign in (1.0, -1.0)]
            result[:, k] = (ends[0] - ends[1]) @ linear / (2.0 * width[k])
        return result

    def better(
        found: Regression, shapes: Float[np.ndarray, " s"]
    ) -> Float[np.ndarray, " s"]:
        """Return the parameters that fit the pseudo-readings of a fit best."""
        good = ~found.wild
        aim = (target - found.residual + found.pseudo)[good]

        def project(
            shapes: Float[np.ndarray, " s"],
        ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "g k"]]:
            base, triangle = np.linalg.qr(columns_at(shapes)[good])
            return np.linalg.lstsq(triangle, base.T @ aim, rcond=SINGULAR)[0], base

        def cost(shapes: Float[np.ndarray, " s"]) -> Float[np.ndarray, " g"]:
            _, base = project(shapes)
            return np.asarray(aim - base @ (base.T @ aim))

        def change(shapes: Float[np.ndarray, " s"]) -> Float[np.ndarray, "g s"]:
            linear, base = project(shapes)
            steep = slopes(shapes, linear)[good]
            return np.asarray(base @ (base.T @ steep) - steep)

        # Stubs of SciPy know a name for the derivative only.
        solver: Any = least_squares
        return np.asarray(
            solver(
                cost, shapes, change, bounds=bounds, x_scale="jac", max_nfev=_TRIALS
            ).x
        )

    found = fit_columns(columns, target, known, loss, floor, shapes)
    still = False
    for _ in range(_ROUNDS):
        shapes = better(found, shapes)
        columns, before = columns_at(shapes), found.residual
        found = fit_columns(columns, target, known, loss, floor, shapes)
        move = float(np.abs(found.residual - before).max())
        still = move <= (LOOSE if quick else TIGHT) * found.noise.white
        if still:
            break
    design = np.hstack(
        [columns, slopes(shapes, found.coefficients[: columns.shape[1]])]
    )
    refuse_confounded(design, names)
    found = dataclasses.replace(found, converged=found.converged and still)
    return shapes, found if quick else with_covariance(found, design, known, time)
