"""Sums over the last cycles as a JAX primitive with a fast transpose.

What XLA makes of a transposed sum of slices pads each of them and asks per element which
ones reach it: six times the time of the sum. Hence two primitives, each linear and each
the other's transpose, as with the tables (`_primitive`).
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float


def smooth(
    values: Float[Array, " n"], response: Float[np.ndarray, " m"]
) -> Float[Array, " t"]:
    """Return the values with each change spread as `response` says, from cycle m on."""
    if response.size == 1:
        return values
    result: Float[Array, " t"] = _smooth_p.bind(
        values, response=tuple(float(share) for share in response)
    )
    return result


# Both primitives work along the last axis, so that a batch is one more axis before it.


def _smooth(values: Array, *, response: tuple[float, ...]) -> Array:
    count = values.shape[-1] - len(response) + 1
    change = values[..., 1:] - values[..., :-1]
    # The oldest value and the part of each change since: summed in this order, a
    # constant stays itself and a step from 0 takes exactly the values of the response.
    result = values[..., :count]
    for lag, share in enumerate(response[::-1][1:]):
        if share != 0.0:
            result = result + share * change[..., lag : lag + count]
    return result


def _spread(amounts: Array, *, response: tuple[float, ...]) -> Array:
    """Return what of each amount goes back to which cycle: the transpose."""
    before = len(response) - 1
    count = amounts.shape[-1] + before
    around = [(0, 0)] * (amounts.ndim - 1) + [(before, before)]
    padded = jnp.pad(amounts, around)
    result = jnp.zeros((*amounts.shape[:-1], count))
    for lag, share in enumerate(np.diff(response, prepend=0.0)):
        if share != 0.0:
            result = result + float(share) * padded[..., lag : lag + count]
    return result


def _smooth_shape(values: Any, *, response: tuple[float, ...]) -> Any:
    count = values.shape[-1] - len(response) + 1
    return ShapedArray((*values.shape[:-1], count), values.dtype)


def _spread_shape(amounts: Any, *, response: tuple[float, ...]) -> Any:
    count = amounts.shape[-1] + len(response) - 1
    return ShapedArray((*amounts.shape[:-1], count), amounts.dtype)


def _linear(name: str, run: Any, abstract: Any) -> Any:
    """Return a primitive; JAX leaves the methods of one untyped."""
    primitive: Any = Primitive(name)
    primitive.def_impl(jax.jit(run, static_argnames=("response",)))
    primitive.def_abstract_eval(abstract)
    mlir.register_lowering(primitive, mlir.lower_fun(run, multiple_results=False))

    def batch(arrays: Sequence[Any], dims: Sequence[Any], **params: Any) -> Any:
        return primitive.bind(jnp.moveaxis(arrays[0], dims[0], 0), **params), 0

    batching.primitive_batchers[primitive] = batch
    return primitive


_smooth_p = _linear("cycles_smooth", _smooth, _smooth_shape)
_spread_p = _linear("cycles_spread", _spread, _spread_shape)


def _transposed(dual: Any) -> Any:
    def transpose(cotangent: Any, values: Any, **params: Any) -> Any:
        if isinstance(cotangent, ad.Zero):
            return (ad.Zero(values.aval),)
        return (dual.bind(cotangent, **params),)

    return transpose


ad.deflinear2(_smooth_p, _transposed(_spread_p))  # type: ignore[no-untyped-call]
ad.deflinear2(_spread_p, _transposed(_smooth_p))  # type: ignore[no-untyped-call]
