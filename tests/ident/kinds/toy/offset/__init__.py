"""A compensation that the library does not know: a constant offset of one axis."""

from axcomp.ident.kinds import Kind

KIND = Kind(
    name="offset",
    holder="compensation",
    prefix="kw.offset",
    activation="lr_param.offset",
    keyword="OFFSET",
    variable="V.A.OFFSET_COMP_CURR",
    channel=None,
    conventions=(),
    noun="the offset",
    adds="The controller adds the value to the command position of the axis.",
)
