"""Fits of tables, in memory and in pieces: arrays in, model and uncertainty out.

`fit_table` (`_table`) and `fit_with_folds` (`_stream`) rest on `axcomp.ident.core`;
`predict` and `leave_out` say what a fit says elsewhere, and without some readings.
"""

from ..core import (
    DriftNoise as DriftNoise,
    FitError as FitError,
    cores as cores,
    one_blas_thread as one_blas_thread,
)
from ._ahead import Ahead as Ahead, in_turn as in_turn
from ._predict import (
    deviations as deviations,
    leave_out as leave_out,
    predict as predict,
    spatial_blocks as spatial_blocks,
)
from ._stream import (
    AbstractPass as AbstractPass,
    Apply as Apply,
    Grouping as Grouping,
    Part as Part,
    Place as Place,
    Stream as Stream,
    StreamedFit as StreamedFit,
    added as added,
    fit_streamed as fit_streamed,
    fit_with_folds as fit_with_folds,
)
from ._table import fit_table as fit_table, fit_values as fit_values
from ._types import (
    RunEffect as RunEffect,
    Samples as Samples,
    TableFit as TableFit,
    TableLayout as TableLayout,
)
