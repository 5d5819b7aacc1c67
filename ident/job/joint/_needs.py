"""Which columns the fits of a group use."""

from collections.abc import Sequence

from ._member import AbstractMember
from ._reader import GroupNeeds


def needs_of(members: Sequence[AbstractMember]) -> GroupNeeds:
    """Return the axes and sensors whose columns the fits use."""

    def unique(names: Sequence[str]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(names))

    return GroupNeeds(
        error=unique([one.axis for one in members]),
        position=unique([name for one in members for name in one.positions]),
        direction=unique([name for one in members for name in one.turning]),
        motion=unique([name for one in members for name in one.accelerating]),
        temperature=unique([name for one in members for name in one.sensors]),
    )
