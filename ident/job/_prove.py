"""The proof of one fit: its file, read back and evaluated by the controller's rules."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..exchange import LIST_UNITS, Model, by_branch
from ..fit import TableFit
from ..proof import ErrorFigures
from ._draft import Written
from ._fitting import AbstractFitted, Fitted
from ._gating import switching_remarks
from ._remarks import Counts, fit_remarks, outside, places_of
from ._result import (
    Remark,
    SampleView,
    Streamed,
    TableResult,
    staged,
)


def offset_at_readings(one: Fitted, model: Model) -> Float[np.ndarray, " t"]:
    """Return what a model of the new table adds at each reading, in mm or °."""
    return one.plan.table.offset(
        model,
        one.readings.positions,
        one.samples.branch,
    )


@dataclasses.dataclass(frozen=True)
class Proof:
    """A fit and its readings under the file as it lies in the folder.

    Attributes:
        fit: The estimate; its arrays over readings are those of ``samples``.
        samples: The readings that are shown.
        error: By stage, over all readings.
        counts: Of the readings.
        by_run: Whether runs were held out, else spatial blocks.
        remarks: What is to be said of the readings.
        streamed: What was read in pieces; None: all readings were in memory.
    """

    fit: TableFit
    samples: SampleView
    error: Mapping[str, ErrorFigures]
    counts: Counts
    by_run: bool
    remarks: tuple[Remark, ...]
    streamed: Streamed | None = None


def prove(one: Fitted, done: Written) -> Proof:
    """Return the proof of a fit: the file as it lies in the folder, read back."""
    readings, table = one.readings, one.plan.table
    back = done.compensation
    assert back is not None  # a table stands in it
    from_file = one.before + offset_at_readings(one, table.read(back)) - one.active
    runs = readings.run_table(table.masters == (table.axis,))
    wild, left = one.fit.wild, one.held_out
    return Proof(
        fit=one.fit,
        samples=SampleView(
            positions=readings.positions,
            direction=readings.direction,
            run=readings.run,
            order=readings.order,
            before=one.before,
            predicted=left.residual,
            from_file=from_file,
            predicted_sd=left.standard_deviation,
            share=one.fit.share,
            timed=readings.timed,
        ),
        error=staged(one.before, left.residual, from_file, wild, runs),
        counts=Counts(
            len(one.before),
            int(wild.sum()),
            int(outside(table, readings.positions).sum()),
            places_of(readings, wild, one.plan.fit.over),
        ),
        by_run=left.by_run,
        remarks=tuple(readings.remarks),
    )


def written_deviation(fit: TableFit) -> Float[np.ndarray, "..."]:
    """Return the standard deviation of entries in mm or °: rounding is part of it."""
    rounding = 1.0 / (12.0 * LIST_UNITS**2)
    return np.asarray(np.sqrt(np.square(fit.standard_deviation) + rounding))


def result_of(
    one: AbstractFitted, proof: Proof, frame: dict[str, Any], done: Written
) -> TableResult:
    """Return the result of a fit, wherever its readings are.

    Args:
        one: The fit.
        proof: Its proof.
        frame: What every result says alike (`AbstractDraft.frame`).
        done: What was written.
    """
    plan, job, files = one.plan, done.job, done.files
    table, spec, old = plan.table, plan.fit, plan.old_offset
    linear = job.spec.axes[spec.axis].kind == "linear"
    return TableResult(
        **frame,
        masters=spec.over,
        nodes=tuple(nodes.positions for nodes in table.nodes),
        table=by_branch(table, table.sign * one.offset),
        old_table=None if old is None else by_branch(table, table.sign * old),
        standard_deviation=by_branch(table, written_deviation(one.fit)),
        support=by_branch(table, one.fit.support),
        fit=proof.fit,
        samples=proof.samples,
        error=proof.error,
        rounding=one.rounding,
        remarks=(
            *plan.remarks,
            *proof.remarks,
            *fit_remarks(one, proof.counts, linear),
            *_without_use(proof.error, proof.by_run),
            *switching_remarks(job, one),
            *files.remarks,
        ),
        files=files.of_lists(done.names),
        cycles=done.cycles if table.branches == 2 else None,
        held_out="run" if proof.by_run else "block",
        streamed=proof.streamed,
    )


def _without_use(error: Mapping[str, ErrorFigures], by_run: bool) -> list[Remark]:
    """Return a warning where the list would not have helped on data it has not seen."""
    if error["predicted"].sound.rms < error["before"].sound.rms:
        return []
    if by_run:
        why = (
            "what was measured is scatter or drift, which no table takes away. Measure"
            " again before loading it."
        )
    else:
        # A block that is left out takes all readings of its nodes with it: that shows
        # what the surroundings tell of a place, not whether the place would repeat.
        why = (
            "its surroundings do not tell the error of a place. That is scatter, or an"
            " error that changes from node to node: repeated runs would tell which."
        )
    return [
        Remark.warning(
            "On readings that the fit did not see, this list leaves no less error than"
            f" there is without it: {why}"
        )
    ]
