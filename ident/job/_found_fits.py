"""A job with the fits that were found: the old text, its ``[[fits]]`` replaced."""

import re
import tomllib
from collections.abc import Mapping

import numpy as np

from ..discover import Discovery, Found
from ._found_nodes import grid_over
from ._load import Job
from ._observe import Observation

_HEADER = re.compile(r"^\s*\[\[?\s*([^\]]+?)\s*\]")
_FITS = re.compile(r"fits(\s*\.|\s*$)")


def job_with_fits(job: Job, observation: Observation, found: Discovery) -> str:
    """Return the text of a job that fits what was found.

    All but the fits stays as it is, byte for byte; only a datum gives way to
    ``remove = "offset"`` where fits are identified together, since none of them alone is
    zero there, and what the measurements showed of their instrument is stated where the
    job says nothing of it (`found_keys`).

    Args:
        job: In which was looked.
        observation: Its measurements.
        found: What they ask for.
    """
    text = _without_fits(job.path.read_text(encoding="utf-8"))
    blocks: list[str] = []
    together: set[str] = set()
    for one in found.found:
        sources = _sources(observation, found, one)
        if not sources:
            continue
        if one.group is not None:
            together.update(sources)
        blocks.append(_block(job, observation, one, sources))
    for name in sorted(together):
        text = _without_datum(text, job, name)
    for name, keys in found_keys(job, observation, found).items():
        text = _with_keys(text, name, keys)
    return "\n\n".join([text.rstrip(), *blocks]) + "\n"


def found_keys(
    job: Job, observation: Observation, found: Discovery
) -> dict[str, dict[str, object]]:
    """Return what to state of each measurement: its drift, and an arbitrary zero.

    What the job states stays.

    Args:
        job: In which was looked.
        observation: Its measurements.
        found: What they ask for.
    """
    result: dict[str, dict[str, object]] = {}
    for number, name in enumerate(observation.names):
        spec, keys = job.spec.measurements[name], dict[str, object]()
        axes = {
            one.axis
            for one in found.found
            if one.group is not None and name in _sources(observation, found, one)
        }
        pieces = [
            each.pieces
            for each in found.drifts
            if each.source == number and each.axis in axes
        ]
        if pieces and "drift" not in spec.model_fields_set:
            keys["drift"] = max(pieces)
        if axes and name in observation.unzeroed:
            if not {"remove", "datum"} & spec.model_fields_set:
                keys["remove"] = "offset"
        if keys:
            result[name] = keys
    return result


def _with_keys(text: str, name: str, keys: Mapping[str, object]) -> str:
    """Return a job with keys of a measurement, behind its header."""
    result, wanted = [], dict(keys)
    for line in text.splitlines(keepends=True):
        result.append(line)
        header = _HEADER.match(line)
        if header is not None and _plain(header[1]) == f"measurements.{name}":
            result += [f"{key} = {_value(value)}\n" for key, value in wanted.items()]
            wanted = {}
    return "".join(result)


def _plain(header: str) -> str:
    return re.sub(r"[\"'\s]", "", header)


def unsaid_keys(text: str, name: str, keys: Mapping[str, object]) -> dict[str, object]:
    """Return those of the keys of a measurement that the text of a job does not have."""
    spec = tomllib.loads(text).get("measurements", {}).get(name, {})
    return {key: value for key, value in keys.items() if spec.get(key) != value}


def _without_fits(text: str) -> str:
    kept, inside = [], False
    for line in text.splitlines(keepends=True):
        header = _HEADER.match(line)
        if header is not None:
            inside = _FITS.match(header[1]) is not None
        if not inside:
            kept.append(line)
    return "".join(kept)


def _without_datum(text: str, job: Job, name: str) -> str:
    if job.spec.measurements[name].datum is None:
        return text
    result, mine = [], False
    for line in text.splitlines(keepends=True):
        header = _HEADER.match(line)
        if header is not None:
            mine = header[1].replace('"', "") == f"measurements.{name}"
        if mine and re.match(r"\s*datum\s*=.*\}\s*(#.*)?$", line):
            line = 'remove = "offset"\n'
        result.append(line)
    return "".join(result)


def _sources(observation: Observation, found: Discovery, one: Found) -> tuple[str, ...]:
    """Return the measurements that hold all that a fit, or its group, needs."""
    data = observation.data
    if one.compensation == "friction":
        known = np.isfinite(data.current[one.axis])
        counts = np.bincount(data.source[known], minlength=len(observation.names))
        return (observation.names[int(np.argmax(counts))],)
    own = [one]
    if one.group is not None:
        own = [each for each in found.found if each.group == one.group]
    known = np.isfinite(data.error[one.axis])
    for each in own:
        axes = {*each.masters, each.axis} & set(data.position)
        for axis in axes:
            known = known & np.isfinite(data.position[axis])
        for sensor in _sensors(each):
            known = known & np.isfinite(data.temperature[sensor])
    return tuple(
        name
        for number, name in enumerate(observation.names)
        if known[data.source == number].any()
    )


def _sensors(one: Found) -> tuple[str, ...]:
    sensors = one.keys.get("sensors")
    if isinstance(sensors, dict):
        return tuple(dict.fromkeys(map(str, sensors.values())))
    return () if one.sensor is None else (one.sensor,)


def _block(
    job: Job, observation: Observation, one: Found, sources: tuple[str, ...]
) -> str:
    lines = ["[[fits]]", f"compensation = {_text(one.compensation)}"]
    lines.append(f"axis = {_text(one.axis)}")
    if len(sources) == 1:
        lines.append(f"measurement = {_text(sources[0])}")
    else:
        lines.append(f"measurements = {_value(list(sources))}")
    lines += [f"{key} = {_value(value)}" for key, value in one.keys.items()]
    lines += _nodes(job, observation, one, sources)
    if one.group is not None:
        lines.append(f"group = {_text(one.group)}")
    return "\n".join(lines)


def _nodes(
    job: Job, observation: Observation, one: Found, sources: tuple[str, ...]
) -> list[str]:
    over = {
        "leadscrew": (one.axis,),
        "cross": one.masters,
        "plane": one.masters,
    }.get(one.compensation)
    if over is None:
        return []
    data = observation.data
    rows = np.isin(data.source, [observation.names.index(name) for name in sources])
    rows &= np.isfinite(data.error[one.axis])
    grids = []
    for axis in over:
        spec = job.spec.axes[axis]
        places = data.position[axis][rows]
        if spec.modulo is not None:
            low, high = spec.modulo
            grids.append((low, (high - low) / 72.0, 73))
            continue
        # What a cross table does beyond its ends is not documented (S-12).
        reach = None
        if one.compensation == "cross" and spec.limits is not None:
            reach = (spec.limits[0], spec.limits[1])
        grids.append(grid_over(places, reach, surface=one.compensation == "plane"))
    start, interval, points = (list(each) for each in zip(*grids, strict=True))
    single = len(grids) == 1
    lines = [
        f"start = {_value(start[0] if single else start)}",
        f"interval = {_value(interval[0] if single else interval)}",
        f"points = {_value(points[0] if single else points)}",
    ]
    if one.compensation == "leadscrew" and job.spec.axes[one.axis].modulo is not None:
        lines.append("modulo = true")
    return lines


def _value(value: object) -> str:
    """Return a value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        inside = ", ".join(f"{key} = {_value(each)}" for key, each in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return _text(value) if isinstance(value, str) else repr(value)


def _text(text: str) -> str:
    inside = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{inside}"'
