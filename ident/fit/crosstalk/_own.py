"""Values of tests from the events around them alone, without a prior between tests."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ....models import AbstractSurface
from ...core._loss import choose_loss

_HOLD = 1e-6
"""Weight, relative to an event, that draws a value without events to the mean of all."""
_PASSES = 30


@dataclasses.dataclass(frozen=True)
class Values:
    """Values of one branch.

    Attributes:
        value: Per test in mm.
        standard_deviation: In mm; inf without events.
        support: Events that touch each test.
        noise: Of one event of median weight in mm.
        wild: Events that were rejected.
    """

    value: Float[np.ndarray, " p"]
    standard_deviation: Float[np.ndarray, " p"]
    support: Int[np.ndarray, " p"]
    noise: float
    wild: Bool[np.ndarray, " n"]


def stencil_columns(
    surface: AbstractSurface, positions: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n p"]:
    """Return the weight of each test in each event, from the controller's own surface."""
    stencil = surface.stencil(jnp.asarray(positions))
    result = np.zeros((len(positions), stencil.size))
    rows = np.repeat(np.arange(len(positions)), stencil.nodes.shape[1])
    np.add.at(
        result,
        (rows, np.asarray(stencil.nodes).reshape(-1)),
        np.asarray(stencil.weights).reshape(-1),
    )
    return result


def own_values(
    columns: Float[np.ndarray, "n p"],
    amount: Float[np.ndarray, " n"],
    weight: Float[np.ndarray, " n"],
    own_noise: float,
    loss: str = "student",
) -> Values:
    """Return the values that explain events best, each test by its own events.

    Args:
        columns: Weight of each test in each event.
        amount: Value of each event in mm.
        weight: Relative weight of each event (median 1).
        own_noise: Scatter of an event of weight 1 as seen within events, in mm: what is
            believed where the events are too few to tell.
        loss: As for `fit_table`; a loss needs spare events to find wild ones.
    """
    tests = columns.shape[1]
    touched = columns > 1e-9
    # A mean that a single odd event cannot move.
    centre = float(np.median(amount))
    root = np.sqrt(weight)
    held = _HOLD * max(float((weight[:, None] * columns**2).sum()) / tests, 1e-300)
    share = np.ones(len(amount))
    wild = np.zeros(len(amount), bool)
    value = np.full(tests, centre)
    for _ in range(_PASSES):
        kept = weight * share
        normal = columns.T @ (kept[:, None] * columns) + held * np.eye(tests)
        right = columns.T @ (kept * (amount - centre))
        fresh = centre + np.linalg.solve(normal, right)
        moved = float(np.abs(fresh - value).max())
        value = fresh
        left_over = len(amount) - int(touched.any(axis=0).sum())
        if left_over < max(4, tests) or loss == "gauss":
            break
        left = (amount - columns @ value) * root
        inflation = float(np.sqrt(len(amount) / left_over))
        chosen = choose_loss(loss, left, inflation, 0.1 * own_noise)
        wild = chosen.wild(left / chosen.scale)
        share = np.where(wild, 0.0, chosen.share(left / chosen.scale))
        if moved < 1e-3 * own_noise:
            break
    left = (amount - columns @ value) * root
    support = (touched & ~wild[:, None]).sum(axis=0)
    spare = float((~wild).sum() - (support > 0).sum())
    variance = own_noise**2
    if spare >= 1:
        seen = float(left[~wild] @ left[~wild]) / spare
        # A few spare events say little: believe what the events say of themselves beside it.
        variance = (spare * seen + 2.0 * variance) / (spare + 2.0)
    good = weight * ~wild
    normal = columns.T @ (good[:, None] * columns) + held * np.eye(tests)
    spread = np.sqrt(variance * np.diag(np.linalg.inv(normal)))
    spread = np.where(support > 0, spread, np.inf)
    return Values(value, spread, support, float(np.sqrt(variance)), wild)
