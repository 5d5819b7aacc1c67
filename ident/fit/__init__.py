"""Estimators: arrays in, model and uncertainty out; this floor knows no files."""

from ._drift import DriftNoise as DriftNoise
from ._errors import FitError as FitError
from ._gather import (
    Gathering as Gathering,
    in_group as in_group,
    waiting as waiting,
)
from ._predict import (
    leave_out as leave_out,
    predict as predict,
    spatial_blocks as spatial_blocks,
)
from ._streamed import fit_streamed as fit_streamed
from ._table import fit_table as fit_table
from ._threads import one_blas_thread as one_blas_thread
from ._types import (
    RunEffect as RunEffect,
    Samples as Samples,
    TableFit as TableFit,
    TableLayout as TableLayout,
)
from ._values import fit_values as fit_values
