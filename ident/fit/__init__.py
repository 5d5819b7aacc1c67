"""Fits of tables, in memory and in pieces: arrays in, model and uncertainty out.

`fit_table` (`_table`) and `fit_streamed` (`_stream`) are one estimator, that of
`axcomp.ident.core`; `_result` says what was found, `_once` what a single probing cannot tell.
`predict` and `leave_out` say what a fit says elsewhere, and without some readings;
`_inequalities` makes the written values keep what they must.
"""

from ..core import (
    DriftNoise as DriftNoise,
    FitError as FitError,
    TableEffect as TableEffect,
    one_blas_thread as one_blas_thread,
)
from ._inequalities import (
    Constraint as Constraint,
    Inequalities as Inequalities,
    kept as kept,
    most_probable as most_probable,
)
from ._predict import (
    as_alike as as_alike,
    leave_out as leave_out,
    mean_row as mean_row,
    predict as predict,
    spatial_blocks as spatial_blocks,
    zeroed as zeroed,
)
from ._result import scatter_of_runs as scatter_of_runs
from ._stream import (
    Apply as Apply,
    Grouping as Grouping,
    Part as Part,
    StreamedFit as StreamedFit,
    fit_streamed as fit_streamed,
)
from ._table import (
    RunEffects as RunEffects,
    fit_table as fit_table,
    fit_values as fit_values,
)
from ._types import RunEffect as RunEffect, Samples as Samples, TableFit as TableFit
