"""Rules of the controller that a second measurement settles, and where they are kept."""

import dataclasses
import datetime
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...data.files import write_atomically
from ..exchange import StoredConventions, read_conventions
from ._load import Job
from ._result import AbstractResult, Remark

CONVENTIONS = "conventions.toml"
"""Name in the output folder, where the job names no file of its machine."""


def settled_by(
    results: Sequence[AbstractResult],
) -> tuple[dict[str, int | str], list[Remark]]:
    """Return the rules of the controller that the diagnoses settle."""
    votes: dict[str, set[int | str]] = {}
    for one in results:
        again = one.again
        found = None if again is None else again.diagnosis
        if again is None:
            continue
        sign = 1 if again.shown else 0 if found is None else found.sign
        if sign == 0:
            continue
        # Scatter of the runs may look like a fault: the error must go the same way.
        if again.rms is not None and (again.rms - again.before) * sign > 0:
            continue
        for rule in one.conventions:
            if rule.decides == "sign":
                votes.setdefault(rule.name, set()).add(sign * int(rule.value))
            elif rule.decides == "owner" and again.acts and sign > 0:
                votes.setdefault(rule.name, set()).add(rule.value)
    remarks = [
        Remark.warning(
            f"{name}: axes contradict each other, nothing is saved: one of the instruments"
            " counts the other way round."
        )
        for name, values in votes.items()
        if len(values) > 1
    ]
    return {n: next(iter(v)) for n, v in votes.items() if len(v) == 1}, remarks


def save_settled(job: Job, root: Path, settled: dict[str, int | str]) -> list[Remark]:
    """Save settled rules in the machine's file; what contradicts it is taken out.

    A rule that was settled otherwise before stays: a log of the controller needs no
    instrument, and one that counts the other way round looks like a flipped sign.
    """
    named = job.spec.machine.conventions
    path = root / CONVENTIONS if named is None else job.file(named)
    stored = StoredConventions()
    if path.is_file():
        stored = read_conventions(path, job.spec.machine.id)
    remarks = []
    for name in stored.contradicted(settled):
        remarks.append(
            Remark.warning(
                f"{name} = {stored.conventions.to_dict()[name]} in {path} was settled"
                f" before and stays; the second measurement says {settled.pop(name)}."
                " Either the controller has changed or the instrument counts the other"
                " way round: take a log of the drive position (axcomp verify --save)."
            )
        )
    values = stored.conventions.to_dict()
    if any(n not in stored.verified or values[n] != v for n, v in settled.items()):
        merged = stored.with_verified(
            settled,
            machine=job.spec.machine.id,
            saved_at=datetime.date.today().isoformat(),
        )
        write_atomically(path, merged.dumps())
    words = ", ".join(f"{name} = {value}" for name, value in settled.items())
    if words:
        own = os.path.relpath(path, job.path.parent)
        hint = "" if named else f' Name it in the job: [machine] conventions = "{own}".'
        remarks.append(Remark.info(f"Settled and saved in {path}: {words}.{hint}"))
    return remarks


def with_settled(
    result: AbstractResult, settled: Mapping[str, int | str]
) -> AbstractResult:
    rules = tuple(
        dataclasses.replace(rule, state="verified")
        if rule.name in settled and str(settled[rule.name]) == rule.value
        else rule
        for rule in result.conventions
    )
    return dataclasses.replace(result, conventions=rules)
