"""What a fit has to say of its runs: where they contradict each other, how far they lie apart."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from ..result._result import Remark

if TYPE_CHECKING:
    from ._draft import TableDraft

SEEN, TINY = 5.0, 1e-3
"""Deviations of a reading, and mm or °, by which a table changes beyond its readings unsaid."""
_IN_A_ROW, _SURELY = 4, 0.98
"""Runs that tell a creep from chance, and how surely."""
_EQUAL, _BY_CHANCE = 1e-9, 0.1
"""mm or °, within which two readings are the same number; share of the places that show one by
chance, from which on it says nothing that others do."""


def run_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Return which runs contradict others, what each was allowed, and how far they lie apart."""
    fit = draft.estimate
    if fit.suspect_runs:
        runs = ", ".join(str(run) for run in fit.suspect_runs)
        counts = "does not count in their mean"
        if fit.loss == "gauss":
            counts = 'counts in their mean all the same (loss = "gauss")'
        yield Remark.warning(f"Contradicts the other runs, and {counts}: run {runs}.")
    yield from _torn_remarks(draft)
    yield from _zero_of_each_direction(draft)
    if len(fit.runs) > 1:
        largest = max(abs(run.offset) for run in fit.runs)
        effect = "offset and drift" if draft.run_effects == "drift" else "offset"
        yield Remark.info(
            f"Each of the {len(fit.runs)} runs was allowed an {effect} of its own"
            f" (offsets up to {draft.small(largest, '.3g')}); the table keeps their"
            " mean."
        )
        zeros = [*_zeros_apart(draft)]
        yield from zeros or _creep_remarks(draft)


def _torn_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Return where some runs contradict the others on a part of their way."""
    apart, readings = draft.estimate.apart, draft.readings
    if not apart.any() or readings.run is None:
        return
    torn = apart != 0.0
    where = " and ".join(
        f"{name} = {column.min():g} to {column.max():g}"
        for name, column in zip(draft.fit.over, readings.positions[torn].T, strict=True)
    )
    far = draft.small(float(np.median(np.abs(apart[torn]))))
    named = ", ".join(str(run) for run in np.unique(readings.run[torn]))
    yield Remark.warning(
        f"Runs contradict each other at {where}, run {named} by {far}, as no offset or drift"
        " explains. Which of them are right nobody can tell: the table lies between them, and"
        " its standard deviations hold that. Find out what happened there, and measure again, or"
        " leave what is wrong out (skip)."
    )


def _zero_of_each_direction(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where each direction has a zero of its own: the lost motion is not in it."""
    readings, way = draft.readings, draft.readings.direction
    if way is None or draft.plan.table.branches == 1 or len(np.unique(way)) < 2:
        return
    lost = (
        f"what {draft.axis} loses where it turns is in no reading, and the table takes it for"
        " what is left. Go both ways without setting the instrument to zero between them, or add"
        " a measurement of the lost motion at one place."
    )
    specs = draft.job.spec.measurements
    apart = [len(np.unique(way[rows])) == 1 for rows in readings.slices.values()]
    zeroed = all(specs[name].remove != "none" for name in readings.slices)
    if apart and all(apart) and zeroed:
        yield Remark.warning(
            "Each direction was measured by itself, with a zero of the instrument's (remove):"
            f" {lost}"
        )
    elif draft.fit.over == (draft.axis,) and not draft.plan.table.periodic:
        place = readings.positions[:, 0]
        first = (way > 0) & (place == place[way > 0].min())
        last = (way < 0) & (place == place[way < 0].max())
        zero = readings.error[first][0]
        begins = np.abs(readings.error - zero) < _EQUAL
        # An instrument that counts coarsely shows the same number at many places.
        coarse = np.mean(begins[~first & ~last]) > _BY_CHANCE
        if not coarse and begins[first].all() and begins[last].all():
            yield Remark.warning(
                f"Every pass begins with the same reading, upward at {place[first][0]:g} and"
                f" downward at {place[last][0]:g}. If the instrument was set to zero there, {lost}"
            )


def _zeros_apart(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where a measurement lies beyond another, and its own runs do not."""
    readings, noise = draft.readings, draft.estimate.noise
    if readings.run is None or len(readings.slices) < 2:
        return
    offset = {run.run: run.offset for run in draft.estimate.runs}
    groups = {
        name: [offset[run] for run in np.unique(readings.run[rows]) if run in offset]
        for name, rows in readings.slices.items()
    }
    means = {name: float(np.mean(each)) for name, each in groups.items() if each}
    if len(means) < 2 or len(offset) < len(means) + 2:
        return
    within = max(abs(each - means[name]) for name in means for each in groups[name])
    low, *_, high = sorted(means, key=lambda name: means[name])
    apart = means[high] - means[low]
    if apart > max(SEEN * within, noise, TINY):
        yield Remark.warning(
            f"Measurement {high!r} lies {draft.small(apart)} above {low!r}, and the runs of each"
            f" within {draft.small(within)} of their mean. Where the zero of one is the"
            ' instrument\'s, state remove = "offset" of it: what is written holds a mean of both.'
        )


def _creep_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where run after run lies further on.

    What goes on from run to run goes on within each of them, too, and there a table takes it
    for the axis: for lost motion where a run turns, for a slope where it does not.
    """
    runs, readings = draft.estimate.runs, draft.readings
    if len(runs) < _IN_A_ROW or readings.run is None:
        return
    begin = [
        readings.order[readings.run == run.run].min(initial=np.inf) for run in runs
    ]
    offsets = np.array([run.offset for run in runs])[np.argsort(begin, kind="stable")]
    place = np.arange(len(runs)) - (len(runs) - 1) / 2.0
    step = float(place @ offsets / (place @ place))
    rest = offsets - offsets.mean() - step * place
    scatter = np.sqrt(np.sum(rest**2) / (len(runs) - 2) / (place @ place))
    by_chance = np.sqrt(np.mean([run.offset_sd**2 for run in runs]) / (place @ place))
    sure = float(max(stdtrit(len(runs) - 2, _SURELY) * scatter, 3.0 * by_chance))
    if abs(step) <= max(sure, draft.estimate.noise, TINY):
        return
    taken = "lost motion" if draft.plan.table.layout.branches > 1 else "slope"
    yield Remark.warning(
        f"Run after run lies {draft.small(step, '+.1f')} further on, as while a machine or an"
        f" instrument warms up. Within a run it goes on as well, and the table holds up to"
        f" {draft.small(abs(step), '.1f')} of it as {taken} of {draft.axis}. Let it come to rest,"
        " and measure again."
    )
