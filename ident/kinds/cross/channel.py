"""What a log shows of a cross table."""

from typing import final

from ...proof.verify import TableChannel


@final
class CrossChannel(TableChannel):
    """A table over one master."""

    edge_rule = "cross_edge"

    def prepare(self) -> None:
        super().prepare()
        axes = sorted(self.motion.positions)
        self.swaps = tuple((axis,) for axis in axes if (axis,) != self.masters)
        self.relevant = ("table_filter",) if self.listed > 1 else ()


CHANNEL = CrossChannel
