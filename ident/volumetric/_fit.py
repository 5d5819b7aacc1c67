"""The fit of a volumetric error: points in, model with uncertainty out."""

import dataclasses
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, final

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from ...models import GeometricErrors
from ..core import (
    DriftNoise,
    Estimate,
    FitError,
    Passes,
    Stack,
    least_scale,
    memory,
    one_blas_thread,
    scatter_of_sums,
)
from ..fit.joint._memory import drift_beside
from ._blocks import FRAME_NAME, ZEROS_NAME, Block, zeros
from ._effects import AbstractVolumetric
from ._freedoms import Freedoms, Gauge, Shapes, Undetermined, degrees_of, rows_of
from ._points import Points
from ._words import (
    beyond_sentence,
    drift_sentence,
    hidden_sentence,
    tool_sentence,
    undetermined_sentence,
)

Tool = tuple[float, float, float] | None

_SAME_TOOL = 1e-3
"""Difference in mm up to which a tool is the one that was measured with."""
_LARGE = 1 << 22
"""Readings × unknowns up to which a drift is carried to every value."""
_EXACT = 1e-6
"""Noise, relative to the size of the readings, that is what passes leave of exact ones."""
_MANY = 200
"""Shapes from which on a drift is sought in the first points only: each set-up has its own."""
_PLACES = 1000
"""All over the volume, at which it is asked whether the points tell the offsets."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """Error at other points.

    Attributes:
        error: In X, Y and Z in mm.
        standard_deviation: Of it, without the noise of a reading; inf where the points of the
            fit do not tell it, and beyond the volume of the model, which holds its edge there.
    """

    error: Float[np.ndarray, "t 3"]
    standard_deviation: Float[np.ndarray, "t 3"]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class VolumetricFit:
    """A fitted volumetric error.

    Attributes:
        effect: As it was stated.
        points: As they were given.
        blocks: Groups of unknowns.
        left_out: Those that only other tools would show.
        stack: The former, as the estimator takes them.
        freedoms: Rules of the gauge, and what the points do not tell.
        result: Of the estimator.
    """

    effect: AbstractVolumetric
    points: Points
    blocks: tuple[Block, ...]
    left_out: tuple[Block, ...]
    stack: Stack
    freedoms: Freedoms
    result: Estimate

    @property
    def noise(self) -> float:
        """Standard deviation of one reading, wild ones left out, in mm."""
        return self.result.noise

    @property
    def converged(self) -> bool:
        """Whether the iterations reached their tolerance."""
        return self.result.converged

    @property
    def gauges(self) -> tuple[Gauge, ...]:
        """What no measurement tells apart, and what was set to zero for it."""
        return self.freedoms.gauges

    @property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """What these points do not tell: no value of it may be relied on."""
        left_out = (
            Undetermined(
                ((block.name, tuple(dict.fromkeys(block.labels))),), block.size, True
            )
            for block in self.left_out
        )
        return (*self.freedoms.undetermined, *left_out)

    @cached_property
    def values(self) -> Float[np.ndarray, " n"]:
        """All unknowns under the rules, as errors; of what is hidden no more than is shown."""
        found = self.freedoms.rules.project(self.result.values)
        readings = self.points.readings
        shown, here = readings.value, self._places.get(ZEROS_NAME)
        if here is not None:  # what any zero of the set-ups leaves
            zero = rows_of(self.stack, readings)[:, here]
            normal = np.linalg.pinv((zero.T @ zero).toarray(), hermitian=True)
            shown = shown - zero @ (normal @ (zero.T @ shown))
        return self.freedoms.held(found, self.noise, shown)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """Covariance of all unknowns under the rules, where the points tell them.

        Beyond that of readings that err by themselves it has what their `drift` adds: to every
        value, or, of very many, to the shapes by which readings are judged.
        """
        post = self.result.posterior
        with one_blas_thread():
            half = self.freedoms.rules.project(post.factor.border_inverse)
            white = np.asarray(post.variance * self.freedoms.rules.project(half.T))
            if self.drift is None:
                return white
            rows, clock, _ = self._believed
            few = len(clock) * len(white) <= _LARGE
            basis = np.eye(len(white)) if few else self._shapes.basis
            moves = rows @ (half.T @ basis)
            more = scatter_of_sums(self.drift, clock, moves)
            more -= post.variance * (moves.T @ moves)
            return np.asarray(white + basis @ more @ basis.T)

    @cached_property
    def drift(self) -> DriftNoise | None:
        """Noise of readings that follow each other and err alike; None where none does."""
        (rows, clock, pseudo), basis = self._believed, self._shapes.basis
        if self.noise < _EXACT * np.std(self.points.readings.value):
            return None
        share = min(1.0, _MANY / basis.shape[1]) ** 2
        some = slice(round(share * len(clock)))
        with one_blas_thread():
            return drift_beside(clock[some], rows[some] @ basis, pseudo[some])

    @cached_property
    def _shapes(self) -> Shapes:
        return Shapes.of(self.blocks)

    @cached_property
    def _believed(
        self,
    ) -> tuple[sp.csr_array, Float[np.ndarray, " s"], Float[np.ndarray, " s"]]:
        """Rows, places in the order and residuals of the readings that are believed."""
        readings, clock = self.points.readings, self.points.order
        rows = rows_of(self.stack, readings)
        pseudo = self.result.pseudo(readings.value - rows @ self.result.centre)
        order = np.argsort(clock)
        order = order[pseudo[order] != 0.0]
        return rows[order], clock[order], pseudo[order]

    @cached_property
    def _deviations(self) -> Float[np.ndarray, " n"]:
        spread = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return np.where(self.freedoms.confounded, np.inf, spread)

    @cached_property
    def _places(self) -> dict[str, slice]:
        """Unknowns of each block by its name."""
        return {block.name: self.stack.here(k) for k, block in enumerate(self.blocks)}

    def _by_name(
        self, values: Float[np.ndarray, " n"], empty: float
    ) -> dict[str, Float[np.ndarray, " _n"]]:
        """Return values by name of the block, those of blocks that were left out too."""
        full = {block.name: np.full(block.size, empty) for block in self.left_out}
        return full | {name: values[here] for name, here in self._places.items()}

    @cached_property
    def model(self) -> Any:
        """The model whose offsets take the error off; errors that nothing shows are 0."""
        return self.effect.to_model(self._by_name(self.values, 0.0), -1.0)

    def law(self, tool: Tool = None) -> Callable[[Any], Any]:
        """Return the offsets of the model as a function of positions, for one tool.

        Args:
            tool: That the machine works with, as in `Points`; None: that of the points.

        Raises:
            FitError: If the points have several and none is given.
        """
        offset: Callable[..., Any] = self.model.offset
        if not self._angles:
            return offset
        return partial(offset, tool=jnp.asarray(self._tool(tool)))

    def remarks(self, tool: Tool = None) -> tuple[str, ...]:
        """Return in sentences what whoever switches on the `law` of a tool must know."""
        own = self._tool(tool)
        places = np.random.default_rng(0).uniform(*self.effect.volume, (_PLACES, 3))
        found = self.predict(places, own, frame=False)
        told = float(np.isfinite(found.standard_deviation).all(axis=1).mean())
        beyond = self.effect.beyond(self.points.position)
        sentences = (
            tool_sentence(own.tolist()) if self._angles else "",
            beyond_sentence(beyond) if beyond.any() else "",
            hidden_sentence(1.0 - told) if told < 1.0 else "",
            *map(undetermined_sentence, self.undetermined),
            drift_sentence(self.drift, len(self.points.position)) if self.drift else "",
        )
        return tuple(filter(None, sentences))

    @property
    def _angles(self) -> bool:
        """Whether tools make a difference."""
        return isinstance(self.model, GeometricErrors)

    def _tool(self, tool: Tool) -> Float[np.ndarray, "3"]:
        tools = self.points.tools if tool is None else np.reshape(tool, (1, 3))
        if np.ptp(tools, axis=0).any() and self._angles:
            msg = "tool: found points with several, expected the one that the machine works with"
            raise FitError(msg)
        return np.asarray(tools[0], float)

    @cached_property
    def standard_deviation(self) -> Any:
        """Standard deviations, shaped like the model; inf where the points tell no value."""
        return self.effect.to_model(self._by_name(self._deviations, np.inf), 1.0)

    @cached_property
    def support(self) -> dict[str, Int[np.ndarray, " _n"]]:
        """Readings that touch each value, by name of the block."""
        touched = self.result.posterior.problem.sums.support
        return {name: touched[here] for name, here in self._places.items()}

    @property
    def frame(self) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]] | None:
        """Shift in mm and rotation in rad of the readings' frame, with its deviations.

        No error of the machine: a work offset takes it up. Zero where set-ups with places of
        their own take it up. None for a grid, which holds it.
        """
        here = self._places.get(FRAME_NAME)
        return None if here is None else (self.values[here], self._deviations[here])

    def predict(
        self,
        position: Float[np.ndarray, "t 3"],
        tool: Float[np.ndarray, "*t 3"] | None = None,
        frame: bool = True,
    ) -> Prediction:
        """Return the error at positions in mm, in the frame of the readings.

        Args:
            position: X, Y and Z in mm.
            tool: As in `Points`.
            frame: With the shift and rotation of the frame, as further readings would show it;
                without, what the model takes off.
        """
        where = Points(position, np.zeros(np.shape(position)), tool=tool).readings
        kept = np.ones(self.stack.size)
        for name in (ZEROS_NAME,) if frame else (ZEROS_NAME, FRAME_NAME):
            kept[self._places.get(name, slice(0))] = 0.0
        rows = sp.csr_array(rows_of(self.stack, where) * kept)
        variance = (rows * (rows @ self.covariance)).sum(axis=1)
        deviation = np.sqrt(np.maximum(variance, 0.0))
        beyond = self.effect.beyond(where.inputs["position"]).any(axis=1)
        deviation[beyond | ~self.freedoms.shown(rows)] = np.inf
        if self.left_out:
            other = np.abs(where.inputs["tool"] - self.points.tools[0]).max(axis=1)
            deviation[other > _SAME_TOOL] = np.inf
        return Prediction((rows @ self.values).reshape(-1, 3), deviation.reshape(-1, 3))


def fit_volumetric(
    effect: AbstractVolumetric, points: Points, *, loss: str = "student"
) -> VolumetricFit:
    r"""Fit a volumetric error to measured points.

    Readings are $e = \sum_k A_k \theta_k + \varepsilon$ over the stencil of the model: tables as
    Gaussian fields, their smoothness by evidence, robust by pseudo-readings, as in `axcomp.fit`.
    The 21 errors stand beside the frame of the readings (shift and rotation), which is no error
    of the machine. What may be moved between them is fixed by rules (`VolumetricFit.gauges`):
    functions have mean zero over their nodes, straightness no slope, and the angles between the
    axes keep what is left. What the points do not tell is named (`VolumetricFit.undetermined`).

    Args:
        effect: `Geometry` or `Volumetric`.
        points: Measured.
        loss: ``"student"`` and ``"huber"`` resist wild readings, ``"gauss"`` does not.

    Raises:
        FitError: If there are too few readings, or the loss is unknown.
    """
    readings = points.readings
    every = effect.blocks(degrees_of(readings.inputs["position"]))
    alike = not np.ptp(readings.inputs["tool"], axis=0).any()
    left_out = tuple(block for block in every if block.by_tools and alike)
    blocks = tuple(block for block in every if block not in left_out)
    if points.run is not None:
        blocks = (*blocks, zeros(readings, points.direction is None))
    stack = Stack(blocks, banded=False)
    with one_blas_thread():
        freedoms = Freedoms.of(stack, blocks, readings, effect.volume)
        if len(readings) <= freedoms.free:
            msg = (
                f"found {len(readings)} readings, expected more than {freedoms.free}: so many "
                "numbers rest on them alone"
            )
            raise FitError(msg)
        floor = least_scale(readings.value)
        over, pins = memory(stack, readings), freedoms.pins
        found = Passes(stack, over, loss, floor=floor, pins=pins).run()
    return VolumetricFit(effect, points, blocks, left_out, stack, freedoms, found)
