"""From a job file to proven lists: plan, readings, fits, drafts, gate, files, result.

`_run.run_job` goes the whole way. `file._load.load_job` gives a `Job`; `_run.fit_all` plans all
fits, then fits one after the other (`_acting` is what acts beside a fit and did not while it was
measured). `write._lists` makes the `AxisFiles` of each axis, each with its gate (`_gating`), and
`_whole` judges all that will act on an axis, read as the controller does. What lies in the
`OutFolder` then is read back and proven by the drafts; `_measure_again` adds what a second
measurement says, `write._loadsheet` what to do with the files, and all is a `JobResult`.

Of one leadscrew table (`table`) this is handed on: `Job`, `Plan`, `Readings`, `TableDraft`,
`AxisFiles`, `TableResult`, `JobResult`. Other compensations go the same way with drafts of their
own, from `axcomp.ident.kinds` (`_protocol` says what a job asks of them); fits that are identified
together get theirs from `joint`. Their results are imported when they are first asked for: a job
of one table starts sooner without.
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
    from .joint._proof import (
        AxisSum as AxisSum,
        EffectShare as EffectShare,
        GroupResult as GroupResult,
    )
    from .joint._share import LeftOutResult as LeftOutResult
    from .table._trend import (
        Trend as Trend,
        asks_for_owner as asks_for_owner,
        is_negligible as is_negligible,
        trend_through as trend_through,
        trend_words as trend_words,
    )

__getattr__ = importer(__name__)
