"""JAX's persistent compilation cache in the user's cache folder."""

import os
import warnings
from pathlib import Path

SWITCH = "AXCOMP_CACHE"
"""Environment variable: ``0``, ``off`` or ``no`` switches the cache off."""


def use_compilation_cache() -> Path | None:
    """Let JAX keep what it compiles, so that the next run starts faster.

    Call before the first compilation. A cache that cannot be written is no failure: the
    run then compiles everything anew.

    Returns:
        The folder, or None where there is no cache.
    """
    if os.environ.get(SWITCH, "").strip().lower() in ("0", "off", "no", "false"):
        return None
    home = os.environ.get("XDG_CACHE_HOME", "")
    base = Path(home) if Path(home).is_absolute() and home else _home_cache()
    if base is None:
        return None
    folder = base / "axcomp" / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK | os.X_OK):
        return None
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
    return folder


def _home_cache() -> Path | None:
    try:
        return Path.home() / ".cache"
    except RuntimeError:
        return None
