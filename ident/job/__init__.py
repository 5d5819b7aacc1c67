"""Job files: from TOML to lists, result and proof.

Results of the rooms beside the tables are imported when they are first asked for: a
job of one table needs none of them, and starts sooner without.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ..proof import ErrorFigures as ErrorFigures, GateCheck as GateCheck
from ._cache import use_compilation_cache as use_compilation_cache
from ._errors import JobError as JobError, OutputError as OutputError
from ._json import result_json as result_json
from ._load import (
    Job as Job,
    load_conventions as load_conventions,
    load_job as load_job,
)
from ._output import write_atomically as write_atomically
from ._outside import read_outside as read_outside
from ._result import (
    AbstractResult as AbstractResult,
    ConventionState as ConventionState,
    JobResult as JobResult,
    LoadStep as LoadStep,
    Remark as Remark,
    SampleView as SampleView,
    TableResult as TableResult,
)
from ._run import run_job as run_job

if TYPE_CHECKING:
    from .backlash import BacklashResult as BacklashResult
    from .crosstalk import (
        CrosstalkResult as CrosstalkResult,
        CrosstalkView as CrosstalkView,
        EventCourse as EventCourse,
    )
    from .friction import (
        FrictionResult as FrictionResult,
        FrictionView as FrictionView,
        LawCurve as LawCurve,
    )
    from .temperature import (
        TemperatureResult as TemperatureResult,
        ThermalLaw as ThermalLaw,
        ThermalView as ThermalView,
    )

_HOMES = {
    "BacklashResult": "backlash",
    "CrosstalkResult": "crosstalk",
    "CrosstalkView": "crosstalk",
    "EventCourse": "crosstalk",
    "FrictionResult": "friction",
    "FrictionView": "friction",
    "LawCurve": "friction",
    "TemperatureResult": "temperature",
    "ThermalLaw": "temperature",
    "ThermalView": "temperature",
}


def __getattr__(name: str) -> Any:
    """Import a public name of a room on first use."""
    if name not in _HOMES:
        msg = f"module {__name__!r} has no attribute {name!r}"
        raise AttributeError(msg)
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
