"""Friction: current over the velocity of the axis."""

from .._kind import Kind

KIND = Kind(
    name="friction",
    words="current over the velocity of the axis",
    holder="compensation",
    prefix="frict_comp",
    activation="lr_param.frict_comp",
    keyword="FRICT",
    variable="V.A.FRICT_COMP_CURR",
    channel=None,
    conventions=("friction_",),
    follows=frozenset({"velocity"}),
    demanded=False,
    adds_current=True,
    compiles=True,
)
