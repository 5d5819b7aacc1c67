"""The joint covariance of the values of an effect, and values that keep inequalities."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse as sp
from jaxtyping import Array, Float

from ._ipopt import least_squares_ipopt
from .core import FitError, one_blas_thread

if TYPE_CHECKING:
    from ._effects import AbstractEffect
    from .fit.joint import JointData, JointFit, Part

_EMPTY = 1e-10
"""Eigenvalue, relative to the largest one, that counts as zero."""


@one_blas_thread()
def covariance_of(
    fit: "JointFit", data: "JointData", place: int
) -> Float[np.ndarray, "p p"]:
    """Return the joint covariance of the values of one part, under the gauge of the fit.

    That of the readings with the weights that the loss left them, an offset per run and
    the smoothness as found. Scaled to the stated standard deviations, which know of lags
    and of noise that drifts as well.

    Args:
        fit: The fit.
        data: Its readings.
        place: Which of its parts.
    """
    axis = fit.parts[place].effect.axis
    own = [k for k, part in enumerate(fit.parts) if part.effect.axis == axis]
    rows = np.isfinite(fit.residual[axis])
    run = data.run_of(axis)
    columns = [np.ones((int(rows.sum()), 1))]
    if run is not None and len(fit.runs.get(axis, ())) > 1:
        runs = np.unique(run[rows], return_inverse=True)[1]
        columns.append(np.eye(int(runs.max()) + 1)[runs.reshape(-1)])
    blocks = [fit.parts[k].effect.block(data) for k in own]
    design = sp.hstack([*(each.columns[rows] for each in blocks), *columns]).tocsr()
    weight = sp.diags_array(fit.share[axis][rows])
    information = (design.T @ weight @ design).toarray()
    starts = np.cumsum([0, *(len(fit.parts[k].values) for k in own)])
    for k, start in zip(own, starts, strict=False):
        weights = fit.parts[k].smoothness
        prior = fit.parts[k].effect.prior
        for name, each in zip(prior.names, prior.rows, strict=True) if prior else ():
            here = slice(start, start + len(fit.parts[k].values))
            information[here, here] += weights[name] * (each.T @ each).toarray()
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information * np.outer(scale, scale)
    inverse = scipy.linalg.pinvh(scaled, rtol=_EMPTY) * np.outer(scale, scale)
    size = int(starts[-1])
    gauge = _gauge(fit, own, place, size + 1)
    found = gauge @ inverse[: size + 1, : size + 1] @ gauge.T
    deviation = fit.parts[place].standard_deviation
    stated = deviation / np.sqrt(np.maximum(np.diag(found), 1e-300))
    known = np.isfinite(deviation)
    stated = np.where(known, stated, np.nan)
    found = np.asarray(found * np.outer(stated, stated))
    found[np.diag_indices_from(found)] = np.where(known, deviation, np.inf) ** 2
    return found


def _gauge(
    fit: "JointFit", own: list[int], place: int, size: int
) -> Float[np.ndarray, "p u"]:
    """Return the values of a part under the gauge, per unknown of its axis and its datum."""
    empty = [np.zeros(len(part.values)) for part in fit.parts]
    axis = fit.parts[place].effect.axis
    columns = []
    for k in own:
        for unit in np.eye(len(empty[k])):
            values = [unit if j == k else each for j, each in enumerate(empty)]
            columns.append(fit.in_gauge(values)[0][place])
    columns.append(fit.in_gauge(empty, {axis: 1.0})[0][place])
    assert len(columns) == size
    return np.stack(columns, axis=1)


def constrained(
    effect: "AbstractEffect",
    part: "Part",
    covariance: Float[np.ndarray, "p p"],
    inequality: Callable[[Any], Array],
) -> Float[np.ndarray, "..."]:
    """Return the most probable table of a part whose model keeps inequalities, by IPOPT.

    Args:
        effect: As it was stated.
        part: As it was fitted.
        covariance: Of its values.
        inequality: Values that the model of the controller keeps at or above zero.

    Raises:
        FitError: If nothing keeps them, or the readings do not determine the values.
    """
    if not np.isfinite(covariance).all():
        msg = f"constraints: the readings do not determine all of {part.name}"
        raise FitError(msg)
    sizes, modes = np.linalg.eigh(covariance)
    kept = sizes > _EMPTY * sizes.max()
    # What neither readings nor prior move stays where it is.
    span = modes[:, kept] * np.sqrt(sizes[kept])
    along = np.stack([part.effect.table(column) for column in span.T], axis=-1)

    def keeps(move: Float[Array, " k"], args: Any) -> Float[Array, " g"]:
        middle, along = args
        table = middle + along @ move
        return jnp.ravel(inequality(effect.to_model(table, -1.0, part.effect)))

    found = least_squares_ipopt(
        lambda move, _: move,
        np.zeros(span.shape[1]),
        (jnp.asarray(part.table), jnp.asarray(along)),
        inequality=keeps,
    )
    if not found.converged:
        msg = f"constraints of {part.name}: IPOPT ended as '{found.status}'"
        raise FitError(msg)
    return np.asarray(part.table + along @ found.values)
