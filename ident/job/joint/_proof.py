"""The proof of a group: how much each effect is, and what all written files leave."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...exchange import Motion
from ...fit.joint import Gauge, Part
from ...proof.axis import added_beyond
from .._acting import acting_after, acting_before
from .._draft import AbstractDraft
from .._lists import AxisFiles
from .._load import Job
from .._result import Remark, staged
from ._identify import IdentifiedGroup
from ._left_out import LeftOutDraft
from ._member import AbstractMember
from ._recording import GroupRecording
from ._result import AxisSum, EffectShare, Freedom, GroupResult, LostPair
from ._share import Share, in_words, lost


@dataclasses.dataclass(frozen=True)
class GroupDraft:
    """A fitted group.

    Attributes:
        name: In the job.
        members: Its fits.
        recording: What was measured.
        found: The joint fit and its proof.
        shares: What each member gets of it.
        drafts: One per member.
        unfit: Fits of the group that its readings tell nothing of, and were not fitted.
    """

    name: str
    members: tuple[AbstractMember, ...]
    recording: GroupRecording
    found: IdentifiedGroup
    shares: tuple[Share, ...]
    drafts: tuple[AbstractDraft, ...]
    unfit: tuple[LeftOutDraft, ...] = ()

    def prove(self, job: Job, files: Mapping[str, AxisFiles]) -> GroupResult:
        """Return the group with what all files of its axes leave together.

        Args:
            job: The job.
            files: Lists by axis.
        """
        fit, unfit = self.found.fit, [one.index for one in self.unfit]
        return GroupResult(
            name=self.name,
            fits=tuple(sorted([*(one.index for one in self.members), *unfit])),
            effects=self._effects(),
            freedoms=tuple(
                Freedom(each.effects, each.sentence, self._rule(each))
                for each in fit.gauges
            ),
            lost=tuple(
                LostPair(each.effects, each.parameters, each.correlation, each.sentence)
                for each in fit.confusions
            ),
            axes=tuple(self._sum(job, files[axis]) for axis in fit.axes),
            order=self.recording.order,
            timed=self.recording.timed,
            held_out=self.recording.held_out,
            converged=fit.converged,
            message=fit.message,
            remarks=tuple(self._remarks()),
        )

    def _rule(self, gauge: Gauge) -> str:
        """Return how a freedom was fixed, and where the lists have the datum."""
        rule = gauge.rule
        for k, value in enumerate(self.found.constant):
            part = self.found.parts[k]
            if value and f"datum of {part.effect.axis}" in gauge.effects:
                rule += f" In the lists the {part.name} holds the datum."
        return rule

    def _effects(self) -> tuple[EffectShare, ...]:
        found = []
        for k, (part, draft) in enumerate(
            zip(self.found.parts, self.drafts, strict=True)
        ):
            missing = lost(part, self.found.fit)
            found.append(
                EffectShare(
                    index=self.members[k].index,
                    name=part.name,
                    axis=part.effect.axis,
                    compensation=part.effect.compensation,
                    rms=_size(part),
                    information=part.share,
                    determined=not missing,
                    written=draft.written,
                    why=in_words(missing),
                )
            )
        for one in self.unfit:
            found.append(
                EffectShare(
                    index=one.index,
                    name=one.name,
                    axis=one.axis,
                    compensation=one.compensation,
                    rms=0.0,
                    information=0.0,
                    determined=False,
                    written=False,
                    why=one.why,
                )
            )
        for part in self.found.helpers:
            late = part.effect.compensation == "delay"
            own = f"line of {part.effect.axis} over its own position"
            found.append(
                EffectShare(
                    index=None,
                    name=part.name if late else own,
                    axis=part.effect.axis,
                    compensation=part.effect.compensation,
                    rms=_size(part),
                    information=part.share,
                    determined=part.known,
                    written=False,
                    why="the instrument's" if late else "no fit of the group holds it",
                )
            )
        return tuple(found)

    def _sum(self, job: Job, files: AxisFiles) -> AxisSum:
        axis, fit, found = files.axis, self.found.fit, self.found
        mine = [k for k, one in enumerate(self.members) if one.axis == axis]
        rows = np.flatnonzero(self.shares[mine[0]].rows)
        error = self.recording.data.error[axis][rows]
        if self.recording.drifting:
            data = self.recording.data
            drift = fit.predict(data, runs=True)[axis] - fit.predict(data)[axis]
            error = error - drift[rows]
        helpers = [part for part in found.helpers if part.effect.axis == axis]
        for part in helpers:
            if part.effect.compensation == "delay":
                error = error - part.contribution[rows]
        predicted = found.held_out[axis][rows].copy()
        unwritten = [found.parts[k] for k in mine if not self.drafts[k].written] + [
            part for part in helpers if part.effect.compensation != "delay"
        ]
        for part in unwritten:
            predicted += part.contribution[rows]
        own = [self.drafts[k] for k in mine]
        from_file = error + added_by_files(job, files, own, self.recording, rows)
        wild = np.asarray(fit.wild[axis][rows])
        if not any(found.constant[k] for k in mine):
            # No list takes a constant away: what is left is judged about its middle.
            error, predicted, from_file = (
                each - float(np.median(each)) for each in (error, predicted, from_file)
            )
        linear = job.spec.axes[axis].kind == "linear"
        return AxisSum(
            axis=axis,
            unit="mm" if linear else "deg",
            noise=float(fit.noise[axis]),
            datum=found.left_constant[axis],
            error=staged(error, predicted, from_file, wild),
            rows=rows,
            before=error,
            predicted=predicted,
            from_file=from_file,
            wild=wild,
            runs=tuple(fit.runs.get(axis, ())),
        )

    def _remarks(self) -> Iterator[Remark]:
        fit = self.found.fit
        yield from [Remark.info(words) for words in _unique(self.recording.remarks)]
        if not fit.converged:
            yield Remark.warning(fit.message)
        left_out = {
            share.part.name
            for share, draft in zip(self.shares, self.drafts, strict=True)
            if isinstance(draft, LeftOutDraft)
        }
        fine = {
            part.name for part in self.found.parts if not lost(part, self.found.fit)
        }
        for each in fit.confusions:
            own = {part.name for part in self.found.parts} & set(each.effects)
            if own <= fine:
                # Only values that hardly any reading reaches: the prior fills them.
                yield Remark.info(each.sentence)
            elif not left_out & own:
                yield Remark.error(each.sentence)
        for axis, value in self.found.left_constant.items():
            if value:
                yield Remark.info(
                    f"A constant error of {axis} stands in no list of this group:"
                    " figures of the sum are about their middle."
                )
        for part in self.found.helpers:
            if part.effect.compensation == "delay":
                continue
            yield Remark.info(
                f"A line over {part.effect.axis} that no temperature moves was"
                " fitted beside the group: it belongs to a leadscrew, and no list of"
                " this group holds it."
            )


def _unique(remarks: Sequence[Remark]) -> list[str]:
    return list(dict.fromkeys(each.message for each in remarks))


def _size(part: Part) -> float:
    known = part.contribution[np.isfinite(part.contribution)]
    return float(np.std(known)) if known.size else 0.0


def added_by_files(
    job: Job,
    files: AxisFiles,
    drafts: Sequence[AbstractDraft],
    recording: GroupRecording,
    rows: Int[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Return what the controller adds beyond what acted while measuring, in mm or °.

    The files of the axis are read back and run as one: what looks up a position that
    others move, or switches another off, does so here too.

    Args:
        job: The job.
        files: The lists of the axis.
        drafts: The fits of the group on this axis.
        recording: What was measured.
        rows: Readings of it that count.
    """
    lists, source = drafts[0].lists, drafts[0].fit.sources[0]
    before = acting_before(job, files.axis, lists)
    after = acting_after(job, files.axis, lists, files, drafts)
    active = job.spec.measurements[source].active
    motion = _motion(job, drafts, recording, rows)
    own = {draft.compensation for draft in drafts} | set(active)
    added = added_beyond(after, before, active, motion)
    known = [value for name, value in added.items() if name in own]
    return np.asarray(np.sum(known, axis=0)) if known else np.zeros(len(rows))


def _motion(
    job: Job,
    drafts: Sequence[AbstractDraft],
    recording: GroupRecording,
    rows: Int[np.ndarray, " n"],
) -> Motion:
    """Return the readings as independent positions: neither filters nor delays."""
    data, axes = recording.data, job.spec.axes

    def columns(table: Mapping[str, np.ndarray]) -> dict[int, np.ndarray]:
        taken = {axes[name].number: values[rows] for name, values in table.items()}
        return {axis: each for axis, each in taken.items() if np.isfinite(each).all()}

    return Motion(
        positions=columns(data.position),
        directions={
            axis: np.where(way < 0, -1, 1)
            for axis, way in columns(data.direction).items()
        },
        time=None,
        velocities=columns(data.velocity),
        accelerations=columns(data.acceleration),
        temperatures={k: v for one in drafts for k, v in one.warmth.items()},
    )
