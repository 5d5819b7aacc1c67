"""The command line: parse, call the library, exit status.

`_app` assembles the commands and turns errors into one line and an exit status. A command is a
function whose docstring is its help, and which returns whether it passed; it imports what it
needs when it runs, so that `axcomp check` starts without JAX. They stand in `_read` (read, new),
`_fit`, `_iso230`, `_batch` (batch, results), `_lists` (check, show, diff, convert), `_export`
(objects, probe, export-external), `_simulate`, `_judge` (verify, doctor), `_discover` and the
folder `demo`. `_options` makes options of their parameters and docstrings, and holds what several
of them take; `_console` prints sentences, tables and progress; `_show_tables` and `_list_plots`
show a list.
"""

import gc
import os
import sys
from typing import NoReturn

_GARBAGE = (200_000, 20, 20)
"""Objects between collections: a command is over before collecting has paid for itself."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Everything is imported in here: even an interrupt while that goes on ends without a
    traceback.
    """
    gc.set_threshold(*_GARBAGE)
    try:
        from ._app import main as command

        return command(argv)
    except KeyboardInterrupt:
        print("axcomp: interrupted", file=sys.stderr)
        return 130


def run() -> NoReturn:
    """Run the command line as a program: end the process with the exit status.

    Ends at once: taking a million objects apart, only to hand the memory back, would take
    longer than some commands.
    """
    status = main()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            # The reader of a pipe has gone; there is nobody left to tell.
            status = status or 1
    os._exit(status)
