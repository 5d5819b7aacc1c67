"""Fits that share a group: identified together, then written and proven like any other."""

from ._apart import untold_apart as untold_apart
from ._group import IdentifiedGroup as IdentifiedGroup, fit_group as fit_group
from ._left_out import LeftOutDraft as LeftOutDraft, LeftOutResult as LeftOutResult
from ._member import members_of as members_of
from ._proof import prove_group as prove_group
from ._result import (
    AxisSum as AxisSum,
    EffectShare as EffectShare,
    GroupResult as GroupResult,
)
from ._share import TOGETHER as TOGETHER
