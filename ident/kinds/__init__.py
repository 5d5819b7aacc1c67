"""One folder per compensation: all that is special about it, behind one record.

`Kind` (`_kind`) holds the facts; the other modules of a folder are its parts, each imported on
first use (`Kind.part`):

* ``effect``: what is fitted, through `axcomp.models` and the estimator;
* ``entries``: between its list and its model (`_protocol.AbstractEntries`);
* ``channel``: what a log shows of it (`proof.verify.AbstractChannel`);
* ``probe``: its step of a probe (`_protocol.AbstractProbe`).

A compensation is added by a folder and by its name in `NAMES`.
"""

import functools
import importlib

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
    found: Kind = importlib.import_module(f".{name}", __name__).KIND
    return found


def kinds() -> tuple[Kind, ...]:
    """Return the records of all compensations."""
    return tuple(map(kind, NAMES))
