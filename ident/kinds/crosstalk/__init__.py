"""Crosstalk: an offset of the axis while another one accelerates.

Read in this order: `_events` (accelerations cut out of a log, one value each), `_tests` (where the
tests of a list stand), `effect` (their values, alone and in what others of a group leave; their
form is the effect of a joint fit), `plan` (all of it), `_draft` and `_result` (list, gate, result
and remarks). The other modules are the parts that every compensation has.
"""

from .._kind import Kind

KIND = Kind(
    name="crosstalk",
    holder="compensation",
    prefix="kw.crosstalk",
    activation="lr_param.crosstalk",
    keyword="CROSSTALK",
    channel="CROSSTALK::end_offset",
    conventions=("crosstalk_",),
    follows=frozenset({"position", "acceleration"}),
    demanded=False,
    manual="kw.crosstalk.manual_activation",
    adds="The controller adds the value to the command position of the axis while the master"
    " accelerates.",
    raw_tables=("position", "table"),
    unseen="it acts while another axis accelerates, and what changed between two measurements"
    " is not compared there, be they at standstill or in motion; compare a log of the"
    " controller (axcomp verify)",
    build="V3.1.3079.32",
)
BRANCHES = (
    "acceleration in positive direction",
    "acceleration in negative direction",
    "deceleration in positive direction",
    "deceleration in negative direction",
)
"""Rows of its values, in the order of `axcomp.models.Crosstalk`."""
MOST_TESTS = 15
"""Measurement tests that a list holds at most ([001] p.84)."""
SAFE_TESTS = 14
"""Tests that satisfy both statements of the manuals: at most 15, fewer than 15 (S-39)."""
