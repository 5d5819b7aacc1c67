"""A compensation that the library does not know: a constant offset of one axis."""

from axcomp.ident.kinds import Kind

KIND = Kind(
    name="offset",
    holder="compensation",
    prefix="kw.offset",
    activation="lr_param.offset",
    keyword="OFFSET",
    channel=None,
    conventions=(),
    adds="The controller adds the value to the command position of the axis.",
)
