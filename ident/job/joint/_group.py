"""A group of fits from its plan to its drafts."""

import dataclasses
from collections.abc import Mapping

from ...exchange import ExchangeError
from ...fit import FitError
from ...readings import Tables
from .._checks import groups_of
from .._draft import AbstractDraft, AxisLists
from .._load import Job
from ._identify import identify_group
from ._left_out import LeftOutDraft
from ._member import AbstractMember, members_of, needs_of
from ._proof import GroupDraft
from ._recording import read_group
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
        every = self.members
        recording = read_group(tables, [one.fit for one in every], needs_of(every))
        where = ("fits", every[0].index)
        unfit = {}
        for k, one in enumerate(every):
            why = one.unfit(recording) or one.confused(job, every, recording)
            if len(every) == 1:
                why = why or one.undetermined(recording.data)
            if why:
                unfit[k] = why
        members = tuple(one for k, one in enumerate(every) if k not in unfit)
        sources = ", ".join(every[0].fit.sources)
        start = f"group {self.name!r} from {sources}"
        if not members:
            reason = "; ".join(f"{every[k].name}: {why}" for k, why in unfit.items())
            raise job.error(where, f"{start}: {reason}")
        try:
            found = identify_group(job, self.name, members, recording)
        except FitError as error:
            raise job.error(where, f"{start}: {error}") from None
        drafts = [_draft(job, one, Share(found, k)) for k, one in enumerate(members)]
        left_out = tuple(
            LeftOutDraft(one.index, one.fit, one.lists, unfit[k])
            for k, one in enumerate(every)
            if k in unfit
        )
        return GroupDraft(found, tuple(drafts), left_out)


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


def _draft(job: Job, one: AbstractMember, share: Share) -> AbstractDraft:
    if not share.group.written[share.number]:
        return LeftOutDraft(one.index, one.fit, one.lists, "", share)
    try:
        return one.draft(job, share)
    except FitError as error:
        return LeftOutDraft(one.index, one.fit, one.lists, str(error), share)
    except ExchangeError as error:
        raise job.error(("fits", one.index), f"{one.name}: {error}") from None
