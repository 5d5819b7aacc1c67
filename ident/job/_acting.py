"""What will act beside a fit, and did not while it was measured: handed on to it, or refused."""

import contextlib
import dataclasses
from collections.abc import Container, Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ...data.lists import new_list
from ..exchange import AxisLists, ExchangeError, InUse, to_add
from ..kinds import kind
from ..kinds._keys import Fault, FitSpec
from ..proof.axis import added_beyond
from ..readings import Rows
from ._draft import AbstractDraft
from .file._load import Job
from .write._lists import read_back


def leftovers(job: Job) -> dict[tuple[int, str], list["Acting"]]:
    """Return what the fits of a job find: compensations that acted in no reading, but will.

    A table of the axis list's own lists over the same axes would correct again what a new
    one corrects. Where the job says that it was off while measuring, and the axis list
    that it acts, the new table is fitted to what it leaves. A backlash beside a table of
    both directions is refused: it is one value, and such a table may hold it already.

    Raises:
        JobError: If the job does not say whether it acts, or acted.
    """
    grouped = job.spec.grouped
    left: dict[tuple[int, str], list[Acting]] = {}
    for index, fit in enumerate(job.spec.fits):
        if not (fit.kind.table or fit.kind.follows == {"direction"}):
            continue
        before = job.lists[fit.axis]
        try:
            used = before.used
        except ExchangeError:
            continue  # the checks of the lists say it
        faults = (*_from_elsewhere(job, fit), *_conflicts(job, fit, before))
        for where, reason in faults:
            raise job.error(where, reason)
        for name in _overlapping(job, fit, before):
            for source in fit.sources:
                if name in job.spec.measurements[source].active:
                    continue
                is_stated = job.spec.measurements[source].stated_active is not None
                decided = before.machine is not None and is_stated
                if not decided or index in grouped or not fit.kind.table:
                    raise _unclear(job, source, fit, name, before)
                words = f"the {name} of {used[name].listing.source}"
                acting = Acting(job, fit.axis, name, before, words)
                left.setdefault((index, source), []).append(acting)
    return left


def _from_elsewhere(job: Job, fit: FitSpec) -> Iterator[Fault]:
    """Yield what moves the axis of a fit from the list of another axis."""
    number = job.spec.axes[fit.axis].number
    for name, lists in job.lists.items():
        foreign = list[InUse]()
        with contextlib.suppress(ExchangeError):  # the checks of the lists say it
            foreign += (held for held in lists.in_use if held.axis == number)
        for held in foreign if name != fit.axis else ():
            yield (
                ("axes", name, "list"),
                f"found a {held.name} in {held.listing.source} that moves {fit.axis} by the"
                f" conventions of this machine: a job judges {fit.axis} by its own lists, so"
                " that both would correct the same error unseen; expected it in the list of"
                f" {fit.axis}, or left out, and measured without it",
            )


def hand_on(
    draft: AbstractDraft,
    later: Sequence[int],
    left: dict[tuple[int, str], list["Acting"]],
) -> None:
    """Hand a fitted list on to the later tables of its axis that correct what it leaves.

    Those of the same measurements; and of other ones, in which it did not act, where both
    may correct the same: added to what they find. What follows more than position and
    direction is not handed on.
    """
    job, name = draft.job, draft.compensation
    if not draft.written or draft.kind.follows - {"position", "direction"}:
        return
    for index in later:
        fit = job.spec.fits[index]
        if not fit.kind.table or fit.axis != draft.axis:
            continue
        # Tables over other axes may correct the same error.
        coupled = draft.kind.table and not (draft.fit.lengths or fit.lengths)
        for source in fit.sources:
            shared = source in draft.fit.sources
            if shared or (coupled and name not in job.spec.measurements[source].active):
                words = f"the {name} of an earlier fit of this job"
                beside = Acting(job, draft.axis, name, _alone(draft), words, shared)
                left.setdefault((index, source), []).append(beside)


def _alone(draft: AbstractDraft) -> AxisLists:
    """Return what one fit adds, as if it were all that acts on its axis."""
    job, number = draft.job, draft.lists.axis
    with job.blaming(("fits", draft.index)):
        entries, machine_entries = draft.entries(), draft.machine_entries(draft.cycles)
    listing = new_list({"kopf.achs_nr": number} | entries) if entries else None
    machine = None if entries else to_add(number, machine_entries, of=draft.axis)
    return AxisLists(number, read_back(listing), read_back(machine), job.reading)


@dataclasses.dataclass(frozen=True)
class Acting:
    """A compensation that acted in no reading of a fit, and will act beside it.

    The lists that are loaded hold it; it may be shared: fitted to the same readings.
    """

    job: Job
    axis: str
    name: str
    loaded: AxisLists
    words: str
    shared: bool = False

    def at(self, rows: Rows) -> Float[np.ndarray, " t"]:
        """Return what it adds to the readings of a measurement beyond what acted, in mm or °.

        Raises:
            JobError: If they do not hold what it looks at.
        """
        turns = "direction" in kind(self.name).follows
        motion = rows.standing(self.axis if turns else None)
        acted = [name for name in rows.spec.active if name == self.name]
        before = self.job.lists[self.axis]
        added = added_beyond(self.loaded, before, acted, motion)
        if self.name not in added:
            inputs = self.loaded.inputs(self.name)
            missing, named = absent(self.job, inputs, motion.positions)
            raise self.job.error(
                (),
                f"{self.words} will act on {self.axis} as well and was off while"
                f" {rows.measured.source} was measured: found no {', '.join(missing)} there,"
                " expected it, so that the new table corrects what is left, or the same"
                f' group = "…" in the [[fits]] of both.{named}',
            )
        return added[self.name]


def absent(
    job: Job, inputs: Iterable[int], positions: Container[int]
) -> tuple[list[str], str]:
    """Return the roles of positions that readings lack, and how to name axes of a list.

    A list may follow an axis that the job does not name.
    """
    axes = {axis.number: name for name, axis in job.spec.axes.items()}
    numbers = sorted(number for number in inputs if number not in positions)
    strange = [f"[axes.A{k}] number = {k}" for k in numbers if k not in axes]
    words = f" Name the axis as well: {', '.join(strange)}." if strange else ""
    return [f"{axes.get(k, f'A{k}')}.position" for k in numbers], words


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
        if not fit.kind.table and not before.turns(name):
            continue  # the same in both directions: no backlash
        if over & set(before.inputs(name) or (before.axis,)):
            yield name


def _conflicts(job: Job, fit: FitSpec, before: AxisLists) -> Iterator[Fault]:
    """Yield what of the lists of an axis contradicts its readings, each with the answers."""
    specs = {source: job.spec.measurements[source] for source in fit.sources}
    fitted = {other.compensation for other in job.spec.fits if other.axis == fit.axis}
    # A table takes over what may have acted while it was measured.
    for name in fit.switches_off:
        for source, spec in specs.items():
            if spec.stated_active is None and before.acts(name):
                yield (
                    ("measurements", source),
                    f"found no active, and {before.used[name].listing.source} switches on the"
                    f" {name} of {fit.axis}, which this {fit.compensation} takes over:"
                    " expected active = [] if it was off while measuring; if it was on,"
                    " measure without it",
                )
    # The axis list has off what acted in the readings over the same axes: what a new table leaves
    # to it, nothing would correct.
    machine = before.machine
    for name in _overlapping(job, fit, dataclasses.replace(before, machine=None)):
        entry = kind(name).activation
        for source, spec in specs.items():
            if machine is not None and name not in before.used and name in spec.active:
                yield (
                    ("measurements", source, "active"),
                    f"found {name}, which {machine.source} switches off on"
                    f" {fit.axis} ({entry}): the {fit.compensation} would leave to it"
                    f" what nothing corrects then; expected {entry} 1 there if it will"
                    f" act, or active without {name} if it was off on {fit.axis}",
                )
    # A PLC moves an axis by its temperature: what a warm axis has grown by would stand in the
    # table, too.
    for name in before.used if fit.kind.table and fit.lengths else ():
        if not kind(name).by_plc or name in fitted or before.acts(name):
            continue
        for source, spec in specs.items():
            if spec.at_reference or name in spec.active:
                continue
            yield (
                ("measurements", source),
                f"found lengths of {fit.axis} without their temperature, and"
                f" {before.used[name].listing.source} switches a law of the PLC on"
                f" ({kind(name).activation}): what a warm axis has grown by would be taken off"
                " twice; expected expansion and material_temperature, already_compensated ="
                " true if these lengths are those at the reference temperature, or active ="
                f' ["{name}"] if it acted',
            )


def _unclear(
    job: Job, source: str, fit: FitSpec, name: str, before: AxisLists
) -> Exception:
    """Return the error that the overlap is, with the keys that settle it."""
    entry, on = kind(name).activation, f'active = ["{name}"]'
    unable = "fits of a group do" if fit.kind.table else f"a {fit.compensation} does"
    if before.machine is None:
        expected = (
            f"machine_data = the axis list, in [axes.{fit.axis}], whose {entry} says"
            f" whether it acts, or {on} with a measurement while it was on"
        )
    elif job.spec.measurements[source].stated_active is None and fit.kind.table:
        expected = (
            f"{on} if it was on, [] if it was off: the {fit.compensation} is then"
            " fitted to what it leaves"
        )
    else:
        expected = (
            f"{on} with a measurement while it was on: {unable} not take it off; or"
            f" {entry} 0"
        )
    return job.error(
        ("measurements", source, "active"),
        f"found no {name}, which {before.used[name].listing.source} holds over the same"
        f" axis as the {fit.compensation} fit of {fit.axis} ({entry}): where it acts and was"
        f" off while measuring, both would correct the same error; expected {expected}",
    )
