"""Curves: columns that depend on a few non-linear parameters, and polylines as columns.

The linear parameters are eliminated, the others searched by `scipy.optimize.least_squares`:
the designs change their length with every fold and log, so that a compiled search would spend
its time on compiling.

Source: L. Kaufman, A variable projection method for solving separable nonlinear least squares
problems, BIT 15, 1975.
"""

from collections.abc import Callable, Sequence
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
    LOOSE,
    SINGULAR,
    TIGHT,
    Regression,
    iterate,
    least_scale,
    refuse_confounded,
    regress,
    with_covariance,
)

_TRIALS = 8
"""Evaluations of a curve in each robust pass; the next pass goes on from there."""
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
    names: Sequence[str] = (),
    loss: str = "student",
    quick: bool = False,
) -> tuple[Float[np.ndarray, " s"], Regression]:
    """Return non-linear parameters of columns, and the regression at their best values.

    Args:
        columns_at: Columns per reading for values of the non-linear parameters.
        target: Readings.
        start: Of these parameters, inside the bounds; empty: a regression is all.
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
    known = np.ones(len(target))
    first = columns_at(start)
    size = first.shape[1]
    if not len(start):
        return start, regress(
            first, target, time=time, names=names, loss=loss, quick=quick
        )
    if len(target) <= size + len(start):
        msg = f"{len(target)} readings for {size + len(start)} unknowns, expected more."
        raise FitError(msg)
    begin = regress(first, target, names=names, loss=loss, quick=True).coefficients

    def slopes(value: Float[np.ndarray, " p"]) -> Float[np.ndarray, "t s"]:
        """Return the change of the fit with each non-linear parameter."""
        result = np.empty((len(target), len(width)))
        for k, step in enumerate(np.diag(width)):
            ends = [columns_at(value[size:] + sign * step) for sign in (1.0, -1.0)]
            result[:, k] = (ends[0] - ends[1]) @ value[:size] / (2.0 * width[k])
        return result

    def residual_at(value: Float[np.ndarray, " p"]) -> Float[np.ndarray, " t"]:
        return np.asarray(target - columns_at(value[size:]) @ value[:size])

    def solve(
        value: Float[np.ndarray, " p"],
        pseudo: Float[np.ndarray, " t"],
        wild: Bool[np.ndarray, " t"],
    ) -> Float[np.ndarray, " p"]:
        good = ~wild
        aim = (columns_at(value[size:]) @ value[:size] + pseudo)[good]

        def project(
            shapes: Float[np.ndarray, " s"],
        ) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "g k"]]:
            base, triangle = np.linalg.qr(columns_at(shapes)[good])
            linear = np.linalg.lstsq(triangle, base.T @ aim, rcond=SINGULAR)[0]
            return np.concatenate([linear, shapes]), base

        def cost(shapes: Float[np.ndarray, " s"]) -> Float[np.ndarray, " g"]:
            _, base = project(shapes)
            return np.asarray(aim - base @ (base.T @ aim))

        def change(shapes: Float[np.ndarray, " s"]) -> Float[np.ndarray, "g s"]:
            now, base = project(shapes)
            steep = slopes(now)[good]
            return np.asarray(base @ (base.T @ steep) - steep)

        inside = np.clip(value[size:], *(edge for edge in bounds))
        # Stubs of SciPy know a name for the derivative only.
        solver: Any = least_squares
        found = solver(
            cost, inside, change, bounds=bounds, x_scale="jac", max_nfev=_TRIALS
        )
        return project(found.x)[0]

    found = iterate(
        np.concatenate([begin, start]),
        residual_at,
        solve,
        known,
        size + len(start),
        least_scale(target),
        loss,
        LOOSE if quick else TIGHT,
    )
    value = found.coefficients
    design = np.hstack([columns_at(value[size:]), slopes(value)])
    refuse_confounded(design, names)
    if not quick:
        scale = np.sqrt(np.square(design).sum(axis=0))
        found = with_covariance(found, design / scale, scale, known, time)
    return value[size:], found
