"""The fits of a group, planned, and the columns that they use."""

from collections.abc import Mapping, Sequence

from ...kinds._parts import group_of
from .._draft import AxisLists
from .._load import Job
from .._source import Tables
from ._member import AbstractMember
from ._reader import GroupNeeds


def members_of(
    job: Job,
    tables: Tables,
    indices: Sequence[int],
    lists: Mapping[str, AxisLists],
) -> tuple[AbstractMember, ...]:
    """Return the fits of a group: existing lists read, keys understood.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
        MeasurementError: If the only sensor is to be taken and there is none.
    """
    pairs = [(index, job.spec.fits[index]) for index in indices]
    return tuple(
        group_of(fit.compensation).member(job, tables, index, fit, lists[fit.axis])
        for index, fit in pairs
    )


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
        heated=unique([one.axis for one in members if one.sensors]),
    )
