"""From a job file to proven lists: plan, readings, fits, drafts, gate, files, result.

Folders: `file` (what a job says), `table` (plane, cross, leadscrew), `joint` (fits of a group),
`write` (lists and load sheet), `result` (what was found). The way of a job with one leadscrew
table, function by function:

1. `_run.run_job` goes the whole way, as follows.
2. `file._load.load_job` reads the job file and gives a `Job`, which reads the lists that its
   axes have already.
3. `_fits.fit_all` plans all fits, then fits one after the other; `_acting.leftovers` and
   `_acting.hand_on` are what acts beside a fit and did not while it was measured.
4. `table._plan.plan` plans a table: its nodes, masters and old values. `table._readings.read_fit`
   gives its `Readings`, those of a group of one (`joint._recording`), and
   `table._fitting.fit_plan` a `TableDraft`, fitted and held out; `_trend.refuse_unowned_trend`
   asks whose a constant and a slope of it are.
5. `write._lists.files_of` makes the `AxisFiles` of each axis from its drafts, each with its gate
   (`_gating`), and `judge_files` checks them beside all other lists.
6. `_whole.judge_whole` judges all that will act on an axis, read back as the controller does.
7. `_run._write` writes them into the `OutFolder`, into ``rejected/`` where the gate failed, and
   reads them back.
8. `TableDraft.prove` judges the lists as they lie there, and gives a `TableResult`.
9. `_measure_again` adds what a second measurement says, `load_sheet` what to do with the files;
   the `JobResult` is written.

What is handed on along this way: `Job`, `Plan`, `Readings`, `TableDraft`, `AxisFiles`,
`TableResult` and `JobResult`; the report makes a section of each result.

Other compensations go the same way with drafts of their own, from `axcomp.ident.kinds`
(`_protocol` says what a job asks of them); fits that are identified together get theirs from
`joint`: `fit_group`, `prove_group`. The results of single compensations are
imported when they are first asked for: a job of one table needs none of them, and starts sooner
without.
"""

from typing import TYPE_CHECKING

from ...data.files import write_atomically as write_atomically
from .._lazy import importer
from ..proof import ErrorFigures as ErrorFigures, GateCheck as GateCheck
from ._cache import use_compilation_cache as use_compilation_cache
from ._run import run_job as run_job
from .file._faults import JobError as JobError
from .file._load import Job as Job, load_job as load_job
from .result._job_result import (
    JobResult as JobResult,
    LoadStep as LoadStep,
    WholeAxis as WholeAxis,
    tree_json as tree_json,
)
from .result._result import (
    AbstractResult as AbstractResult,
    ConventionState as ConventionState,
    Remark as Remark,
    SampleView as SampleView,
    TableResult as TableResult,
    by_level as by_level,
    largest_wild as largest_wild,
    some_of as some_of,
)
from .result._second import (
    MeasuredAgain as MeasuredAgain,
    SecondMeasurement as SecondMeasurement,
    SecondMeasurementError as SecondMeasurementError,
)
from .result._verdict import (
    Code as Code,
    Judgement as Judgement,
    Reason as Reason,
    Verdict as Verdict,
)
from .write._output import (
    OutFolder as OutFolder,
    OutputError as OutputError,
    signed as signed,
)

if TYPE_CHECKING:
    from ..kinds.backlash._result import BacklashResult as BacklashResult
    from ..kinds.crosstalk._result import CrosstalkResult as CrosstalkResult
    from ..kinds.friction._result import FrictionResult as FrictionResult
    from ..kinds.temperature._law import ThermalLaw as ThermalLaw
    from ..kinds.temperature._result import TemperatureResult as TemperatureResult
    from .file._found_fits import (
        found_keys as found_keys,
        job_with_fits as job_with_fits,
        nodes_for as nodes_for,
    )
    from .file._schema import JobFile as JobFile
    from .joint import (
        AxisSum as AxisSum,
        EffectShare as EffectShare,
        GroupResult as GroupResult,
        LeftOutResult as LeftOutResult,
    )
    from .table._trend import (
        Trend as Trend,
        asks_for_owner as asks_for_owner,
        is_negligible as is_negligible,
        trend_through as trend_through,
        trend_words as trend_words,
    )

__getattr__ = importer(__name__)
