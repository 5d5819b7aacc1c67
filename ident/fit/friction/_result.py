"""What a friction fit gives: the law, its parameters with σ, and what the data cannot say."""

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ....models import AbstractFriction
from ._problem import Known
from ._structure import AbstractStructure


@dataclasses.dataclass(frozen=True)
class FrictionFit:
    """A fitted friction law with what is known about it.

    Loads are in the unit that ``gain`` times the current has (drive units for gain 1).

    Attributes:
        method: How it was found, in words.
        structure: Which kind of law.
        has_law: Whether the level of friction is told from a constant load.
        parameters: By the names of the result file, in load units over mm/s and mm/s²; only
            those that the data determine.
        standard_deviations: Of the same.
        names: Order of ``values`` and ``covariance``: all parameters, determined or not.
        values: All of them; NaN where undetermined.
        covariance: Between them; NaN where undetermined.
        undetermined: What the data cannot say: name → reason.
        gauges: Sentences on what can only be told together.
        remarks: Further sentences for the report.
        noise: Robust standard deviation of the residual.
        relative_error: RMS of the residual over RMS of the load, over all samples in motion.
        residual: Load − fit per sample used, after filtering, in load units.
        share: Weight that each of them had, 0 to 1.
        index: Sample of the recording that each of them is centred on.
        count: Samples that counted.
        lag: Samples over which residuals were taken to resemble each other (HAC), 0 for none.
        passes: Iterations.
        converged: Whether the last one changed nothing.
        message: One sentence on how the fit went.
        known: What was not fitted.
        decimate: Samples of the recording per sample used.
        state: Linear factors as fitted: inertia, offset, loads where fitted, then those of the
            law, before a gauge parts level and offset.
        state_covariance: Of ``state`` and ``shape``.
        factors: Linear factors of the law, in the order of `AbstractStructure.names`.
        shape: Logarithms of the law's non-linear parameters.
        law_covariance: Of ``factors`` and ``shape``, for `band`.
    """

    method: str
    structure: AbstractStructure
    has_law: bool
    parameters: Mapping[str, float]
    standard_deviations: Mapping[str, float]
    names: tuple[str, ...]
    values: Float[np.ndarray, " r"]
    covariance: Float[np.ndarray, "r r"]
    undetermined: Mapping[str, str]
    gauges: tuple[str, ...]
    remarks: tuple[str, ...]
    noise: float
    relative_error: float
    residual: Float[np.ndarray, " t"]
    share: Float[np.ndarray, " t"]
    index: Int[np.ndarray, " t"]
    count: int
    lag: int
    passes: int
    converged: bool
    message: str
    known: Known
    decimate: int
    state: Float[np.ndarray, " n"]
    state_covariance: Float[np.ndarray, "m m"]
    factors: Float[np.ndarray, " k"]
    shape: Float[np.ndarray, " s"]
    law_covariance: Float[np.ndarray, "p p"]

    @cached_property
    def law(self) -> AbstractFriction | None:
        """Current over velocity without the offset, in load units.

        None where the level of friction cannot be told from a constant load.
        """
        law: AbstractFriction | None = jax.tree.map(jnp.asarray, self.plain_law)
        return law

    @cached_property
    def plain_law(self) -> AbstractFriction | None:
        """The same for where no derivative is taken with respect to its numbers.

        They may be as NumPy has them: arrays of JAX take longer to make than all the rest.
        """
        if not self.has_law:
            return None
        factors = self.factors.reshape(self.structure.ways, -1)
        return self.structure.law(factors, self.shape)

    def band(
        self, velocity: Float[np.ndarray, " v"]
    ) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """Return friction and its standard deviation at velocities in mm/s, in load units."""
        columns = self.structure.columns(velocity, self.shape)
        tangents = [
            slope @ self.factors
            for slope in self.structure.column_slopes(velocity, self.shape)
        ]
        full = np.concatenate([columns, *[each[:, None] for each in tangents]], axis=1)
        variance = np.einsum("tk,tk->t", full @ self.law_covariance, full)
        return columns @ self.factors, np.sqrt(np.maximum(variance, 0.0))
