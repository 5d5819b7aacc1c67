"""The second measurement: the lists as loaded, measured again (docs/measure-again.md).

Rules of the controller that it settles are kept in the file of the machine.
"""

import contextlib
import dataclasses
import datetime
import functools
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.errors import AxcompError
from ...data.files import sha256, write_atomically
from ...data.lists import ListFile
from ..core import FitError, regress
from ..exchange import ExchangeError, StoredConventions, read_conventions
from ..kinds import kind
from ..proof import Diagnosis, Measured, diagnose, driving_axes, not_judged
from ..readings import Tables, errors_in, read_outside
from ._draft import AbstractDraft
from .file._faults import MissingFileError
from .file._load import Job, load_job
from .file._schema import MeasurementSpec
from .result._job_result import JobResult
from .result._result import AbstractResult, Remark, by_level
from .result._second import LESS, MeasuredAgain, SecondMeasurement
from .write._lists import AxisFiles

_CONVENTIONS = "conventions.toml"
"""Name in the output folder, where the job names no file of its machine."""
_FACTORS = {
    1.0: ("right", "the list adds what it says", 1),
    -1.0: ("sign", "added with opposite sign", -1),
    0.0: (
        "wrong axis",
        "nothing is added: it is not active, or follows another axis",
        0,
    ),
    2.0: ("twice", "added twice", 1),
    **{
        times: ("unit", f"added {times:g} times as large as the list says", 1)
        for times in (0.1, 10.0, 25.4, 100.0, 1000.0)
    },
}
"""What a list is, by how many times it acts, and the sign with which it does."""
_HIDDEN = (
    "cannot tell: the list that acted before has the same shape, so that nothing says which of"
    " both acts, and how often: measure with the compensation off, and again with it on"
)
_NEAR = 0.1
"""Share by which a list that is turned round may act otherwise than it says."""


@dataclasses.dataclass(frozen=True)
class Second:
    """A second measurement that is about the lists of this run.

    Attributes:
        name: Of the file of its job, relative to the first job.
        date: Day on which it was first evaluated.
        lists: Hashes of what the lists say, by file name.
    """

    job: Job
    name: str
    date: str
    lists: Mapping[str, str]

    @functools.cached_property
    def source(self) -> dict[str, str]:
        """File, hash and date, as result.json names them."""
        hashed = sha256(self.job.path)
        return {"file": self.name, "sha256": hashed, "date": self.date}


def plan_second(
    job: Job, named: Path | None, root: Path, files: Sequence[AxisFiles]
) -> tuple[Second | None, tuple[Remark, ...]]:
    """Return the second measurement of a run, before its lists are written.

    The one that is asked for; else the one that ``[verify]`` names; else that of an
    earlier run into the same folder. The last two count as long as lists and measurement
    are the same, else a remark says that they do not.

    Raises:
        JobError: If the second measurement that is asked for was made with other lists.
        OSError: If its job cannot be read.
    """
    earlier = _earlier(root)
    stated = job.spec.verify
    path = job.file(stated.job) if named is None and stated is not None else named
    if path is None and earlier is None:
        return None, ()
    lists = {
        name: _hash_of(listing)
        for axis in files
        if not axis.failed
        for name, listing in axis.lists
    }
    if path is not None:
        try:
            after = load_job(path, fits=False)
        except MissingFileError as error:
            if named is not None or earlier is not None:
                raise
            # Lists that only this run writes, or readings that are yet to be taken.
            words = (
                f"The second measurement of [verify] does not count yet: {error}. Load the lists"
                " of this run, measure again, and run the job once more."
            )
            return None, (Remark.warning(words),)
        _refuse_other_axes(job, after)
        _refuse_same_readings(job, after)
        name = job.relative(path)
        other = _other_list(job, after, root, files, lists)
        if other is not None and named is not None:
            raise after.error((), other)
        if other is not None:
            words = (
                f"The second measurement of [verify] ({name}) does not count: {other}"
            )
            return None, (Remark.warning(words),)
        date, notes = datetime.date.today().isoformat(), tuple[Remark, ...]()
        if earlier is not None and earlier["inputs"] == _hashes(after):
            date = earlier["date"]
        elif earlier is not None and earlier["file"] != name:
            words = (
                f"{name} takes the place of the second measurement of {earlier['date']}"
                f" ({earlier['file']}): what only that one showed is not called verified any"
                " more. Name the measurements of both in one job to keep it."
            )
            notes = (Remark.warning(words),)
        return Second(after, name, date, lists), notes
    assert earlier is not None
    name, why = str(earlier["file"]), "the lists have changed since"
    if earlier["lists"] == lists:
        why = "it has changed since, or is gone"
        with contextlib.suppress(AxcompError, OSError):
            after = load_job(job.file(name), fits=False)
            if _hashes(after) == earlier["inputs"]:
                return Second(after, name, str(earlier["date"]), lists), ()
    words = (
        f"The second measurement of {earlier['date']} ({name}) no longer counts: {why}."
        " Measure again with the lists of this run, and give it with --after."
    )
    return None, (Remark.warning(words),)


def measure_again(
    job: Job,
    second: Second,
    drafts: Sequence[AbstractDraft],
    result: JobResult,
    root: Path,
) -> JobResult:
    """Return a result with what the second measurement says, and save what it settles."""
    diagnoses, remarks, outside = _diagnoses(job, second, result.fits, root)
    tables = Tables(second.job)
    measured = errors_in(tables)
    # A fit of a group is compared as the group as a whole.
    sums = {axis.axis: axis.error for group in result.groups for axis in group.axes}
    figures_of = [
        fit.error if fit.group is None else sums.get(fit.axis, fit.error)
        for fit in result.fits
    ]
    found: list[SecondMeasurement | None] = []
    for draft, fit in zip(drafts, result.fits, strict=True):
        readings = None
        names = [name for name, axes in measured.items() if fit.axis in axes]
        names = [name for name in draft.fit.sources if name in names] or names
        active = {n: second.job.spec.measurements[n].stated_active for n in names}
        on = [n for n, on in active.items() if on is None or fit.compensation in on]
        # Of friction, say, readings at standstill tell nothing either way.
        if fit.files and names and not on and not kind(fit.compensation).unseen:
            words = (
                f"{second.name} says that the {fit.compensation} was off while"
                f" {', '.join(names)} was measured (active), which tells nothing of it:"
                f' expected active = ["{fit.compensation}"] and its list loaded.'
            )
            remarks.append(Remark.warning(words))
        if fit.files and on:
            update = {"measurement": None, "measurements": on}
            try:
                readings = draft.second_measurement(
                    tables, draft.fit.model_copy(update=update)
                )
            except AxcompError as error:
                remarks.append(Remark.warning(f"Not measured again: {error}"))
        found.append(readings)
    pairs = zip(drafts, found, strict=True)
    adding = [draft.axis for draft, one in pairs if one and one.adds.size]
    for draft, readings, figures in zip(drafts, found, figures_of, strict=True):
        if readings and draft.foreseen is not None:
            first, best = draft.foreseen.before, figures["predicted"].sound.rms
            unit = job.spec.axes[draft.axis].small_unit
            alone = adding.count(draft.axis) == int(readings.adds.size > 0)
            readings.check_scatter(first, best, unit, alone=alone)
    left = {
        fit.axis: figures["predicted"].sound.rms
        for fit, figures in zip(result.fits, figures_of, strict=True)
    }
    found = _with_factors(result.fits, found, left, diagnoses)
    fits = []
    for fit, readings, figures in zip(result.fits, found, figures_of, strict=True):
        diagnosis = diagnoses.get((fit.axis_number, fit.compensation))
        again = None
        if readings is not None or diagnosis is not None:
            before, predicted = (figures[k].sound.rms for k in ("before", "predicted"))
            if readings and readings.before is not None and fit.group is None:
                before = readings.before
            diagnosis = _turned(fit, diagnosis, readings)
            again = MeasuredAgain(second.source, readings, diagnosis, before, predicted)
            if diagnosis is None and again.is_hidden:
                identity = fit.axis_number, fit.compensation
                hidden = Diagnosis(*identity, "cannot tell", sentence=_HIDDEN)
                again = dataclasses.replace(again, diagnosis=hidden)
        beginning = f"{fit.axis} {fit.compensation}: not judged: "
        own = [one for one in remarks if one.message.startswith(beginning)]
        told = by_level((*fit.remarks, *own)) if own else fit.remarks
        fits.append(dataclasses.replace(fit, again=again, remarks=told))
    fits = [_beside(fit, fits, outside) for fit in fits]
    settled, notes = _settled_by(fits)
    if settled:
        notes += _save_settled(job, root, settled)
    # So that a rerun does not lose it.
    record = {**second.source, "inputs": _hashes(second.job), "lists": second.lists}
    return dataclasses.replace(
        result,
        fits=tuple(_finished(fit, settled) for fit in fits),
        remarks=(*result.remarks, *remarks, *notes),
        second=record,
    )


def _beside(
    fit: AbstractResult, fits: Sequence[AbstractResult], after: Sequence[Measured]
) -> AbstractResult:
    """Return a fit with the wrong fits of its axis, where it is not and its error stays large."""
    again = fit.again
    if again is None:
        return fit
    others = {
        other.compensation: other.again
        for other in fits
        if other.axis == fit.axis and other is not fit and other.again is not None
    }
    wrong = [name for name, other in others.items() if other.is_wrong]
    if again.is_wrong:
        # What a list does beside another one that is known to be wrong is no "other" fault.
        named = [name for name in wrong if others[name].verdict != "other"]
        if again.verdict != "other" or not named:
            return fit
        again, wrong = dataclasses.replace(again, diagnosis=None), named
    elif not wrong and _is_left_in_motion(fit.axis_number, again.predicted, after):
        mine = [other.compensation for other in fits if other.axis == fit.axis]
        wrong = [name for name in mine if "acceleration" in kind(name).follows]
    elif not wrong and again.verdict == "right":
        wrong = [name for name, other in others.items() if not other.acts]
    if not wrong or again.rms is None or again.rms <= LESS * again.predicted:
        return fit
    beside = dataclasses.replace(again, beside=tuple(wrong))
    return dataclasses.replace(fit, again=beside)


def _is_left_in_motion(axis: int, predicted: float, after: Sequence[Measured]) -> bool:
    """Return whether more than predicted is left where another axis accelerates, and only there."""
    largest = LESS * predicted
    return any(
        np.std(one.undriven.error) <= largest < np.std(one.error[one.driven])
        for one in after
        if one.axis == axis and one.driven is not None and one.driven.any()
    )


def _with_factors(
    fits: Sequence[AbstractResult],
    found: Sequence[SecondMeasurement | None],
    predicted: Mapping[str, float],
    told: Collection[tuple[int, str]],
) -> list[SecondMeasurement | None]:
    """Return readings with how many times each list of an axis acts.

    What all lists of an axis add is the negative of its error as it was fitted: what is left
    of it in the second measurement is how much more or less each of them adds. That counts
    where nothing else is left: a list that acts in a part only is no factor. Where that leaves
    more, those that acted before may still act, or do so no longer, whatever the new ones do.

    Args:
        fits: As the first job has them.
        found: Readings of each.
        predicted: What the lists of each axis are to leave, rms in mm or °.
        told: Axis numbers and compensations that are diagnosed by what changed.
    """
    result = list(found)
    for axis in dict.fromkeys(fit.axis for fit in fits):
        own = {
            k: one
            for k, (fit, one) in enumerate(zip(fits, found, strict=True))
            if fit.axis == axis and one is not None and one.adds.size
        }
        adds = [one.adds for one in own.values()]
        if len({*map(len, adds)}) != 1:
            continue
        first, error = fits[min(own)], own[min(own)].error
        if len(own) == 1 and (first.axis_number, first.compensation) in told:
            continue  # one list alone is diagnosed better
        acted = {k: one.acted for k, one in own.items() if one.acted.any()}
        whole = [one.adds + acted.get(k, 0.0) for k, one in own.items()]
        for parts in (adds, [*whole, *acted.values()])[: 1 + bool(acted)]:
            columns = np.stack([np.ones(len(error)), *parts], axis=1)
            with contextlib.suppress(FitError):
                fitted = regress(columns, error, loss="gauss")
                rest = error - columns @ fitted.coefficients
                if np.std(rest) > LESS * predicted[axis]:
                    continue
                values = (
                    fitted.coefficients.tolist(),
                    fitted.standard_deviation.tolist(),
                )
                pairs = [*zip(*values, strict=True)]
                still = dict(zip(acted, pairs[1 + len(own) :], strict=False))
                for (k, one), (more, spread) in zip(
                    own.items(), pairs[1:], strict=False
                ):
                    new = dataclasses.replace(one, factor=(1.0 + more, spread))
                    result[k] = dataclasses.replace(new, still=still.get(k))
                break
    return result


def _turned(
    fit: AbstractResult, diagnosis: Diagnosis | None, readings: SecondMeasurement | None
) -> Diagnosis | None:
    """Return a diagnosis; a fault for none or "cannot tell" where readings show its factor."""
    told = diagnosis is not None and diagnosis.verdict != "cannot tell"
    if told or readings is None or (factor := readings.factor) is None:
        return diagnosis
    (value, deviation), identity = factor, (fit.axis_number, fit.compensation)
    old, spread = readings.still or (0.0, 0.0)
    times = min(_FACTORS, key=lambda each: abs(value - each))
    near = _NEAR * (abs(times) or 1.0)
    sure = abs(value - times) <= near and 3.0 * max(deviation, spread) <= near
    if sure and abs(old) <= _NEAR:
        verdict, words, sign = _FACTORS[times]
        if readings.still is not None:  # the one before acted as assumed
            sign = max(sign, 0)
        elif diagnosis is None and not times:
            words = "nothing has changed: the list that acted before is still the one loaded"
        return Diagnosis(*identity, verdict, value, sentence=words, sign=sign)
    if sure and times == 1.0 and abs(old - 1.0) <= _NEAR:
        words = (
            "the list that acted before still acts beside it, and is contained in it"
        )
        return Diagnosis(*identity, "twice", value, sentence=words, sign=1)
    # Readings at standstill see a temperature line as a constant.
    words = (
        f"cannot tell: what it does is {value:.2g} ± {deviation:.1g} times what it says"
    )
    return diagnosis and dataclasses.replace(diagnosis, sentence=words)


def _finished(
    result: AbstractResult, settled: Mapping[str, int | str]
) -> AbstractResult:
    """Return a result with settled rules and measured figures: as verified only where it is."""
    own, beside = (
        tuple(
            dataclasses.replace(rule, state="verified")
            if rule.name in settled and str(settled[rule.name]) == rule.value
            else rule
            for rule in rules
        )
        for rules in (result.conventions, result.rests_on)
    )
    remarks = result.unsettled(settled)
    result = dataclasses.replace(
        result, conventions=own, rests_on=beside, remarks=remarks
    )
    if result.measured is None:
        return result
    key = result.measured_as.replace(" ", "_")
    error = {**result.error, key: result.measured.figures}
    return dataclasses.replace(result, error=error)


def _diagnoses(
    job: Job, second: Second, results: Sequence[AbstractResult], root: Path
) -> tuple[dict[tuple[int, str], Diagnosis], list[Remark], tuple[Measured, ...]]:
    """Return what each list does, by axis number and compensation, and what was measured again."""
    lists = [ListFile.read(root / name) for name in second.lists]
    names = {axis.number: name for name, axis in job.spec.axes.items()}
    lines = not_judged(lists, job.conventions, names)
    if all(kind(result.compensation).unseen for result in results):
        return {}, [*map(Remark.warning, lines)], ()
    remarks = [*map(Remark.info, lines)]
    reading = dataclasses.replace(second.job.reading, conventions=job.conventions)
    try:
        driving = driving_axes(lists, job.conventions)
        outside = read_outside(job, driving), read_outside(second.job, driving)
        if all(_stayed_on(result, *outside) for result in results):
            return {}, remarks, ()  # readings tell what is added, and no switching does
        diagnoses = diagnose(lists, *outside, reading, names=names)
    except ExchangeError as error:
        words = f"What the lists do cannot be diagnosed from {second.name}: {error}"
        return {}, [*remarks, Remark.warning(words)], ()
    by_list = {(one.axis, one.compensation): one for one in diagnoses}
    return by_list, remarks, outside[1]


def _stayed_on(
    result: AbstractResult, before: Sequence[Measured], after: Sequence[Measured]
) -> bool:
    """Return whether a compensation acted in both measurements, by what their jobs state."""
    first, second = (
        [one.active for one in each if one.axis == result.axis_number]
        for each in (before, after)
    )
    name = result.compensation
    stated = bool(first) and all(name in (on or ()) for on in first)
    return stated and all(on is None or name in on for on in second)


def _other_list(
    job: Job,
    after: Job,
    root: Path,
    files: Sequence[AxisFiles],
    lists: Mapping[str, str],
) -> str | None:
    """Return why the second measurement is not about the lists of this run, or None.

    Loaded was what its job names, else what an earlier run left in the folder.
    """
    for axis_files in files:
        axis = after.spec.axes.get(axis_files.axis)
        name = axis_files.compensation_name
        if axis is None or name not in lists:
            continue
        stated = axis.listing
        path = root / name if stated is None else after.file(stated)
        if path.is_file() and _hash_of(ListFile.read(path)) != lists[name]:
            return (
                f"found {path}, which is not the {name} that {job.path.name} makes now,"
                " expected the second measurement to be made with the lists of the first"
                " job: fit without --after, load its lists and measure again"
            )
    return None


def _refuse_other_axes(job: Job, after: Job) -> None:
    """Raise where a second job calls an axis otherwise than the first, or another so."""
    numbers = {name: axis.number for name, axis in job.spec.axes.items()}
    names = {number: name for name, number in numbers.items()}
    for name, axis in after.spec.axes.items():
        first = names.get(axis.number, name)
        if (first, numbers.get(name, axis.number)) != (name, axis.number):
            raise after.error(
                ("axes", name),
                f"found axis {axis.number} as {name}, expected the names and numbers of"
                f" {job.path.name}: {', '.join(f'{k} = {v}' for k, v in numbers.items())}",
            )


def _refuse_same_readings(job: Job, after: Job) -> None:
    """Raise where a second job holds the readings of the first one."""

    def source(owner: Job, spec: MeasurementSpec) -> tuple[object, ...]:
        files = [spec.file] if spec.file is not None else spec.files or []
        hashes = [sha256(path) for path in map(owner.file, files) if path.is_file()]
        return hashes, spec.profile, spec.skip, spec.rows, spec.columns

    first = [source(job, spec) for spec in job.spec.measurements.values()]
    for name, spec in after.spec.measurements.items():
        if (own := source(after, spec)) in first and own[0]:
            raise after.error(
                ("measurements", name),
                f"found the readings of the first measurement ({job.path.name}), expected"
                " those that were taken with the lists of this run",
            )


def _hash_of(listing: ListFile) -> str:
    """Return the hash of what a list says: comments and layout do not count."""
    text = "\n".join(f"{entry.name} {entry.value}" for entry in listing.entries)
    return hashlib.sha256(text.encode()).hexdigest()


def _earlier(root: Path) -> dict[str, Any] | None:
    """Return what an earlier run into the folder says of its second measurement."""
    try:
        record = json.loads((root / "result.json").read_bytes())["second_measurement"]
        complete = {"file", "date", "inputs", "lists"} <= set(record)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return dict(record) if complete else None


def _hashes(after: Job) -> dict[str, str]:
    """Return the hashes of a second job and of its measurements, by name."""
    lists = {
        after.file(name)
        for axis in after.spec.axes.values()
        for name in axis.files.values()
    }
    # What this run writes and saves itself tells nothing of the measurement.
    if (rules := after.spec.machine.conventions) is not None:
        lists.add(after.file(rules))
    return after.hashes(without=lists)


def _settled_by(
    results: Sequence[AbstractResult],
) -> tuple[dict[str, int | str], list[Remark]]:
    """Return the rules of the controller that the diagnoses settle."""
    votes: dict[str, set[int | str]] = {}
    for result in results:
        again = result.again
        if again is None:
            continue
        diagnosis, readings = again.diagnosis, again.readings
        sign = 1 if again.shown else 0 if diagnosis is None else diagnosis.sign
        decided = {"owner", "zero"} if readings and readings.zero else {"owner"}
        # Scatter of the runs may look like a fault: the error must go the same way.
        worse = again.rms is not None and (again.rms - again.before) * sign > 0
        if sign == 0 or worse:
            continue
        for rule in result.conventions:
            if rule.decides == "sign":
                votes.setdefault(rule.name, set()).add(sign * int(rule.value))
            elif again.acts and sign > 0 and rule.decides in decided:
                value = int(rule.value) if rule.decides == "zero" else rule.value
                votes.setdefault(rule.name, set()).add(value)
    remarks = [
        Remark.warning(
            f"{name}: axes contradict each other, nothing is saved: one of the instruments"
            " counts the other way round."
        )
        for name, values in votes.items()
        if len(values) > 1
    ]
    return {n: next(iter(v)) for n, v in votes.items() if len(v) == 1}, remarks


def _save_settled(job: Job, root: Path, settled: dict[str, int | str]) -> list[Remark]:
    """Save settled rules in the machine's file; what contradicts it is taken out.

    A rule that was settled otherwise before stays: a log of the controller needs no
    instrument, and one that counts the other way round looks like a flipped sign.
    """
    named = job.spec.machine.conventions
    path = root / _CONVENTIONS if named is None else job.file(named)
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
        machine, day = job.spec.machine.id, datetime.date.today().isoformat()
        merged = stored.with_verified(settled, machine=machine, saved_at=day)
        before = path.read_text(encoding="utf-8") if path.is_file() else ""
        write_atomically(path, merged.saved_over(before))
    words = ", ".join(f"{name} = {value}" for name, value in settled.items())
    if words:
        own = job.relative(path)
        hint = "" if named else f' Name it in the job: [machine] conventions = "{own}".'
        remarks.append(Remark.info(f"Settled and saved in {path}: {words}.{hint}"))
    return remarks
