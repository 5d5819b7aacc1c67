"""Fits that share a group: identified together, then written and proven like any other."""

from ._apart import untold_apart as untold_apart
from ._group import GroupPlan as GroupPlan, plan_groups as plan_groups
from ._left_out import LeftOutDraft as LeftOutDraft, LeftOutResult as LeftOutResult
from ._proof import GroupDraft as GroupDraft
from ._result import (
    AxisSum as AxisSum,
    EffectShare as EffectShare,
    GroupResult as GroupResult,
)
from ._share import TOGETHER as TOGETHER
