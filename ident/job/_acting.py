"""What will act beside a fit, and did not while it was measured: handed on to it, or refused."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ...data.lists import new_list
from ..exchange import AxisLists, ExchangeError
from ..kinds import kind
from ..kinds._keys import FitSpec
from ..readings import Rows
from ._draft import AbstractDraft, Leftovers
from .file._load import Job
from .write._lists import read_back


def leftovers(job: Job) -> Leftovers:
    """Return what the fits of a job find: compensations that acted in no reading, but will.

    A table of the axis list's own lists over the same axes would correct again what a new
    one corrects. Where the job says that it was off while measuring, and the axis list
    that it acts, the new table is fitted to what it leaves.

    Raises:
        JobError: If the job does not say whether it acts, or acted.
    """
    left, grouped = Leftovers(), job.spec.grouped
    for index, fit in enumerate(job.spec.fits):
        if not fit.kind.table:
            continue
        before = job.lists[fit.axis]
        try:
            used = before.used
        except ExchangeError:
            continue  # the checks of the lists say it
        _refuse_taken_over(job, fit, before)
        for name in _overlapping(job, fit, before):
            for source in fit.sources:
                if name in job.spec.measurements[source].active:
                    continue
                shaped = "position" in kind(name).follows
                if not shaped and not _is_stated(job, source, before):
                    continue
                _refuse_unclear(job, source, fit, name, before)
                if index in grouped:
                    raise _unclear(
                        job, source, fit, name, before,
                        f'active = ["{name}"] with a measurement while it was on: fits of'
                        f" a group do not take it off; or {kind(name).activation} 0",
                    )  # fmt: skip
                words = f"the {name} of {used[name].listing.source}"
                left.add(index, source, Acting(job, fit.axis, name, before, words))
    return left


def hand_on(draft: AbstractDraft, left: Leftovers) -> None:
    """Hand a fitted table on to the later ones of its axis that may correct the same.

    Only to readings of other measurements: those of its own know of it already.
    """
    if not _is_coupled(draft.fit) or not draft.written:
        return
    job, grouped = draft.job, draft.job.spec.grouped
    for index, fit in enumerate(job.spec.fits):
        if index in grouped or fit.axis != draft.axis or not _is_coupled(fit):
            continue
        if fit.compensation == draft.compensation:
            continue
        for source in fit.sources:
            active = job.spec.measurements[source].active
            if source not in draft.fit.sources and draft.compensation not in active:
                alone = _alone(draft)
                words = f"the {draft.compensation} that this job fits first"
                beside = Acting(job, draft.axis, draft.compensation, alone, words)
                left.add(index, source, beside)


def _alone(draft: AbstractDraft) -> AxisLists:
    """Return what one fit adds, as if it were all that acts on its axis."""
    job, number = draft.job, draft.lists.axis
    with job.blaming(("fits", draft.index)):
        entries = draft.entries()
    listing = new_list({"kopf.achs_nr": number} | entries) if entries else None
    return AxisLists(number, read_back(listing), None, job.reading)


def _is_coupled(fit: FitSpec) -> bool:
    """Return whether it is a table over other axes: these may correct the same error."""
    return fit.kind.table and not fit.lengths


@dataclasses.dataclass(frozen=True)
class Acting:
    """A compensation that acted in no reading of a fit, and will act beside it.

    Attributes:
        job: The job.
        axis: On which it acts.
        name: Of the compensation.
        loaded: The lists that hold it.
        words: Which it is.
    """

    job: Job
    axis: str
    name: str
    loaded: AxisLists
    words: str

    def at(self, rows: Rows) -> Float[np.ndarray, " t"]:
        """Return what it adds to the readings of a measurement, in mm or °.

        Raises:
            JobError: If they do not hold what it looks at.
        """
        turns = "direction" in kind(self.name).follows
        motion = rows.standing(self.axis if turns else None)
        added = self.loaded.parts(motion)
        if self.name not in added:
            missing = [
                f"{name}.position"
                for name, axis in self.job.spec.axes.items()
                if axis.number in self.loaded.inputs(self.name)
                and axis.number not in motion.positions
            ]
            raise self.job.error(
                (),
                f"{self.words} will act on {self.axis} as well and was off while"
                f" {rows.measured.source} was measured: found no {', '.join(missing)} there,"
                " expected it, so that the new table corrects what is left, or the same"
                ' group = "…" in the [[fits]] of both',
            )
        return added[self.name]


def _overlapping(job: Job, fit: FitSpec, before: AxisLists) -> Iterator[str]:
    """Yield what the lists of an axis hold that acts over axes of a new table."""
    axes = job.spec.axes
    over = {axes[name].number for name in fit.over}
    fitted = {other.compensation for other in job.spec.fits if other.axis == fit.axis}
    for name in before.used:
        if name in fitted or name in fit.switches_off or not before.acts(name):
            continue
        if "acceleration" in kind(name).follows:
            continue
        if over & set(before.inputs(name) or (before.axis,)):
            yield name


def _refuse_taken_over(job: Job, fit: FitSpec, before: AxisLists) -> None:
    """Raise where a table takes over what may have acted while it was measured."""
    for name in set(fit.switches_off) & before.used.keys():
        for source in fit.sources:
            stated = "active" in job.spec.measurements[source].model_fields_set
            if stated or not before.acts(name):
                continue
            raise job.error(
                ("measurements", source),
                f"found no active, and {before.used[name].listing.source} switches on the {name}"
                f" of {fit.axis}, which this {fit.compensation} takes over: expected"
                " active = [] if it was off while measuring; if it was on, measure"
                " without it",
            )


def _is_stated(job: Job, source: str, before: AxisLists) -> bool:
    """Return whether it is known what was on while measuring, and what will be."""
    fields = job.spec.measurements[source].model_fields_set
    return before.machine is not None and "active" in fields


def _refuse_unclear(
    job: Job, source: str, fit: FitSpec, name: str, before: AxisLists
) -> None:
    if before.machine is None:
        raise job.error(
            ("axes", fit.axis),
            f"found no axis list (machine_data), while {before.used[name].listing.source}"
            f" holds a {name} over the same axis as the {fit.compensation} fit, which was"
            f" off while {source!r} was measured: where it acts, both correct the same"
            f" error; expected machine_data = the axis list, whose {kind(name).activation}"
            f' says whether it acts, or active = ["{name}"] in [measurements.{source}]'
            " with a measurement while it was on",
        )
    if not _is_stated(job, source, before):
        raise _unclear(
            job, source, fit, name, before,
            f'active = ["{name}"] if it was on, [] if it was off: the'
            f" {fit.compensation} is then fitted to what it leaves",
        )  # fmt: skip


def _unclear(
    job: Job, source: str, fit: FitSpec, name: str, before: AxisLists, expected: str
) -> Exception:
    assert before.machine is not None  # it says that both act
    return job.error(
        ("measurements", source, "active"),
        f"found no {name}, which {before.machine.source} switches on over the same axis as the"
        f" {fit.compensation} fit of {fit.axis} ({kind(name).activation}): where it was off"
        f" while measuring, both would correct the same error; expected {expected}",
    )
