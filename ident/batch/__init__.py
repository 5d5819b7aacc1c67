"""Many jobs: one or a hundred thousand, resumable, on one machine or a cluster.

Read in this order: `_run` (the whole), `_collect` (which jobs there are), `_folder` (its
manifest and its lock), `_workers` (chunks of jobs on workers that may die), `_work` (what a worker
does, and what the folder of a finished job tells), `_rows` (a row per fit), `_table` (questions to
them) and `_summary` (what they say of all machines). `_log` spreads one huge log over the same
workers.

Fitting a log is imported when it is first asked for: it needs the estimators, while the process
that looks after a batch leaves them to its workers.
"""

from typing import TYPE_CHECKING

from .._lazy import importer
from ._collect import Task as Task, collect_jobs as collect_jobs
from ._folder import BatchError as BatchError
from ._rows import COLUMNS as COLUMNS, VERSION as VERSION
from ._run import (
    BatchResult as BatchResult,
    Progress as Progress,
    run_batch as run_batch,
)
from ._summary import Summary as Summary, summarise as summarise
from ._table import query_results as query_results, read_results as read_results

if TYPE_CHECKING:
    from ._log import fit_log as fit_log

__getattr__ = importer(__name__)
