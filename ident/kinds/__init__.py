"""One folder per compensation: all that is special about it, behind one record.

`Kind` (`_kind`) holds the facts; the other modules of a folder are its parts, each imported on
first use (`Kind.part`). `_protocol` says which they are and what is asked of them, `_keys` what
the keys of all fits in a job have in common.

A compensation is added by a folder and by its name in `NAMES`. Entries that the registry of
`data.lists` does not have stand in ``parameters.toml`` of the folder.
"""

import functools
import importlib
import pathlib

from ._kind import Kind as Kind

NAMES: tuple[str, ...] = (
    "cross",
    "plane",
    "leadscrew",
    "temperature",
    "backlash",
    "crosstalk",
    "friction",
)
"""All compensations, in the order in which they are listed."""


@functools.cache
def kind(name: str) -> Kind:
    """Return the record of a compensation.

    Raises:
        KeyError: If there is none of this name.
    """
    if name not in NAMES:
        raise KeyError(name)
    folder = importlib.import_module(f".{name}", __name__)
    record: Kind = folder.KIND
    parameters = pathlib.Path(folder.__path__[0], "parameters.toml")
    if parameters.is_file():
        from ...data.lists import add_parameters

        add_parameters(parameters)
    return record


def kinds() -> tuple[Kind, ...]:
    """Return the records of all compensations."""
    return tuple(map(kind, NAMES))
