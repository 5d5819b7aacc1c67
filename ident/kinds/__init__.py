"""One folder per compensation: all that is special about it, behind one record.

`Kind` (`_kind`) holds the facts; the other modules of a folder are its parts, each imported on
first use (`Kind.part`):

* ``effect``: what is fitted, through `axcomp.models` and the estimator;
* ``entries``: between its list and its model (`_protocol.AbstractEntries`);
* ``channel``: what a log shows of it (`proof.verify.AbstractChannel`);
* ``probe``: its step of a probe (`_protocol.AbstractProbe`);
* ``keys``: the keys of a fit in a job, and what is wrong with them (`_keys.FitSpec`);
* ``job``: a fit from its plan to a draft, list and result (`_protocol.SinglePart`);
* ``group``: the same in a group of fits (`_protocol.GroupPart`);
* ``page``: its part of the report (`_protocol.PagePart`); tables share these three.

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
    found: Kind = folder.KIND
    own = pathlib.Path(folder.__path__[0], "parameters.toml")
    if own.is_file():
        from ...data.lists import add_parameters

        add_parameters(own)
    return found


def kinds() -> tuple[Kind, ...]:
    """Return the records of all compensations."""
    return tuple(map(kind, NAMES))
