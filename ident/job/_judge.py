"""What the checker says of the lists of a job, each alone and as a set."""

import dataclasses
from collections.abc import Iterable, Sequence

from ...data.lists import Finding, ListFile, check
from ._lists import AxisFiles
from ._load import Job
from ._result import Remark


def judge_files(
    job: Job, files: Sequence[AxisFiles]
) -> tuple[tuple[AxisFiles, ...], tuple[Remark, ...]]:
    """Return the lists with their findings, and what the set as a whole has.

    New lists are judged beside the existing ones of the other axes. What stood in the
    user's lists before is named as such; an error that is new fails the list.
    """
    existing = {axis: _existing(job, axis) for axis in job.spec.axes}
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


def _existing(job: Job, name: str) -> list[ListFile]:
    axis = job.spec.axes[name]
    files = (axis.listing, axis.machine_data)
    return [ListFile.read(job.file(file)) for file in files if file is not None]


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
