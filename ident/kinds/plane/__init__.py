"""Plane: a grid over the positions of two masters."""

from .._kind import Kind

KIND = Kind(
    name="plane",
    holder="compensation",
    prefix="kw.crosscomp2",
    activation="lr_param.crosscomp2",
    keyword="PLANE",
    channel="CC2::correction",
    conventions=("plane_",),
    follows=frozenset({"position"}),
    cycles=("kw.crosscomp2.n_cycles", 20),
    table=True,
    takes_constant=2,
    often_open=True,
    manual="kw.crosscomp2.manual_activation",
    adds="The controller adds the entry to the command position of the axis as it stands.",
)
