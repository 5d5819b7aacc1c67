"""Backlash: the lost motion at a reversal."""

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
