"""Every fit of a job: all of them planned, then fitted in the order that they need."""

import contextlib
import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...data.errors import AxcompError
from ...data.measurements import standstill_words
from ..core import FitError
from ..kinds._keys import FitSpec
from ..readings import Tables
from ._acting import hand_on, leftovers
from ._draft import AbstractDraft
from .file._faults import JobError
from .file._load import Job

if TYPE_CHECKING:
    from .joint._group import IdentifiedGroup


def fit_all(
    tables: Tables, say: Callable[[str], None]
) -> tuple[list[AbstractDraft], list["IdentifiedGroup"]]:
    """Plan all fits of a job, then fit one after the other; later ones take what is left.

    Groups come first: each explains the whole error of its measurements. Then backlash:
    it leaves the readings of both directions on the reference flank, where a table of
    one direction belongs.

    Args:
        tables: Measurements of the job.
        say: Called with a short line before each fit.

    Returns:
        The draft of each fit, in the order of the job, and the groups.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit, or the readings
            determine none of the fits.
        MeasurementError: If a measurement cannot be used.
    """
    job = tables.job
    fits, grouped = job.spec.fits, job.spec.grouped
    _refuse_streams(job, grouped)
    drafts: dict[int, AbstractDraft] = {}
    groups: list[IdentifiedGroup] = []
    plans = [fit.kind.planner.plan(tables, k, fit) for k, fit in enumerate(fits)]
    single = {k: plan for k, plan in enumerate(plans) if k not in grouped}
    order = sorted(single, key=lambda k: not fits[k].kind.fitted_first)
    left = leftovers(job)
    for name, indices in job.spec.groups.items():
        from .joint._group import fit_group  # takes long to load

        every = [plans[k] for k in indices]
        names = ", ".join(member.name for member in every)
        say(f"fitting group {name!r} together: {names}")
        group, shares = fit_group(tables, name, every)
        groups.append(group)
        drafts |= shares
        for member in shares.values():
            hand_on(member, order, left)
    undetermined: dict[int, FitError] = {}
    confounded: dict[int, str] = {}
    several = len({fits[k].axis for k in single}) < len(single)
    if several or any(fits[k].kind.often_open for k in single):
        from .joint._group import confounded as examined

        confounded = examined(tables, single)
    for place, k in enumerate(order):
        draft = None
        if k not in confounded or fits[k].kind.partial:
            say(f"fitting {fits[k].compensation} of {fits[k].axis}")
            try:
                with job.blaming(("fits", k), f"{_start(fits[k])}: "):
                    draft = single[k].fit_single(tables, left)
            except JobError as error:
                reason = _with_standing(error.reason, tables, fits[k])
                raise JobError(error.source, error.line, reason) from None
            except FitError as error:
                if k not in confounded:
                    undetermined[k], confounded[k] = error, str(error)
        if draft is None or (k in confounded and draft.written and not draft.partial):
            draft = single[k].left_out(confounded[k])
        drafts[k] = draft
        hand_on(draft, order[place + 1 :], left)
    if len(undetermined) == len(fits):
        k = next(iter(undetermined))
        reason = _with_standing(str(undetermined[k]), tables, fits[k])
        raise job.error(("fits", k), f"{_start(fits[k])}: {reason}")
    for (k, _), acting in left.items():
        beside = dict.fromkeys((*drafts[k].beside, *(each.name for each in acting)))
        drafts[k] = dataclasses.replace(drafts[k], beside=tuple(beside))
    return [drafts[k] for k in range(len(fits))], groups


def _start(fit: FitSpec) -> str:
    return f"{fit.name} from {', '.join(fit.sources)}"


def _with_standing(reason: str, tables: Tables, fit: FitSpec) -> str:
    """Return why nothing came out of a fit, and why few readings are left of its logs."""
    words = []
    for name in fit.sources:
        # What cannot be read, or not as a whole, is what the reason is about.
        with contextlib.suppress(AxcompError, OSError):
            if tables.large(name) is None:
                measured = tables.measured(name, fit.axis)
                words.append(standstill_words(measured, fit.axis))
    return ". ".join([reason, *filter(None, words)]).replace("..", ".")


def _refuse_streams(job: Job, grouped: frozenset[int]) -> None:
    """Raise where a log is to be read in pieces for a fit that needs the whole of it.

    Raises:
        JobError: Naming the measurement.
    """
    for index, fit in enumerate(job.spec.fits):
        if index not in grouped and fit.kind.table:
            continue
        for name in fit.sources:
            if job.spec.measurements[name].stream is True:
                words = f"the {fit.compensation} fit of {fit.axis}"
                words += " in a group" if index in grouped else ""
                raise job.error(
                    ("measurements", name, "stream"),
                    f"found true, but {words} needs its log in memory, expected it for"
                    " plane, cross and leadscrew fits of their own",
                )
