"""Public names of a package that are imported on first use, so that a command starts sooner."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def importer(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package: it imports a name from its module.

    Args:
        package: Name of the package.
        homes: Module inside of it by public name, behind ``:`` its name there if another.
    """

    def find(name: str) -> Any:
        if name not in homes:
            msg = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(msg)
        module, _, own = homes[name].partition(":")
        return getattr(importlib.import_module(f".{module}", package), own or name)

    return find
