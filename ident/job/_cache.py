"""JAX's persistent compilation cache in the user's cache folder."""

import os
import warnings
from pathlib import Path

_SWITCH = "AXCOMP_CACHE"
"""Environment variable: ``0``, ``off`` or ``no`` switches the cache off."""


def use_compilation_cache() -> None:
    """Let JAX keep what it compiles, so that the next run starts faster.

    Call before the first compilation. A cache that cannot be written is no failure: the
    run then compiles everything anew.
    """
    if os.environ.get(_SWITCH, "").strip().lower() in ("0", "off", "no", "false"):
        return
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        base = base if base.is_absolute() else Path.home() / ".cache"
        folder = base / "axcomp" / "jax"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # no folder can be made, or nobody has a home
        return
    if not os.access(folder, os.W_OK | os.X_OK):
        return
    import jax

    settings = {
        "jax_compilation_cache_dir": str(folder),
        # Everything here compiles in well under JAX's threshold of one second.
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    for name, value in settings.items():
        jax.config.update(name, value)  # type: ignore[no-untyped-call]
    # A full disk or a damaged entry costs time, and is nobody's concern.
    warnings.filterwarnings("ignore", message=".*persistent compilation cache.*")
