"""Friction: current over the velocity of the axis."""

from .._kind import Kind

KIND = Kind(
    name="friction",
    holder="compensation",
    prefix="frict_comp",
    activation="lr_param.frict_comp",
    keyword="FRICT",
    channel=None,
    conventions=("friction_",),
    follows=frozenset({"velocity"}),
    demanded=False,
    adds_current=True,
    adds="The controller adds sign(v) times the value over the velocity to the motor current,"
    " scaled by scaling_factor (0.1 %).",
    raw_tables=("table",),
    unseen="it adds current and no position; compare quadrant spikes of a circle, or a log of"
    " the controller (axcomp verify)",
)
