"""What is exported: the tables of a job's result, or of lists."""

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.files import write_atomically
from ...data.lists import ListFile
from ...models import Conventions, ExternalCompensation, OffsetStack
from ..exchange import (
    ExchangeError,
    Ranges,
    Reading,
    axes_in_use,
    machine_lists,
)
from ..job import tree_json
from ..kinds import kind
from ._law import external_from_lists


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
    job = _Job.read(paths[0]) if len(paths) == 1 and _is_result(paths[0]) else _Job()
    lists = [ListFile.read(path) for path in (job.lists if job.result else paths)]
    rules = conventions or job.conventions
    machine = machine_lists(lists)
    used = machine.in_use(rules)
    held = [one for one in used if one.kind.table]
    if not held:
        raise ExchangeError(
            where=", ".join(str(path) for path in paths),
            found="no active cross, plane or leadscrew table",
            expected="at least one: all else needs more than positions",
        )
    numbers = tuple(axes or sorted({*job.axes, *axes_in_use(used, machine)}))
    ranges = {**job.modulo, **(modulo or {})}
    steps = increment if increment is not None else job.increments or None
    law = external_from_lists(lists, Reading(rules, steps, ranges), axes=numbers)
    left = {(f"A{one.axis}", one.name) for one in used} | set(job.fits)
    remarks = [
        f"{axis}: the {name} compensation is left out, as {_reason(name)}. Leave it active."
        for axis, name in sorted(left)
        if not kind(name).table
    ]
    replaced: dict[int, list[str]] = {}
    for one in held:
        replaced.setdefault(one.axis, []).append(one.name)
    workspace = {**_reach(law.law, numbers), **ranges, **job.limits}
    said = (*job.remarks, *remarks)
    return ListSource(law, numbers, workspace, replaced, said, job.result)


def _reason(name: str) -> str:
    if kind(name).adds_current:
        return "it adds to the current"
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


def _is_result(path: Path) -> bool:
    return path.is_dir() or path.suffix == ".json"


@dataclasses.dataclass(frozen=True)
class _Job:
    """What the result of a job says of lists and machine; empty where there is none."""

    lists: tuple[Path, ...] = ()
    conventions: Conventions = dataclasses.field(default_factory=Conventions)
    axes: tuple[int, ...] = ()
    limits: Ranges = dataclasses.field(default_factory=dict)
    modulo: Ranges = dataclasses.field(default_factory=dict)
    increments: Mapping[int, float] = dataclasses.field(default_factory=dict)
    fits: tuple[tuple[str, str], ...] = ()
    remarks: tuple[str, ...] = ()
    result: Path | None = None

    @classmethod
    def read(cls, path: Path) -> "_Job":
        file = path / "result.json" if path.is_dir() else path
        try:
            tree = json.loads(file.read_bytes())
            axes = tree["job"]["axes"].values()
            numbers = {one["number"]: one for one in axes}
            fits, files = tree["fits"], tree["files"]
            bad = [fit for fit in fits if fit["verdict"] == "rejected"]
            stated = [rule for fit in fits for rule in fit["conventions"]]
            rules = _conventions({rule["name"]: rule["value"] for rule in stated})
            lists = [name for name in files if name.endswith(".lis")]
            known = tuple((fit["axis"], fit["compensation"]) for fit in fits)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise ExchangeError(
                where=str(file),
                found="no result of a job",
                expected="that of axcomp fit",
            ) from None
        if bad:
            raise ExchangeError(
                where=str(file),
                found=f"the {bad[0]['compensation']} of {bad[0]['axis']} rejected",
                expected="fits whose gate passed",
            )
        unproven = sorted({fit["axis"] for fit in fits if fit["verdict"] == "unproven"})
        remark = f"Signs of {', '.join(unproven)} are assumed: no measurement has shown them."
        return cls(
            lists=tuple(
                file.parent / name
                for name in lists
                if not name.endswith(".add.lis") and "/" not in name
            ),
            conventions=rules,
            axes=tuple(sorted(numbers)),
            limits=_ranges(numbers, "limits"),
            modulo=_ranges(numbers, "modulo"),
            increments={
                number: one["increment"]
                for number, one in numbers.items()
                if one.get("increment") is not None
            },
            fits=known,
            remarks=(remark,) if unproven else (),
            result=file,
        )


def _ranges(axes: Mapping[int, Mapping[str, Any]], key: str) -> Ranges:
    return {
        number: (float(one[key][0]), float(one[key][1]))
        for number, one in axes.items()
        if one.get(key) is not None
    }


def _conventions(texts: Mapping[str, str]) -> Conventions:
    """Return the rules that a result names; it writes their values as text."""
    chosen: dict[str, int | str] = {}
    for rule in Conventions().listing():
        if rule.name in texts:
            values = {str(choice): choice for choice in rule.choices}
            chosen[rule.name] = values[str(texts[rule.name])]
    return Conventions.from_dict(chosen)
