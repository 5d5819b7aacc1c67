"""The estimator: a stack of effects and readings in, a posterior out.

It knows no file and no compensation by name.
"""

from ._drift import DriftNoise as DriftNoise
from ._errors import FitError as FitError
from ._ipopt import (
    IpoptSolution as IpoptSolution,
    IpoptStatus as IpoptStatus,
    least_squares_ipopt as least_squares_ipopt,
)
from ._loss import AbstractLoss as AbstractLoss, choose_loss as choose_loss
from ._regression import (
    Regression as Regression,
    refuse_confounded as refuse_confounded,
    regress as regress,
)
from ._threads import cores as cores, one_blas_thread as one_blas_thread
