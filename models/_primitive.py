"""Interpolation in tables as a JAX primitive with a fast transpose.

JAX lets a user choose the transpose of a function only by `custom_vjp`, which forbids
forward mode (its `linear_call` cannot be batched). Hence two primitives, each linear in
its first argument and each the other's transpose: `jvp`, `vjp`, `vmap` and any nesting
of them work, and each reaches the chunked scatter of `_kernels`.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Float, Int

from ._kernels import gather, scatter


def interpolate(
    values: Float[Array, " n"],
    coordinates: Sequence[Float[Array, " t"]],
    shape: tuple[int, ...],
    table: Int[Array, " t"] | None = None,
) -> Float[Array, " t"]:
    """Return the table's value at each sample, (bi)linear, in the unit of the values.

    Args:
        values: Flattened table, last axis fastest; several tables of equal shape may
            stand one behind the other.
        coordinates: Per axis of `shape` the place of each sample counted in nodes, from
            0 to count − 1 (`AbstractNodes.coordinate`).
        shape: Number of nodes per axis.
        table: Which of the tables each sample uses, from 0; None: there is only one.

    Differentiable in values and coordinates. At a node the derivative with respect to a
    coordinate is that of the cell which begins there; at the last node that of the last
    cell (the nodes themselves see to the derivative outside).
    """
    inputs = coordinates if table is None else (table, *coordinates)
    form = jnp.shape(inputs[-1])
    if len(form) != 1:  # one position, or rows of them
        inputs = [jnp.ravel(each) for each in inputs]
    result: Float[Array, " t"] = _interpolate_p.bind(
        values, *inputs, shape=tuple(shape), stacked=table is not None
    )
    return result if len(form) == 1 else result.reshape(form)


# Both primitives take (linear argument, *inputs): the inputs are coordinates, and before
# them the number of the table per sample if the tables are `stacked`.


def _split(inputs: Sequence[Any], stacked: bool) -> tuple[Any | None, Sequence[Any]]:
    return (inputs[0], inputs[1:]) if stacked else (None, inputs)


def _gather(
    values: Array, *inputs: Array, shape: tuple[int, ...], stacked: bool
) -> Array:
    table, coordinates = _split(inputs, stacked)
    return gather(values, coordinates, shape, table)


def _scatter(
    amounts: Array, *inputs: Array, shape: tuple[int, ...], stacked: bool, tables: int
) -> Array:
    table, coordinates = _split(inputs, stacked)
    return scatter(amounts, coordinates, shape, table, tables)


def _interpolate_shape(values: Any, *inputs: Any, **_: Any) -> Any:
    return ShapedArray(inputs[-1].shape, values.dtype)


def _accumulate_shape(
    amounts: Any, *_: Any, shape: tuple[int, ...], stacked: bool, tables: int
) -> Any:
    del stacked
    return ShapedArray((tables * math.prod(shape),), amounts.dtype)


# ---------------------------------------------------------------------- differentiation


def _jvp(
    primitive: Any,
    evaluate: Callable[..., Any],
    primals: Sequence[Any],
    tangents: Sequence[Any],
    **params: Any,
) -> tuple[Any, Any]:
    """Differentiate: the primitive in its linear argument, `evaluate` in coordinates."""
    linear, *inputs = primals
    parts = []
    if not isinstance(tangents[0], ad.Zero):
        parts.append(primitive.bind(tangents[0], *inputs, **params))
    moving = [
        number
        for number, tangent in enumerate(tangents)
        if number > int(params["stacked"]) and not isinstance(tangent, ad.Zero)
    ]
    if moving:

        def shifted(*places: Any) -> Any:
            arguments = list(primals)
            for number, place in zip(moving, places, strict=True):
                arguments[number] = place
            return evaluate(*arguments, **params)

        parts.append(
            jax.jvp(
                shifted,
                tuple(primals[number] for number in moving),
                tuple(tangents[number] for number in moving),
            )[1]
        )
    result = primitive.bind(linear, *inputs, **params)
    if not parts:
        return result, ad.Zero(jax.typeof(result))
    return result, functools.reduce(jnp.add, parts)


def _interpolate_transpose(
    cotangent: Any, values: Any, *inputs: Any, **params: Any
) -> Any:
    if isinstance(cotangent, ad.Zero):
        return (ad.Zero(values.aval), *(None for _ in inputs))
    tables = values.aval.size // math.prod(params["shape"])
    amounts = _accumulate_p.bind(cotangent, *inputs, tables=tables, **params)
    return (amounts, *(None for _ in inputs))


def _accumulate_transpose(
    cotangent: Any, amounts: Any, *inputs: Any, tables: int, **params: Any
) -> Any:
    del tables
    if isinstance(cotangent, ad.Zero):
        return (ad.Zero(amounts.aval), *(None for _ in inputs))
    return (_interpolate_p.bind(cotangent, *inputs, **params), *(None for _ in inputs))


# ------------------------------------------------------------------------------- vmap


def _flat_batch(
    inputs: Sequence[Any], dims: Sequence[Any], batch: int, tables: int, stacked: bool
) -> list[Any]:
    """Flatten a batch: entry k looks at table k of a stack, `tables` apart."""
    flat = [_flatten(leaf, dim, batch) for leaf, dim in zip(inputs, dims, strict=True)]
    samples = flat[-1].size // batch
    entry = jnp.repeat(jnp.arange(batch, dtype=jnp.int32) * tables, samples)
    if stacked:
        return [flat[0].astype(jnp.int32) + entry, *flat[1:]]
    return [entry, *flat]


def _flatten(array: Any, dim: int | None, batch: int) -> Any:
    if dim is None:
        return jnp.broadcast_to(array[None], (batch, array.size)).reshape(-1)
    return jnp.moveaxis(array, dim, 0).reshape(-1)


def _batch_size(arrays: Sequence[Any], dims: Sequence[Any]) -> int:
    return next(
        int(array.shape[dim])
        for array, dim in zip(arrays, dims, strict=True)
        if dim is not None
    )


def _interpolate_batch(
    arrays: Sequence[Any], dims: Sequence[Any], *, shape: tuple[int, ...], stacked: bool
) -> tuple[Any, int]:
    batch = _batch_size(arrays, dims)
    values, *inputs = arrays
    shared = dims[0] is None
    tables = (values.size if shared else values.size // batch) // math.prod(shape)
    # A whole batch on one shared table needs no stack: each entry looks at table 0.
    row = _flat_batch(inputs, dims[1:], batch, 0 if shared else tables, stacked)
    if shared and not stacked:
        row = row[1:]
    flat = values if shared else _flatten(values, dims[0], batch)
    result = _interpolate_p.bind(flat, *row, shape=shape, stacked=stacked or not shared)
    return result.reshape(batch, -1), 0


def _accumulate_batch(
    arrays: Sequence[Any],
    dims: Sequence[Any],
    *,
    shape: tuple[int, ...],
    stacked: bool,
    tables: int,
) -> tuple[Any, int]:
    batch = _batch_size(arrays, dims)
    amounts = _flatten(arrays[0], dims[0], batch)
    row = _flat_batch(arrays[1:], dims[1:], batch, tables, stacked)
    result = _accumulate_p.bind(
        amounts, *row, shape=shape, stacked=True, tables=batch * tables
    )
    return result.reshape(batch, -1), 0


# ----------------------------------------------------------------------- registration


def _primitive(
    name: str, run: Any, static: tuple[str, ...], abstract: Any
) -> Any:  # JAX leaves the methods of a primitive untyped
    primitive: Any = Primitive(name)
    primitive.def_impl(jax.jit(run, static_argnames=static))
    primitive.def_abstract_eval(abstract)
    mlir.register_lowering(primitive, mlir.lower_fun(run, multiple_results=False))
    return primitive


_interpolate_p = _primitive(
    "table_interpolate", _gather, ("shape", "stacked"), _interpolate_shape
)
_accumulate_p = _primitive(
    "table_accumulate", _scatter, ("shape", "stacked", "tables"), _accumulate_shape
)
ad.primitive_jvps[_interpolate_p] = functools.partial(_jvp, _interpolate_p, _gather)
ad.primitive_jvps[_accumulate_p] = functools.partial(_jvp, _accumulate_p, _scatter)
ad.primitive_transposes[_interpolate_p] = _interpolate_transpose
ad.primitive_transposes[_accumulate_p] = _accumulate_transpose
batching.primitive_batchers[_interpolate_p] = _interpolate_batch
batching.primitive_batchers[_accumulate_p] = _accumulate_batch
