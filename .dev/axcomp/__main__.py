"""Run the command line as ``python -m axcomp``."""

import sys

from axcomp.ident.cli import main

if __name__ == "__main__":
    sys.exit(main())
