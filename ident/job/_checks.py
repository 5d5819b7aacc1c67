"""What a job must fulfil beyond the types of its keys, checked before any work."""

import difflib
from collections.abc import Iterable, Iterator

from ..exchange import ExchangeError, build_number
from ._fit_schema import (
    CrossSpec,
    FitSpec,
    LeadscrewSpec,
    LineSpec,
    PlaneSpec,
)
from ._lines import Path as KeyPath
from ._schema import JobFile

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
    close = difflib.get_close_matches(name, names, 1, cutoff=0.0)
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
            yield ("axes", name, "gantry"), _unknown(axis.gantry, job.axes, "an axis")


def _measurements(job: JobFile) -> Iterator[Fault]:
    for name, measured in job.measurements.items():
        where: KeyPath = ("measurements", name)
        if measured.files is not None:
            yield (
                (*where, "files"),
                "several files on one clock are not built in this version,"
                " expected one file",
            )
        if measured.file is None:
            yield (*where, "file"), "found nothing, expected this key"
        if measured.axis is not None and measured.axis not in job.axes:
            yield (*where, "axis"), _unknown(measured.axis, job.axes, "an axis")
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


def _fits(job: JobFile) -> Iterator[Fault]:
    seen: dict[tuple[str, str], int] = {}
    for k, fit in enumerate(job.fits):
        where: KeyPath = ("fits", k)
        yield from _references(job, fit, where)
        if not isinstance(fit, PlaneSpec | CrossSpec | LeadscrewSpec):
            yield (
                (*where, "compensation"),
                f"{fit.compensation} is not built in this version, expected plane,"
                " cross or leadscrew",
            )
            continue
        if fit.group is not None:
            yield (
                (*where, "group"),
                "fits that are identified jointly are not built in this version,"
                " expected no group",
            )
        twin = seen.setdefault((fit.compensation, fit.axis), k)
        if twin != k:
            yield (
                (*where, "axis"),
                f"found a second {fit.compensation} fit of {fit.axis} (the first is"
                f" fits[{twin}]), expected one: an axis has one table of each kind",
            )
        yield from _nodes(fit, where)
        if isinstance(fit, LeadscrewSpec):
            yield from _leadscrew(job, fit, where)
        else:
            yield from _masters(job, fit, where)


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
                f"found the modulo axis {name!r}, expected axes with two ends: a plane"
                " over a modulo axis is not built in this version",
            )
    if len(set(masters)) < len(masters):
        yield (*where, key), f"found {masters}, expected two different axes"
