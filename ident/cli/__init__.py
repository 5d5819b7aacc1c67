"""The command line: parse, call the library, exit status."""

from ._app import main as main
