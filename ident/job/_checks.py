"""What a job must fulfil beyond the types of its keys, checked before any work."""

import difflib
from collections.abc import Iterable, Iterator

from ...data.measurements import find_role
from ..exchange import ExchangeError, build_number
from ._crosstalk_faults import crosstalk_faults, named_axes
from ._fit_schema import (
    BacklashSpec,
    CrossSpec,
    CrosstalkSpec,
    FitSpec,
    FrictionSpec,
    LeadscrewSpec,
    LineSpec,
    PlaneSpec,
    TemperatureSpec,
)
from ._group_faults import group_faults
from ._lines import Path as KeyPath
from ._schema import JobFile, MeasurementSpec

Fault = tuple[KeyPath, str]
"""A key and what is wrong with it."""


def find_fault(job: JobFile) -> Fault | None:
    """Return the first thing that is wrong, or None."""
    for faults in (_controller(job), _axes(job), _measurements(job), _fits(job)):
        for fault in faults:
            return fault
    return None


def _unknown(name: str, known: Iterable[str], what: str) -> str:
    names = list(known)
    close = [known for known in names if known.casefold() == name.casefold()]
    close = close or difflib.get_close_matches(name, names, 1, cutoff=0.0)
    hint = f" (nearest: {close[0]!r})" if close else ""
    return f"found {name!r}, expected {what}: {', '.join(names) or 'none'}{hint}"


def _controller(job: JobFile) -> Iterator[Fault]:
    if job.controller.build is not None:
        try:
            build_number(job.controller.build)
        except ExchangeError as error:
            reason = f"found {error.found}, expected {error.expected}"
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
        if axis.gantry is not None and axis.gantry not in job.axes:
            yield ("axes", name, "gantry"), _unknown(axis.gantry, job.axes, "an axis")


def _measurements(job: JobFile) -> Iterator[Fault]:
    for name, measured in job.measurements.items():
        where: KeyPath = ("measurements", name)
        yield from _files(measured, where)
        if measured.axis is not None and measured.axis not in job.axes:
            yield (*where, "axis"), _unknown(measured.axis, job.axes, "an axis")
        for text in measured.columns:
            role = find_role(text)
            if role is not None and role.axis not in (None, *job.axes):
                reason = _unknown(role.axis or "", job.axes, "an axis")
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
            reason = _unknown(column.file, files or (), "one of files")
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
        if isinstance(fit, BacklashSpec):
            yield from _backlash(job, fit, where)
            continue
        if isinstance(fit, FrictionSpec):
            yield from _friction(fit, where)
            continue
        if isinstance(fit, TemperatureSpec):
            yield from _temperature(job, fit, where)
            continue
        if isinstance(fit, CrosstalkSpec):
            yield from _crosstalk(job, fit, where)
            continue
        if not isinstance(fit, PlaneSpec | CrossSpec | LeadscrewSpec):
            yield (
                (*where, "compensation"),
                f"{fit.compensation} is not built in this version, expected plane,"
                " cross, leadscrew, temperature, friction, backlash or crosstalk",
            )
            continue
        yield from _nodes(fit, where)
        if isinstance(fit, LeadscrewSpec):
            yield from _leadscrew(job, fit, where)
        else:
            yield from _masters(job, fit, where)
    yield from group_faults(job)


_OF_TABLES = ("smoothness", "max_points", "n_cycles", "manual_activation")


def _without(fit: FitSpec, keys: Iterable[str], where: KeyPath) -> Iterator[Fault]:
    for key in keys:
        if key in fit.model_fields_set:
            reason = f"{fit.compensation} has no such entry, expected it for tables"
            yield (*where, key), reason


def _friction(fit: FrictionSpec, where: KeyPath) -> Iterator[Fault]:
    yield from _without(fit, ("smoothness", "n_cycles", "manual_activation"), where)
    if fit.rated_current is not None and fit.rated_torque is not None:
        reason = "found beside rated_current, expected the one that suits the recording"
        yield (*where, "rated_torque"), reason
    if fit.method != "output_error":
        for key in ("solver", "constraints"):
            if key in fit.model_fields_set:
                reason = f"found with method {fit.method!r}, expected 'output_error'"
                yield (*where, key), reason
    if fit.constraints and fit.solver != "ipopt":
        reason = f"found with solver {fit.solver!r}, expected 'ipopt', which keeps them"
        yield (*where, "constraints"), reason


def _backlash(job: JobFile, fit: BacklashSpec, where: KeyPath) -> Iterator[Fault]:
    yield from _without(fit, _OF_TABLES, where)
    for k, other in enumerate(job.fits):
        if isinstance(other, LeadscrewSpec) and other.bilateral:
            if other.axis == fit.axis:
                reason = (
                    f"found backlash beside the bilateral leadscrew of fits[{k}], both"
                    " of which compensate the reversal, expected one of them"
                )
                yield (*where, "compensation"), reason


def _temperature(job: JobFile, fit: TemperatureSpec, where: KeyPath) -> Iterator[Fault]:
    yield from _without(fit, ("smoothness", "max_points"), where)
    axis = job.axes.get(fit.axis)
    if axis is not None and axis.kind != "linear":
        yield (
            (*where, "axis"),
            f"found the {axis.kind} axis {fit.axis}, expected a linear one: the unit of"
            " the coefficient is not defined for others",
        )
    if fit.n_cycles is not None and fit.n_cycles > 19:
        # P-AXIS-00275 must stay below 20 in one place of the manual (S-44).
        yield (*where, "n_cycles"), f"found {fit.n_cycles}, expected at most 19"
    if fit.sensor is not None and fit.sensors is not None:
        yield (*where, "sensors"), "found beside sensor, expected one of them"
    if fit.law is not None:
        expected = ["offset", "coefficient"] if fit.sensors is None else fit.sensors
        if set(fit.law) != set(expected):
            found = ", ".join(fit.law) or "nothing"
            reason = f"found {found}, expected a law for {' and '.join(expected)}"
            yield (*where, "law"), reason
    for name in fit.sources:
        measured = job.measurements.get(name)
        if measured is None:
            continue
        if measured.expansion is not None or measured.already_compensated:
            key = "expansion" if measured.expansion is not None else None
            yield (
                ("measurements", name, key or "already_compensated"),
                f"found lengths referred to {measured.reference_temperature:g} °C, from"
                " which the growth of the axis is gone that a temperature fit looks for,"
                " expected them as measured",
            )
        if "temperature" in measured.active:
            yield (
                ("measurements", name, "active"),
                "found temperature active while measuring: what it added is known to"
                " the PLC alone, expected a measurement with COMP OFF TEMP",
            )


def _crosstalk(job: JobFile, fit: CrosstalkSpec, where: KeyPath) -> Iterator[Fault]:
    yield from _without(fit, ("smoothness",), where)
    for key, name in named_axes(fit):
        if name not in job.axes:
            yield (*where, key), _unknown(name, job.axes, "an axis")
    yield from crosstalk_faults(job, fit, where)


def _references(job: JobFile, fit: FitSpec, where: KeyPath) -> Iterator[Fault]:
    if fit.axis not in job.axes:
        yield (*where, "axis"), _unknown(fit.axis, job.axes, "an axis")
    if (fit.measurement is None) == (fit.measurements is None):
        found = "nothing" if fit.measurement is None else "both"
        reason = f"found {found}, expected measurement or measurements"
        yield (*where, "measurement"), reason
    key = "measurement" if fit.measurement is not None else "measurements"
    for name in fit.sources:
        if name not in job.measurements:
            reason = _unknown(name, job.measurements, "a measurement")
            yield (*where, key), reason
    if len(set(fit.sources)) < len(fit.sources):
        yield (*where, key), f"found {list(fit.sources)}, expected each once"


def _nodes(fit: PlaneSpec | LineSpec, where: KeyPath) -> Iterator[Fault]:
    grid = {"start": fit.start, "interval": fit.interval, "points": fit.points}
    given = [key for key, value in grid.items() if value is not None]
    missing = [key for key in grid if key not in given]
    single = isinstance(fit, LineSpec) and fit.setpoints is not None
    if single and given:
        reason = "found beside setpoints, expected one way to give the nodes"
        yield (*where, given[0]), reason
    if given and missing:
        yield (*where, missing[0]), f"found nothing, expected it beside {given[0]}"


def _leadscrew(job: JobFile, fit: LeadscrewSpec, where: KeyPath) -> Iterator[Fault]:
    if fit.n_cycles is not None:
        yield (
            (*where, "n_cycles"),
            "a leadscrew list has no such entry, expected it for cross and plane",
        )
    axis = job.axes.get(fit.axis)
    if fit.modulo and axis is not None and axis.kind == "linear" and not axis.modulo:
        yield (
            (*where, "modulo"),
            f"found axis {fit.axis} of type linear without modulo, expected a rotary"
            " axis or its modulo range",
        )


def _masters(
    job: JobFile, fit: PlaneSpec | CrossSpec, where: KeyPath
) -> Iterator[Fault]:
    key = "masters" if isinstance(fit, PlaneSpec) else "master"
    masters = fit.masters if isinstance(fit, PlaneSpec) else [fit.master]
    for name in masters:
        if name not in job.axes:
            yield (*where, key), _unknown(name, job.axes, "an axis")
        elif name == fit.axis:
            reason = f"found {name!r}, the compensated axis itself, expected another"
            yield (*where, key), reason
        elif isinstance(fit, PlaneSpec) and job.axes[name].modulo is not None:
            yield (
                (*where, key),
                f"found the modulo axis {name!r}, expected axes with two ends: over an"
                " axis that goes round both edges of a plane must be equal (S-20), and"
                " planes are fitted without that. A cross table over"
                f" {name} goes round; a plane can, where {name} never passes its"
                " transition and is stated without modulo",
            )
    if len(set(masters)) < len(masters):
        yield (*where, key), f"found {masters}, expected two different axes"
