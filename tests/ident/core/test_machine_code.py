"""Loops of numbers as machine code."""

from typing import Any

import numba.core.caching
import pytest
from numba import types

from axcomp.ident.core._machine_code import machine_code


@pytest.mark.parametrize("signature", [None, types.float64(types.float64)])
def test_a_loop_is_compiled_where_no_code_can_be_kept(
    monkeypatch: pytest.MonkeyPatch, signature: Any
) -> None:
    # As in a container whose image and home are read-only.
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])

    def twice(number: float) -> float:
        return 2.0 * number

    assert machine_code(twice, signature)(1.5) == 3.0
