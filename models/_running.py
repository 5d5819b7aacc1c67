"""Which of some flags is the last one so far, without a pass over each of its bits.

A running maximum of their numbers says the same; XLA's own takes ten times as long on
the CPU.
"""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Int

from ._kernels import take

_BITS = 64
"""Flags per word."""
_FLAG = np.uint64(1) << np.arange(_BITS, dtype=np.uint64)
_UP_TO = np.cumsum(_FLAG, dtype=np.uint64)


def last_flagged(flags: Bool[Array, " t"]) -> Int[Array, " t"]:
    """Return the number of the last flag up to and with each place, from 1; 0: none."""
    count = flags.shape[0]
    rows = jnp.pad(flags, (0, -count % _BITS)).reshape(-1, _BITS)
    words = jnp.sum(
        jnp.where(rows, _FLAG[None], np.uint64(0)), axis=1, dtype=jnp.uint64
    )
    end = _BITS * jnp.arange(1, words.size + 1, dtype=jnp.int32)

    def highest(word: Array, end: Array) -> Array:
        return end - lax.clz(word).astype(jnp.int32)

    masked = words[:, None] & _UP_TO[None]
    before = jnp.zeros_like(end)
    if words.size > 1:
        row = jnp.pad(last_flagged(words != 0)[:-1], (1, 0))
        index = jnp.maximum(row - 1, 0)
        before = jnp.where(row > 0, take(highest(words, end), index), 0)
    last = jnp.where(masked != 0, highest(masked, end[:, None]), before[:, None])
    return last.reshape(-1)[:count]
