"""A group of fits from its plan to its drafts: the joint fit, and its share of each.

Fits of no group that share readings are looked at likewise: what these cannot tell apart.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ....data.errors import AxcompError
from ...fit import FitError
from ...fit.joint import (
    AbstractEffect,
    Delay,
    JointData,
    JointFit,
    Leadscrew,
    Part,
    Temperature,
    examine_design,
    fit_joint,
    held_out_errors,
)
from ...readings import Tables
from .._draft import AbstractDraft, AbstractPlan
from ._recording import GroupRecording, read_group
from ._share import Share

_MOST = 10_000
"""Readings that are enough to see what goes together."""


@dataclasses.dataclass(frozen=True)
class IdentifiedGroup:
    """A joint fit with its proof.

    Attributes:
        fit: The estimate; the parts of the members first, in their order.
        held_out: Error less the whole sum as fitted without the reading, by axis.
    """

    name: str
    members: tuple[AbstractPlan, ...]
    recording: GroupRecording
    fit: JointFit
    held_out: Mapping[str, Float[np.ndarray, " t"]]

    @property
    def indices(self) -> tuple[int, ...]:
        """The fits of the group, those included that its readings do not show."""
        return self.members[0].job.spec.groups[self.name]

    @property
    def parts(self) -> tuple[Part, ...]:
        """One per member."""
        return self.fit.parts[: len(self.members)]

    @property
    def helpers(self) -> tuple[Part, ...]:
        """What was fitted beside them and no list of the group holds."""
        return self.fit.parts[len(self.members) :]

    @functools.cached_property
    def written(self) -> tuple[bool, ...]:
        """Whether each member's part may be written."""
        pairs = zip(self.members, self.parts, strict=True)
        return tuple(member.may_be_written(part, self.fit) for member, part in pairs)

    @functools.cached_property
    def datum(self) -> tuple[tuple[float, ...], dict[str, float]]:
        """By member what its table takes over of the axis's datum; by axis what is left."""
        members = self.members
        datum = {axis: float(value) for axis, (value, _) in self.fit.datum.items()}
        constant = [0.0] * len(members)
        takers = [
            (rank, k)
            for k, member in enumerate(members)
            if (rank := member.kind.takes_constant) is not None and self.written[k]
        ]
        for _, k in sorted(takers):
            axis = members[k].axis
            constant[k], datum[axis] = datum.get(axis, 0.0), 0.0
        return tuple(constant), datum


def fit_group(
    tables: Tables, name: str, every: Sequence[AbstractPlan]
) -> tuple[IdentifiedGroup, dict[int, AbstractDraft]]:
    """Read the measurements of a group and fit all its members together.

    Returns:
        The joint fit, and the draft of each fit by its index.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        JobError: If the readings cannot carry the fit, or a result fits no list.
    """
    recording = read_group(tables, every)
    unfit = {plan.index: _unfit(plan, every, recording) for plan in every}
    members = tuple(plan for plan in every if not unfit[plan.index])
    try:
        if not members:
            msg = "; ".join(f"{plan.name}: {unfit[plan.index]}" for plan in every)
            raise FitError(msg)
        group = _identified(name, members, recording)
    except FitError as error:
        words = f"group {name!r} from {', '.join(every[0].fit.sources)}: {error}"
        raise every[0].refusal(words) from None
    drafts = {
        plan.index: plan.left_out(unfit[plan.index])
        for plan in every
        if unfit[plan.index]
    }
    for k, plan in enumerate(members):
        share = Share(group, k)
        if not group.written[k]:
            drafts[plan.index] = plan.left_out("", share)
            continue
        try:
            with plan.job.blaming(("fits", plan.index), f"{plan.name}: "):
                drafts[plan.index] = plan.draft(share)
        except FitError as error:
            drafts[plan.index] = plan.left_out(str(error), share)
    return group, drafts


def fit_group_of_one(plan: AbstractPlan, recording: GroupRecording) -> Share:
    """Fit a plan to its own measurements: a group of one.

    Raises:
        FitError: If the readings do not tell it.
    """
    if why := _unfit(plan, [plan], recording):
        raise FitError(why)
    share = Share(_identified("", (plan,), recording), 0)
    if not share.group.written[0]:
        raise FitError(share.why_undetermined)
    return share


def _unfit(
    plan: AbstractPlan, members: Sequence[AbstractPlan], recording: GroupRecording
) -> str:
    """Return why a member cannot be fitted to these readings, in words, or nothing."""
    why = plan.unfit(recording) or plan.confused(members, recording)
    return why or plan.undetermined(recording.data)


def _identified(
    name: str, members: tuple[AbstractPlan, ...], recording: GroupRecording
) -> IdentifiedGroup:
    """Return the joint fit of the members, and what it leaves of readings held out."""
    helpers = [*_helpers(members, recording)]
    effects = _effects(members, recording, helpers)
    fit = _fit(members, recording, [*effects, *helpers])
    removed = [
        members[0].job.spec.measurements[source].remove for source in recording.slices
    ]
    arbitrary = len(removed) > 1 and "none" not in removed
    if recording.data.own_zero is not None or arbitrary:
        recording = _zeroed(recording, fit)
        fit = _fit(members, recording, [*effects, *helpers])
    left = held_out_errors(fit, recording.fold, runs=recording.drifting)
    return IdentifiedGroup(name, members, recording, fit, left)


def _zeroed(recording: GroupRecording, fit: JointFit) -> GroupRecording:
    """Return readings whose zero is arbitrary with the one that the others give them."""
    data, error = recording.data, dict(recording.data.error)
    for axis, runs in fit.runs.items():
        number, mixed = data.run_of(axis), fit.fits[axis].design.course.counted
        if number is None or not (mixed or data.own_zero is None):
            continue
        offset = np.zeros(len(data))
        for run in runs:
            offset[number == run.run] = run.offset
        if data.own_zero is not None:
            offset[data.own_zero] = 0.0
        else:  # of each measurement: its runs may differ
            for rows in recording.slices.values():
                offset[rows] = offset[rows].mean()
        error[axis] = error[axis] - offset
    data = dataclasses.replace(data, error=error)
    return dataclasses.replace(recording, data=data)


def _effects(
    members: Sequence[AbstractPlan],
    recording: GroupRecording,
    helpers: Sequence[AbstractEffect],
) -> list[AbstractEffect]:
    """Return the effect of each member; some show their form in what the others leave."""
    effects = [member.effect(recording, None) for member in members]
    errors = {member.axis: recording.data.error[member.axis] for member in members}
    others = [*(effect for effect in effects if effect is not None), *helpers]
    if None in effects and others:
        first = _fit(members, recording, others)
        fitted = first.predict(recording.data)
        errors |= {axis: errors[axis] - fitted[axis] for axis in first.fits}
    every = list[AbstractEffect]()
    for member, effect in zip(members, effects, strict=True):
        try:
            shown = effect or member.effect(recording, errors[member.axis])
        except FitError as error:
            msg = f"{member.name}: {error}"
            raise FitError(msg) from None
        assert shown is not None  # what the others leave is known now
        every.append(shown)
    return every


def _helpers(
    members: Sequence[AbstractPlan], recording: GroupRecording
) -> Iterator[AbstractEffect]:
    """Return what must stand beside the members, so that they show what is theirs.

    A curve over the position that no temperature moves belongs to the leadscrew of its
    axis; where the group has none, it is fitted and left where it is.
    """
    screws = {member.axis for member in members if member.takes_line}
    curves: dict[str, Float[np.ndarray, " n"]] = {}
    for member in members:
        nodes = member.nodes_beside(recording.data)
        if len(nodes) > max(len(curves.get(member.axis, ())), 1):
            curves[member.axis] = nodes
    yield from (Leadscrew(axis, n) for axis, n in curves.items() if axis not in screws)
    if recording.data.time is not None:
        # What is left of the delay of the instrument, and of the rate of its clock.
        needed = dict.fromkeys(
            member.axis for member in members if member.axis in recording.moving
        )
        yield from (Delay(axis) for axis in needed)


def _fit(
    members: Sequence[AbstractPlan],
    recording: GroupRecording,
    effects: Sequence[AbstractEffect],
) -> JointFit:
    tables = [member.fit for member in members if member.kind.table]
    specs = members[0].job.spec.measurements
    # Where its zero is the instrument's, the mean of all readings was taken off.
    removed = {specs[source].remove for source in recording.slices}
    return fit_joint(
        recording.data,
        effects,
        loss=members[0].fit.loss,
        smoothness=tables[0].smoothness if tables else "auto",
        drift=recording.drift,
        all_runs="none" not in removed,
    )


def confounded(tables: Tables, plans: Mapping[int, AbstractPlan]) -> dict[int, str]:
    """Return which fits that stand alone cannot be told, and why.

    Each of them is fitted as if there was no other. Those of one axis and measurement
    are looked at together: where the readings cannot tell two of them apart, either would
    take the whole.
    """
    groups: dict[tuple[str, tuple[str, ...]], list[AbstractPlan]] = {}
    for plan in plans.values():
        if not plan.kind.adds_current:  # friction has its own
            sources = tuple(sorted(plan.fit.sources))
            groups.setdefault((plan.axis, sources), []).append(plan)
    reasons: dict[int, str] = {}
    for members in groups.values():
        # A table alone on a log that is read in pieces stays aside: whatever shares the
        # log has it read into memory.
        specs = {k: tables.job.spec.measurements[k] for k in members[0].fit.sources}
        with contextlib.suppress(AxcompError):  # what is wrong each fit says itself
            in_pieces = members[0].kind.table and any(
                spec.stream is not False and tables.large(name) is not None
                for name, spec in specs.items()
            )
            if len(members) > 1 or not in_pieces:
                reasons |= _confused(members, read_group(tables, members))
    return reasons


def _confused(
    members: Sequence[AbstractPlan], recording: GroupRecording
) -> dict[int, str]:
    """Return which members these readings do not tell from another, or at all, and why."""
    data, reasons = few(recording.data), dict[int, str]()
    for member in members:
        if member.unfit(recording):
            continue  # It says so in its own words.
        if why := member.undetermined(data) or member.confused(members, recording):
            reasons[member.index] = why
    if len(members) < 2 or reasons:
        return reasons
    error, effects = recording.data.error, dict[int, AbstractEffect]()
    for member in members:
        # One whose form is open has that of a fit to the whole error.
        whole = error[member.axis]
        effect = member.effect(recording, None) or member.effect(recording, whole)
        assert effect is not None  # all of the error is known
        effects[member.index] = at_once(effect)
    for pair in examine_design(data, [*effects.values()])[1]:
        pair_names = set(pair.effects)
        for index, effect in effects.items():
            if len(pair_names) > 1 and effect.name in pair_names:
                reasons.setdefault(index, pair.sentence)
    return reasons


def at_once(effect: AbstractEffect) -> AbstractEffect:
    """Return an effect without the lag of what it follows: linear in its values."""
    if isinstance(effect, Temperature):
        return dataclasses.replace(effect, lag=0.0)
    return effect


def few(data: JointData) -> JointData:
    """Return evenly spaced readings, few enough to compare the effects quickly."""
    step = -(-len(data) // _MOST)
    return data.take(np.arange(0, len(data), step)) if step > 1 else data
