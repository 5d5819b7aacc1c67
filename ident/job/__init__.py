"""Job files: from TOML to lists, result and proof."""

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
from .backlash import BacklashResult as BacklashResult
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
