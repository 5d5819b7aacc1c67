"""What the checker says of the lists of a job, each alone and as a set."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

from ...data.lists import Finding, ListFile, check
from ._draft import AxisLists
from ._lists import AxisFiles
from ._load import Job
from ._result import Remark


def judge_files(
    job: Job, files: Sequence[AxisFiles], lists: Mapping[str, AxisLists]
) -> tuple[tuple[AxisFiles, ...], tuple[Remark, ...]]:
    """Return the lists with their findings, and what the set as a whole has.

    New lists are judged beside the existing ones of the other axes. What stood in the
    user's lists before is named as such; an error that is new fails the list.

    Args:
        job: The job.
        files: The axes that are fitted.
        lists: What every axis of the job has already.
    """
    existing = {
        axis: [one for one in (own.compensation, own.machine) if one is not None]
        for axis, own in lists.items()
    }
    theirs = [listing for own in existing.values() for listing in own]
    fitted = {one.axis for one in files}
    others = [
        listing
        for axis, own in existing.items()
        if axis not in fitted
        for listing in own
    ]
    ours = [listing for one in files for _, listing in one.lists]
    known = {_identity(item) for item in _check(job, theirs)} if theirs else set()
    findings = _check(job, [*ours, *others])
    judged = []
    for one in files:
        names = [name for name, _ in one.lists]
        own = tuple(item for item in findings if item.file in names)
        remarks = (*one.remarks, *_remarks(own, known))
        judged.append(dataclasses.replace(one, findings=own, remarks=remarks))
    rest = [item for item in findings if item.file in {one.source for one in others}]
    new = [item for item in rest if _identity(item) not in known]
    return tuple(judged), tuple(_remarks(new, known))


def _check(job: Job, lists: Sequence[ListFile]) -> list[Finding]:
    axes = job.spec.axes
    pairs = [
        (axis.number, axes[axis.gantry].number)
        for axis in axes.values()
        if axis.gantry is not None
    ]
    return check(lists, build=job.spec.controller.build, gantry=pairs)


def _identity(item: Finding) -> tuple[str | None, str, str]:
    # Without the line, which an edit may move.
    return item.id, item.message, item.found


def _remarks(
    findings: Iterable[Finding], known: set[tuple[str | None, str, str]]
) -> Iterable[Remark]:
    for item in findings:
        if item.level == "info":
            continue
        if _identity(item) in known:
            yield Remark.warning(f"Was in your list before and stays: {item}")
        else:
            yield Remark("error" if item.level == "error" else "warning", str(item))
