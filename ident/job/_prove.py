"""The proof of one fit: its file, read back and evaluated by the controller's rules."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile
from ..exchange import Model, by_branch
from ..proof import ErrorFigures, error_figures
from ._fitting import Fitted
from ._lists import AxisFiles
from ._load import Job
from ._output import OutFolder
from ._remarks import Counts, fit_remarks, outside
from ._result import (
    Remark,
    SampleView,
    TableResult,
)
from ._source import masters_of


def offset_at_readings(one: Fitted, model: Model) -> Float[np.ndarray, " t"]:
    """Return what a model of the new table adds at each reading, in mm or °."""
    return one.plan.table.offset(
        model,
        one.readings.positions,
        one.samples.branch,
    )


def prove(
    job: Job,
    folder: OutFolder,
    one: Fitted,
    frame: dict[str, Any],
    files: AxisFiles,
    written: tuple[Path, ...],
    cycles: int | None,
) -> TableResult:
    """Return one fit with its proof: the file as it lies in the folder, read back.

    Args:
        job: The job.
        folder: Where the files lie.
        one: The fit.
        frame: What every result says alike (`AbstractDraft.frame`).
        files: The lists of the axis.
        written: Their names in the folder, the compensation list first.
        cycles: Value of P-AXIS-00243, where a table of the axis has two directions.
    """
    plan, readings = one.plan, one.readings
    table, spec = plan.table, plan.fit
    back = ListFile.read(folder.root / written[0])
    from_file = one.before + offset_at_readings(one, table.read(back)) - one.active
    runs = readings.run_table(table.masters == (table.axis,))
    entries = table.sign * one.offset
    old = plan.old_offset
    linear = job.spec.axes[spec.axis].kind == "linear"
    counts = Counts(
        len(one.before),
        int(one.fit.wild.sum()),
        int(outside(table, readings.positions).sum()),
    )
    error = {
        "before": error_figures(one.before, runs, one.fit.wild),
        "predicted": error_figures(one.held_out.residual, runs, one.fit.wild),
        "from_file": error_figures(from_file, runs, one.fit.wild),
    }
    return TableResult(
        **frame,
        masters=masters_of(spec),
        nodes=tuple(nodes.positions for nodes in table.nodes),
        table=by_branch(table, entries),
        old_table=None if old is None else by_branch(table, table.sign * old),
        standard_deviation=by_branch(table, one.fit.standard_deviation),
        support=by_branch(table, one.fit.support),
        fit=one.fit,
        samples=SampleView(
            positions=readings.positions,
            direction=readings.direction,
            run=readings.run,
            order=readings.order,
            before=one.before,
            predicted=one.held_out.residual,
            from_file=from_file,
            predicted_sd=one.held_out.standard_deviation,
            share=one.fit.share,
        ),
        error=error,
        rounding=one.rounding,
        remarks=(
            *plan.remarks,
            *readings.remarks,
            *fit_remarks(one, counts, linear),
            *without_use(error, one.held_out.by_run),
            *files.remarks,
        ),
        files=files.of_lists(written),
        cycles=cycles if table.branches == 2 else None,
        held_out="run" if one.held_out.by_run else "block",
    )


def without_use(error: Mapping[str, ErrorFigures], by_run: bool) -> list[Remark]:
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
        Remark(
            "warning",
            "On readings that the fit did not see, this list leaves no less error than"
            f" there is without it: {why}",
        )
    ]
