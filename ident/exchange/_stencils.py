"""What tables add at a few positions, over stencils that are kept.

A machine is measured at the same targets over and over, and so are all machines of a
kind: the model says once which nodes each target touches, and every table over these
nodes is then a handful of sums.
"""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import (
    AbstractNodes,
    Cross,
    EquidistantNodes,
    Leadscrew,
    ModuloNodes,
    Plane,
    Stencil,
)

FEW = 1024
"""Positions up to which a stencil is kept."""
_SMALLEST = 256
"""Batches are padded to powers of two from here on: few shapes to compile."""

_Model = Plane | Cross | Leadscrew


@dataclasses.dataclass(frozen=True)
class _Question:
    """Which nodes some positions touch: what the answer depends on, and what gives it."""

    nodes: tuple[object, ...]
    rules: tuple[object, ...]
    positions: bytes
    direction: bytes
    model: _Model = dataclasses.field(compare=False)


def offsets_at(
    model: _Model,
    entries: Float[np.ndarray, "k n"],
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, "k t"]:
    """Return what several tables over the same nodes add at each position, in mm or °.

    Args:
        model: One table over these nodes.
        entries: Entries of each table in a row, as the model's stencil counts them.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    # Further columns are other axes: a table of one master looks at the first.
    own = positions[:, : 2 if isinstance(model, Plane) else 1]
    places = np.ascontiguousarray(own, dtype=np.float64)
    sense = b""
    if direction is not None and isinstance(model, Leadscrew):
        sense = (np.asarray(direction) < 0).tobytes()
    question = _Question(_nodes(model), _rules(model), places.tobytes(), sense, model)
    answer = _kept if len(places) <= FEW else _asked
    nodes, weights = answer(question)
    if len(places) <= FEW:
        return np.asarray(model.sign * (entries[:, nodes] * weights).sum(axis=2))
    # One by one, which takes less memory.
    return np.stack(
        [model.sign * (table[nodes] * weights).sum(axis=1) for table in entries]
    )


def entries_of(model: _Model) -> Float[np.ndarray, " n"]:
    """Return the entries of a table in a row, as its stencil counts them."""
    if isinstance(model, Leadscrew):
        parts = [model.pos] if model.neg is None else [model.pos, model.neg]
        return np.concatenate([np.asarray(part) for part in parts])
    return np.asarray(model.values).reshape(-1)


def padded(values: np.ndarray) -> np.ndarray:
    """Return rows filled up with zeros to a power of two."""
    size = max(_SMALLEST, 1 << max(len(values) - 1, 0).bit_length())
    result = np.zeros((size, *values.shape[1:]), values.dtype)
    result[: len(values)] = values
    return result


def _nodes(model: _Model) -> tuple[object, ...]:
    if isinstance(model, Plane):
        return (*_numbers(model.nodes1), *_numbers(model.nodes2))
    return _numbers(model.nodes)


def _numbers(nodes: AbstractNodes) -> tuple[object, ...]:
    """Return all that a look-up in the nodes depends on."""
    if isinstance(nodes, ModuloNodes):
        return (nodes.limits, *_numbers(nodes.nodes))
    if isinstance(nodes, EquidistantNodes):
        return (float(nodes.start), float(nodes.interval), nodes.count)
    return (np.asarray(nodes.positions).tobytes(),)


def _rules(model: _Model) -> tuple[object, ...]:
    if isinstance(model, Leadscrew):
        return (Leadscrew, model.modulo, model.bilateral)
    return (type(model), isinstance(model, Cross) and model.held)


def _asked(
    question: _Question,
) -> tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]:
    places = np.frombuffer(question.positions)
    columns = 2 if isinstance(question.model, Plane) else 1
    places = places.reshape(-1, columns)
    sense = np.ones(len(places), dtype=np.int64)
    if question.direction:
        sense[np.frombuffer(question.direction, dtype=bool)] = -1
    found = _stencil(
        question.model, jnp.asarray(padded(places)), jnp.asarray(padded(sense))
    )
    rows = slice(0, len(places))
    return np.asarray(found.nodes)[rows], np.asarray(found.weights)[rows]


@functools.lru_cache(maxsize=512)
def _kept(
    question: _Question,
) -> tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]:
    return _asked(question)


@eqx.filter_jit
def _stencil(
    model: _Model, positions: Float[Array, "t d"], direction: Int[Array, " t"]
) -> Stencil:
    if isinstance(model, Plane):
        return model.stencil(positions)
    if isinstance(model, Cross):
        return model.stencil(positions[:, 0])
    return model.stencil(positions[:, 0], direction)
