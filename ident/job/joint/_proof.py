"""The proof of a group: how much each effect is, and what all written files leave."""

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...fit import RunEffect
from ...fit.joint import Confusion, Gauge, Part
from ...proof import ErrorFigures
from ...proof.axis import added_beyond
from .._draft import AbstractDraft
from ..result._result import Remark, some_of, staged
from ..write._lists import AxisFiles
from ._group import IdentifiedGroup
from ._recording import GroupRecording
from ._share import MOST, LeftOutDraft, Share, undetermined_values


@dataclasses.dataclass(frozen=True)
class EffectShare:
    """How much of the error one effect is.

    Attributes:
        index: Of its fit in the job, or None for what was fitted beside the fits.
        rms: Root mean square of what it adds to the readings, about its mean, in mm or °.
        information: What is left of its information beside the other effects, 0 to 1.
        determined: Whether the readings tell it.
        written: Whether it stands in a list.
        why: What is left out and why, empty where nothing is.
    """

    index: int | None
    name: str
    axis: str
    compensation: str
    rms: float
    information: float
    determined: bool
    written: bool
    why: str = ""


@dataclasses.dataclass(frozen=True)
class AxisSum:
    """The whole sum on one axis.

    Attributes:
        unit: ``mm`` or ``deg``.
        noise: Standard deviation of one reading.
        datum: Constant error that no list of the group holds.
        rows: Readings, as rows of all measurements one after the other.
        before: Error as measured.
        predicted: Left under lists that were fitted without the reading.
        from_file: Left under all written files together, read back.
        wild: Readings that the loss rejected.
        runs: Offset and drift of each run; empty without.
    """

    axis: str
    unit: str
    noise: float
    datum: float
    rows: Int[np.ndarray, " t"]
    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    from_file: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]
    runs: tuple[RunEffect, ...]

    @functools.cached_property
    def error(self) -> dict[str, ErrorFigures]:
        """Keys ``before``, ``predicted``, ``from_file``."""
        return staged(self.before, self.predicted, self.from_file, self.wild)


@dataclasses.dataclass(frozen=True)
class GroupResult:
    """A group of fits that were identified together.

    Attributes:
        fits: Indices of its fits.
        effects: How much of the error each is; helpers last.
        gauges: What may be moved between effects without changing the sum.
        confusions: What these readings cannot tell apart.
        order: Time in s, or row number, of all rows; a time where it is `timed`.
        held_out: What the prediction left out together: ``run`` or ``block``.
        message: How the fit went.
        remarks: What concerns the group as a whole.
    """

    name: str
    fits: tuple[int, ...]
    effects: tuple[EffectShare, ...]
    gauges: tuple[Gauge, ...]
    confusions: tuple[Confusion, ...]
    axes: tuple[AxisSum, ...]
    order: Float[np.ndarray, " t"]
    timed: bool
    held_out: str
    converged: bool
    message: str
    remarks: tuple[Remark, ...]

    def as_tree(self) -> dict[str, Any]:
        """Return what result.json says of the group."""
        shown = {k: v for k, v in vars(self).items() if k not in ("order", "timed")}
        return shown | {
            "axes": {
                axis.axis: {
                    "unit": axis.unit,
                    "noise": axis.noise,
                    "datum": axis.datum,
                    "readings": len(axis.rows),
                    "wild": int(np.sum(axis.wild)),
                    "error": {key: each.as_tree() for key, each in axis.error.items()},
                    "runs": axis.runs,
                }
                for axis in self.axes
            }
        }


def prove_group(
    group: IdentifiedGroup,
    drafts: Sequence[AbstractDraft],
    files: Mapping[str, AxisFiles],
) -> GroupResult:
    """Return a group with what all files of its axes leave together."""
    fit, recording = group.fit, group.recording
    return GroupResult(
        name=group.name,
        fits=group.indices,
        effects=tuple(_effects(group, drafts)),
        gauges=tuple(
            dataclasses.replace(gauge, rule=_rule(group, gauge)) for gauge in fit.gauges
        ),
        confusions=fit.confusions,
        axes=tuple(_sum(group, drafts, files[axis]) for axis in fit.fits),
        order=recording.data.order,
        timed=recording.data.time is not None,
        held_out=recording.held_out,
        converged=fit.converged,
        message=fit.message,
        remarks=tuple(_remarks(group, drafts)),
    )


def _rule(group: IdentifiedGroup, gauge: Gauge) -> str:
    """Return how a freedom was fixed, and where the lists have the datum."""
    rule = gauge.rule
    for part, value in zip(group.parts, group.datum[0], strict=True):
        if value and f"datum of {part.effect.axis}" in gauge.effects:
            rule += f" In the lists the {part.name} holds the datum."
    return rule


def _effects(
    group: IdentifiedGroup, drafts: Sequence[AbstractDraft]
) -> Iterator[EffectShare]:
    """Yield how much of the error each fit is, and each effect beside them."""
    members = [draft.index for draft in group.members]
    for index, part in zip(members, group.parts, strict=True):
        missing, written = undetermined_values(part, group.fit), drafts[index].written
        yield _share_of(part, not missing, some_of(missing, MOST), index, written)
    for draft in (drafts[index] for index in group.indices if index not in members):
        assert isinstance(draft, LeftOutDraft)  # it was not fitted
        named = draft.index, draft.name, draft.axis, draft.compensation
        yield EffectShare(*named, 0.0, 0.0, False, False, draft.why)
    for part in group.helpers:
        if part.effect.compensation == "delay":
            yield _share_of(part, part.known, "the instrument's")
            continue
        share = _share_of(part, part.known, "no fit of the group holds it")
        name = f"error of {part.effect.axis} over its own position"
        yield dataclasses.replace(share, name=name)


def _share_of(
    part: Part,
    determined: bool,
    why: str,
    index: int | None = None,
    written: bool = False,
) -> EffectShare:
    """Return how much a part of the joint fit is."""
    contribution = part.contribution[np.isfinite(part.contribution)]
    rms = float(np.std(contribution)) if contribution.size else 0.0
    named = part.name, part.effect.axis, part.effect.compensation
    return EffectShare(index, *named, rms, part.share, determined, written, why)


def _sum(
    group: IdentifiedGroup, drafts: Sequence[AbstractDraft], files: AxisFiles
) -> AxisSum:
    axis, fit, recording = files.axis, group.fit, group.recording
    data = recording.data
    mine = [k for k, member in enumerate(group.members) if member.axis == axis]
    drafts_of = {k: drafts[group.members[k].index] for k in mine}
    rows = np.flatnonzero(Share(group, mine[0]).rows)
    error = data.error[axis][rows]
    if recording.drifting:
        drift = fit.predict(data, runs=True)[axis] - fit.predict(data)[axis]
        error = error - drift[rows]
    predicted = group.held_out[axis][rows].copy()
    unwritten = [group.parts[k] for k, draft in drafts_of.items() if not draft.written]
    for part in group.helpers:
        if part.effect.axis == axis and part.effect.compensation == "delay":
            error = error - part.contribution[rows]
        elif part.effect.axis == axis:
            unwritten.append(part)
    for part in unwritten:
        predicted += part.contribution[rows]
    from_file = error + _added_by_files(files, [*drafts_of.values()], recording, rows)
    constant, residual = group.datum
    if not any(constant[k] for k in mine):
        # No list takes a constant away: what is left is judged about its middle.
        error, predicted, from_file = (
            value - float(np.median(value)) for value in (error, predicted, from_file)
        )
    return AxisSum(
        axis=axis,
        unit=drafts_of[mine[0]].unit,
        noise=float(fit.noise[axis]),
        datum=residual[axis],
        rows=rows,
        before=error,
        predicted=predicted,
        from_file=from_file,
        wild=np.asarray(fit.wild[axis][rows]),
        runs=tuple(fit.runs.get(axis, ())),
    )


def _remarks(
    group: IdentifiedGroup, drafts: Sequence[AbstractDraft]
) -> Iterator[Remark]:
    fit = group.fit
    yield from dict.fromkeys(group.recording.remarks)
    if not fit.converged:
        yield Remark.warning(fit.message)
    members = dict(zip((part.name for part in group.parts), group.members, strict=True))
    open_ = {part.name for part in group.parts if undetermined_values(part, fit)}
    for confusion in fit.confusions:
        shared = [name for name in confusion.effects if name in members]
        if not open_.intersection(shared):
            # Only values that hardly any reading reaches: the prior fills them.
            yield Remark.info(confusion.sentence)
        elif not any(
            isinstance(drafts[members[name].index], LeftOutDraft) for name in shared
        ):
            yield Remark.error(confusion.sentence)
    for axis, value in group.datum[1].items():
        if value:
            yield Remark.info(
                f"A constant error of {axis} stands in no list of this group:"
                " figures of the sum are about their middle."
            )
    for part in group.helpers:
        if part.effect.compensation != "delay":
            yield Remark.info(
                f"An error over {part.effect.axis} that no fit of the group holds was fitted"
                " beside it: it belongs to a leadscrew, and no list of this group holds it."
            )


def _added_by_files(
    files: AxisFiles,
    drafts: Sequence[AbstractDraft],
    recording: GroupRecording,
    rows: Int[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Return what the controller adds beyond what acted while measuring, in mm or °.

    The files of the axis are read back and run as one: what looks up a position that
    others move, or switches another off, does so here too.
    """
    job = drafts[0].job
    active = job.spec.measurements[drafts[0].fit.sources[0]].active
    data = recording.data

    def columns(table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        taken = {name: values[rows] for name, values in table.items()}
        return {name: item for name, item in taken.items() if np.isfinite(item).all()}

    signs = columns(data.direction)
    motion = job.standing(
        positions=columns(data.position),
        directions={axis: np.where(sign < 0, -1, 1) for axis, sign in signs.items()},
        velocities=columns(data.velocity),
        accelerations=columns(data.acceleration),
        temperatures={k: v for draft in drafts for k, v in draft.warmth.items()},
    )
    names = {draft.compensation for draft in drafts} | set(active)
    added = added_beyond(files.after, files.existing, active, motion)
    parts = (value for name, value in added.items() if name in names)
    return sum(parts, np.zeros(len(rows)))
