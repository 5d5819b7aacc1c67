"""All that acts on one axis, judged together: offsets, motion, and what switching does.

Read `_workspace` (all that the lists of an axis add, over the travel) and `_together` (on the
readings of a measurement); one compensation that comes or goes is the gate's.
"""

from .._gate import check_switching as check_switching
from .._reversal import (
    largest_step as largest_step,
    switching_cycles as switching_cycles,
)
from ._together import (
    Together as Together,
    acts_against as acts_against,
    added_beyond as added_beyond,
    judge_together as judge_together,
)
from ._workspace import (
    Travel as Travel,
    judge_workspace as judge_workspace,
    warm_states as warm_states,
)
