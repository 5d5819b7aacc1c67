"""What a job must fulfil beyond the types of its keys, checked before any work."""

from collections.abc import Iterator

from ...data.measurements import find_role
from ..exchange import ExchangeError, build_number
from ..kinds._keys import Fault, FitSpec, KeyPath, unknown
from ._group_faults import group_faults
from ._schema import JobFile, MeasurementSpec


def find_fault(job: JobFile) -> Fault | None:
    """Return the first thing that is wrong, or None."""
    for faults in (_controller(job), _axes(job), _measurements(job), _fits(job)):
        for fault in faults:
            return fault
    return None


def _controller(job: JobFile) -> Iterator[Fault]:
    if job.controller.build is not None:
        try:
            build_number(job.controller.build)
        except ExchangeError as error:
            reason = f"found {error.found}, expected {error.expected}"
            yield ("controller", "build"), reason


def _axes(job: JobFile) -> Iterator[Fault]:
    owners: dict[int, str] = {}
    for name, axis in job.axes.items():
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
        if axis.gantry is not None and axis.gantry not in job.axes:
            yield ("axes", name, "gantry"), unknown(axis.gantry, job.axes, "an axis")


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
        if measured.expansion is None and measured.material_temperature is not None:
            yield (
                (*where, "material_temperature"),
                "found no expansion, expected it in µm/m/K beside the temperature",
            )
        if (
            measured.expansion is not None
            and measured.material_temperature is None
            and not measured.already_compensated
        ):
            yield (
                (*where, "expansion"),
                "found no material_temperature, expected it in °C or as a role"
                " temperature.<sensor>",
            )


def _files(measured: MeasurementSpec, where: KeyPath) -> Iterator[Fault]:
    files = measured.files
    if files is None:
        if measured.file is None:
            yield (*where, "file"), "found nothing, expected this key"
        if measured.offsets is not None:
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
        offsets = measured.offsets
        if offsets is not None and len(offsets) != len(files) - 1:
            yield (
                (*where, "offsets"),
                f"found {len(offsets)} for {len(files)} files, expected one for each"
                " file after the first",
            )
    for role, column in measured.columns.items():
        if isinstance(column, str) or column.file is None:
            continue
        if column.file not in (files or ()):
            reason = unknown(column.file, files or (), "one of files")
            yield (*where, "columns", role, "file"), reason


def _fits(job: JobFile) -> Iterator[Fault]:
    seen: dict[tuple[str, str], int] = {}
    for k, fit in enumerate(job.fits):
        where: KeyPath = ("fits", k)
        yield from _references(job, fit, where)
        twin = seen.setdefault((fit.compensation, fit.axis), k)
        if twin != k:
            yield (
                (*where, "axis"),
                f"found a second {fit.compensation} fit of {fit.axis} (the first is"
                f" fits[{twin}]), expected one: an axis has one of each kind",
            )
        for key in fit.lacking:
            if key in fit.model_fields_set:
                reason = f"{fit.compensation} has no such entry, expected it for tables"
                yield (*where, key), reason
        yield from fit.faults(job, where)
    yield from group_faults(job)


def _references(job: JobFile, fit: FitSpec, where: KeyPath) -> Iterator[Fault]:
    if fit.axis not in job.axes:
        yield (*where, "axis"), unknown(fit.axis, job.axes, "an axis")
    if (fit.measurement is None) == (fit.measurements is None):
        found = "nothing" if fit.measurement is None else "both"
        reason = f"found {found}, expected measurement or measurements"
        yield (*where, "measurement"), reason
    key = "measurement" if fit.measurement is not None else "measurements"
    for name in fit.sources:
        if name not in job.measurements:
            reason = unknown(name, job.measurements, "a measurement")
            yield (*where, key), reason
    if len(set(fit.sources)) < len(fit.sources):
        yield (*where, key), f"found {list(fit.sources)}, expected each once"
