"""Backlash: the lost motion at a reversal.

Read in this order: `effect` (readings in both directions in, the width out), `_trace` (reversals of
a motion), `_recording` (the readings of a job), `plan`, `_draft` and `_result`. The other modules
are the parts that every compensation has.
"""

from .._kind import Kind

KIND = Kind(
    name="backlash",
    words="the lost motion at a reversal",
    holder="axis",
    prefix="getriebe[0].lose",
    activation="lr_param.anwahl_losekomp",
    keyword="BACKLASH",
    variable="V.A.BACKLASH_COMP_CURR",
    channel="BC::actual backlash",
    conventions=("backlash_", "direction_source"),
    follows=frozenset({"direction"}),
    fitted_first=True,
    shows_init=False,
    noun="the backlash",
    build="V3.1.3081.05",
)
