"""Backlash: the lost motion at a reversal.

Its fit is that of a group (`job.joint`), alone a group of one: `plan` says beside which curve and
what is written, `_result` what is known of it. The other modules are the parts that every
compensation has.
"""

from .._kind import Kind

KIND = Kind(
    name="backlash",
    holder="axis",
    prefix="getriebe[0].lose",
    activation="lr_param.anwahl_losekomp",
    keyword="BACKLASH",
    channel="BC::actual backlash",
    conventions=("backlash_", "direction_source"),
    follows=frozenset({"direction"}),
    fitted_first=True,
    shows_init=False,
    build="V3.1.3081.05",
)
