"""Benchmarks measure the machines and fleets of the tests: `tests` can be imported here."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
