"""From a job file to proven lists: plan, readings, fits, drafts, gate, files, result.

Read in this order: `_schema` (every key; those of a fit stand in the folders of `kinds`), `_load`
with `_checks` (a job that can be run), `_run` (the whole way, in one function), `_plans` (every
fit, planned), `_readings` and `_trend` (readings of a table, by `axcomp.ident.readings`),
`_plan`, `_fitting` and `_table_draft` (a table; `_draft` is what every fit can be asked), `_lists`
(an axis from its drafts to its files), `_gating`, `_whole` with `_acting` (the gate of a fit and
of a whole axis), `_result` with `_verdict`, `_job_result`, `_loadsheet` (its sentences stand in
``load_sheet.txt.jinja``), and `_measure_again` (the second measurement).

What is special about one compensation stands in `axcomp.ident.kinds` (`_protocol` says what a
job asks of it); `joint` identifies the fits of one group, `streamed` reads logs in pieces. The
results of single compensations are imported when they are first asked for: a job of one table
needs none of them, and starts sooner without.
"""

from typing import TYPE_CHECKING

from ...data.files import write_atomically as write_atomically
from .._lazy import importer
from ..proof import ErrorFigures as ErrorFigures, GateCheck as GateCheck
from ._cache import use_compilation_cache as use_compilation_cache
from ._errors import JobError as JobError, OutputError as OutputError
from ._job_result import (
    JobResult as JobResult,
    LoadStep as LoadStep,
    WholeAxis as WholeAxis,
)
from ._json import (
    plain as plain,
    result_json as result_json,
    tree_json as tree_json,
)
from ._load import (
    Job as Job,
    load_conventions as load_conventions,
    load_job as load_job,
)
from ._result import (
    AbstractResult as AbstractResult,
    ConventionState as ConventionState,
    Expectation as Expectation,
    Remark as Remark,
    SampleView as SampleView,
    Streamed as Streamed,
    TableResult as TableResult,
)
from ._run import (
    JobRun as JobRun,
    begin_job as begin_job,
    input_hashes as input_hashes,
    run_job as run_job,
)
from ._second import (
    MeasuredAgain as MeasuredAgain,
    SecondMeasurement as SecondMeasurement,
    SecondMeasurementError as SecondMeasurementError,
)
from ._verdict import (
    Code as Code,
    Judgement as Judgement,
    Reason as Reason,
    Verdict as Verdict,
)

if TYPE_CHECKING:
    from ..kinds.backlash._result import BacklashResult as BacklashResult
    from ..kinds.crosstalk._result import (
        CrosstalkResult as CrosstalkResult,
    )
    from ..kinds.friction._listing import LawCurve as LawCurve
    from ..kinds.friction._result import (
        FrictionResult as FrictionResult,
        FrictionView as FrictionView,
        choice_sentence as choice_sentence,
    )
    from ..kinds.temperature._law import ThermalLaw as ThermalLaw
    from ..kinds.temperature._result import (
        TemperatureResult as TemperatureResult,
        ThermalView as ThermalView,
    )
    from ._acting import reading_of as reading_of
    from ._found_fits import (
        found_keys as found_keys,
        job_with_fits as job_with_fits,
        nodes_for as nodes_for,
    )
    from ._schema import Gate as Gate, JobFile as JobFile
    from ._trend import (
        Trend as Trend,
        asks_for_owner as asks_for_owner,
        trend_through as trend_through,
        trend_words as trend_words,
    )
    from .joint import (
        AxisSum as AxisSum,
        EffectShare as EffectShare,
        GroupResult as GroupResult,
        LeftOutResult as LeftOutResult,
    )

_NAMES = {
    "_acting": "reading_of",
    "_found_fits": "found_keys job_with_fits nodes_for",
    "_schema": "Gate JobFile",
    "_trend": "Trend asks_for_owner trend_through trend_words",
    "joint": "AxisSum EffectShare GroupResult LeftOutResult",
    ".kinds.backlash._result": "BacklashResult",
    ".kinds.crosstalk._result": "CrosstalkResult",
    ".kinds.friction._listing": "LawCurve",
    ".kinds.friction._result": "FrictionResult FrictionView choice_sentence",
    ".kinds.temperature._result": "TemperatureResult ThermalView",
    ".kinds.temperature._law": "ThermalLaw",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}

__getattr__ = importer(__name__, _HOMES)
