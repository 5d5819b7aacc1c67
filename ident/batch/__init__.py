"""Many jobs: one or a hundred thousand, resumable, on one machine or a cluster."""

from ._collect import JobItem as JobItem, collect_jobs as collect_jobs
from ._errors import BatchError as BatchError
from ._log import fit_log as fit_log
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
