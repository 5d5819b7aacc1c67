"""The fit of a linear stack as a differentiable function: models from readings.

Everything is JAX: derivatives of any order, forward and reverse, with respect to readings,
inputs (positions, temperatures), weights and smoothness. For noise, evidence, robustness and
standard deviations there is `axcomp.fit`.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import lineax as lx
import numpy as np
import scipy.sparse as sp
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..models import Cross, FrictionTable, Leadscrew, ModuloNodes, Plane
from ._linear_solver import Arrow, ArrowCholesky
from ._parameters import (
    Form,
    as_measured,
    fitted_arrays,
    inputs_of,
    number_of,
    path_name,
    readings_of,
    weights_of,
)
from .core import FitError, Stack, TableEffect

M = TypeVar("M")

Weights = ArrayLike | tuple[ArrayLike, ArrayLike]
"""Of second differences, or of second and of fourth differences."""

_MANY = 400
"""Values of a table from which on they are a band; fewer are cheaper one by one."""
_TOGETHER = 1 << 20
"""Readings × products that are in memory at a time."""
_STEPS = {
    0: [np.zeros(0, int)],
    1: [np.array([0]), np.array([1])],
    2: [np.array(step) for step in ((0, 0), (0, 1), (1, -1), (1, 0), (1, 1))],
}
"""Steps to later nodes with which a node shares a cell, by the axes of a table."""
_LINEAR = 1e-6
"""Share of the predictions up to which they may differ from a linear function: rounding."""
_LOCAL = 1e-8
"""Relative error of a product with the matrix that columns of one colour gave, above which the
matrix has elements between columns that share a colour: they were not independent."""


def fit_linear(
    model: M,
    predict: Callable[[M, Any], Array],
    inputs: Any,
    measured: ArrayLike,
    *,
    smoothness: Weights | Mapping[str, Weights] = 0.0,
    weights: ArrayLike | None = None,
    solver: lx.AbstractLinearSolver[Any] | None = None,
    throw: bool = True,
) -> M:
    r"""Return the model that minimises the penalised squares, differentiably.

    $\hat\theta = (X^T W X + P)^{-1} X^T W y$ with the design $X$, the derivative of the
    predictions, and the differences of the tables as penalty $P$. The design is never
    stored: $X^T W X$ is read off its products with some vectors, one per value of the model,
    but for the largest table, where neighbours that no reading has in common share them.
    So a million readings of a plane of 10⁴ nodes take 300 MB, their gradient 1 GB.

    Args:
        model: A model, or a tuple, list or dictionary of models: a stack. Its arrays are
            fitted, except the positions of nodes and the scaling of a friction table; their
            values do not matter. A constant error is an array of the tree, too; numbers that
            are no arrays stay.
        predict: ``predict(model, inputs)``, linear in the arrays of the model.
        inputs: Arrays, or a tree of them, in mm, °, °C as the models take them.
        measured: Readings in the unit of the predictions.
        smoothness: Weight of the squared second differences per node distance of each
            table, relative to 1/noise²; or a pair with that of fourth differences; or
            either by the path of a table in the tree (``"0"``, ``"screw"``).
        weights: Of the readings, relative; 0 leaves one out.
        solver: Of the normal equations, any of lineax that takes a positive definite
            operator; left out: `ArrowCholesky`, a band on the host. What does not factorise
            (`lineax.CG`, `lineax.SVD`) finds some model of many where the readings do not
            determine it, and does not say so.
        throw: Raise where the readings do not determine the model; else it is NaN.

    Returns:
        The fitted model, of the type of `model`.

    Raises:
        FitError: If the readings and the penalty do not determine the model, a prediction
            is no number or not linear, or a reading of a large table touches more than one
            of its cells, shapes do not fit together, or `smoothness` names no table or is
            below zero.
    """
    if solver is not None and not isinstance(solver, lx.AbstractLinearSolver):
        msg = f"solver: found {solver!r}, expected one of lineax, made"
        raise FitError(msg)
    params, rest = eqx.partition(model, _linear_arrays(model))
    form, readings = Form.of(params), readings_of(measured)
    smooth = _weights_by_table(model, smoothness)
    problem = _Problem(
        predict,
        form,
        rest,
        _Structure.of(model, form),
        inputs_of(inputs),
        readings,
        weights_of(readings, weights),
        smooth,
    )
    values, held = _solved(problem, solver or ArrowCholesky())
    if throw and not isinstance(values, Tracer):
        for words, holds in zip(_EXPECTED, held, strict=True):
            if not bool(holds):
                msg = f"fit_linear: {words}"
                raise FitError(msg)
    found: M = eqx.combine(form.tree(values), rest)
    return found


_EXPECTED = (
    "found predictions that are no numbers, expected finite inputs",
    "found predictions that touch several cells of a large table, expected one each; tables"
    f" of up to {_MANY} values may do so",
    "readings and smoothness do not determine the model; expected readings that touch every"
    " node, or a smoothness above 0",
    "found predictions that are not linear in the arrays of the model; fit_model takes them",
)
"""What holds of a fit, in the order in which it is looked at."""


def _linear_arrays(model: Any) -> Any:
    """Return the filter of the arrays to fit: a scaling multiplies the entries beside it."""

    def scalings(tree: Any) -> list[Any]:
        leaves = jax.tree.leaves(tree, is_leaf=lambda x: isinstance(x, FrictionTable))
        return [leaf.scaling for leaf in leaves if isinstance(leaf, FrictionTable)]

    chosen = fitted_arrays(model, None)
    return eqx.tree_at(scalings, chosen, replace_fn=lambda _: False)


def _weights_by_table(
    model: Any, smoothness: Weights | Mapping[str, Weights]
) -> tuple[tuple[Array, ...], ...]:
    """Return the weight of second differences of each table, and of fourth where given."""
    names = [path_name(path) for path, _ in _tables(model)]
    named = smoothness if isinstance(smoothness, Mapping) else {}
    wrong = [name for name in named if name not in names]
    if wrong:
        msg = f"smoothness: found {', '.join(wrong)}, expected tables {names}"
        raise FitError(msg)
    every = 0.0 if isinstance(smoothness, Mapping) else smoothness
    found = [named.get(name, every) for name in names]
    pairs = [each if isinstance(each, tuple | list) else (each,) for each in found]
    if not all(1 <= len(pair) <= 2 for pair in pairs):
        msg = f"smoothness: found {smoothness!r}, expected a number, or two"
        raise FitError(msg)
    result = tuple(tuple(number_of(w, "smoothness") for w in pair) for pair in pairs)
    for weight in (weight for pair in result for weight in pair):
        if not isinstance(weight, Tracer) and not 0 <= weight < np.inf:
            msg = f"smoothness: found {weight}, expected a number of 0 or more"
            raise FitError(msg)
    return result


@final
class _Penalty(eqx.Module):
    """Squared differences of the values of one array, as elements of a matrix."""

    row: Int[Array, " e"]
    column: Int[Array, " e"]
    data: Float[Array, " e"]
    reach: int = eqx.field(static=True)
    """Largest distance of an element from the diagonal; 0 outside of the band."""
    weight: tuple[int, int] = eqx.field(static=True)
    """Number of the table, and 0 or 1 for second or fourth differences."""


@final
class _Structure(eqx.Module):
    """Unknowns of a stack, those of a large table first: tables as `TableEffect` has them."""

    unknown: Int[Array, " n"]
    """Of each number of the model; the last node of a ring is the first one again."""
    penalties: tuple[_Penalty, ...]
    """Of each table, axis and order."""
    size: int = eqx.field(static=True)
    band: int = eqx.field(static=True)
    """Unknowns of the table that is a band; 0 where none is large."""
    fast: int = eqx.field(static=True)
    """Those of them that follow each other along one of its axes."""
    offsets: tuple[int, ...] = eqx.field(static=True)
    """Distances between those of them that share a cell."""

    @classmethod
    def of(cls, model: Any, form: Form) -> "_Structure":
        """Return the unknowns of the fitted arrays of a model."""
        starts = dict(zip(form.paths, np.cumsum([0, *form.sizes]), strict=False))
        tables = [
            (number, starts[_first_array(path, table)], _effect(table))
            for number, (path, table) in enumerate(_tables(model))
        ]
        large = [one for _, _, one in tables if not one.periodic and one.size > _MANY]
        widest = max(large, key=lambda one: one.size, default=None)
        unknown, penalties, size = np.full(sum(form.sizes), -1), list[_Penalty](), 0
        for number, start, own in sorted(tables, key=lambda one: one[2] is not widest):
            unknown[start + np.arange(len(own.place))] = size + own.place
            for k, each in enumerate(Stack((own,)).terms):
                gram = sp.coo_array(each.gram)
                row, column = (jnp.asarray(size + at) for at in gram.coords)
                reach = max(each.distances, default=0) if own is widest else 0
                weight = number, k % 2
                data = jnp.asarray(gram.data)
                penalties.append(_Penalty(row, column, data, reach, weight))
            size += own.size
        rest = np.flatnonzero(unknown < 0)
        unknown[rest] = size + np.arange(len(rest))
        band, fast, offsets = 0, 1, tuple[int, ...]()
        if widest is not None:
            band, offsets = widest.size, widest.offsets
            fast = min(map(len, widest.nodes))
        size += len(rest)
        return cls(jnp.asarray(unknown), tuple(penalties), size, band, fast, offsets)


class _Linear(NamedTuple):
    """A linear function of the unknowns: predictions at zero, and products."""

    off: Float[Array, " t"]
    along: Callable[[Float[Array, " u"]], Float[Array, " t"]]
    """Design × values."""
    spread: Callable[[Float[Array, " t"]], Float[Array, " u"]]
    """Transposed design × weights × amounts."""

    def gram(self, values: Float[Array, " u"]) -> Float[Array, " u"]:
        """Return the information of the readings × values."""
        return self.spread(self.along(values))


class _Problem(eqx.Module):
    """Penalised squares over the unknowns: the matrix by its products, the right side."""

    predict: Callable[[Any, Any], Array] = eqx.field(static=True)
    form: Form = eqx.field(static=True)
    rest: Any
    structure: _Structure
    inputs: Any
    readings: Float[Array, "..."]
    weights: Float[Array, "..."]
    smoothness: tuple[tuple[Array, ...], ...]

    def linear(self) -> "_Linear":
        """Return the predictions as a linear function of the unknowns."""
        zero, weights = jnp.zeros(self.structure.size), jnp.ravel(self.weights)
        off, along = jax.linearize(self.predicted, zero)
        back = jax.linear_transpose(along, zero)
        return _Linear(off, along, lambda x: back(weights * x)[0])

    def predicted(self, values: Float[Array, " u"]) -> Float[Array, " t"]:
        """Return the predictions for some unknowns."""
        numbers = self.form.tree(values[self.structure.unknown])
        found = self.predict(eqx.combine(numbers, self.rest), self.inputs)
        return jnp.ravel(as_measured(found, self.readings.shape))

    @property
    def penalties(self) -> Iterator[tuple[Array, _Penalty]]:
        """Weights, and what they weigh."""
        for own in self.structure.penalties:
            table, order = own.weight
            if order < len(self.smoothness[table]):
                yield self.smoothness[table][order], own

    def product(
        self, linear: "_Linear", values: Float[Array, " u"]
    ) -> Float[Array, " u"]:
        """Return (information + penalties) × values."""
        result = linear.gram(values)
        for weight, own in self.penalties:
            result = result.at[own.row].add(weight * own.data * values[own.column])
        return result

    def matrix(self) -> tuple[Arrow, Bool[Array, ""]]:
        """Return information + penalties, and whether that is all of it."""
        structure, size = self.structure, self.structure.size
        n, fast = structure.band, structure.fast
        # Nodes that are three apart have no cell in common: they share a product.
        places = np.arange(n)
        colour = 3 * (places // fast % 3) + places % fast % 3
        colours = int(colour.max(initial=-1)) + 1
        test = np.cos(np.arange(size))
        probes = np.zeros((colours + size - n + 1, size))
        probes[colour, places] = 1.0
        probes[colours:-1, n:] = np.eye(size - n)
        probes[-1] = test
        few = len(probes) * self.readings.size <= _TOGETHER
        gram = self.linear().gram
        each = jax.vmap(gram) if few else partial(jax.lax.map, gram)
        found = each(jnp.asarray(probes))
        columns, expected = found[:-1], found[-1]
        reach = [each.reach for _, each in self.penalties]
        band = jnp.zeros((n, max([0, *reach, *structure.offsets]) + 1))
        for away in structure.offsets:
            low = places[: n - away]
            # Neither round the end of a row of nodes.
            low = low[np.abs(low % fast - (low + away) % fast) <= 1]
            band = band.at[low, away].set(columns[colour[low], low + away])
        rows = columns[colours:]
        arrow = Arrow(band, rows[:, :n], rows[:, n:])
        local = jnp.max(jnp.abs(arrow @ jnp.asarray(test) - expected), initial=0.0)
        local = local <= _LOCAL * jnp.max(jnp.abs(expected), initial=0.0)
        border = arrow.border
        for weight, own in self.penalties:
            data, first = weight * own.data, own.row >= own.column
            if own.reach:
                at = jnp.where(first, own.column, n), own.row - own.column
                band = band.at[at].add(data, mode="drop")
            else:
                border = border.at[own.row - n, own.column - n].add(data)
        return Arrow(band, arrow.cross, border), local


@eqx.filter_jit
def _solved(
    problem: _Problem, solver: lx.AbstractLinearSolver[Any]
) -> tuple[Float[Array, " n"], tuple[Array, ...]]:
    """Return the fitted arrays in a row, and whether what `_EXPECTED` says holds."""
    linear, used = problem.linear(), jnp.ravel(problem.weights) > 0
    known = jnp.where(used, jnp.ravel(problem.readings), 0.0)
    right = linear.spread(jnp.where(used, known - linear.off, 0.0))
    operator = lx.FunctionLinearOperator(
        partial(problem.product, linear),
        jax.eval_shape(lambda: right),
        lx.positive_semidefinite_tag,
    )
    options: dict[str, Any] = {}
    local = jnp.asarray(True)
    if isinstance(solver, ArrowCholesky):
        # Derivatives are those of the operator: the factor counts as constant.
        arrays, rest = eqx.partition(problem, eqx.is_array)
        fixed: _Problem = eqx.combine(jax.lax.stop_gradient(arrays), rest)
        options["matrix"], local = fixed.matrix()
    found = lx.linear_solve(operator, right, solver, options=options, throw=False)
    solved = jnp.all(jnp.isfinite(found.value))
    bent = problem.predicted(found.value) - linear.off - linear.along(found.value)
    size = jnp.max(jnp.abs(linear.off + linear.along(found.value)), initial=0.0)
    straight = jnp.max(jnp.abs(bent), initial=0.0) <= _LINEAR * size
    finite = jnp.all(jnp.isfinite(right))
    held = finite, local | ~finite, solved, straight
    return found.value[problem.structure.unknown], held


def _tables(model: Any) -> Iterator[tuple[Any, Any]]:
    kinds = (Leadscrew, Cross, Plane, FrictionTable)
    leaves = jtu.tree_leaves_with_path(model, is_leaf=lambda x: isinstance(x, kinds))
    return ((path, leaf) for path, leaf in leaves if isinstance(leaf, kinds))


def _first_array(path: Any, table: Any) -> str:
    field = "pos" if isinstance(table, Leadscrew) else "values"
    return ".".join(filter(None, [path_name(path), field]))


def _effect(table: Any) -> TableEffect:
    """Return a table as the estimator knows it: order of unknowns, cells, penalties."""
    ways = (table.nodes1, table.nodes2) if isinstance(table, Plane) else (table.nodes,)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(ways)):
        msg = (
            "fit_linear: found nodes that are traced, expected known ones: make the model "
            "outside of the function that jax.jit or vmap transforms"
        )
        raise FitError(msg)
    with jax.ensure_compile_time_eval():  # constants under jit, too
        nodes = tuple(np.asarray(each.positions) for each in ways)
    ring = isinstance(ways[0], ModuloNodes)
    branches = 1
    if isinstance(table, Leadscrew):
        ring = table.modulo is not None and table.modulo is not False
        branches = 1 if table.neg is None else 2
    return TableEffect(nodes, branches, ring)
