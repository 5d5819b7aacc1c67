"""The estimator: a stack of effects and readings in, a posterior out.

It knows no file and no compensation by name.
"""

from ._curve import (
    filled as filled,
    node_shares as node_shares,
    regress_curve as regress_curve,
)
from ._drift import DriftNoise as DriftNoise
from ._errors import FitError as FitError
from ._loss import AbstractLoss as AbstractLoss, choose_loss as choose_loss
from ._regression import (
    Regression as Regression,
    refuse_confounded as refuse_confounded,
    regress as regress,
)
from ._threads import cores as cores, one_blas_thread as one_blas_thread
