"""What is exported: the tables of a job's result, or of lists."""

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.files import sha256, write_atomically
from ...data.lists import ListFile
from ...models import Conventions, ExternalCompensation, OffsetStack
from ..exchange import (
    ExchangeError,
    Ranges,
    Reading,
    axes_in_use,
    machine_lists,
)
from ..job import Job, JobFile, tree_json
from ..kinds import kind
from ._law import external_from_lists, tables_in


@dataclasses.dataclass(frozen=True)
class ListSource:
    """The tables of a machine, ready for `export_external`.

    Attributes:
        law: Their offsets.
        axes: Logical numbers of the columns.
        workspace: By axis, in mm or °.
        replaced: Tables that the law holds, by axis.
        remarks: What is left out, and why.
        result: The ``result.json`` that they come from; None: single lists.
    """

    law: ExternalCompensation
    axes: tuple[int, ...]
    workspace: Mapping[int, tuple[float, float]]
    replaced: Mapping[int, Sequence[str]]
    remarks: tuple[str, ...]
    result: Path | None = None

    def name_in_result(self, code: Path) -> None:
        """Name the code in the fits that it holds, under ``external``, if there is a job.

        Args:
            code: The C file of the export; it is named as seen from the result.

        Raises:
            OSError: If the result cannot be written.
        """
        if self.result is None:
            return
        tree = json.loads(self.result.read_bytes())
        place = Path(os.path.relpath(code, self.result.parent)).as_posix()
        for fit in tree["fits"]:
            if fit["compensation"] in self.replaced.get(fit["axis_number"], ()):
                fit["external"] = place
        write_atomically(self.result, tree_json(tree).encode("utf-8"))


def list_source(
    paths: Sequence[Path],
    conventions: Conventions | None = None,
    *,
    axes: Sequence[int] | None = None,
    modulo: Ranges | None = None,
    increment: float | None = None,
) -> ListSource:
    """Return the tables of a job's result or of lists as one law.

    Cross, plane and leadscrew tables that are active. What a job knows of its machine (axes,
    limits, ranges, rules of the controller) is taken from its result; what is given here
    counts before it.

    Args:
        paths: The folder of a job, its ``result.json``, or lists.
        conventions: Rules of the controller; None: those of the job, else the defaults.
        axes: Logical numbers of all axes of the controller, ascending; None: those of the
            job, else all that the lists name.
        modulo: Range in ° by axis that turns.
        increment: mm or ° per increment, for lists with ``unit 0``.

    Raises:
        ExchangeError: If a result or a list cannot be used, or there is no such table.
        OSError: If a file cannot be read.
    """
    given = _given(paths)
    job, rules = given.job, conventions or given.job.conventions
    lists = [ListFile.read(path) for path in given.lists]
    machine = machine_lists(lists)
    used = machine.in_use(rules)
    ranges = {**job.ranges, **(modulo or {})}
    steps = increment if increment is not None else job.increments or None
    reading = Reading(rules, steps, ranges)
    held = tables_in(used, reading)
    if not held:
        raise ExchangeError(
            where=", ".join(str(path) for path in paths),
            found="no active cross, plane or leadscrew table for both directions alike",
            expected="at least one: all else needs more than positions",
        )
    own = job.spec.axes.values()
    stated = {*(one.number for one in own), *axes_in_use(used, machine)}
    numbers = tuple(axes or sorted(stated))
    law = external_from_lists(lists, reading, axes=numbers)
    left = {(f"A{one.axis}", one.name) for one in used if one not in held}
    left |= {fit for fit in given.fits if not kind(fit[1]).table}
    remarks = [
        f"{axis}: the {name} compensation is left out, as {_reason(name)}. Leave it active."
        for axis, name in sorted(left)
    ]
    remarks += (
        f"A{one.axis}: the {one.name} table waits for COMP ON in the NC program"
        " (manual_activation 1); as a part of this compensation it acts whenever that is on."
        for one in held
        if one.manual
    )
    replaced: dict[int, list[str]] = {}
    for one in held:
        replaced.setdefault(one.axis, []).append(one.name)
    limits = {one.number: (one.limits[0], one.limits[1]) for one in own if one.limits}
    workspace = {**_reach(law.law, numbers), **ranges, **limits}
    said = (*given.remarks, *remarks)
    return ListSource(law, numbers, workspace, replaced, said, given.result)


def _reason(name: str) -> str:
    if kind(name).adds_current:
        return "it adds to the current"
    if kind(name).table:
        return "it has a table for each direction of motion"
    return "it needs more than the positions that the interface hands over"


def _reach(law: Any, numbers: Sequence[int]) -> dict[int, tuple[float, float]]:
    """Return from where to where the tables over each axis go."""
    assert isinstance(law, OffsetStack)
    found: dict[int, tuple[float, float]] = {}
    for part in law.parts:
        for column, nodes in zip(part.masters, part.model.ways, strict=True):
            ends = np.asarray(nodes.positions)[[0, -1]]
            low, high = found.get(numbers[column], (np.inf, -np.inf))
            both = min(low, float(ends[0])), max(high, float(ends[1]))
            found[numbers[column]] = both
    return found


@dataclasses.dataclass(frozen=True)
class _Given:
    """Lists to export, and what a job says of their machine; of nothing where there is none."""

    job: Job
    lists: Sequence[Path]
    fits: frozenset[tuple[str, str]] = frozenset()
    remarks: tuple[str, ...] = ()
    result: Path | None = None


def _given(paths: Sequence[Path]) -> _Given:
    """Return lists as they are, or those of a job with what its result says.

    Raises:
        ExchangeError: If a result is none, or one of its fits is rejected.
    """
    file = paths[0] / "result.json" if paths[0].is_dir() else paths[0]
    if len(paths) > 1 or file.suffix != ".json":
        spec = JobFile.model_construct(axes={}, measurements={})
        return _Given(Job(file, spec), paths)
    try:
        tree = json.loads(file.read_bytes())
        spec = JobFile.model_validate_json(json.dumps(tree["job"]))
        fits = tree["fits"]
        bad = [fit for fit in fits if fit["verdict"] == "rejected"]
        unproven = sorted({fit["axis"] for fit in fits if fit["verdict"] == "unproven"})
        rules = Conventions.from_dict(tree["conventions"])
        known = frozenset((fit["axis"], fit["compensation"]) for fit in fits)
        names = [name for name in tree["files"] if _is_list(name)]
        digests = dict(tree["digests"])
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ExchangeError(
            where=str(file),
            found="no result of a job",
            expected="that of axcomp fit of this version",
        ) from None
    if bad:
        raise ExchangeError(
            where=str(file),
            found=f"the {bad[0]['compensation']} of {bad[0]['axis']} rejected",
            expected="fits whose gate passed",
        )
    job = Job(file, spec, conventions=rules)
    remark = (
        f"Signs of {', '.join(unproven)} are assumed: no measurement has shown them."
    )
    lists = [file.parent / name for name in names]
    remarks = [remark] if unproven else []
    remarks += (
        f"{path.name} is not as axcomp fit wrote it: what {file.name} says is not about it."
        for path in lists
        if path.is_file() and sha256(path) != digests.get(path.name)
    )
    return _Given(job, lists, known, tuple(remarks), file)


def _is_list(name: str) -> bool:
    """Return whether a file of a job is a whole list that may be loaded."""
    return name.endswith(".lis") and not name.endswith(".add.lis") and "/" not in name
