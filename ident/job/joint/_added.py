"""What the written files of an axis add to the readings of its group, all together."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ...exchange import Motion
from ...proof.axis import added_beyond
from .._acting import acting_after, acting_before
from .._draft import AbstractDraft
from .._lists import AxisFiles
from .._load import Job
from ._recording import GroupRecording


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
