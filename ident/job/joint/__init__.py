"""Fits that share a group: identified together, then written and proven like any other."""

from typing import TYPE_CHECKING

from ..._lazy import importer

if TYPE_CHECKING:
    from ._group import (
        IdentifiedGroup as IdentifiedGroup,
        confounded as confounded,
        fit_group as fit_group,
        fit_group_of_one as fit_group_of_one,
    )
    from ._proof import (
        AxisSum as AxisSum,
        EffectShare as EffectShare,
        GroupResult as GroupResult,
        prove_group as prove_group,
    )
    from ._recording import GroupRecording as GroupRecording, read_group as read_group
    from ._share import (
        TOGETHER as TOGETHER,
        LeftOutDraft as LeftOutDraft,
        LeftOutResult as LeftOutResult,
    )

__getattr__ = importer(__name__)
