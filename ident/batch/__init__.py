"""Many jobs: one or a hundred thousand, resumable, on one machine or a cluster.

Read in this order: `_run` (the whole), `_collect` with `_job_table` (which jobs there are),
`_manifest` and `_journal` (what was done so far, on disk), `_lock`, `_pool` over `_cluster`
(chunks of jobs on workers that may die), `_work` (what a worker does), `_rows` and `_schema` (a
row per fit), `_table` (questions to them), `_summary` and `_page`. `_log` spreads one huge log
over the same workers.

Fitting a log is imported when it is first asked for: it needs the estimators, while the process
that looks after a batch leaves them to its workers.
"""

from typing import TYPE_CHECKING

from .._lazy import importer
from ._collect import JobItem as JobItem, collect_jobs as collect_jobs
from ._errors import BatchError as BatchError
from ._progress import Progress as Progress
from ._run import BatchResult as BatchResult, run_batch as run_batch
from ._schema import COLUMNS as COLUMNS, VERSION as VERSION
from ._summary import (
    Outlier as Outlier,
    Spread as Spread,
    Summary as Summary,
    Trend as Trend,
    summarise as summarise,
)
from ._table import query_results as query_results, read_results as read_results

if TYPE_CHECKING:
    from ._log import fit_log as fit_log

__getattr__ = importer(__name__, {"fit_log": "_log"})
