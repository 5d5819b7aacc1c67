"""What a job found of a crosstalk, and what a person must know of it."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.signals import signs_at_one_place
from ....models import Crosstalk
from ...job.result._result import AbstractResult, Remark
from ...proof import GateCheck
from . import BRANCHES
from ._events import count_cut, from_place, gone_by, logs_of, without_level
from ._tests import LEAST_SPAN
from .effect import CrosstalkFit

if TYPE_CHECKING:
    from ._draft import CrosstalkDraft

SHORT = ("accelerating +", "accelerating −", "decelerating +", "decelerating −")
"""Words for the rows of `BRANCHES`: what the master does, and its direction."""
_QUADRANTS = {"crosstalk_accelerate", "crosstalk_sign"}
_COVERED = 0.995
_FEW = 0.1
"""Share of the events up to which it is no matter that they say nothing."""
_OF_PLACE = 0.05
"""Part of the events that a slope of the error over the master makes, from which on it is said."""
_PER_LOG, _APART, _LARGE = 3, 5.0, 0.3
"""Events of a kind in each of two logs, deviations, and part of an event that they lie apart,
from which on logs contradict each other."""
_HELD = 0.97
"""Part of an event that the list takes off, below which the master accelerates too hard."""


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class CrosstalkResult(AbstractResult):
    """The crosstalk of an axis; errors of events are those at full acceleration, in mm.

    Attributes:
        model: The written list as the controller runs it; None: nothing is written.
        written: Which tests of the fit stand in it.
        coverage: Share of the workspace that the tests cover, 0 to 1.
        fit: The estimate behind it with its events (sign of the error).
        from_file: What the written file, read back, leaves of each event.
        time: When each event begins, in s.
    """

    model: Crosstalk | None
    written: Bool[np.ndarray, " q"]
    coverage: float
    fit: CrosstalkFit
    from_file: Float[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]

    @property
    def entries(self) -> Float[np.ndarray, "4 p"]:
        """Written entries in mm by row of `BRANCHES`, with the sign of the list."""
        return np.zeros((4, 0)) if self.model is None else np.asarray(self.model.values)

    @property
    def subject(self) -> str:
        return f"the mean error of {self.axis} in each, at the specified acceleration,"

    @property
    def points(self) -> Float[np.ndarray, "p k"]:
        """Places of the written tests in mm."""
        return np.asarray(self.fit.effect.points[self.written])

    @property
    def standard_deviation(self) -> Float[np.ndarray, "4 p"]:
        """Of the entries."""
        return self.fit.standard_deviation[:, self.written]

    @property
    def support(self) -> Int[np.ndarray, "4 p"]:
        """Events that touch each entry."""
        return self.fit.support[:, self.written]

    @property
    def adaptation(self) -> tuple[str, ...]:
        """Axes on whose positions it depends."""
        return self.fit.effect.adaptation

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose motion it acts."""
        return self.fit.effect.masters

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        fit, form, events = self.fit, self.fit.effect, self.fit.events
        names = [name.replace(" ", "_") for name in BRANCHES]
        columns = {
            "time": self.time,
            "kind": [BRANCHES[row] for row in events.branch],
            "positions": events.positions,
            "peak": events.peak,
            "error": events.value,
            "standard_deviation": events.standard_deviation,
            "predicted": fit.predicted,
            "from_file": self.from_file,
            "wild": events.wild,
        }
        return {
            "master": form.master,
            "adaptation": list(self.adaptation),
            "parameters": {
                "mode": form.mode,
                "acceleration": float(form.acceleration),
                "deceleration": float(form.deceleration),
                "velocity_dependent": form.velocity_dependent,
                "n_cycles": 0 if self.model is None else self.model.cycles,
                "positions": self.points,
                "table": dict(zip(names, self.entries, strict=True)),
            },
            "standard_deviations": {
                "table": dict(zip(names, self.standard_deviation, strict=True))
            },
            "support": dict(zip(names, self.support, strict=True)),
            "measured": {
                "positions": form.points,
                "error": dict(zip(names, fit.values, strict=True)),
                "complete": fit.complete,
            },
            "noise": dict(zip(names, fit.noise, strict=True)),
            "coverage": self.coverage,
            "events": [
                dict(zip(columns, row, strict=True))
                for row in zip(*columns.values(), strict=True)
            ],
        }


def remarks_of(draft: "CrosstalkDraft", gate: Sequence[GateCheck]) -> Iterator[Remark]:
    """Return everything that the report has to say of a fit."""
    yield from draft.remarks
    yield from _of_the_events(draft)
    yield from _of_the_adaptation(draft)
    yield from _of_the_tests(draft.found, draft.written)
    master = draft.fit.master
    if any(check.name == "from_file" and not check.passed for check in gate):
        yield Remark.error(
            f"The list leaves more than was predicted (from_file): the acceleration of {master} is"
            f" not that under which {draft.axis} errs, as where a filter smears short ones. Let"
            f" {master} rest or cruise between any two accelerations, as long as each of them"
            " lasts, and record faster."
        )
    if draft.model is not None:
        yield from _of_the_list(draft, draft.model.cycles)
    log, form = draft.log, draft.found.effect
    if signs_at_one_place(log.acceleration[master], gone_by(log, form)) == 2:
        yield Remark.warning(
            f"All strokes of {master} begin and end at the same places: what else the error of"
            f" {draft.axis} does there, over the position of {master} or at its reversals, counts"
            " as crosstalk, and no standard deviation holds it. Record strokes of different"
            " lengths."
        )
    yield from _of_the_logs(draft)
    slope, made = from_place(log, form, draft.found.events)
    size = float(np.sqrt(np.mean(np.square(made))))
    whole = float(np.sqrt(np.mean(np.square(draft.found.events.value))))
    if size > _OF_PLACE * whole:
        yield Remark.warning(
            f"The error of {draft.axis} also follows the position of {master}, by"
            f" {1e3 * slope:.2g} µm/mm, and that makes {1e3 * size:.2g} µm of the"
            f" {1e3 * whole:.2g} µm (rms) that count as crosstalk, which no standard deviation"
            f" holds. Give a cross fit of {draft.axis} over {master} and this one the same group."
        )
    if reason := draft.plan.unread:
        yield Remark.warning(
            f"The new crosstalk replaces one that cannot be read: {reason}"
        )
    elif draft.plan.old is not None:
        words = "off while measuring: the new one replaces it."
        if draft.plan.active:
            words = "active while measuring: the new one is old + residual."
        yield Remark.info(f"The old crosstalk was {words}")


def _of_the_list(draft: "CrosstalkDraft", cycles: int) -> Iterator[Remark]:
    """Return what must be known of the list that is written."""
    axis, master = draft.axis, draft.fit.master
    if draft.coverage < _COVERED:
        axes = " and ".join(draft.masters)
        yield Remark.warning(
            f"The tests cover {draft.coverage:.0%} of the workspace of {axes}. Beyond"
            " them incorrect values can occur ([001] p.84); the controller is taken to"
            " hold the nearest (S-37, S-38)."
        )
    if cycles > 1:
        delay = 0.5e3 * cycles * draft.job.spec.controller.cycle_time
        yield Remark.info(
            f"The values pass a filter over {cycles} cycles (n_cycles,"
            f" P-COMP-00064), so that a step of the acceleration of {master} is"
            f" no jump of {axis}: the correction comes {delay:.3g} ms late."
            " The figures from the file are those without this delay."
        )
    if not draft.job.verified >= _QUADRANTS:
        yield Remark.warning(
            "What counts as accelerating (S-34) and the sign of the entries (S-42) are"
            " assumed: under another reading the correction has the wrong sign for one"
            f" direction and doubles the error there. Log {master} with"
            " acceleration and deceleration in both directions together with"
            f" CROSSTALK::end_offset of {axis}, and give the log to axcomp verify,"
            " before relying on this list."
        )


def _of_the_events(draft: "CrosstalkDraft") -> Iterator[Remark]:
    """Return what the log says of itself: its events, a delay, too hard accelerations."""
    events, delay, master = draft.found.events, draft.delay, draft.fit.master
    counts = np.bincount(events.branch, minlength=len(BRANCHES))
    parts = [f"{n} of {name}" for n, name in zip(counts, BRANCHES, strict=True)]
    yield Remark.info(f"{len(events)} events: {', '.join(parts)}.")
    total, form = count_cut(draft.log, draft.found.effect), draft.found.effect
    if (untold := total - len(events)) > 0:
        words = f"{without_level(untold, total, form)} They were left out."
        # At the ends of a log there is often one.
        say = Remark.warning if untold > _FEW * total else Remark.info
        yield say(words)
    if wild := int(events.wild.sum()):
        words = (
            f"Events that contradict the others were left out: {wild} of {len(events)}."
        )
        yield Remark.warning(words)
    if events.left_out.any():
        words = f"{events.left_out.sum()} readings in and beside"
        yield Remark.info(
            f"{words} {np.count_nonzero(events.left_out)} events lie far from the others"
            " there and were left out."
        )
    if delay:
        word = "late" if delay > 0 else "early"
        yield Remark.warning(
            f"The error of {draft.axis} comes {1e3 * abs(delay):.3g} ms {word}"
            f" against the acceleration of {master}; that was taken off, as the delay of"
            " an instrument is. If it is the machine that follows late, the correction"
            " will come too early by as much."
        )
    if draft.taken.min() < _HELD:
        excess = float(np.max(np.abs(events.peak) / draft.found.full))
        name, measured = "the specified acceleration", ""
        if None in (draft.fit.acceleration, draft.fit.deceleration):
            name = "what it mostly reaches here"
            measured = ", and record faster if they last a few samples only"
        yield Remark.warning(
            f"{master} accelerates up to {excess:.0%} of {name} ({form.acceleration:g} and"
            f" {form.deceleration:g} mm/s²). Above it the controller is taken to hold the"
            " correction (S-36): state the largest one as acceleration and deceleration in"
            f" the job{measured}."
        )


def _of_the_logs(draft: "CrosstalkDraft") -> Iterator[Remark]:
    """Return which logs contradict each other, by what the fit leaves of events of one kind."""
    found, names = draft.found, draft.fit.sources
    events, left = found.events, found.predicted
    log = logs_of(draft.log)[events.start]
    size = float(np.sqrt(np.mean(np.square(events.value))))
    for first, second in itertools.combinations(range(len(names)), 2):
        for branch, kind in enumerate(SHORT):
            pair = [
                (log == each) & (events.branch == branch) for each in (first, second)
            ]
            if min(rows.sum() for rows in pair) < _PER_LOG:
                continue
            means = [float(np.median(left[rows])) for rows in pair]
            scatter = [float(np.std(left[rows])) / np.sqrt(rows.sum()) for rows in pair]
            if abs(means[1] - means[0]) > max(
                _APART * np.hypot(*scatter), _LARGE * size
            ):
                shown = [1e3 * float(np.median(events.value[rows])) for rows in pair]
                yield Remark.warning(
                    f"Measurements {names[first]!r} and {names[second]!r} contradict each other:"
                    f" where {draft.fit.master} is {kind}, {draft.axis} errs by"
                    f" {shown[0]:+.2g} µm in one and by {shown[1]:+.2g} µm in the other, and the"
                    " fit lies between them. Was a list on in one of them (active), or the sign"
                    " of its error turned?"
                )
                break


def _of_the_adaptation(draft: "CrosstalkDraft") -> Iterator[Remark]:
    """Return why the list does not depend on an axis that the job states."""
    fit, rows = draft.fit, draft.found.events.start
    for name in fit.adapts_to if fit.mode == "auto" else ():
        if name in draft.masters:
            continue
        if np.ptp(draft.log.position[name][rows]) > LEAST_SPAN:
            yield Remark.info(
                f"Not adapted to {name}: the events do not show that the error of {draft.axis}"
                f" changes with its position. mode = {1 + len(fit.adapts_to)} in the job adapts"
                " it all the same."
            )
        else:
            yield Remark.warning(
                f"Not adapted to {name}: it stood at one place while {fit.master} accelerated, and"
                f" the list adds the same at all others. Measure at several places of {name}."
            )


def _of_the_tests(fit: CrosstalkFit, written: bool) -> Iterator[Remark]:
    """Return which entries are not known, and why no test is written where none is."""
    missing, form = np.isnan(fit.values), fit.effect
    empty = [BRANCHES[k] for k in np.flatnonzero(missing.all(axis=1))]
    if empty:
        remedy = f"Measure {form.master} with acceleration and deceleration in both directions."
        if len(np.unique(fit.events.branch)) == len(BRANCHES):
            remedy = (
                f"There are more tests than places of {' and '.join(form.adaptation)} where"
                " it accelerated: leave positions out, or state those places."
            )
        yield Remark.error(
            f"Nothing is known for {' and '.join(empty)}: the entries of a test are"
            " written all four or not at all, since a missing one would be 0 in the"
            f" controller, so no test can be written. {remedy}"
        )
    for number in () if empty else np.flatnonzero(missing.any(axis=0)):
        place = ", ".join(f"{value:g}" for value in form.points[number])
        names = [BRANCHES[k] for k in np.flatnonzero(missing[:, number])]
        yield Remark.error(
            f"The test at ({place}) mm is left out: no event for {' and '.join(names)}."
        )
    if written or missing.all():
        return
    if not fit.significant:
        largest = 1e3 * float(np.nanmax(np.abs(fit.values)))
        yield Remark.warning(
            f"No crosstalk from {form.master} shows: no value exceeds what chance over all of"
            f" them would give (the largest is {largest:.2f} µm). Nothing is written."
        )
    elif fit.complete.any():
        yield Remark.error(
            "The tests whose four entries are all measured stand in a line, or are too"
            " few to span the adaptation axes: no list is written."
        )
