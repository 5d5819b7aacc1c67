"""Run the command line as ``python -m axcomp``."""

from axcomp.ident.cli import run

if __name__ == "__main__":
    run()
