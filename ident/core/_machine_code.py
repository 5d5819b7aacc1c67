"""Functions of numbers as machine code, compiled once per machine."""

from typing import Any

from numba import njit


def machine_code(function: Any, signature: Any = None) -> Any:
    """Return a function compiled; kept for the next process, where that can be written.

    Without a signature it is compiled at its first call, for the arrays of that call.
    """
    options: Any = {"nogil": True, "error_model": "numpy"}
    try:
        return njit(signature, cache=True, **options)(function)
    except (RuntimeError, OSError):  # nowhere to write, or no space left
        return njit(signature, **options)(function)
