"""A model as a graph of CasADi: its own arithmetic, traced by JAX and carried over.

JAX writes down what a model does with one row of positions (its jaxpr). All that does not depend
on the positions is computed at once; what remains are a few scalar operations, searches of cells
and look-ups in constant tables. No law is written twice.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, final

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal
from jaxtyping import Array, Float

from ...data.errors import AxcompError
from ._arithmetic import ELEMENTWISE, MOVES, REDUCTIONS

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
    """
    traced = jax.make_jaxpr(law)(jnp.zeros((1, axes)))
    positions = ca.MX.sym("position", axes)
    graph = _Graph([positions[k] for k in range(axes)])
    (found,) = graph.run(traced, [_Ids(np.arange(axes).reshape(1, axes))])
    offsets = ca.vertcat(*graph.expressions(graph.ids(found).reshape(-1)))
    return ca.Function(name, [positions], [ca.cse(offsets)])


@final
class _Ids:
    """An array of expressions, by their numbers in the graph."""

    def __init__(self, numbers: Any) -> None:
        self.numbers = np.asarray(numbers, dtype=np.int64)


_Value = np.ndarray | _Ids
"""Constants, or expressions of the positions."""


@final
class _Graph:
    """The expressions so far, and how operations of JAX add to them."""

    def __init__(self, inputs: Sequence[Any]) -> None:
        self._nodes: list[Any] = list(inputs)

    def expressions(self, numbers: Iterable[int | np.int64]) -> list[Any]:
        return [self._nodes[k] for k in numbers]

    def ids(self, value: _Value) -> np.ndarray:
        """Return the numbers of the elements of a value; constants get their own."""
        if isinstance(value, _Ids):
            return value.numbers
        flat = [self._add(ca.MX(float(one))) for one in value.reshape(-1)]
        return np.array(flat, dtype=np.int64).reshape(value.shape)

    def run(self, closed: ClosedJaxpr, inputs: Sequence[_Value]) -> list[_Value]:
        """Return what a traced function gives."""
        jaxpr = closed.jaxpr
        values: dict[Any, _Value] = dict(zip(jaxpr.invars, inputs, strict=True))
        values |= zip(jaxpr.constvars, map(np.asarray, closed.consts), strict=True)

        def read(variable: Any) -> _Value:
            if isinstance(variable, Literal):
                return np.asarray(variable.val)
            return values[variable]

        for equation in jaxpr.eqns:
            found = self._apply(equation, [read(one) for one in equation.invars])
            values.update(zip(equation.outvars, found, strict=True))
        return [read(one) for one in jaxpr.outvars]

    def _apply(self, equation: JaxprEqn, inputs: Sequence[_Value]) -> list[_Value]:
        name, params = equation.primitive.name, equation.params
        moving = any(isinstance(one, _Ids) for one in inputs)
        inner = params.get("jaxpr", params.get("call_jaxpr"))
        if inner is not None:
            if moving and (special := _SPECIAL.get(str(params.get("name")))):
                return [special(self, *inputs)]
            closed = inner if isinstance(inner, ClosedJaxpr) else ClosedJaxpr(inner, ())
            return self.run(closed, inputs)
        if not moving:
            return _bound(equation, *inputs)
        if name in ELEMENTWISE:
            return [self._elementwise(ELEMENTWISE[name](params), inputs)]
        if name in REDUCTIONS:
            axes = [int(axis) for axis in params["axes"]]
            return [self._reduced(REDUCTIONS[name], inputs[0], axes)]
        if name in MOVES and self._only_moves(name, inputs):
            held = MOVES[name] or range(len(inputs))
            numbers = [
                self.ids(one) if k in held else one for k, one in enumerate(inputs)
            ]
            found = _bound(equation, *numbers)
            return [_Ids(one) for one in found]
        if name in _OPERATIONS:
            return [_OPERATIONS[name](self, equation, *inputs)]
        raise UntraceableError(name)

    def _add(self, expression: Any) -> int:
        self._nodes.append(expression)
        return len(self._nodes) - 1

    def _only_moves(self, name: str, inputs: Sequence[_Value]) -> bool:
        """Tell whether what is moved where does not depend on positions."""
        held = MOVES[name] or range(len(inputs))
        return not any(
            isinstance(one, _Ids) for k, one in enumerate(inputs) if k not in held
        )

    def _elementwise(
        self, function: Callable[..., Any], inputs: Sequence[_Value]
    ) -> _Ids:
        numbers = np.broadcast_arrays(*map(self.ids, inputs))
        rows = zip(*(one.reshape(-1) for one in numbers), strict=True)
        found = [self._add(function(*self.expressions(r))) for r in rows]
        return _Ids(np.reshape(found, numbers[0].shape))

    def _reduced(
        self, function: Callable[..., Any], value: _Value, axes: Sequence[int]
    ) -> _Ids:
        numbers = self.ids(value)
        last = np.moveaxis(numbers, axes, range(-len(axes), 0))
        shape = last.shape[: numbers.ndim - len(axes)]
        rows = last.reshape(math.prod(shape), -1)
        found = [
            self._add(functools.reduce(function, self.expressions(row))) for row in rows
        ]
        return _Ids(np.reshape(found, shape))

    # ------------------------------------------------------------ tables and their cells

    def interpolate(self, equation: JaxprEqn, values: _Value, *where: _Value) -> _Value:
        """Return the (bi)linear value of a table, as `axcomp.models` defines it."""
        shape = equation.params["shape"]
        tables = _constant(values, equation).reshape(-1, *shape)
        number = np.zeros((), dtype=int)
        if equation.params["stacked"]:
            number, where = _constant(where[0], equation), where[1:]
        places = np.broadcast_arrays(*map(self.ids, where), np.empty(number.shape))
        found = []
        for place in np.ndindex(places[-1].shape):
            table = tables[int(np.broadcast_to(number, places[-1].shape)[place])]
            at = self.expressions([int(one[place]) for one in places[:-1]])
            found.append(self._add(_look_up(table[..., None], at)))
        return _Ids(np.reshape(found, places[-1].shape))

    def gather(self, equation: JaxprEqn, table: _Value, index: _Value) -> _Value:
        """Return the entries of a constant table at numbers that positions decide."""
        entries = _constant(table, equation)
        numbers, dimensions = self.ids(index), equation.params["dimension_numbers"]
        if numbers.shape[-1] != 1:
            what = "gather along several axes at once"
            raise UntraceableError(what)
        axis = dimensions.start_index_map[0]
        count = entries.shape[axis] - equation.params["slice_sizes"][axis] + 1

        primitive: Any = equation.primitive

        def entry(number: Any) -> Any:
            at = jnp.full(numbers.shape, number)
            return primitive.bind(entries, at, **equation.params)

        columns = np.asarray(jax.vmap(entry)(jnp.arange(count, dtype=jnp.int32)))
        shape = columns.shape[1:]
        asked = np.expand_dims(numbers[..., 0], dimensions.offset_dims)
        of_entry = np.broadcast_to(asked, shape).reshape(-1)
        columns = columns.reshape(count, -1)
        found = np.zeros(of_entry.size, dtype=np.int64)
        for number in np.unique(of_entry):
            here = np.flatnonzero(of_entry == number)
            all_at_once = _look_up(columns[:, here], self.expressions([number]))
            found[here] = [self._add(all_at_once[k]) for k in range(here.size)]
        return _Ids(found.reshape(shape))

    def cell(self, points: _Value, position: _Value) -> _Value:
        """Return the cell of a position between ascending points."""
        nodes = np.asarray(points)
        last = float(nodes.size - 2)
        count = _interpolant(np.arange(nodes.size, dtype=float), [nodes], "binary")

        def search(place: Any) -> Any:
            return ca.fmin(ca.fmax(ca.floor(count(place)), 0.0), last)

        return self._elementwise(search, [position])

    # ------------------------------------------------------------------ sums of products

    def dot(self, equation: JaxprEqn, left: _Value, right: _Value) -> _Value:
        """Return the product of two arrays of numbers."""
        (first, second), (batch1, batch2) = equation.params["dimension_numbers"]
        rows, shape1 = _in_order(self.ids(left), batch1, first)
        columns, shape2 = _in_order(self.ids(right), batch2, second)
        found = [
            self._add(_product(self.expressions(row), self.expressions(column)))
            for one, two in zip(rows, columns, strict=True)
            for row, column in itertools.product(one, two)
        ]
        batch = np.shape(left.numbers if isinstance(left, _Ids) else left)
        return _Ids(np.reshape(found, (*(batch[k] for k in batch1), *shape1, *shape2)))

    def scatter_add(
        self, equation: JaxprEqn, operand: _Value, index: _Value, updates: _Value
    ) -> _Value:
        """Return an array with numbers added to some of its elements."""
        into, more = self.ids(operand).copy(), self.ids(updates)
        where = _constant(index, equation)
        for place in np.ndindex(more.shape):
            one = np.zeros(more.shape)
            one[place] = 1.0
            there = _bound(equation, np.zeros(into.shape), where, one)[0]
            for at in zip(*np.nonzero(there), strict=True):
                old, new = self.expressions((int(into[at]), int(more[place])))
                into[at] = self._add(old + new)
        return _Ids(into)


_SPECIAL: dict[str, Callable[..., _Value]] = {
    "cell_of": _Graph.cell,
    "whole": lambda _, number: number,
}
"""Functions of `axcomp.models` that are carried over as a whole, by name."""

_OPERATIONS: dict[str, Callable[..., _Value]] = {
    "table_interpolate": _Graph.interpolate,
    "gather": _Graph.gather,
    "dot_general": _Graph.dot,
    "scatter-add": _Graph.scatter_add,
}


def _bound(equation: JaxprEqn, *inputs: Any) -> list[Any]:
    primitive: Any = equation.primitive
    found = primitive.bind(*inputs, **equation.params)
    parts = found if isinstance(found, (list, tuple)) else [found]
    return [np.asarray(one) for one in parts]


def _constant(value: _Value, equation: JaxprEqn) -> np.ndarray:
    if isinstance(value, _Ids):
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


def _product(left: Sequence[Any], right: Sequence[Any]) -> Any:
    return functools.reduce(
        ca.plus, (one * two for one, two in zip(left, right, strict=True))
    )
