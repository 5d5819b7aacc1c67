"""Estimators: arrays in, model and uncertainty out; this floor knows no files."""

from ..core._drift import DriftNoise as DriftNoise
from ..core._errors import FitError as FitError
from ..core._threads import cores as cores, one_blas_thread as one_blas_thread
from ._ahead import Ahead as Ahead, in_turn as in_turn
from ._gather import (
    Gathering as Gathering,
    in_group as in_group,
    waiting as waiting,
)
from ._grid import Grid as Grid
from ._passes import (
    AbstractPass as AbstractPass,
    Apply as Apply,
    Grouping as Grouping,
    Part as Part,
    Place as Place,
    Stream as Stream,
    added as added,
)
from ._predict import (
    deviations as deviations,
    leave_out as leave_out,
    predict as predict,
    spatial_blocks as spatial_blocks,
)
from ._streamed import (
    StreamedFit as StreamedFit,
    fit_streamed as fit_streamed,
    fit_with_folds as fit_with_folds,
)
from ._table import fit_table as fit_table
from ._types import (
    RunEffect as RunEffect,
    Samples as Samples,
    TableFit as TableFit,
    TableLayout as TableLayout,
)
from ._values import fit_values as fit_values
