"""The fits of a group, planned: existing lists read, keys understood."""

from collections.abc import Mapping, Sequence

from .._draft import AxisLists
from .._fit_schema import (
    BacklashSpec,
    CrosstalkSpec,
    Effect,
    FitSpec,
    TableSpec,
    TemperatureSpec,
)
from .._load import Job
from .._plan import plan_fit
from .._source import Tables, measured_for
from ..backlash import known_backlash
from ..crosstalk import active_in, read_existing
from ..temperature import only_sensor, refuse_unstated_law, sensor_name
from ._backlash import BacklashMember
from ._crosstalk import CrosstalkMember
from ._member import AbstractMember
from ._table import TableMember
from ._temperature import TemperatureMember


def members_of(
    job: Job,
    tables: Tables,
    indices: Sequence[int],
    lists: Mapping[str, AxisLists],
) -> tuple[AbstractMember, ...]:
    """Return the fits of a group.

    Raises:
        JobError: If keys, nodes, masters or existing lists do not suit.
        MeasurementError: If the only sensor is to be taken and there is none.
    """
    return tuple(
        _member(
            job, tables, index, job.spec.fits[index], lists[job.spec.fits[index].axis]
        )
        for index in indices
    )


def _member(
    job: Job, tables: Tables, index: int, fit: FitSpec, lists: AxisLists
) -> AbstractMember:
    if isinstance(fit, BacklashSpec):
        return BacklashMember(index, lists, fit, known_backlash(job, index, fit, lists))
    if isinstance(fit, TemperatureSpec):
        refuse_unstated_law(job, fit, lists)
        return TemperatureMember(index, lists, fit, _sensors(tables, fit))
    if isinstance(fit, CrosstalkSpec):
        old, why = read_existing(lists.compensation, job.conventions)
        active = active_in(job, index, fit, old, why) is not None
        return CrosstalkMember(index, lists, fit, old, active, why)
    # `group_faults` has refused what cannot stand in a group.
    assert isinstance(fit, TableSpec)
    return TableMember(index, lists, plan_fit(job, tables, index, fit, lists))


def _sensors(tables: Tables, fit: TemperatureSpec) -> dict[Effect, str]:
    effects: dict[Effect, str] | None = fit.effects
    if effects is None:
        measured = measured_for(tables, fit.sources[0], fit, (fit.axis,))
        only = only_sensor(measured, fit.axis)
        effects = {"offset": only, "coefficient": only}
    return {key: sensor_name(name) for key, name in effects.items()}
