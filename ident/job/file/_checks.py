"""What a job must fulfil beyond the types of its keys, checked before any work."""

import itertools
from collections.abc import Iterator

from ....data.lists import BuildError, parse_build
from ....data.measurements import find_role
from ...kinds._keys import Fault, FitSpec, KeyPath, unknown
from ...readings import IN_SHOP, SHOP
from ._schema import ColumnOfRun, JobFile, MeasurementSpec

_SHRINKS, _GROWS, _LEAST_GROWTH, _PER_KELVIN = -2.0, 100.0, 0.05, 1e-3
"""µm/m per K of carbon fibre and of plastics; below which a scale of glass ceramics may as well
have none; and of what was stated in 1/K."""


def find_fault(job: JobFile) -> Fault | None:
    """Return the first thing that is wrong, or None."""
    parts = _controller(job), _axes(job), _measurements(job), _fits(job)
    return next(itertools.chain(*parts), None)


def _controller(job: JobFile) -> Iterator[Fault]:
    try:
        if job.controller.build is not None:
            parse_build(job.controller.build)
    except BuildError as error:
        reason = f"found {error.build!r}, expected a build such as V3.1.3108.4"
        yield ("controller", "build"), reason


def _axes(job: JobFile) -> Iterator[Fault]:
    owners: dict[int, str] = {}
    words: dict[tuple[int, str], str] = {}
    for name, axis in job.axes.items():
        word = (axis.channel, job.nc_word(name).upper())
        if word in words:
            yield (
                ("axes", name, "nc_name"),
                f"found {word[1]!r}, the word of axis {words[word]!r} in channel {word[0]},"
                " expected a word of its own, or another channel",
            )
        words[word] = name
        if axis.number in owners:
            yield (
                ("axes", name, "number"),
                f"found {axis.number}, which axis {owners[axis.number]!r} has already,"
                " expected a number of its own",
            )
        owners[axis.number] = name
        for key, span in (("limits", axis.limits), ("modulo", axis.modulo)):
            if span is not None and not span[0] < span[1]:
                reason = f"found {span}, expected the smaller value first"
                yield ("axes", name, key), reason
        others = [other for other in job.axes if other != name]
        if axis.gantry is not None and axis.gantry not in others:
            reason = unknown(axis.gantry, others, "another axis")
            yield ("axes", name, "gantry"), reason


def _measurements(job: JobFile) -> Iterator[Fault]:
    for name, measured in job.measurements.items():
        where: KeyPath = ("measurements", name)
        yield from _files(measured, where)
        if measured.axis is not None and measured.axis not in job.axes:
            yield (*where, "axis"), unknown(measured.axis, job.axes, "an axis")
        for text in measured.columns:
            role = find_role(text)
            if role is not None and role.axis not in (None, *job.axes):
                reason = unknown(role.axis or "", job.axes, "an axis")
                yield (*where, "columns", text), reason
        yield from _lengths(measured, where)


def _lengths(measured: MeasurementSpec, where: KeyPath) -> Iterator[Fault]:
    """Yield what is wrong with what refers lengths to the reference temperature."""
    expansion, warmth = measured.expansion, measured.material_temperature
    if expansion is None:
        if warmth is not None:
            yield (
                (*where, "material_temperature"),
                "found no expansion, expected it in µm/m/K beside the temperature",
            )
        return
    size = abs(expansion)
    if not _SHRINKS <= expansion <= _GROWS or 0.0 < size < _LEAST_GROWTH:
        per_kelvin = " (times 1e6 where it was 1/K)" if size < _PER_KELVIN else ""
        yield (
            (*where, "expansion"),
            f"found {expansion:g}, which no material has, expected µm/m per K{per_kelvin}: steel"
            " 11.5, aluminium 23, 0 for what does not grow",
        )
    if warmth is None and not measured.already_compensated:
        yield (
            (*where, "expansion"),
            "found no material_temperature, expected it in °C or as a role"
            " temperature.<sensor>",
        )
    stated = {"reference_temperature": measured.reference_temperature}
    if warmth is not None and not isinstance(warmth, str):
        stated = {"material_temperature": float(warmth)} | stated
    for key, degrees in stated.items():
        if not SHOP[0] <= degrees <= SHOP[1]:
            yield (*where, key), f"found {degrees:g} °C, {IN_SHOP}"


def _files(measured: MeasurementSpec, where: KeyPath) -> Iterator[Fault]:
    files, offsets = measured.files, measured.offsets
    if files is None:
        if measured.file is None:
            yield (*where, "file"), "found nothing, expected this key"
        if offsets is not None:
            reason = "found without files, expected it beside several files"
            yield (*where, "offsets"), reason
    else:
        if measured.file is not None:
            yield (*where, "files"), "found beside file, expected one of them"
        if len(set(files)) < len(files):
            yield (*where, "files"), f"found {files}, expected each once"
        if measured.profile is not None:
            reason = "found beside files, expected a single file"
            yield (*where, "profile"), reason
        if offsets is not None and len(offsets) != len(files) - 1:
            reason = (
                f"found {len(offsets)} for {len(files)} files, expected one for each"
            )
            yield (*where, "offsets"), f"{reason} file after the first"
    if measured.rows is not None and measured.rows[0] > measured.rows[1]:
        yield (*where, "rows"), f"found {list(measured.rows)}, expected first ≤ last"
    for role, column in measured.columns.items():
        key = (*where, "columns", role)
        if isinstance(column, str):
            continue
        if isinstance(column, list):
            yield from _columns_of_runs(column, files, key)
            continue
        if (column.column is None) == (column.value is None):
            stated = "both" if column.column is not None else "neither"
            yield key, f"found {stated}, expected one of column and value"
        if column.interval and column.value is None:
            yield key, "found interval, expected value beside it, of the first row"
        if column.value is not None and files is not None:
            yield key, "found a value beside several files, expected a column"
        if column.file is not None and column.file not in (files or ()):
            yield (*key, "file"), unknown(column.file, files or (), "one of files")


def _columns_of_runs(
    columns: list[ColumnOfRun], files: list[str] | None, where: KeyPath
) -> Iterator[Fault]:
    """Yield what is wrong with the columns of a role in a wide table."""
    if files is not None:
        yield where, "found columns per run beside several files, expected one file"
    for name in ("run", "direction"):
        stated = sum(getattr(column, name) is not None for column in columns)
        if 0 < stated < len(columns):
            reason = f"found {name} in {stated} of {len(columns)} columns"
            yield where, f"{reason}, expected it in all of them or in none"


def _fits(job: JobFile) -> Iterator[Fault]:
    first: dict[tuple[str, str], int] = {}
    for k, fit in enumerate(job.fits):
        where: KeyPath = ("fits", k)
        yield from _references(job, fit, where)
        earlier = first.setdefault((fit.compensation, fit.axis), k)
        if earlier != k:
            yield (
                (*where, "axis"),
                f"found a second {fit.compensation} fit of {fit.axis} (the first is"
                f" fits[{earlier}]), expected one: an axis has one of each kind",
            )
        for key in fit.lacking:
            if key in fit.model_fields_set:
                reason = f"{fit.compensation} has no such entry, expected none"
                yield (*where, key), reason
        yield from fit.faults(job, where)
    yield from _groups(job)


def _references(job: JobFile, fit: FitSpec, where: KeyPath) -> Iterator[Fault]:
    if fit.axis not in job.axes:
        yield (*where, "axis"), unknown(fit.axis, job.axes, "an axis")
    if (fit.measurement is None) == (fit.measurements is None):
        stated = "nothing" if fit.measurement is None else "both"
        reason = f"found {stated}, expected measurement or measurements"
        yield (*where, "measurement"), reason
    key = "measurement" if fit.measurement is not None else "measurements"
    for name in fit.sources:
        if name not in job.measurements:
            reason = unknown(name, job.measurements, "a measurement")
            yield (*where, key), reason
    if len(set(fit.sources)) < len(fit.sources):
        yield (*where, key), f"found {list(fit.sources)}, expected each once"


def _groups(job: JobFile) -> Iterator[Fault]:
    """Yield what is wrong, each with its key."""
    for k, fit in enumerate(job.fits):
        if fit.group is not None and fit.kind.adds_current:
            yield (
                ("fits", k, "group"),
                f"found {fit.compensation} in group {fit.group!r}: it works on the current of the"
                " drive and not on the position, expected no group",
            )
    together = {name for k in job.grouped for name in job.fits[k].sources}
    for name, measured in job.measurements.items():
        if measured.drift and job.fits and name not in together:
            yield (
                ("measurements", name, "drift"),
                "found for a measurement of no group, expected it where fits name a group",
            )
    for name, members in job.groups.items():
        yield from _unlike(job, name, members)
        yield from _beside(job, name, members)


def _unlike(job: JobFile, name: str, members: tuple[int, ...]) -> Iterator[Fault]:
    first = job.fits[members[0]]
    for key in ("loss", "smoothness"):
        able = [k for k in members if key not in job.fits[k].lacking]
        for k in able[1:]:
            mine, theirs = getattr(job.fits[k], key), getattr(job.fits[able[0]], key)
            if mine != theirs:
                yield (
                    ("fits", k, key),
                    f"found {mine!r} in group {name!r}, of which fits[{able[0]}] has"
                    f" {theirs!r}, expected one for all: they are one fit",
                )
    for k in members[1:]:
        fit, where = job.fits[k], ("fits", k)
        if set(fit.sources) != set(first.sources):
            yield (
                (*where, "measurement"),
                f"found {', '.join(fit.sources)} in group {name!r}, whose first fit"
                f" (fits[{members[0]}]) has {', '.join(first.sources)}, expected the"
                " same measurements for all",
            )
    for source in first.sources:
        measured = job.measurements.get(source)
        if measured is not None and measured.datum is not None:
            yield (
                ("measurements", source, "datum"),
                f"found for group {name!r}, of which no single effect is zero there,"
                ' expected remove = "offset" or nothing',
            )


def _beside(job: JobFile, name: str, members: tuple[int, ...]) -> Iterator[Fault]:
    axes = {job.fits[k].axis for k in members}
    sources = set(job.fits[members[0]].sources)
    for k, fit in enumerate(job.fits):
        if k in members or fit.kind.adds_current or fit.axis not in axes:
            continue
        if shared := sources & set(fit.sources):
            yield (
                ("fits", k, "measurement"),
                f"found {', '.join(sorted(shared))}, from which group {name!r} explains"
                f" the whole error of {fit.axis}, expected this fit in the group as"
                " well, or a measurement of its own",
            )
