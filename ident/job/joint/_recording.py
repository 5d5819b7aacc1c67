"""Readings of a group: every role that its effects need, all measurements joined."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ..._recording import CHANNELS, JointData, stacked
from ...kinds._keys import FitSpec
from .._readings import joined_runs, rows_of
from .._result import Remark
from .._source import Tables
from ._reader import GroupNeeds, GroupReader, ReadPart

_FOLDS, _BLOCKS = 5, 20
"""In how many turns readings are held out, and stretches of the recording."""
_MOST_RUNS = 10


@dataclasses.dataclass(frozen=True)
class GroupRecording:
    """What a group has been measured with.

    Attributes:
        data: All readings, measurements one after the other.
        slices: Rows of each measurement.
        order: Time in s, or row number.
        timed: Whether it is a time.
        fold: Turn in which each reading is held out.
        by_run: Whether whole runs are held out, else stretches of the recording.
        moving: Compensated axes whose error was recorded in motion, with their velocity.
        drift: Pieces of a slow drift of the instrument that is allowed for.
        remarks: What was taken for granted.
    """

    data: JointData
    slices: Mapping[str, slice]
    order: Float[np.ndarray, " t"]
    timed: bool
    fold: Int[np.ndarray, " t"]
    by_run: bool
    moving: frozenset[str]
    drift: int
    remarks: tuple[Remark, ...]

    @property
    def drifting(self) -> bool:
        """Whether a slow drift of the instrument is allowed for, and known when held out."""
        return self.drift > 0 and not self.by_run

    @property
    def held_out(self) -> str:
        """What the prediction leaves out together."""
        return "run" if self.by_run else "block"


def read_group(
    tables: Tables, fits: Sequence[FitSpec], needs: GroupNeeds
) -> GroupRecording:
    """Return the readings of a group.

    Raises:
        MeasurementError: If a role is missing or a value cannot be used.
        JobError: If a measurement does not suit.
    """
    parts, remarks = [], list[Remark]()
    lead = max(fits, key=lambda fit: len(fit.over))
    for name in lead.sources:
        reader = GroupReader(tables, name, lead, fits, needs)
        parts.append(reader.read())
        remarks += [Remark.info(words) for words in dict.fromkeys(reader.remarks)]
    counts = [part.count for part in parts]
    time = None
    if all(part.time is not None for part in parts):
        time = np.concatenate([part.time for part in parts if part.time is not None])
    label = joined_runs([(part.run, part.count) for part in parts])
    several = label is not None and len(np.unique(label)) > 1
    heated = needs.heated  # runs without an offset: it is what tells the temperature
    beside = _set_ups(parts, tables, lead.sources)
    data = JointData(
        **{table: stacked(parts, table, counts) for table in CHANNELS},
        time=time,
        run=label if several else None,
        runs=dict.fromkeys(heated, beside),
    )
    order = np.arange(len(data), dtype=float) if time is None else time
    fold, by_run = _folds(label, order)
    if several and heated and beside is None:
        remarks.append(
            Remark.info(
                f"Runs have no offset of their own on {' and '.join(heated)}: it could"
                " not be told from what the temperature does from run to run."
            )
        )
    return GroupRecording(
        data=data,
        slices=rows_of(lead.sources, counts),
        order=np.asarray(order, dtype=float),
        timed=time is not None,
        fold=fold,
        by_run=by_run,
        moving=frozenset().union(*(part.moving for part in parts)),
        drift=max(tables.job.spec.measurements[name].drift for name in lead.sources),
        remarks=tuple(remarks),
    )


def _set_ups(
    parts: Sequence[ReadPart], tables: Tables, sources: Sequence[str]
) -> Int[np.ndarray, " t"] | None:
    """Return what has an offset of its own beside a temperature.

    Only where the zero of each measurement is arbitrary (``remove``), each has one.
    """
    removed = [tables.job.spec.measurements[name].remove != "none" for name in sources]
    if len(parts) == 1 or not any(removed):
        return None
    return np.repeat(np.arange(1, len(parts) + 1), [part.count for part in parts])


def _folds(
    label: Int[np.ndarray, " t"] | None, order: Float[np.ndarray, " t"]
) -> tuple[Int[np.ndarray, " t"], bool]:
    """Return the turn of each reading, and whether runs are held out as a whole."""
    if label is not None:
        runs, index = np.unique(label, return_inverse=True)
        if len(runs) > 2:
            return np.asarray(index.reshape(-1) % min(len(runs), _MOST_RUNS)), True
    rank = np.empty(len(order), dtype=np.int64)
    rank[np.argsort(order, kind="stable")] = np.arange(len(order))
    return rank * _BLOCKS // max(len(order), 1) % _FOLDS, False
