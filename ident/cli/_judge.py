"""Commands that judge a controller: ``verify`` by what it logged, ``doctor`` by an instrument."""

import dataclasses
import datetime
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ._console import note, print_result, working
from ._options import (
    AsJson,
    CycleTime,
    Increment,
    Lists,
    Modulo,
    Rules,
    axis_ranges,
    read_lists,
    rules_of,
)

if TYPE_CHECKING:
    from ..exchange import StoredConventions
    from ..proof import Diagnosis, Measured, Verdict, Verification

_FAR = 0.1
"""Part of the longest travel from which on that of an axis counts."""


def verify(
    files: Lists,
    *,
    log: Path,
    save: Path | None = None,
    increment: Increment = None,
    conventions: Rules = None,
    cycle_time: CycleTime = None,
    modulo: Modulo = None,
    as_json: AsJson = False,
) -> bool:
    """Compare what a controller logged that it added with what its lists say.

    Says in one sentence per compensation what the controller does. Exit status 0 only
    where all agree.

    Options:
        log (L.csv): What the controller logged: time, A1.position, … and A3.cross,
            V.A.CROSS_COMP_CURR.Z, CROSSC::actual_offset, A3.EXTC[0].actual_offset or
            A3.drive_position; or diagdata.txt of an external compensation.
        save (CONVENTIONS.toml): Where to store the rules that the log settles, for the jobs of
            this machine; what stands there already is kept.

    Examples:
      axcomp verify axcomp-out/achskw1.lis --log log.csv
    """
    from ...data.measurements import read_log
    from ..exchange import Reading
    from ..external import read_snapshot, verify_external, verify_snapshot
    from ..job import use_compilation_cache
    from ..kinds import kinds
    from ..proof import Verification, turns_in_log, verify_log

    ranges = axis_ranges(modulo, "--modulo")
    use_compilation_cache()
    stored = rules_of(save if save is not None and save.exists() else None)
    assumed = stored if conventions is None else rules_of(conventions)
    lists = read_lists(files)
    rules = assumed.conventions
    reading = Reading(rules, increment, ranges)
    with working("reading the log"):
        snapshot, answer = read_snapshot(log), Verification((), (), rules, frozenset())
        if snapshot is not None:
            outside = verify_snapshot(lists, snapshot, reading)
        else:
            names = [kind.name for kind in kinds()]
            turns = turns_in_log(lists, ranges)
            logged = read_log(log, increment, cycle_time, names, turns)
            outside, logged = verify_external(lists, logged, reading)
            if logged.offsets or not outside:
                answer = verify_log(lists, logged, reading)
        verdicts = (*outside, *answer.verdicts)
        answer = dataclasses.replace(answer, verdicts=verdicts)
    trees = [_json(item, f"A{item.axis}") for item in verdicts]
    for tree in trees:
        # Several only where several verdicts explain the log.
        if len(tree["value"]) < 2:
            tree["value"] = next(iter(tree["value"]), None)
    _print(trees, as_json=as_json)
    note(answer.remarks)
    if save is not None:
        _save(save, stored, answer)
    return answer.agrees


def _json(answer: "Verdict | Diagnosis", axis: str) -> dict[str, Any]:
    keys = ("compensation", "verdict", "value", "sentence")
    return {"axis": axis} | {key: getattr(answer, key) for key in keys}


def _print(trees: Sequence[Mapping[str, Any]], *, as_json: bool) -> None:
    lines = [
        f"{each['axis']} {each['compensation']}: {each['sentence']}" for each in trees
    ]
    print_result(trees if as_json else None, lines)


def _save(path: Path, stored: "StoredConventions", answer: "Verification") -> None:
    """Add the rules that the log settled to a file; those that only fit stay assumed."""
    from ..job import write_atomically

    values = answer.conventions.to_dict()
    settled = {name: values[name] for name in sorted(answer.settled)}
    turned = stored.contradicted(settled)
    before = stored.conventions.to_dict()
    kept = {name: before[name] for name in stored.verified}
    fitting = type(answer.conventions).from_dict({**values, **kept})
    merged = dataclasses.replace(stored, conventions=fitting).with_verified(
        settled, saved_at=datetime.date.today().isoformat()
    )
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    write_atomically(path, merged.saved_over(text))
    names = ", ".join(f"{name} = {value}" for name, value in settled.items())
    note([f"{path}: settled {names or 'nothing'}"])
    note(f"{name} was settled otherwise before; the new log counts." for name in turned)


def _parts_seen(
    before: Sequence["Measured"],
    after: Sequence["Measured"],
    judged: Collection[int],
    names: Mapping[int, str],
) -> Iterator[str]:
    """Yield of which part of the travel the second measurement shows nothing, by axis."""
    import numpy as np  # what needs no arrays starts without it

    from ..job.result._second import part_of

    for axis in sorted(judged):
        both = [
            [one.positions for one in each if one.axis == axis]
            for each in (before, after)
        ]
        shared = set.intersection(*(set(places) for each in both for places in each))
        first, second = (
            {k: np.concatenate([places[k] for places in each]) for k in sorted(shared)}
            for each in both
        )
        least = _FAR * max(map(np.ptp, first.values()), default=0.0)
        parts = (
            part_of([names[k]], place[:, None], second[k][:, None])
            for k, place in first.items()
            if np.ptp(place) > least
        )
        if part := next(filter(None, parts), None):
            yield (
                f"{names.get(axis, f'A{axis}')}: the second measurement shows {part[0]} ="
                f" {part[1]:.6g} to {part[2]:.6g} only; what the lists do beyond is not judged"
            )


def doctor(
    files: list[Path],
    *,
    before: Path,
    after: Path,
    as_json: AsJson = False,
) -> bool:
    """Say what is wrong with a list, from measurements without and with it.

    Right, sign, unit, shift, wrong axis, swapped directions, applied twice, or that the
    measurements cannot tell. Exit status 0 where all that was switched is right, at every place.

    Options:
        files (FILE.lis …): Lists as they were active in the second measurement.
        before (JOB.toml): Job with the measurements without the lists; needs no [[fits]].
        after (JOB.toml): Job with the measurements with the lists active; active = [...] where
            not all of them were.

    Examples:
      axcomp doctor axcomp-out/achskw1.lis --before job.toml --after after.toml
    """
    from ..job import load_job, use_compilation_cache
    from ..proof import diagnose, driving_axes, not_judged, unlisted
    from ..readings import read_outside

    use_compilation_cache()
    old, new = (load_job(path, fits=False) for path in (before, after))
    lists = read_lists(files)
    names = {axis.number: name for name, axis in new.spec.axes.items()}
    with working("reading the measurements"):
        driving = driving_axes(lists, new.conventions)
        outside = read_outside(old, driving), read_outside(new, driving)
        diagnoses = diagnose(lists, *outside, new.reading, names=names)
    missing = unlisted(lists, *outside, new.conventions, names)
    parts = _parts_seen(*outside, {each.axis for each in diagnoses}, names)
    note((*not_judged(lists, new.conventions, names), *missing, *parts), "")
    axes = (names.get(answer.axis, f"A{answer.axis}") for answer in diagnoses)
    _print([*map(_json, diagnoses, axes)], as_json=as_json)
    return all(answer.is_right for answer in diagnoses) and not missing
