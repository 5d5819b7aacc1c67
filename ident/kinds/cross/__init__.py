"""Cross: a table over the position of one master."""

from .._kind import Kind

KIND = Kind(
    name="cross",
    holder="compensation",
    prefix="kw.crosscomp",
    activation="lr_param.crosscomp",
    keyword="CROSS",
    channel="CROSSC::actual_offset",
    conventions=("cross_",),
    follows=frozenset({"position"}),
    cycles=("kw.crosscomp.n_cycles", 20),
    table=True,
    takes_constant=3,
    manual="kw.crosscomp.manual_activation",
    owner="cross_list",
    adds="The controller adds the entry to the command position of the axis as it stands.",
)
