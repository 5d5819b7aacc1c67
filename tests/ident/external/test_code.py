"""The generated code, compiled without a warning, beside the model that it was made of."""

import subprocess
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from axcomp.models import OffsetLaw

from .conftest import Built, compiled

UNITS = 10**8


def test_code_gives_the_offsets_of_the_model(
    built: Built, expected: Callable[[OffsetLaw, np.ndarray], np.ndarray]
) -> None:
    positions = built.positions(1_000_000, seed=3)
    found = built.offsets(positions)
    assert np.any(found != 0)
    # One unit of 1e-8 mm: sums of other order differ by 1e-17, which may turn a rounding.
    np.testing.assert_allclose(found, expected(built.law, positions), rtol=0, atol=1)
