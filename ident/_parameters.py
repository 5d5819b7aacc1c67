"""The fitted arrays of a model as one vector: names, limits, and units for a solver."""

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, final, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from ..models import AbstractNodes, AbstractSurface
from .core import FitError

Pairs = Any
"""A tree shaped like the model, or a mapping of names: a pair of numbers or None each."""


def fitted_arrays(model: Any, fitted: Sequence[str] | None) -> Any:
    """Return the filter of the arrays to fit."""
    fitted = (fitted,) if isinstance(fitted, str) else fitted
    if fitted is None:
        positions = (AbstractNodes, AbstractSurface)
        return jax.tree.map(
            lambda leaf: not isinstance(leaf, positions) and eqx.is_inexact_array(leaf),
            model,
            is_leaf=lambda leaf: isinstance(leaf, positions),
        )
    arrays = eqx.filter(model, eqx.is_inexact_array)
    known = [path_name(path) for path, _ in jtu.tree_leaves_with_path(arrays)]
    for name in fitted:
        if not any((own + ".").startswith(f"{name}.") for own in known):
            msg = f"fitted: found {name}, expected some of {', '.join(known)}"
            raise FitError(msg)
    return jtu.tree_map_with_path(
        lambda path, leaf: (
            eqx.is_inexact_array(leaf)
            and any((path_name(path) + ".").startswith(name + ".") for name in fitted)
        ),
        model,
    )


def path_name(path: Any) -> str:
    return jtu.keystr(path, simple=True, separator=".")


@final
@dataclasses.dataclass(frozen=True)
class Form:
    """How the fitted arrays of a model lie in one vector."""

    structure: Any
    shapes: tuple[tuple[int, ...], ...]
    paths: tuple[str, ...]
    """Name of each array."""

    @classmethod
    def of(cls, params: Any) -> "Form":
        """Return the form of arrays.

        Raises:
            FitError: If there is none.
        """
        leaves = jtu.tree_leaves_with_path(params)
        if not leaves:
            msg = (
                "found no array to fit in the model, expected one of floats: "
                "jnp.asarray(1.0), as the number 1.0 counts as known"
            )
            raise FitError(msg)
        shapes = tuple(jnp.shape(leaf) for _, leaf in leaves)
        paths = tuple(path_name(path) for path, _ in leaves)
        return cls(jax.tree.structure(params), shapes, paths)

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many numbers each array has."""
        return tuple(math.prod(shape) for shape in self.shapes)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each number."""
        return tuple(
            path + (f"[{', '.join(map(str, place))}]" if place else "")
            for path, shape in zip(self.paths, self.shapes, strict=True)
            for place in np.ndindex(shape)
        )

    def flat(self, params: Any) -> Float[Array, " p"]:
        return jnp.concatenate(
            [jnp.ravel(as_float(x)) for x in jax.tree.leaves(params)]
        )

    def tree(self, values: Float[Array, " p"]) -> Any:
        ends = np.cumsum(self.sizes)[:-1]
        parts = jnp.split(values, ends)
        leaves = [jnp.reshape(p, s) for p, s in zip(parts, self.shapes, strict=True)]
        return jax.tree.unflatten(self.structure, leaves)

    def pairs(
        self, given: Pairs, default: tuple[float, float], what: str, whole: bool = False
    ) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Return the first and the second number of all pairs, as two vectors.

        Args:
            given: Pairs; where one is None, or one of its numbers, the default counts.
            default: Pair of numbers.
            what: They are, in words.
            whole: Whether a pair has both its numbers.

        Raises:
            FitError: If a name is unknown, or a pair is none or of another shape.
        """
        if given is None or isinstance(given, Mapping):
            named = dict(given or {})
        else:
            leaves = jtu.tree_leaves_with_path(given, is_leaf=_is_pair)
            named = {path_name(path): pair for path, pair in leaves}
            # What is not fitted may have a place in the tree.
            named = {path: named[path] for path in self.paths if path in named}
            if not named:
                expected = f"pairs by name: {{{self.paths[0]!r}: (0.0, 1.0)}}"
                msg = f"{what}: found {given!r}, expected {expected}"
                raise FitError(msg)
        unknown = [name for name in named if name not in self.paths]
        if unknown:
            known = ", ".join(self.paths)
            msg = f"{what}: found {', '.join(unknown)}, expected some of {known}"
            raise FitError(msg)
        sides: tuple[list[Array], list[Array]] = ([], [])
        for path, shape in zip(self.paths, self.shapes, strict=True):
            pair = named.get(path)
            if not _is_pair(pair) or (whole and pair is not None and None in pair):
                numbers = "a pair of numbers" if whole else "a pair"
                msg = f"{what} of {path}: found {pair!r}, expected {numbers} or None"
                raise FitError(msg)
            for side, one, other in zip(sides, pair or default, default, strict=True):
                value = other if one is None else one
                side.append(jnp.ravel(broadcast(value, shape, f"{what} of {path}")))
        return jnp.concatenate(sides[0]), jnp.concatenate(sides[1])

    def check(
        self,
        pairs: tuple[Float[Array, " p"], Float[Array, " p"]],
        rule: Callable[[Any, Any], Any],
        words: str,
    ) -> None:
        """Check the pairs of all numbers; where they are traced, nothing is known of them.

        Raises:
            FitError: If a pair does not keep the rule; NaN keeps none.
        """
        if any(isinstance(side, Tracer) for side in pairs):
            return
        first, second = map(np.asarray, pairs)
        wrong = np.flatnonzero(~rule(first, second))
        if wrong.size:
            at = wrong[0]
            found = f"{self.names[at]}: found {first[at]:g} and {second[at]:g}"
            msg = f"{found}, expected {words}"
            raise FitError(msg)


def _is_pair(node: Any) -> bool:
    return node is None or (type(node) in (tuple, list) and len(node) == 2)


@final
class Scaled(eqx.Module):
    """Numbers in units that change the residual by its size at the start, within limits.

    Beyond a limit they stand still: a solver that knows no limits comes to rest there.
    """

    start: Float[Array, " p"]
    unit: Float[Array, " p"]
    limits: tuple[Float[Array, " p"], Float[Array, " p"]]
    length: Float[Array, ""]
    """Of the residual at the start."""

    @classmethod
    def of(
        cls,
        residual: Callable[[Float[Array, " p"]], Float[Array, " r"]],
        start: Float[Array, " p"],
        limits: tuple[Float[Array, " p"], Float[Array, " p"]],
    ) -> "Scaled":
        """Return the numbers about a start, which is moved into its limits."""
        low, high = limits
        start = jnp.clip(start, low, high)
        off, design = residual(start), jax.jacfwd(residual)(start)
        length = jnp.linalg.norm(off)
        length = jnp.where(length > 0, length, 1.0)
        norms = jnp.linalg.norm(design, axis=0)
        felt = jnp.isfinite(norms) & (norms > 0)
        natural = jnp.where(start != 0, jnp.abs(start), 1.0)
        unit = jnp.where(felt, length / jnp.where(felt, norms, 1.0), natural)
        width = high - low
        unit = jnp.where(width > 0, jnp.minimum(unit, width), unit)
        # What the cost pushes against its limit begins beyond it, where it has no slope.
        slope = off @ design
        start = jnp.where((start <= low) & (slope > 0), low - unit, start)
        start = jnp.where((start >= high) & (slope < 0), high + unit, start)
        return cls(*jax.lax.stop_gradient((start, unit, limits, length)))

    def values(self, x: Float[Array, " p"]) -> Float[Array, " p"]:
        """Return the numbers of the model; on a limit their derivative is that inside."""
        low, high = self.limits
        free = self.start + self.unit * x
        return jnp.where(free < low, low, jnp.where(free > high, high, free))

    def at_rest(
        self, values: Float[Array, " p"], slope: Float[Array, " p"]
    ) -> Bool[Array, ""]:
        """Return whether the cost pushes all that stands on a limit against it."""
        low, high = self.limits
        inward = ((values <= low) & (slope < 0)) | ((values >= high) & (slope > 0))
        return ~jnp.any(inward & (low < high))


@runtime_checkable
class _Column(Protocol):
    """What NumPy can read: its arrays and numbers, columns of pandas, polars or pyarrow."""

    def __array__(self) -> np.ndarray: ...


def as_float(value: Any) -> Any:
    """Return numbers as an array of 64-bit floats, integers of arrays as they are."""
    if isinstance(value, Array):
        wide = jnp.issubdtype(value.dtype, jnp.floating)
        return value.astype(jnp.float64) if wide else value
    if np.ma.is_masked(value):
        value = np.ma.filled(np.ma.asarray(value).astype(float), np.nan)
    if isinstance(value, int | float | Sequence | _Column):
        return jnp.asarray(value, jnp.float64)
    return value


def number_of(value: Any, what: str) -> Array:
    """Return a number as an array of no dimension, or what may be traced as it is.

    Raises:
        FitError: If it is none.
    """
    with contextlib.suppress(TypeError, ValueError):
        number = None if isinstance(value, str) else as_float(value)
        if isinstance(number, Array) and not number.ndim:
            return number
    msg = f"{what}: found {value!r}, expected a number"
    raise FitError(msg)


def readings_of(measured: Any) -> Array:
    """Return readings as an array.

    Raises:
        FitError: If they are no numbers.
    """
    with contextlib.suppress(TypeError, ValueError):
        readings = None if isinstance(measured, str) else as_float(measured)
        if isinstance(readings, Array):
            return readings
    found = type(measured).__name__
    msg = f"measured: found {found}, expected an array of numbers"
    raise FitError(msg)


def inputs_of(inputs: Any) -> Any:
    """Return a tree of inputs with arrays of 64-bit floats; a list of numbers is one array."""

    def is_row(node: Any) -> bool:
        return isinstance(node, list) and all(isinstance(x, int | float) for x in node)

    return jax.tree.map(as_float, inputs, is_leaf=is_row)


def broadcast(value: Any, shape: tuple[int, ...], what: str) -> Array:
    """Return numbers in a shape that they have, or can be repeated to.

    Raises:
        FitError: If they cannot.
    """
    try:
        return jnp.broadcast_to(as_float(value), shape)
    except ValueError:
        msg = f"{what}: found shape {np.shape(value)}, expected {shape}"
        raise FitError(msg) from None


def as_measured(predicted: Any, shape: tuple[int, ...]) -> Array:
    """Return predictions, which have the shape of the readings.

    Raises:
        FitError: If they do not.
    """
    if np.shape(predicted) != shape:
        msg = (
            f"predict: found shape {np.shape(predicted)}, expected that of the "
            f"readings, {shape}"
        )
        raise FitError(msg)
    return jnp.asarray(predicted)


def weights_of(measured: Float[Array, "..."], given: ArrayLike | None) -> Array:
    """Return the weight of each reading.

    Raises:
        FitError: If they are of another shape, one is below 0, a reading that counts is no
            number, or none counts.
    """
    weights = broadcast(1.0 if given is None else given, measured.shape, "weights")
    if not isinstance(weights, Tracer):
        if not np.all((np.asarray(weights) >= 0) & np.isfinite(weights)):
            msg = "weights: found one below 0 or not finite, expected 0 or more"
            raise FitError(msg)
        if not np.any(np.asarray(weights) > 0):
            msg = "measured: found no reading of a weight above 0, expected some"
            raise FitError(msg)
        if not isinstance(measured, Tracer):
            # By NumPy: under jit, JAX traces what it computes of constants, too.
            used = np.asarray(weights) > 0
            lost = np.flatnonzero(used & ~np.isfinite(np.asarray(measured)))
            if lost.size:
                msg = (
                    f"measured: reading {lost[0]} is not finite; weight 0 leaves it out"
                )
                raise FitError(msg)
    return weights
