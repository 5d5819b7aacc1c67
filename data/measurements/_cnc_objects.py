"""Objects of the CNC that ADS reads: what the manuals say of each, as data.

All belong to the GEO task. Their index offset begins with the number of the axis: 0x30035 is 0x35
of axis 3 ([001] p. 19). Units stand as printed; ``Incr.`` are encoder increments.
"""

import dataclasses
from typing import Literal, final

GEO_PORT = 551
"""ADS port of the GEO task."""
INDEX_GROUP = 0x120300
"""Index group of all of its objects."""
_AXIS = 0x10000

ObjectType = Literal["BOOLEAN", "SGN32", "SGN32/SGN64", "REAL64"]
_BYTES: dict[ObjectType, int | None] = {
    "BOOLEAN": 1,
    "SGN32": 4,
    "SGN32/SGN64": None,
    "REAL64": 8,
}


@final
@dataclasses.dataclass(frozen=True)
class CncObject:
    """One object as a manual describes it.

    Attributes:
        compensation: As in a job: ``cross``; ``external`` for that of a TcCOM module.
        name: As the manual prints it.
        offset: Of its index, without the number of the axis.
        type: Of its value.
        unit: As printed; empty where none is.
        meaning: What it holds.
        source: Manual and page.
        reports: What it tells a log of the offset: after the filters over cycles, or before
            them; None: not an offset.
        tells_state: Whether it tells that the compensation acts in this cycle.
        writable: Whether it can be written as well.
        of_axis: Whether each axis has its own.
    """

    compensation: str
    name: str
    offset: int
    type: ObjectType
    unit: str
    meaning: str
    source: str
    reports: Literal["filtered", "unfiltered"] | None = None
    tells_state: bool = False
    writable: bool = False
    of_axis: bool = True

    @property
    def size(self) -> int | None:
        """Bytes of its value; None where the manual leaves the type open."""
        return _BYTES[self.type]

    def index_offset(self, axis: int) -> int:
        """Return the index offset for an axis by its number, from 1."""
        return self.offset + (axis * _AXIS if self.of_axis else 0)


def _objects(
    compensation: str, source: str, *rows: tuple[str, int, ObjectType, str, str]
) -> tuple[CncObject, ...]:
    return tuple(CncObject(compensation, *row, source) for row in rows)


def _marked() -> tuple[CncObject, ...]:
    """Return all objects, with what they report and whether they can be written."""
    return tuple(
        dataclasses.replace(
            entry,
            reports=_REPORTS.get(entry.name),
            tells_state=entry.name in _STATES,
            writable=entry.name in _WRITABLE,
            of_axis=entry.name not in _OF_PLATFORM,
        )
        for entry in _DESCRIBED
    )


_ACTS = "it acts: homed, and all that it needs is enabled"
_SWITCHED = "the axis list switches it on"
_CHANGE = "change of the offset in this cycle"

_DESCRIBED = (
    *_objects(
        "backlash", "[001] p.11-12",
        ("BC::actual backlash", 0x93, "SGN32", "", "offset that acts"),
        ("BC::sum backlash", 0x94, "SGN32", "", "offset at this position, without filter"),
        ("BC::delta backlash", 0x95, "SGN32", "", _CHANGE),
        ("BC::conf. backlash", 0xAF, "SGN32", "Incr.", "size of the backlash (P-AXIS-00103)"),
    ),
    *_objects(
        "temperature", "[001] p.21-23",
        ("TEMPC::activated", 0x41, "BOOLEAN", "", f"{_SWITCHED}; may be written"),
        ("TEMPC::f_is_active", 0x1D8, "BOOLEAN", "", _ACTS),
        ("TEMPC::actual_offset", 0x42, "SGN32", "Incr.", "offset that acts"),
        ("TEMPC::coefficient", 0x43, "REAL64", "µm/m", "slope of the line (P-AXIS-00274)"),
        ("TEMPC::offset_0", 0x44, "SGN32", "0.1 µm", "value of the line (P-AXIS-00273)"),
        ("TEMPC::position_0", 0x45, "SGN32", "0.1 µm", "place of that value (P-AXIS-00272)"),
    ),
    *_objects(
        "cross", "[001] p.35",
        ("CROSSC::activated", 0x1D6, "BOOLEAN", "", _SWITCHED),
        ("CROSSC::f_is_active", 0x4F, "BOOLEAN", "", _ACTS),
        ("CROSSC::actual_offset", 0x35, "SGN32", "Incr.", "offset that acts"),
        ("CROSSC::delta_offset", 0x34, "SGN32", "Incr.", _CHANGE),
    ),
    *_objects(
        "plane", "[001] p.48",
        ("CC2::activated", 0x1D7, "BOOLEAN", "", _SWITCHED),
        ("CC2::correction", 0x52, "SGN32", "Incr.", "offset that acts"),
    ),
    *_objects(
        "leadscrew", "[001] p.61",
        ("ssfk activated", 0x38, "BOOLEAN", "", _SWITCHED),
        ("LSEC::active", 0xD0, "BOOLEAN", "", _ACTS),
        ("LSEC::sum epsilon", 0x1D, "SGN32", "Incr.", "offset that acts"),
        ("LSEC::epsilon", 0x1C, "SGN32", "Incr.", _CHANGE),
    ),
    *_objects(
        "crosstalk", "[001] p.90-91",
        ("CROSSTALK::activated", 0x1F4, "BOOLEAN", "", _SWITCHED),
        ("CROSSTALK::actual_offset", 0x1F7, "SGN32", "Incr.", "offset that acts"),
        ("CROSSTALK::delta_offset", 0x1F6, "SGN32", "Incr.", _CHANGE),
        ("CROSSTALK::end_offset", 0x1F8, "SGN32", "Incr.", "offset at this state, without filter"),
    ),
    *_objects(
        "external", "[004] p.20",
        ("EXTC[0].initialized", 0x1181, "BOOLEAN", "", "the interface is switched on"),
        ("EXTC[0].registered", 0x1182, "BOOLEAN", "", "the module is loaded"),
        ("EXTC[0].state", 0x1183, "SGN32", "", "0 off, 1 on, 2 error"),
        ("EXTC[0].last_offset", 0x1180, "SGN32/SGN64", "Incr.", "offset of the cycle before"),
        ("EXTC[0].actual_offset", 0x1181, "SGN32/SGN64", "Incr.", "offset that acts"),
        ("EXTC[0].next_offset", 0x1182, "SGN32/SGN64", "Incr.", "offset that follows"),
        ("EXTC[0].offset_delta", 0x1183, "SGN32/SGN64", "Incr.", "change of the offset"),
        ("EXTC[0].diff", 0x1184, "REAL64", "mm/s²", "acceleration of the offset"),
    ),
)  # fmt: skip

_REPORTS: dict[str, Literal["filtered", "unfiltered"]] = {
    "BC::actual backlash": "filtered",
    "BC::sum backlash": "unfiltered",
    "TEMPC::actual_offset": "filtered",
    "CROSSC::actual_offset": "filtered",
    "CC2::correction": "filtered",
    "LSEC::sum epsilon": "filtered",
    "CROSSTALK::actual_offset": "filtered",
    "CROSSTALK::end_offset": "unfiltered",
}
_STATES = {"TEMPC::f_is_active", "CROSSC::f_is_active", "LSEC::active"}
_WRITABLE = {
    "TEMPC::activated",
    "TEMPC::coefficient",
    "TEMPC::offset_0",
    "TEMPC::position_0",
}
_OF_PLATFORM = {"EXTC[0].initialized", "EXTC[0].registered", "EXTC[0].state"}

CNC_OBJECTS = _marked()
"""Every object of a compensation whose address a manual gives."""
