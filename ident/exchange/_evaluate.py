"""What tables add at given positions, NumPy to NumPy.

A machine is measured at the same targets over and over, and so are all machines of a
kind: the model says once which nodes each target touches, and every table over these
nodes is then a handful of sums.
"""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...models import AbstractLookup, Stencil

_FEW = 1024
"""Positions up to which a stencil is kept."""
_SMALLEST = 256
"""Batches are padded to powers of two from here on: few shapes to compile."""


@dataclasses.dataclass(frozen=True)
class _Question:
    """Which nodes some positions touch: what the answer depends on, and what gives it."""

    structure: object
    nodes: tuple[bytes, ...]
    positions: bytes
    direction: bytes
    model: AbstractLookup = dataclasses.field(compare=False)


def offset_at(
    model: AbstractLookup,
    positions: Float[np.ndarray, "t d"],
    direction: Int[np.ndarray, " t"] | None = None,
) -> Float[np.ndarray, " t"]:
    """Return the offset in mm or ° that a table adds at each position.

    Args:
        model: The table.
        positions: One column per master (leadscrew: the axis itself), in mm or °.
        direction: ±1 per row for a leadscrew; positive where it is left out.
    """
    rows = len(positions)
    if rows <= _FEW:
        entries = np.concatenate([np.ravel(table) for table in model.tables])
        return np.asarray(offsets_at(model, entries[None], positions, direction)[0])
    sense = np.ones(rows, dtype=np.int64) if direction is None else direction
    return np.asarray(_offset(model, *_padded(positions, sense)))[:rows]


def offsets_at(
    model: AbstractLookup,
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
    # Further columns are other axes.
    own = positions[:, : len(model.ways)]
    places = np.ascontiguousarray(own, dtype=np.float64)
    sense = b""
    if direction is not None and len(model.tables) > 1:
        sense = (np.asarray(direction) < 0).tobytes()
    question = _Question(
        jax.tree.structure(model),
        tuple(np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(model.ways)),
        places.tobytes(),
        sense,
        model,
    )
    table: Any = model
    if len(places) <= _FEW:
        nodes, weights = _kept(question)
        return np.asarray(table.sign * (entries[:, nodes] * weights).sum(axis=2))
    nodes, weights = _asked(question)
    # One by one, which takes less memory.
    return np.stack(
        [table.sign * (row[nodes] * weights).sum(axis=1) for row in entries]
    )


def _asked(
    question: _Question,
) -> tuple[Int[np.ndarray, "t k"], Float[np.ndarray, "t k"]]:
    places = np.frombuffer(question.positions).reshape(-1, len(question.model.ways))
    sense = np.ones(len(places), dtype=np.int64)
    if question.direction:
        sense[np.frombuffer(question.direction, dtype=bool)] = -1
    found = _stencil(question.model, *_padded(places, sense))
    rows = slice(0, len(places))
    return np.asarray(found.nodes)[rows], np.asarray(found.weights)[rows]


_kept = functools.lru_cache(maxsize=512)(_asked)


def _padded(
    positions: Float[np.ndarray, "t d"], direction: Int[np.ndarray, " t"]
) -> tuple[Float[Array, "p d"], Int[Array, " p"]]:
    """Return the rows filled up to a power of two, directions as ±1."""
    size = max(_SMALLEST, 1 << max(len(positions) - 1, 0).bit_length())
    more = size - len(positions)
    sense = np.where(np.pad(direction, (0, more)) < 0, -1, 1)
    return jnp.asarray(np.pad(positions, ((0, more), (0, 0)))), jnp.asarray(sense)


@eqx.filter_jit
def _stencil(
    model: AbstractLookup, positions: Float[Array, "p d"], direction: Int[Array, " p"]
) -> Stencil:
    table: Any = model
    found: Stencil = table.stencil(*model.looked_up(positions, direction))
    return found


@eqx.filter_jit
def _offset(
    model: AbstractLookup, positions: Float[Array, "p d"], direction: Int[Array, " p"]
) -> Float[Array, " p"]:
    table: Any = model
    found: Float[Array, " p"] = table.offset(*model.looked_up(positions, direction))
    return found
