"""Leadscrew: a table over the position of the axis itself."""

from .._kind import Kind

KIND = Kind(
    name="leadscrew",
    holder="compensation",
    prefix="kw.ssfk",
    activation="lr_param.ssfk",
    keyword="LEAD",
    channel="LSEC::sum epsilon",
    conventions=("leadscrew_", "direction_source", "start_direction"),
    follows=frozenset({"position", "direction"}),
    table=True,
    takes_constant=1,
    manual="kw.ssfk.manual_activation",
    adds="The entry is the error of the axis (actual minus setpoint); the controller adds its"
    " negative to the command position.",
)
