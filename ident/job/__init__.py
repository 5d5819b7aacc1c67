"""From a job file to proven lists: plan, readings, fits, drafts, gate, files, result.

Read in this order: `_schema` (every key; those of a fit stand in the folders of `kinds`), `_load`
with `_checks` (a job that can be run), `_run` (the whole way, in one function), `_plans` (every
fit, planned), `_source` and `_readings` with `_remove` and `_trend` (from a file to readings),
`_plan`, `_fitting` and `_table_draft` (a table; `_draft` is what every fit can be asked), `_lists`
(entries into the user's lists), `_gating`, `_whole` with `_acting` (the gate of a fit and of a
whole axis), `_prove` (the files, read back), `_result` with `_verdict`, `_job_result`,
`_loadsheet`, and `_measure_again` (the second measurement).

What is special about one compensation stands in `axcomp.ident.kinds` (`_parts` says what a job
asks of it); `joint` identifies the fits of one group, `streamed` reads logs in pieces. The results
of single compensations are imported when they are first asked for: a job of one table needs none
of them, and starts sooner without.
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
    from ..kinds.friction._result import (
        FrictionResult as FrictionResult,
        FrictionView as FrictionView,
        LawCurve as LawCurve,
        choice_sentence as choice_sentence,
    )
    from ..kinds.temperature._law import ThermalLaw as ThermalLaw
    from ..kinds.temperature._result import (
        TemperatureResult as TemperatureResult,
        ThermalView as ThermalView,
    )
    from ._found_fits import (
        found_keys as found_keys,
        job_with_fits as job_with_fits,
        nodes_for as nodes_for,
    )
    from ._observe import Observation as Observation, observe as observe
    from ._outside import read_outside as read_outside
    from ._remove import without_zero as without_zero
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
        Freedom as Freedom,
        GroupResult as GroupResult,
        LeftOutResult as LeftOutResult,
        LostPair as LostPair,
    )

_HOMES = {
    "Observation": "_observe",
    "found_keys": "_found_fits",
    "job_with_fits": "_found_fits",
    "nodes_for": "_found_fits",
    "read_outside": "_outside",
    "observe": "_observe",
    "without_zero": "_remove",
    "Gate": "_schema",
    "JobFile": "_schema",
    "Trend": "_trend",
    "asks_for_owner": "_trend",
    "trend_through": "_trend",
    "trend_words": "_trend",
    "AxisSum": "joint",
    "BacklashResult": ".kinds.backlash._result",
    "CrosstalkResult": ".kinds.crosstalk._result",
    "EffectShare": "joint",
    "Freedom": "joint",
    "FrictionResult": ".kinds.friction._result",
    "FrictionView": ".kinds.friction._result",
    "GroupResult": "joint",
    "LawCurve": ".kinds.friction._result",
    "LeftOutResult": "joint",
    "LostPair": "joint",
    "choice_sentence": ".kinds.friction._result",
    "TemperatureResult": ".kinds.temperature._result",
    "ThermalLaw": ".kinds.temperature._law",
    "ThermalView": ".kinds.temperature._result",
}

__getattr__ = importer(__name__, _HOMES)
