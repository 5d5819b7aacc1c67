"""Switches JAX to 64-bit floats, on import and before any array exists.

0.1 µm over 10 m needs 27 bits; single precision has 24. A model evaluated in single
precision would be wrong by more than the compensation it describes.
"""

import jax

jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
