"""What the written files of one fit add to every reading of its group."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from .._draft import AbstractDraft
from .._lists import AxisFiles
from .._load import Job
from .._output import OutFolder
from .._result import AbstractResult, TableResult
from ..backlash import BacklashDraft, BacklashResult
from ..crosstalk import CrosstalkDraft
from ..temperature import TemperatureResult
from ._share import Share


def added_by(
    draft: AbstractDraft,
    share: Share,
    job: Job,
    folder: OutFolder,
    files: AxisFiles,
    written: tuple[Path, ...],
    result: AbstractResult,
) -> Float[np.ndarray, " t"]:
    """Return what is added beyond what acted while measuring, in mm or °, per row.

    0 where the row is not used.

    Args:
        draft: The fit.
        share: Its part of the joint fit.
        job: The job.
        folder: Where the files lie.
        files: The lists of the axis.
        written: Their names in the folder.
        result: The fit with its proof.
    """
    rows = share.rows
    added = np.zeros(len(rows))
    if isinstance(result, TableResult):
        added[rows] = result.samples.from_file - result.samples.before
    elif isinstance(result, TemperatureResult):
        added[rows] = result.view.from_file - result.view.before
    elif isinstance(result, BacklashResult):
        assert isinstance(draft, BacklashDraft)  # whose result it is
        view, way = result.view, result.view.direction.astype(float)
        # The proof is about the mean of both directions, the controller goes from the
        # reference direction.
        width = 2.0 * way * (view.from_file - view.before)
        added[rows] = 0.5 * (way - draft.reference) * width
    elif isinstance(draft, CrosstalkDraft):
        place = draft.recording.rows
        assert place is not None  # of a group
        known = place >= 0
        added[place[known]] = draft.added_to_log(job, folder, files, written)[known]
        added[~rows] = 0.0
    return added
