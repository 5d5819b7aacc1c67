"""What acts beside a fit and did not while it was measured: handed on, or refused."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ...data.measurements import DirectionUnknown, Measurement, explain_direction
from ..exchange import ExchangeError, Motion
from ..kinds import kind
from ..proof.axis import Loaded
from ._acting import acting_alone, acting_before, adds_nothing
from ._draft import AbstractDraft, AxisLists, Beside, Leftovers
from ._fit_schema import CrossSpec, FitSpec, LeadscrewSpec, PlaneSpec
from ._load import Job
from ._outside import positions_of
from ._rooms import Plans
from ._source import masters_of

_COUPLED = ("cross", "plane")
"""Tables over other axes, which may correct the same error."""


def leftovers(job: Job, plans: Plans) -> Leftovers:
    """Return what the fits of a job find: compensations that acted in no reading, but will.

    A table of the axis list's own lists over the same axes would correct again what a new
    one corrects. Where the job says that it was off while measuring, and the axis list
    that it acts, the new table is fitted to what it leaves.

    Raises:
        JobError: If the job does not say whether it acts, or acted.
    """
    left = Leftovers()
    for index, fit in enumerate(job.spec.fits):
        if not isinstance(fit, PlaneSpec | CrossSpec | LeadscrewSpec):
            continue
        lists = plans.lists[fit.axis]
        before = acting_before(job, fit.axis, lists)
        for name in _overlapping(job, fit, before):
            for source in fit.sources:
                if name in job.spec.measurements[source].active:
                    continue
                if name == "backlash" and not _is_stated(job, source, lists):
                    continue  # has no shape over the position
                _refuse_unclear(job, source, fit, name, before, lists)
                if index not in plans.single:
                    raise _unclear(
                        job, source, fit, name, before,
                        f'active = ["{name}"] with a measurement while it was on: fits of'
                        f" a group do not take it off; or {kind(name).activation} 0",
                    )  # fmt: skip
                words = f"the {name} of {before.used[name].listing.source}"
                left.add(index, source, _Acting(job, fit.axis, name, before, words))
    return left


def hand_on(job: Job, plans: Plans, draft: AbstractDraft, left: Leftovers) -> None:
    """Hand a fitted table on to the later ones of its axis that may correct the same.

    Only to readings of other measurements: those of its own know of it already.
    """
    if draft.compensation not in _COUPLED or draft.switch is None:
        return
    for index in plans.single:
        fit = job.spec.fits[index]
        if fit.axis != draft.axis or fit.compensation not in _COUPLED:
            continue
        if fit.compensation == draft.compensation:
            continue
        for source in fit.sources:
            active = job.spec.measurements[source].active
            if source not in draft.fit.sources and draft.compensation not in active:
                alone = acting_alone(job, draft)
                words = f"the {draft.compensation} that this job fits first"
                beside = _Acting(job, draft.axis, draft.compensation, alone, words)
                left.add(index, source, beside)


@dataclasses.dataclass(frozen=True)
class _Acting(Beside):
    """A compensation that lists hold."""

    job: Job
    axis: str
    name: str
    loaded: Loaded
    words: str

    def at(self, measured: Measurement) -> Float[np.ndarray, " t"]:
        places = positions_of(self.job, measured)
        directions = {}
        if self.name in ("backlash", "leadscrew"):
            try:
                way = explain_direction(measured, self.axis).values
                directions = {self.loaded.axis: way}
            except DirectionUnknown:
                pass
        motion = Motion(positions=places, directions=directions, time=None)
        added = self.loaded.parts(motion)
        if self.name not in added:
            axes = self.job.spec.axes
            missing = [
                f"{name}.position"
                for name, axis in axes.items()
                if axis.number in self.loaded.inputs(self.name)
                and axis.number not in places
            ]
            raise self.job.error(
                (),
                f"{self.words} will act on {self.axis} as well and was off while"
                f" {measured.source} was measured: found no {', '.join(missing)} there,"
                " expected it, so that the new table corrects what is left, or the same"
                ' group = "…" in the [[fits]] of both',
            )
        return added[self.name]


def _overlapping(job: Job, fit: FitSpec, before: Loaded) -> Iterator[str]:
    """Yield what the lists of an axis hold that acts over axes of a new table."""
    axes = job.spec.axes
    assert isinstance(fit, PlaneSpec | CrossSpec | LeadscrewSpec)
    over = {axes[name].number for name in masters_of(fit)}
    fitted = {other.compensation for other in job.spec.fits if other.axis == fit.axis}
    try:
        used = before.used
    except ExchangeError:
        return  # the checks of the lists say it
    for name, one in used.items():
        if name in fitted or name == "crosstalk" or adds_nothing(one):
            continue
        if name == "backlash" and isinstance(fit, LeadscrewSpec) and fit.bilateral:
            continue  # is switched off
        if over & set(before.inputs(name) or (before.axis,)):
            yield name


def _is_stated(job: Job, source: str, lists: AxisLists) -> bool:
    """Return whether it is known what was on while measuring, and what will be."""
    fields = job.spec.measurements[source].model_fields_set
    return lists.machine is not None and "active" in fields


def _refuse_unclear(
    job: Job, source: str, fit: FitSpec, name: str, before: Loaded, lists: AxisLists
) -> None:
    if lists.machine is None:
        raise job.error(
            ("axes", fit.axis),
            f"found no axis list (machine_data), while {before.used[name].listing.source}"
            f" holds a {name} over the same axis as the {fit.compensation} fit, which was"
            f" off while {source!r} was measured: where it acts, both correct the same"
            f" error; expected machine_data = the axis list, whose {kind(name).activation}"
            f' says whether it acts, or active = ["{name}"] in [measurements.{source}]'
            " with a measurement while it was on",
        )
    if not _is_stated(job, source, lists):
        raise _unclear(
            job, source, fit, name, before,
            f'active = ["{name}"] if it was on, [] if it was off: the'
            f" {fit.compensation} is then fitted to what it leaves",
        )  # fmt: skip


def _unclear(
    job: Job, source: str, fit: FitSpec, name: str, before: Loaded, expected: str
) -> Exception:
    machine = next(one.source for one in before.lists if one.kind == "axis")
    return job.error(
        ("measurements", source, "active"),
        f"found no {name}, which {machine} switches on over the same axis as the"
        f" {fit.compensation} fit of {fit.axis} ({kind(name).activation}): where it was off"
        f" while measuring, both would correct the same error; expected {expected}",
    )
