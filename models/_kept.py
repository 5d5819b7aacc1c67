"""What is kept for a derivative, and what is worked out again."""

from collections.abc import Callable
from typing import Any

import jax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Float

_NAME = "kept"


def kept(values: Float[Array, "..."]) -> Float[Array, "..."]:
    """Return the values, marked as too dear to be worked out again."""
    marked: Array = checkpoint_name(values, _NAME)  # type: ignore[no-untyped-call]
    return marked


def run_again(body: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that backwards is run again, but for what is marked.

    What a piece of a log needs fits the cache that way, and not memory.
    """
    checkpointed: Callable[..., Any] = jax.checkpoint(
        body,
        prevent_cse=False,
        policy=jax.checkpoint_policies.save_only_these_names(_NAME),
    )
    return checkpointed
