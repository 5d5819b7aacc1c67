"""The keys of an offset in a job: none of its own."""

from typing import Literal

from axcomp.ident.kinds._keys import FitSpec


class Spec(FitSpec, frozen=True):
    """A constant offset."""

    lacking = ("smoothness", "max_points", "n_cycles", "manual_activation")

    compensation: Literal["offset"]
