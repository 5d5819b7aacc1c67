"""The estimator: a stack of effects and readings in, a posterior out.

It knows no file and no compensation by name. The route of one table (a leadscrew, say):

1. `TableEffect.design` asks the controller's model for the stencil of every reading;
2. `Passes` makes passes over the readings in turn with the search for the weights:
3. `memory` is the pass (a stream has one over its pieces); it calls
4. `sums_of`: residuals about the estimate, their influence, and what adds up (`_kernel` is
   the same for many readings);
5. `choose_loss` takes scale and tails of the noise from the residuals;
6. `Problem.at` puts information and prior together and calls
7. `ArrowFactor.of`, a band with a dense border, and
8. `ArrowFactor.solve`, which gives the `Posterior`;
9. `choose_weights` searches the weights of the prior by its evidence and slopes, for which
10. `Chain.logdet` gives the prior's determinant and
11. `band_inverse` the elements of the inverse, for the variances (`Estimate.spread`);
12. `leave_one_out` gives the posterior without a group of readings.

Read `_readings`, `_prior`, `_effect`, `_stack`, `_sums`, `_factor`, `_posterior`, `_evidence`,
`_loss`, `_robust`, `_hold_out` in this order. Beside them stand fits of few columns with noise
that drifts (`_regression`).
"""

from ._effect import (
    AbstractEffect as AbstractEffect,
    ColumnsEffect as ColumnsEffect,
    GroupEffect as GroupEffect,
    TableEffect as TableEffect,
    axis_nodes as axis_nodes,
    node_shares as node_shares,
    touched as touched,
)
from ._evidence import Spread as Spread, choose_weights as choose_weights
from ._factor import ArrowFactor as ArrowFactor, one_blas_thread as one_blas_thread
from ._hold_out import (
    leave_one_out as leave_one_out,
    simplest as simplest,
    sums_by_group as sums_by_group,
)
from ._loss import WILD as WILD, Loss as Loss, choose_loss as choose_loss
from ._posterior import Posterior as Posterior, Problem as Problem
from ._prior import (
    AbstractPrior as AbstractPrior,
    Independent as Independent,
    NoPrior as NoPrior,
    Smooth as Smooth,
    chain as chain,
)
from ._readings import (
    NOT_DETERMINED as NOT_DETERMINED,
    FitError as FitError,
    Readings as Readings,
    filled as filled,
)
from ._regression import (
    DriftNoise as DriftNoise,
    Regression as Regression,
    estimate_columns as estimate_columns,
    find_drift as find_drift,
    least_scale as least_scale,
    regress as regress,
    rooted as rooted,
    scatter_of_sums as scatter_of_sums,
)
from ._robust import Estimate as Estimate, Passes as Passes, memory as memory
from ._stack import Stack as Stack
from ._sums import Sums as Sums, sums_of as sums_of
