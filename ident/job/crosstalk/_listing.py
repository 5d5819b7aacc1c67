"""The list that a crosstalk fit stands for: which tests, and what each holds."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ....models import Conventions, Crosstalk, surface_through
from ...kinds.crosstalk.effect import CrosstalkFit
from ._existing import Existing


def kept_tests(fit: CrosstalkFit, active: Existing | None) -> Bool[np.ndarray, " p"]:
    """Return which tests are written: all four values measured, or known from before.

    Args:
        fit: The estimate.
        active: The list that was active while measuring: its tests keep what they hold
            where nothing was measured.
    """
    if active is None:
        return fit.complete
    return np.asarray(fit.complete | active.holds(fit.points))


def list_model(
    fit: CrosstalkFit, active: Existing | None, rules: Conventions
) -> Crosstalk:
    """Return the list of the kept tests as the controller runs it, without a filter."""
    kept = kept_tests(fit, active)
    points = fit.points[kept]
    offset = np.where(fit.complete, -fit.values, 0.0)[:, kept]
    if active is not None:
        offset = offset + active.at(fit.acceleration, fit.deceleration, points)
    return Crosstalk(
        surface_through(points),
        jnp.asarray(rules.crosstalk_sign * offset),
        jnp.asarray(fit.acceleration),
        jnp.asarray(fit.deceleration),
        velocity_dependent=True,
        **rules.of_crosstalk,
    )


def coverage_of(
    model: Crosstalk, workspace: Float[np.ndarray, "k 2"], resolution: int = 41
) -> float:
    """Return the share of a workspace that lies among the tests, 0 to 1.

    Args:
        model: The list.
        workspace: From where to where each adaptation axis goes, in mm.
        resolution: Places looked at along each axis.
    """
    if not len(workspace):
        return 1.0
    lines = [np.linspace(low, high, resolution) for low, high in workspace]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    return float(np.mean(np.asarray(model.covers(grid.reshape(-1, len(lines))))))
