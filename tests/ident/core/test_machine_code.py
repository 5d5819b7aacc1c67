"""Loops of numbers as machine code."""

import numba.core.caching
import pytest

from axcomp.ident.core._kernel import machine_code


def test_a_loop_is_compiled_where_no_code_can_be_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As in a container whose image and home are read-only.
    monkeypatch.setattr(numba.core.caching.CacheImpl, "_locator_classes", [])

    def twice(number: float) -> float:
        return 2.0 * number

    assert machine_code(twice)(1.5) == 3.0
