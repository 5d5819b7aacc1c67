"""A model as a graph of CasADi: its own arithmetic, traced by JAX and carried over.

JAX writes down what a model does with one row of positions (its jaxpr). All that does not depend
on the positions is computed at once; what remains are a few scalar operations, searches of cells
and look-ups in constant tables. No law is written twice.
"""

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal
from jaxtyping import Array, Float

from ...data.errors import AxcompError
from ..exchange import ExchangeError
from ._arithmetic import MOVES, REDUCTIONS, elementwise

OffsetLaw = Callable[[Float[Array, "t a"]], Float[Array, "t a"]]
"""From positions of all axes in mm or ° to their offsets; row by row, without memory."""


class UntraceableError(AxcompError, ValueError):
    """A model does something that no C code is made of."""

    def __init__(self, operation: str) -> None:
        super().__init__(operation)
        self.operation = operation

    def __str__(self) -> str:
        return (
            f"the model: found the operation {self.operation!r} on positions, expected"
            " arithmetic, comparisons and look-ups in constant tables (axcomp.models)"
        )


def casadi_function(law: OffsetLaw, axes: int, name: str) -> ca.Function:
    """Return the offsets of all axes as a CasADi function of their positions.

    Args:
        law: From positions, shape ``(t, axes)``, to offsets; its arrays become constants.
        axes: Number of axes.
        name: Of the function.

    Raises:
        UntraceableError: If the model does what the graph cannot hold.
        ExchangeError: If its offsets are not those of all axes.
    """
    try:
        traced = jax.make_jaxpr(law)(jnp.zeros((1, axes)))
    except jax.errors.JAXTypeError:
        # NumPy, float() or if look at a value while the model is traced.
        name = "conversion to a number"
        raise UntraceableError(name) from None
    shapes = [each.shape for each in traced.out_avals]
    if shapes != [(1, axes)]:
        raise ExchangeError(
            where="the model",
            found=f"offsets of shape {', '.join(map(str, shapes))}",
            expected=f"{(1, axes)}: one offset of each axis for a row of positions",
        )
    positions = ca.MX.sym("position", axes)
    (found,) = _run(traced, [_array((positions[k] for k in range(axes)), (1, axes))])
    offsets = ca.vertcat(*_expressions(found).reshape(-1))
    return ca.Function(name, [positions], [ca.cse(offsets)])


_Value = np.ndarray
"""Constants, or, where the type is object, expressions of the positions."""


def _moves(value: _Value) -> bool:
    return bool(value.dtype == object)


def _array(elements: Iterable[Any], shape: Sequence[int]) -> _Value:
    """Return an array of expressions, which NumPy must not look into."""
    return np.fromiter(elements, dtype=object).reshape(shape)


def _expressions(value: _Value) -> _Value:
    """Return a value with constants as expressions, too."""
    if _moves(value):
        return value
    return _array((ca.MX(float(one)) for one in value.reshape(-1)), value.shape)


def _run(closed: ClosedJaxpr, inputs: Sequence[_Value]) -> list[_Value]:
    """Return what a traced function gives."""
    jaxpr = closed.jaxpr
    values: dict[Any, _Value] = dict(zip(jaxpr.invars, inputs, strict=True))
    values |= zip(jaxpr.constvars, map(np.asarray, closed.consts), strict=True)

    def read(variable: Any) -> _Value:
        if isinstance(variable, Literal):
            return np.asarray(variable.val)
        return values[variable]

    for equation in jaxpr.eqns:
        found = _apply(equation, [read(one) for one in equation.invars])
        values.update(zip(equation.outvars, found, strict=True))
    return [read(one) for one in jaxpr.outvars]


def _apply(equation: JaxprEqn, inputs: Sequence[_Value]) -> list[_Value]:
    name, params = equation.primitive.name, equation.params
    moving = any(map(_moves, inputs))
    inner = params.get("jaxpr", params.get("call_jaxpr"))
    if inner is not None:
        if moving and (special := _SPECIAL.get(str(params.get("name")))):
            return [special(*inputs)]
        closed = inner if isinstance(inner, ClosedJaxpr) else ClosedJaxpr(inner, ())
        return _run(closed, inputs)
    if not moving:
        return _bound(equation, *inputs)
    if (operation := elementwise(name, params)) is not None:
        return [_elementwise(operation, *inputs)]
    if name in REDUCTIONS:
        return [_reduced(REDUCTIONS[name], inputs[0], params["axes"])]
    held = MOVES.get(name, ()) or range(len(inputs))
    fixed = (one for k, one in enumerate(inputs) if k not in held)
    if name in MOVES and not any(map(_moves, fixed)):
        return _moved(equation, inputs, held)
    if name in _OPERATIONS:
        return [_OPERATIONS[name](equation, *inputs)]
    raise UntraceableError(name)


def _elementwise(function: Callable[..., Any], *inputs: _Value) -> _Value:
    parts = np.broadcast_arrays(*map(_expressions, inputs))
    return _array(map(function, *(one.flat for one in parts)), parts[0].shape)


def _reduced(
    function: Callable[..., Any], value: _Value, axes: Sequence[Any]
) -> _Value:
    last = np.moveaxis(value, axes, range(-len(axes), 0))
    shape = last.shape[: value.ndim - len(axes)]
    rows = last.reshape(math.prod(shape), -1)
    return _array((functools.reduce(function, row) for row in rows), shape)


def _moved(
    equation: JaxprEqn, inputs: Sequence[_Value], held: Sequence[int]
) -> list[_Value]:
    """Return elements at other places: an operation that moves their numbers moves them."""
    ends = np.cumsum([0, *(one.size for one in inputs)])
    numbers = [
        np.arange(ends[k], ends[k + 1]).reshape(one.shape) if k in held else one
        for k, one in enumerate(inputs)
    ]
    parts = [
        _expressions(one) if k in held else one.astype(object)
        for k, one in enumerate(inputs)
    ]
    pool = np.concatenate([one.reshape(-1) for one in parts])
    found = _bound(equation, *numbers)
    return [pool[each.reshape(-1)].reshape(each.shape) for each in found]


# ------------------------------------------------------------ tables and their cells


def _interpolate(equation: JaxprEqn, values: _Value, *where: _Value) -> _Value:
    """Return the (bi)linear value of a table, as `axcomp.models` defines it."""
    tables = _constant(values, equation).reshape(-1, *equation.params["shape"])
    number = np.zeros((), dtype=int)
    if equation.params["stacked"]:
        number, where = _constant(where[0], equation), where[1:]
    numbers, *places = np.broadcast_arrays(number, *map(_expressions, where))
    rows = zip(*(one.flat for one in (numbers, *places)), strict=True)
    found = (_look_up(tables[own][..., None], at) for own, *at in rows)
    return _array(found, numbers.shape)


def _gather(equation: JaxprEqn, table: _Value, index: _Value) -> _Value:
    """Return the entries of a constant table at numbers that positions decide."""
    entries, dimensions = (
        _constant(table, equation),
        equation.params["dimension_numbers"],
    )
    if index.shape[-1] != 1:
        what = "gather along several axes at once"
        raise UntraceableError(what)
    axis = dimensions.start_index_map[0]
    count = entries.shape[axis] - equation.params["slice_sizes"][axis] + 1
    primitive: Any = equation.primitive

    def entry(number: Any) -> Any:
        at = jnp.full(index.shape, number)
        return primitive.bind(entries, at, **equation.params)

    columns = np.asarray(jax.vmap(entry)(jnp.arange(count, dtype=jnp.int32)))
    shape = columns.shape[1:]
    asked = np.expand_dims(index[..., 0], dimensions.offset_dims)
    # What the same expression asks for is looked up together.
    places: dict[int, tuple[Any, list[int]]] = {}
    for k, one in enumerate(np.broadcast_to(asked, shape).flat):
        places.setdefault(id(one), (one, []))[1].append(k)
    columns = columns.reshape(count, -1)
    found = np.empty(columns.shape[1], dtype=object)
    for one, here in places.values():
        together = _look_up(columns[:, here], [one])
        found[here] = _array((together[k] for k in range(len(here))), (len(here),))
    return found.reshape(shape)


def _cell(points: _Value, position: _Value) -> _Value:
    """Return the cell of a position between ascending points."""
    nodes = np.asarray(points)
    last = float(nodes.size - 2)
    count = _interpolant(np.arange(nodes.size, dtype=float), [nodes], "binary")

    def search(place: Any) -> Any:
        return ca.fmin(ca.fmax(ca.floor(count(place)), 0.0), last)

    return _elementwise(search, position)


# ------------------------------------------------------------------ sums of products


def _dot(equation: JaxprEqn, left: _Value, right: _Value) -> _Value:
    """Return the product of two arrays of numbers."""
    (first, second), (batch1, batch2) = equation.params["dimension_numbers"]
    rows, free1 = _in_order(_expressions(left), batch1, first)
    columns, free2 = _in_order(_expressions(right), batch2, second)
    batch = tuple(left.shape[k] for k in batch1)
    found = np.matmul(rows, columns.swapaxes(1, 2))
    return np.asarray(found).reshape((*batch, *free1, *free2))


def _scatter_add(
    equation: JaxprEqn, operand: _Value, index: _Value, updates: _Value
) -> _Value:
    """Return an array with numbers added to some of its elements."""
    into, more = _expressions(operand).copy(), _expressions(updates)
    where = _constant(index, equation)
    for place in np.ndindex(more.shape):
        one = np.zeros(more.shape)
        one[place] = 1.0
        there = _bound(equation, np.zeros(into.shape), where, one)[0]
        for at in zip(*np.nonzero(there), strict=True):
            into[at] = into[at] + more[place]
    return into


_SPECIAL: dict[str, Callable[..., _Value]] = {
    "cell_of": _cell,
    "whole": lambda number: number,
}
"""Functions of `axcomp.models` that are carried over as a whole, by name."""

_OPERATIONS: dict[str, Callable[..., _Value]] = {
    "table_interpolate": _interpolate,
    "gather": _gather,
    "dot_general": _dot,
    "scatter-add": _scatter_add,
}


def _bound(equation: JaxprEqn, *inputs: Any) -> list[Any]:
    primitive: Any = equation.primitive
    found = primitive.bind(*inputs, **equation.params)
    parts = found if isinstance(found, (list, tuple)) else [found]
    return [np.asarray(one) for one in parts]


def _constant(value: _Value, equation: JaxprEqn) -> np.ndarray:
    if _moves(value):
        what = f"{equation.primitive.name} of a table that moves"
        raise UntraceableError(what)
    return value


def _look_up(table: np.ndarray, place: Sequence[Any]) -> Any:
    """Return the linear interpolation at places counted in nodes, which lie in the table.

    Args:
        table: An axis per place, and one more for what is looked up together.
        place: Expressions.
    """
    wide = [axis for axis, _ in enumerate(place) if table.shape[axis] > 1]
    values = table.reshape([*(table.shape[axis] for axis in wide), -1])
    if not wide:
        return ca.MX(ca.DM(values))
    # CasADi counts what is looked up together fastest, then the first axis.
    axes = [np.arange(count, dtype=float) for count in reversed(values.shape[:-1])]
    return _interpolant(values.reshape(-1), axes, "exact")(
        ca.vertcat(*(place[axis] for axis in reversed(wide)))
    )


def _interpolant(values: np.ndarray, axes: Sequence[np.ndarray], search: str) -> Any:
    options = {"lookup_mode": [search] * len(axes)}
    return ca.interpolant("table", "linear", axes, values, options)


def _in_order(
    numbers: np.ndarray, batch: Sequence[Any], summed: Sequence[Any]
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Return an array as batch × free × summed, and the shape of what is free."""
    free = [k for k in range(numbers.ndim) if k not in (*batch, *summed)]
    size = [math.prod(numbers.shape[k] for k in part) for part in (batch, free, summed)]
    order = numbers.transpose((*batch, *free, *summed))
    return order.reshape(size), tuple(numbers.shape[k] for k in free)
