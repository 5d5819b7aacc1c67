"""Examples of the commands, shown by ``--help`` and run by the tests in this order."""

import inspect
import re
from collections.abc import Callable
from typing import Any

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("axcomp demo --out mill",),
    "read": ("axcomp read laser_x.csv",),
    "new": (
        "axcomp new laser_x.csv",
        "axcomp new laser_x.csv --axis X=1 --out screw.toml",
        "axcomp new laser_x.csv --list achskw1.lis --out again.toml",
    ),
    "fit": (
        "axcomp fit job.toml",
        "axcomp fit job.toml --after after.toml",
    ),
    "iso230": (
        "axcomp iso230 laser_x.csv",
        "axcomp iso230 laser_x.csv laser_again.csv --tolerance 20um --out chart",
    ),
    "check": ("axcomp check axcomp-out/achskw1.lis",),
    "show": ("axcomp show axcomp-out/achskw1.lis",),
    "diff": ("axcomp diff achskw1.lis axcomp-out/achskw1.lis",),
    "convert": (
        "axcomp convert axcomp-out/achskw1.lis screw.csv",
        "axcomp convert axcomp-out/achskw1.lis screw.comp",
        "axcomp convert screw.comp converted.lis --axis 1",
    ),
    "objects": ("axcomp objects axcomp-out/achskw1.lis --out watch",),
    "probe": ("axcomp probe job.toml",),
    "simulate": (
        "axcomp simulate axcomp-out/achskw1.lis --motion motion.csv --out offsets.csv",
    ),
    "verify": ("axcomp verify axcomp-out/achskw1.lis --log log.csv",),
    "export-external": ("axcomp export-external achskw3.lis --out external",),
    "doctor": (
        "axcomp doctor axcomp-out/achskw1.lis --before job.toml --after after.toml",
    ),
    "discover": ("axcomp discover job.toml --write fits.toml",),
    "batch": ('axcomp batch "machines/*.toml" --out night',),
    "results": ('axcomp results night --where "not passed"',),
}
"""Lines by command."""


def help_of(name: str, command: Callable[..., Any]) -> str:
    """Return what ``--help`` says: the docstring, its paragraphs on one line, and examples."""
    paragraphs = inspect.cleandoc(command.__doc__ or "").split("\n\n")
    text = "\n\n".join(re.sub(r"\s*\n\s*", " ", each) for each in paragraphs)
    lines = "\n".join(f"  {each}" for each in EXAMPLES[name])
    return f"{text}\n\nExamples:\n{lines}"
