"""A TwinCAT Scope configuration (``.tcscopex``) that records what shows the compensations.

One acquisition per object, and one trace that draws it; the two belong together by the
identifier of the acquisition. Identifiers follow from the names, so that the same machine gives
the same file.
"""

import functools
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

from ...data.measurements import GEO_PORT, INDEX_GROUP
from ._objects import Observable

_ASSEMBLY = "TwinCAT.Measurement.Scope.API.Model"
_TYPES = {"BOOLEAN": "BIT", "SGN32": "INT32", "REAL64": "REAL64"}
"""Scope's names of the types of the kernel."""
_TICKS = 10_000_000
"""Ticks of 100 ns per second."""
_COLORS = (-16776961, -65536, -16744448, -23296, -8388480, -16711681, -65281)
_ALL_BITS = str(2**64 - 1)
_LOCAL = "127.0.0.1.1.1"
_RECORD_TIME = 600.0
"""Seconds that a recording takes at most."""


# Machines of a fleet have the same axes, and writing it takes a tenth of a short job.
@functools.lru_cache(maxsize=16)
def scope_configuration(
    rows: tuple[Observable, ...],
    *,
    cycle_time: float | None = None,
    net_id: str = _LOCAL,
) -> bytes:
    """Return the configuration: UTF-8 with a byte order mark and CRLF, as Scope writes it.

    What has no address, or no certain type, stands there disabled, to be completed in Scope.

    Args:
        rows: Of `observables`.
        cycle_time: Time between samples in s; None: that of the task.
        net_id: AMS net id of the controller.
    """
    recorded = [row for row in rows if row.channel is not None]
    acquisitions = [_acquisition(row, cycle_time, net_id) for row in recorded]
    groups: dict[str, list[Observable]] = {}
    for row in recorded:
        groups.setdefault(_group(row), []).append(row)
    chart = _member("YTChart", "Compensations", [
        *(_axis_group(title, own) for title, own in groups.items()),
        _member("ChartStyle", "Chart Style", [], {"StackedAxes": "true"}),
    ])  # fmt: skip
    project = _member(
        "ScopeProject", "Compensations",
        [_member("DataPool", "DataPool", acquisitions), chart],
        {
            "Version": "1.0.0.0", "StopMode": "AutoStop", "MainServer": net_id,
            "RecordTime": str(round(_RECORD_TIME * _TICKS)),
        },
    )  # fmt: skip
    ET.indent(project)
    text = ET.tostring(project, encoding="unicode", short_empty_elements=True)
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return f"{head}{text}\n".replace("\n", "\r\n").encode("utf-8-sig")


def _group(row: Observable) -> str:
    """Return the band in which a trace is drawn: offsets and states of an axis, positions."""
    if not row.compensation:
        return "Positions"
    where = "Controller" if row.axis is None else f"A{row.axis}"
    return f"{where} states" if row.type == "BOOLEAN" else f"{where} values"


def _acquisition(row: Observable, cycle_time: float | None, net_id: str) -> ET.Element:
    scope_type, address = _TYPES.get(row.type), row.index_offset
    return _member(
        "AdsAcquisition", _channel(row), [],
        {
            "Enabled": _flag(address is not None and scope_type is not None),
            "AmsNetId": net_id,
            "TargetPort": str(GEO_PORT),
            "SymbolBased": "false",
            "SymbolName": row.name,
            "IndexGroup": str(0 if address is None else INDEX_GROUP),
            "IndexOffset": str(address or 0),
            "DataType": scope_type or "REAL64",
            "VariableSize": str(row.bytes or 8),
            "UseTaskSampleTime": _flag(cycle_time is None),
            "BaseSampleTime": str(round((cycle_time or 1e-3) * _TICKS)),
            "UseLocalServer": "true",
            "ArrayLength": "0",
            "Comment": row.note or row.meaning,
        },
    )  # fmt: skip


def _axis_group(title: str, rows: Sequence[Observable]) -> ET.Element:
    axes = [
        _member("TimeAxis", "Time Axis", [], {"Orientation": "X"}, title),
        _member("ValueAxis", "Value Axis", [], {"Orientation": "Y"}, title),
    ]
    traces = [_trace(row, color) for color, row in enumerate(rows)]
    return _member("AxisGroup", title, axes + traces, {"Enabled": "true"})


def _trace(row: Observable, color: int) -> ET.Element:
    name = _channel(row)
    link = _member(
        "AcquisitionInterpreter", f"Y: {name}", [],
        {
            "AcquisitionGUID": _guid("AdsAcquisition", name),
            "Usage": "Y", "Offset": "0", "ScaleFactor": "1", "BitMask": _ALL_BITS,
        },
    )  # fmt: skip
    style = _member("ChannelStyle", f"Style of {name}", [], {"Visible": "true"})
    shown = {"Enabled": "true", "DisplayColor": str(_COLORS[color % len(_COLORS)])}
    return _member("Channel", name, [link, style], shown)


def _member(
    tag: str,
    name: str,
    members: Sequence[ET.Element],
    fields: Mapping[str, str] | None = None,
    owner: str = "",
) -> ET.Element:
    """Return a node of Scope's model with what every one has."""
    node = ET.Element(tag, AssemblyName=_ASSEMBLY)
    own = {
        "Guid": _guid(tag, owner + name), "Title": name, "Name": name, "Comment": "",
        "DisplayColor": "Black", "SortPriority": "100",
    }  # fmt: skip
    for key, value in (own | dict(fields or {})).items():
        ET.SubElement(node, key).text = value
    ET.SubElement(node, "SubMember").extend(members)
    return node


def _guid(tag: str, name: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, f"axcomp/{tag}/{name}"))


def _flag(value: bool) -> str:
    return "true" if value else "false"


def _channel(row: Observable) -> str:
    assert row.channel is not None
    return row.channel
