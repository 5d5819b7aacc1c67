"""Public names of a package that are imported on first use, so that a command starts sooner."""

import ast
import functools
import importlib
import pkgutil
from collections.abc import Callable, Mapping
from typing import Any


@functools.cache
def homes_of(package: str) -> Mapping[str, tuple[str, str]]:
    """Return module and name there of what a package imports ``if TYPE_CHECKING``."""
    found: dict[str, tuple[str, str]] = {}
    for block in ast.parse(pkgutil.get_data(package, "__init__.py") or b"").body:
        for node in block.body if isinstance(block, ast.If) else ():
            match node:
                case ast.ImportFrom(module=str(module), names=names, level=level):
                    for one in names:
                        found[one.asname or one.name] = "." * level + module, one.name
                case ast.Assign(targets=[ast.Name(id=name)], value=ast.Name(id=same)):
                    found[name] = found[same]
    return found


def importer(package: str) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package: it imports what type checkers see.

    Args:
        package: Name of the package; the names stand below ``if TYPE_CHECKING``.
    """

    def find(name: str) -> Any:
        if name not in homes_of(package):
            msg = f"module {package!r} has no attribute {name!r}"
            raise AttributeError(msg)
        module, own = homes_of(package)[name]
        return getattr(importlib.import_module(module, package), own)

    return find
