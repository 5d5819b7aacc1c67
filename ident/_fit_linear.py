"""The fit of a linear stack as a differentiable function: models from readings.

Everything is JAX: derivatives of any order, forward and reverse, with respect to readings,
inputs (positions, temperatures), weights and smoothness. For noise, evidence, robustness and
standard deviations there is `axcomp.fit`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.tree_util as jtu
import lineax as lx
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..models import AbstractNodes, Cross, FrictionTable, Leadscrew, ModuloNodes, Plane
from ._parameters import Form, as_float, fitted_arrays, path_name, weights_of
from .core import FitError, chain, one_blas_thread

M = TypeVar("M")

Weights = ArrayLike | tuple[ArrayLike, ArrayLike]
"""Of second differences, or of second and of fourth differences."""


def fit_linear(
    model: M,
    predict: Callable[[M, Any], Array],
    inputs: Any,
    measured: ArrayLike,
    *,
    smoothness: Weights | Mapping[str, Weights] = 0.0,
    weights: ArrayLike | None = None,
    throw: bool = True,
) -> M:
    r"""Return the model that minimises the penalised squares, differentiably.

    $\hat\theta = (X^T W X + P)^{-1} X^T W y$ with the design $X$, the derivative of the
    predictions, and the differences of the tables as penalty $P$. The design is dense: good
    for up to some $10^7$ numbers. Inside `jax.jit` threads of BLAS may fight on a busy
    machine: run what was compiled under `axcomp.ident.core.one_blas_thread`.

    Args:
        model: A model, or a tuple, list or dictionary of models: a stack. Its arrays are
            fitted, except the positions of nodes; their values do not matter. A constant
            error is an array of the tree, too.
        predict: ``predict(model, inputs)``, linear in the arrays of the model.
        inputs: Arrays, or a tree of them, in mm, °, °C as the models take them.
        measured: Readings in the unit of the predictions.
        smoothness: Weight of the squared second differences per node distance of each
            table, relative to 1/noise²; or a pair with that of fourth differences; or
            either by the path of a table in the tree (``"[0]"``, ``"screw"``).
        weights: Of the readings, relative; 0 leaves one out.
        throw: Raise where the readings do not determine the model; else it is NaN.

    Returns:
        The fitted model, of the type of `model`.

    Raises:
        FitError: If the readings and the penalty do not determine the model.
        ValueError: If `smoothness` names no table.
    """
    params, rest = eqx.partition(model, fitted_arrays(model, None))
    form, readings = Form.of(params), as_float(measured)
    inputs = jax.tree.map(as_float, inputs)
    known = weights_of(readings, weights).ravel()
    unknown, penalties = _structure(model, form)
    asked = smoothness if isinstance(smoothness, Mapping) else ()
    wrong = [name for name in asked if name not in penalties]
    if wrong:
        msg = f"smoothness: found {', '.join(wrong)}, expected tables {list(penalties)}"
        raise ValueError(msg)
    named = smoothness if isinstance(smoothness, Mapping) else {}
    every = 0.0 if isinstance(smoothness, Mapping) else smoothness
    pairs = []
    for name in penalties:
        given = named.get(name, every)
        pair = given if isinstance(given, tuple) else (given, 0.0)
        pairs.append((as_float(pair[0]), as_float(pair[1])))
    with one_blas_thread():
        values, solved = _values(
            predict,
            form,
            rest,
            unknown,
            inputs,
            readings,
            known,
            list(penalties.values()),
            pairs,
        )
        if not isinstance(values, Tracer):
            values.block_until_ready()
    if throw and not isinstance(solved, Tracer) and not bool(solved):
        msg = (
            "fit_linear: readings and smoothness do not determine the model; expected "
            "readings that touch every node, or a smoothness above 0"
        )
        raise FitError(msg)
    found: M = eqx.combine(form.tree(values), rest)
    return found


@eqx.filter_jit
def _values(
    predict: Callable[[Any, Any], Array],
    form: Form,
    rest: Any,
    unknown: Int[Array, " n"],
    inputs: Any,
    readings: Float[Array, "..."],
    weights: Float[Array, " t"],
    penalties: list[Float[Array, "2 p p"]],
    pairs: list[tuple[Float[Array, ""], Float[Array, ""]]],
) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Return the fitted arrays in a row, and whether they are determined."""

    def predicted(values: Float[Array, " p"]) -> Float[Array, " t"]:
        full = eqx.combine(form.tree(values[unknown]), rest)
        return jnp.ravel(predict(full, inputs))

    count = penalties[0].shape[1] if penalties else len(unknown)
    off, along = jax.linearize(predicted, jnp.zeros(count))
    design = jax.vmap(along, out_axes=1)(jnp.eye(count))
    used = weights > 0
    error = jnp.where(used, jnp.where(used, readings.ravel(), 0.0) - off, 0.0)
    matrix = design.T @ (weights[:, None] * design)
    for terms, pair in zip(penalties, pairs, strict=True):
        matrix += pair[0] * terms[0] + pair[1] * terms[1]
    values, solved = _solve(matrix, design.T @ (weights * error))
    return values[unknown], solved


def _solve(
    matrix: Float[Array, "p p"], right: Float[Array, " p"]
) -> tuple[Float[Array, " p"], Array]:
    """Return the solution with a positive definite matrix, and whether there is one."""
    size = jax.lax.stop_gradient(jnp.sqrt(jnp.diag(matrix)))
    unit = 1.0 / jnp.where(size > 0, size, 1.0)
    scaled = matrix * (unit[:, None] * unit[None, :])
    # A direction without information leaves a root of rounding size.
    least = jnp.min(jnp.diag(jnp.linalg.cholesky(jax.lax.stop_gradient(scaled))))
    solved = least > _ROUNDING * matrix.shape[0] ** 0.5
    operator = lx.MatrixLinearOperator(scaled, lx.positive_semidefinite_tag)
    found = lx.linear_solve(operator, unit * right, lx.Cholesky(), throw=False)
    return jnp.where(solved, unit * found.value, jnp.nan), solved


_ROUNDING = float(np.sqrt(np.finfo(np.float64).eps))


def _tables(model: Any) -> Iterator[tuple[Any, Any]]:
    kinds = (Leadscrew, Cross, Plane, FrictionTable)
    leaves = jtu.tree_leaves_with_path(model, is_leaf=lambda x: isinstance(x, kinds))
    return ((path, leaf) for path, leaf in leaves if isinstance(leaf, kinds))


def _structure(
    model: Any, form: Form
) -> tuple[Int[Array, " n"], dict[str, Float[Array, "2 p p"]]]:
    """Return the unknown of each number of the model, and the penalties of each table.

    The last node of a ring is the first one again: they are one unknown.
    """
    starts = dict(zip(form.paths, np.cumsum([0, *form.sizes]), strict=False))
    same = np.arange(sum(form.sizes))
    found: list[tuple[str, int, np.ndarray, np.ndarray]] = []
    for path, table in _tables(model):
        name = path_name(path)
        for field, axes in _axes(table).items():
            start = starts[f"{name}.{field}" if name else field]
            with jax.ensure_compile_time_eval():  # nodes are constants under jit, too
                places = [np.asarray(nodes.positions) for nodes, _ in axes]
            shape = tuple(map(len, places))
            index = start + np.arange(math.prod(shape)).reshape(shape)
            for axis, (place, (_, ring)) in enumerate(zip(places, axes, strict=True)):
                along, prior = np.moveaxis(index, axis, 0), chain(place, ring)
                if ring:
                    same[along[-1]] = same[along[0]]
                lines = along[: prior.size].reshape(prior.size, -1).T
                for order, gram in enumerate(prior.grams):
                    found.append((name, order, lines, gram.toarray()))
    kept, unknown = np.unique(same, return_inverse=True)
    size = len(kept)
    penalties = {name: np.zeros((2, size, size)) for name, *_ in found}
    for name, order, lines, gram in found:
        own = unknown[lines]
        np.add.at(penalties[name][order], (own[:, :, None], own[:, None, :]), gram)
    return jnp.asarray(unknown), {k: jnp.asarray(v) for k, v in penalties.items()}


def _axes(table: Any) -> dict[str, list[tuple[AbstractNodes, bool]]]:
    """Return the nodes along each axis of each array of a table, and whether a ring."""
    if isinstance(table, Leadscrew):
        ring = table.modulo is not None and table.modulo is not False
        fields = ["pos"] if table.neg is None else ["pos", "neg"]
        return {field: [(table.nodes, ring)] for field in fields}
    nodes = (table.nodes2, table.nodes1) if isinstance(table, Plane) else (table.nodes,)
    return {"values": [(each, isinstance(each, ModuloNodes)) for each in nodes]}
