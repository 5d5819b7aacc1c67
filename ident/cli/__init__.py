"""The command line: parse, call the library, exit status."""

import gc
import sys

_GARBAGE = (200_000, 20, 20)
"""Objects between collections: a command is over before collecting has paid for itself."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Everything is imported in here: even an interrupt while that goes on ends without a
    traceback.
    """
    gc.set_threshold(*_GARBAGE)
    try:
        from ._app import main as run

        return run(argv)
    except KeyboardInterrupt:
        print("axcomp: interrupted", file=sys.stderr)
        return 130
