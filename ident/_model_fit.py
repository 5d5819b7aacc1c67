"""What a fitted model is: values, noise, covariance, and what the readings do not tell."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Generic, TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float, Int

M = TypeVar("M", bound=eqx.Module)

STATUSES = ("converged", "max_steps", "infeasible", "not_finite", "failed")
"""How a solve ends, by its code."""

_RANK = 1e-8
"""Singular value of the equilibrated design, relative to the largest one, that counts as
zero: what the stopping tolerance of a solver leaves of a derivative is not information."""
_PART = 1e-6
"""Share of a parameter in an undetermined direction from which on it is undetermined."""


@final
@dataclasses.dataclass(frozen=True)
class Undetermined:
    """A direction in which parameters may move together without a change of predictions.

    Attributes:
        direction: Movement of each parameter that takes part, in its unit; one of them, which
            takes part in no other direction, moves by 1.
    """

    direction: Mapping[str, float]

    def __str__(self) -> str:
        if len(self.direction) == 1:
            return f"{next(iter(self.direction))} changes no prediction"
        parts = " ".join(f"{by:+.3g}·{name}" for name, by in self.direction.items())
        return f"along {parts} no prediction changes"


@final
class ModelFit(eqx.Module, Generic[M]):
    """A fitted model with its uncertainty; a pytree of arrays, also under `jax.jit`.

    Standard deviations are those of the linearised model at the solution, from readings
    and priors; limits and inequalities are no information (`at_limit` names what rests on
    one). A parameter that takes part in an undetermined direction has the deviation inf.
    """

    model: M
    """The fitted model, of the type of the start."""
    standard_deviation: M
    """Shaped like the model, in its units; None for what was not fitted."""
    noise: Float[Array, ""]
    """Standard deviation of a reading of weight 1, in the unit of the readings.

    It is inf where there are no more readings than parameters, as all deviations then are.
    """
    held_out: Float[Array, ""]
    """Root mean square of the weighted error at readings that a fit has not seen.

    Blocks (ten runs of consecutive readings, or the given groups) are left out in turn; the
    fit without one is a Gauss-Newton step from the fit of all, exact for what is linear.
    """
    residual: Float[Array, "..."]
    """Measured − predicted, in the unit of the readings."""
    steps: Int[Array, ""]
    """Steps that the solver took, of all passes."""
    code: Int[Array, ""]
    """Index into `STATUSES`; see `result`."""
    names: tuple[str, ...] = eqx.field(static=True)
    """Every fitted number by its place in the model: ``law.values[3]``."""
    values: Float[Array, " p"]
    """Of the fitted numbers, in the order of `names`."""
    limits: Float[Array, "2 p"]
    """Lower and upper limit of each; −∞ and ∞ where there is none."""
    scale: Float[Array, " p"]
    """Unit in which each number changes the predictions equally much."""
    singular: Float[Array, " p"]
    """Singular values of the design in these units, priors included, noise as unit."""
    directions: Float[Array, "p p"]
    """Right singular vectors, one per row."""

    @property
    def result(self) -> str:
        """How the solve ended: ``"converged"`` or why it did not (`STATUSES`)."""
        return STATUSES[int(self.code)]

    @property
    def converged(self) -> bool:
        """Whether the solve ended at a solution."""
        return self.result == "converged"

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Names of the numbers that rest on a limit (within 1e-6 of it, in their scale)."""
        limits, values = np.asarray(self.limits), np.asarray(self.values)
        finite = np.where(np.isfinite(limits), limits, 0.0)
        near = 1e-6 * np.maximum(np.abs(finite), np.asarray(self.scale))
        close = np.isfinite(limits) & (np.abs(values - finite) <= near)
        return tuple(np.asarray(self.names)[close.any(axis=0)].tolist())

    @property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """Directions in which the readings and priors do not determine the model.

        By the rank of the design at the solution.
        """
        kept = _determined(self.singular)
        empty = np.asarray(self.directions)[~np.asarray(kept)]
        if not len(empty):
            return ()
        order: Any = scipy.linalg.qr(empty, mode="r", pivoting=True)[-1]
        own = np.asarray(order)[: len(empty)]
        found, scale = [], np.asarray(self.scale)
        for row, place in zip(np.linalg.solve(empty[:, own], empty), own, strict=True):
            moves = row * scale / scale[place]
            takes_part = np.flatnonzero(np.abs(row) > _PART * np.abs(row).max())
            direction = {self.names[k]: float(moves[k]) for k in takes_part}
            found.append(Undetermined(direction))
        return tuple(found)

    def covariance(self, names: str | Sequence[str]) -> Float[Array, "k k"]:
        """Return the joint covariance of some parameters, in products of their units.

        Args:
            names: Of numbers, or of arrays as a whole (``"values"``), in any order; or one.

        Returns:
            The rows in the order of the names. Where a number is not determined, its
            variance is inf and its covariances are NaN.

        Raises:
            KeyError: If a name is not one of `names`, or the beginning of one.
        """
        names = [names] if isinstance(names, str) else names
        chosen = np.concatenate([self._places(name) for name in names])
        matrix, lost = covariance_of(self.singular, self.directions, self.scale)
        lost |= jnp.isinf(self.noise)
        matrix = jnp.where(lost[:, None] | lost[None, :], jnp.nan, matrix)
        matrix = jnp.where(jnp.diag(lost), jnp.inf, self.noise**2 * matrix)
        return matrix[chosen[:, None], chosen]

    def _places(self, name: str) -> np.ndarray:
        ends = ("", "[", ".")
        found = [
            place
            for place, own in enumerate(self.names)
            if any(own == name or (end and own.startswith(name + end)) for end in ends)
        ]
        if not found:
            shown = ", ".join(self.names[:12])
            msg = f"found no fitted parameter '{name}', expected one of {shown}"
            raise KeyError(msg)
        return np.asarray(found)


def _determined(singular: Float[Array, " p"]) -> Any:
    return singular > _RANK * jnp.max(singular)


@eqx.filter_jit
def covariance_of(
    singular: Float[Array, " p"],
    directions: Float[Array, "p p"],
    scale: Float[Array, " p"],
) -> tuple[Float[Array, "p p"], Array]:
    """Return the covariance per noise², and which numbers are not determined."""
    kept = _determined(singular)
    inverse = jnp.where(kept, 1.0 / jnp.where(kept, singular, 1.0), 0.0)
    rows = directions * inverse[:, None] * scale[None, :]
    lost = jnp.any((jnp.abs(directions) > _PART) & ~kept[:, None], axis=0)
    return rows.T @ rows, lost


def factor(
    design: Float[Array, "t p"], prior: Float[Array, " p"]
) -> tuple[Float[Array, " p"], Float[Array, " p"], Float[Array, "p p"]]:
    """Return scale, singular values and directions of a design and prior precisions.

    Args:
        design: Weighted derivatives of the predictions by the fitted numbers.
        prior: Noise over the prior's standard deviation of each number; 0 = no prior.
    """
    rows = jnp.concatenate([design, jnp.diag(prior)])
    norms = jnp.linalg.norm(rows, axis=0)
    scale = 1.0 / jnp.where(norms > 0, norms, 1.0)
    _, singular, directions = jnp.linalg.svd(rows * scale[None, :], full_matrices=False)
    return scale, singular, directions


def held_out_rms(
    design: Float[Array, "t p"],
    residual: Float[Array, " t"],
    prior: Float[Array, " p"],
    blocks: Int[Array, " t"],
    count: int,
    used: Float[Array, " t"],
) -> Float[Array, ""]:
    """Return the rms residual of blocks that a Gauss-Newton step without them predicts.

    Args:
        design: Weighted derivatives of the predictions.
        residual: Weighted, measured − predicted.
        prior: As in `factor`.
        blocks: Number of the block of each reading.
        count: Of blocks.
        used: 1 for a reading that counts, else 0.
    """
    norms = jnp.linalg.norm(design, axis=0)
    scale = 1.0 / jnp.where(norms > 0, norms, 1.0)
    design, prior = design * scale[None, :], prior * scale
    full = design.T @ design + jnp.diag(prior**2)

    def of(block: Int[Array, ""]) -> Float[Array, ""]:
        mine = jnp.where(blocks == block, used, 0.0)
        own = design * mine[:, None]
        rest = full - own.T @ own
        # The optimum of all: the slope of the block balances that of the rest.
        slope = own.T @ (residual * mine)
        values, vectors = jnp.linalg.eigh(rest)
        kept = values > _RANK * jnp.max(values)
        inverse = jnp.where(kept, 1.0 / jnp.where(kept, values, 1.0), 0.0)
        step = -vectors @ (inverse * (vectors.T @ slope))
        return jnp.sum(mine * (residual - design @ step) ** 2)

    total = jnp.sum(jax.lax.map(of, jnp.arange(count)))
    return jnp.sqrt(total / jnp.sum(used))
