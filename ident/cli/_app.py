"""Assembles the commands and turns errors into one line and an exit status.

Only light modules are imported here: every command imports what it needs when it runs,
so that ``axcomp --help`` and ``axcomp check`` start in a fraction of a second.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import typer

from axcomp import __version__

from ...data.errors import AxcompError, UsageError
from . import (
    _batch,
    _discover,
    _export,
    _fit,
    _iso230,
    _judge,
    _lists,
    _read,
    _simulate,
)
from ._options import declared
from .demo import demo

app = typer.Typer(
    name="axcomp",
    help="Turns measurements of a machine tool into compensation lists that are proven to work.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
COMMANDS: dict[str, Callable[..., Any]] = {
    command.__name__.replace("_", "-"): command
    for command in (
        demo,
        _read.read,
        _read.new,
        _fit.fit,
        _iso230.iso230,
        _batch.batch,
        _batch.results,
        _lists.check,
        _lists.show,
        _lists.diff,
        _lists.convert,
        _export.objects,
        _export.probe,
        _simulate.simulate,
        _judge.verify,
        _export.export_external,
        _judge.doctor,
        _discover.discover,
    )
}
"""Function by name, in the order in which they are shown; its docstring is the help."""


for _name, _function in COMMANDS.items():
    app.command(_name)(declared(_function))


def _print_version(value: bool) -> bool:
    if value:
        typer.echo(__version__)
        raise typer.Exit
    return value  # what a callback returns is what the option gets


@app.callback()
def _options(
    version: bool = typer.Option(
        False,
        "--version",
        callback=_print_version,
        is_eager=True,
        help="Print the version.",
    ),
) -> None:
    """Turn measurements of a machine tool into compensation lists that are proven to work."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0 done; 1 bad input, failed fit, failed gate, or something requested that the data
    cannot determine; 2 bad usage; 130 interrupted.
    """
    before, sys.unraisablehook = sys.unraisablehook, _again
    try:
        app(args=argv, prog_name="axcomp")
    except SystemExit as end:
        if end.code == 130:  # typer has caught the interrupt, and says nothing
            print("axcomp: interrupted", file=sys.stderr)
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except AxcompError as error:
        print(f"axcomp: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        reason = os.strerror(error.errno) if error.errno else str(error)
        if isinstance(error, IsADirectoryError):
            reason = "is a folder, expected a file"
        print(f"axcomp: {where}{reason}", file=sys.stderr)
        return 1
    finally:
        sys.unraisablehook = before
    return 0


def _again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Interrupt once more where Python dropped an interrupt and went on.

    One that falls into a callback of the garbage collector (JAX has one) cannot be
    raised there: it would be printed with its traceback, and the job would go on.
    """
    if issubclass(unraisable.exc_type, KeyboardInterrupt):
        later = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT))
        later.daemon = True
        later.start()
    else:
        sys.__unraisablehook__(unraisable)
