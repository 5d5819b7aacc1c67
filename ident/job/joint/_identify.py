"""The joint fit of a group, and what readings left out say of it."""

import dataclasses
import functools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ...fit import FitError
from ...fit.joint import (
    AbstractEffect,
    Delay,
    JointFit,
    Leadscrew,
    Part,
    fit_joint,
    refit_joint,
)
from .._load import Job
from ._member import AbstractMember
from ._recording import GroupRecording


@dataclasses.dataclass(frozen=True)
class IdentifiedGroup:
    """A joint fit with its proof.

    Attributes:
        name: Of the group in the job.
        members: Its fits.
        recording: What was measured.
        fit: The estimate; the parts of the members first, in their order.
        held_out: Error less the whole sum as fitted without the reading, by axis.
    """

    name: str
    members: tuple[AbstractMember, ...]
    recording: GroupRecording
    fit: JointFit
    held_out: Mapping[str, Float[np.ndarray, " t"]]

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
        return tuple(one.may_be_written(part, self.fit) for one, part in pairs)

    @functools.cached_property
    def datum(self) -> tuple[tuple[float, ...], dict[str, float]]:
        """By member what its table takes over of the axis's datum; by axis what is left."""
        members = self.members
        left = {axis: float(value) for axis, (value, _) in self.fit.datum.items()}
        constant = [0.0] * len(members)
        takers = [
            k for k, m in enumerate(members) if m.takes_constant and self.written[k]
        ]
        for k in sorted(takers, key=lambda k: members[k].fit.kind.takes_constant or 0):
            axis = members[k].axis
            constant[k], left[axis] = left.get(axis, 0.0), 0.0
        return tuple(constant), left


def identify_group(
    job: Job,
    name: str,
    members: tuple[AbstractMember, ...],
    recording: GroupRecording,
) -> IdentifiedGroup:
    """Fit all members together and hold readings out.

    Raises:
        FitError: If the readings cannot carry the fit.
    """
    effects = _effects(job, members, recording)
    helpers = _helpers(members, recording)
    fit = _fit(members, recording, [*effects, *helpers])
    return IdentifiedGroup(name, members, recording, fit, _held_out(recording, fit))


def _effects(
    job: Job, members: Sequence[AbstractMember], recording: GroupRecording
) -> list[AbstractEffect]:
    """Return the effect of each member; some show their form behind the others."""
    found = [one.effect(job, recording, None) for one in members]
    if all(effect is not None for effect in found):
        return [effect for effect in found if effect is not None]
    known = [effect for effect in found if effect is not None]
    known += _helpers(members, recording)
    errors = {one.axis: recording.data.error[one.axis] for one in members}
    left = dict(errors)
    if known:
        first = _fit(members, recording, known)
        fitted = first.predict(recording.data)
        left |= {axis: errors[axis] - fitted[axis] for axis in first.axes}
    result = []
    for one, effect in zip(members, found, strict=True):
        chosen = effect
        if chosen is None:
            try:
                chosen = one.effect(job, recording, left[one.axis])
            except FitError as error:
                msg = f"{one.name}: {error}"
                raise FitError(msg) from None
        assert chosen is not None  # what the others leave is known now
        result.append(chosen)
    return result


def _helpers(
    members: Sequence[AbstractMember], recording: GroupRecording
) -> Iterator[AbstractEffect]:
    """Return what must stand beside the members, so that they show what is theirs.

    A line over the position that no temperature moves belongs to the leadscrew of its
    axis; where the group has none, it is fitted and left where it is.
    """
    screws = {one.axis for one in members if one.takes_line}
    for one in members:
        if one.needs_line and one.axis not in screws:
            place = recording.data.position[one.axis]
            ends = np.array([np.nanmin(place), np.nanmax(place)], dtype=float)
            if ends[1] > ends[0]:
                yield Leadscrew(one.axis, ends)
    if recording.timed:
        # What is left of the delay of the instrument, and of the rate of its clock.
        own = dict.fromkeys(one.axis for one in members if one.axis in recording.moving)
        yield from (Delay(axis) for axis in own)


def _fit(
    members: Sequence[AbstractMember],
    recording: GroupRecording,
    effects: Sequence[AbstractEffect],
) -> JointFit:
    tables = [one.fit for one in members if one.takes_constant]
    return fit_joint(
        recording.data,
        effects,
        loss=members[0].fit.loss,
        smoothness=tables[0].smoothness if tables else "auto",
        drift=recording.drift,
    )


def _held_out(
    recording: GroupRecording,
    fit: JointFit,
) -> dict[str, Float[np.ndarray, " t"]]:
    """Return each error less the sum that is fitted without its run or block.

    Nodes, lags, forms and smoothness are those of the whole fit; everything else is
    fitted anew.
    """
    data = recording.data
    result = {axis: np.full(len(data), np.nan) for axis in fit.axes}
    for turn in np.unique(recording.fold):
        out = recording.fold == turn
        try:
            other = refit_joint(fit, data, use=~out)
        except FitError:
            # What is left tells nothing: neither does the prediction.
            for axis in fit.axes:
                known = data.error[axis][~out & np.isfinite(data.error[axis])]
                middle = float(np.median(known)) if known.size else 0.0
                result[axis][out] = data.error[axis][out] - middle
            continue
        predicted = other.predict(data, runs=recording.drifting)
        for axis in fit.axes:
            result[axis][out] = (data.error[axis] - predicted[axis])[out]
    return result
