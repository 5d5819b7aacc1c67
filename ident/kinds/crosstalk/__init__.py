"""Crosstalk: an offset of the axis while another one accelerates."""

from .._kind import Kind

KIND = Kind(
    name="crosstalk",
    words="an offset while another axis accelerates",
    holder="compensation",
    prefix="kw.crosstalk",
    activation="lr_param.crosstalk",
    keyword="CROSSTALK",
    variable="V.A.CROSSTALK_COMP_CURR",
    channel="CROSSTALK::end_offset",
    conventions=("crosstalk_",),
    follows=frozenset({"position", "acceleration"}),
    demanded=False,
)
