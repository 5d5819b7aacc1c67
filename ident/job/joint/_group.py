"""A group of fits from its plan to its drafts."""

import dataclasses
from collections.abc import Mapping, Sequence

from ...exchange import ExchangeError
from ...fit import FitError
from .._draft import AbstractDraft, AxisLists
from .._group_faults import groups_of
from .._load import Job
from .._source import Tables
from ._identify import IdentifiedGroup, identify_group
from ._left_out import LeftOutDraft
from ._member import AbstractMember
from ._members import members_of
from ._proof import GroupDraft
from ._reader import GroupNeeds
from ._recording import GroupRecording, read_group
from ._share import Share


@dataclasses.dataclass(frozen=True)
class GroupPlan:
    """A group before its measurements are looked at.

    Attributes:
        name: In the job.
        members: Its fits.
    """

    name: str
    members: tuple[AbstractMember, ...]

    @property
    def words(self) -> str:
        """What is fitted, in words."""
        own = ", ".join(one.name for one in self.members)
        return f"group {self.name!r} together: {own}"

    def fit(self, job: Job, tables: Tables) -> GroupDraft:
        """Read the measurements and fit all members together.

        Raises:
            MeasurementError: If a role is missing or a value cannot be used.
            JobError: If the readings cannot carry the fit, or a result fits no list.
        """
        members = self.members
        recording = read_group(tables, [one.spec for one in members], _needs(members))
        where = ("fits", members[0].index)
        sources = ", ".join(members[0].spec.sources)
        try:
            found = identify_group(job, members, recording)
        except FitError as error:
            reason = f"group {self.name!r} from {sources}: {error}"
            raise job.error(where, reason) from None
        shares = tuple(
            _share(self.name, k, members, recording, found) for k in range(len(members))
        )
        drafts = []
        for one, share in zip(members, shares, strict=True):
            drafts.append(_draft(job, one, share))
        return GroupDraft(self.name, members, recording, found, shares, tuple(drafts))


def plan_groups(
    job: Job, tables: Tables, lists: Mapping[str, AxisLists]
) -> tuple[GroupPlan, ...]:
    """Return the groups of a job, planned.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
    """
    return tuple(
        GroupPlan(name, members_of(job, tables, own, lists))
        for name, own in groups_of(job.spec).items()
    )


def _needs(members: Sequence[AbstractMember]) -> GroupNeeds:
    def unique(names: Sequence[str]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(names))

    return GroupNeeds(
        error=unique([one.axis for one in members]),
        position=unique([name for one in members for name in one.positions]),
        direction=unique([name for one in members for name in one.turning]),
        motion=unique([name for one in members for name in one.accelerating]),
        temperature=unique([name for one in members for name in one.sensors]),
    )


def _share(
    name: str,
    k: int,
    members: Sequence[AbstractMember],
    recording: GroupRecording,
    found: IdentifiedGroup,
) -> Share:
    part = found.parts[k]
    axis = part.effect.axis
    beside = [
        j for j, each in enumerate(found.parts) if j != k and each.effect.axis == axis
    ]
    return Share(
        group=name,
        others=tuple(found.parts[j].name for j in beside),
        tables=tuple(
            found.parts[j].name
            for j in beside
            if members[j].holds_constant and found.written[j]
        ),
        recording=recording,
        fit=found.fit,
        part=part,
        constant=found.constant[k],
        predicted=found.held_out[axis],
        written=found.written[k],
    )


def _draft(job: Job, one: AbstractMember, share: Share) -> AbstractDraft:
    if not share.written:
        return LeftOutDraft(one.index, one.spec, one.lists, share)
    try:
        return one.draft(job, share)
    except FitError as error:
        return LeftOutDraft(one.index, one.spec, one.lists, share, str(error))
    except ExchangeError as error:
        raise job.error(("fits", one.index), f"{one.name}: {error}") from None
