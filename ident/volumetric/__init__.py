"""Errors over the whole volume of a machine from measured points.

`Geometry` (the 21 errors) and `Volumetric` (a grid) say what is fitted, `Points` hold what was
measured, `fit_volumetric` fits by the estimator of `core`. Read `_effects`, `_points`, `_blocks`
(the unknowns as effects of the estimator), `_freedoms` (gauges, and what points cannot tell),
`_fit`, `_words` in this order.
"""

from ._effects import (
    AbstractVolumetric as AbstractVolumetric,
    Geometry as Geometry,
    Volumetric as Volumetric,
)
from ._fit import (
    Prediction as Prediction,
    Tool as Tool,
    VolumetricFit as VolumetricFit,
    fit_volumetric as fit_volumetric,
)
from ._freedoms import Gauge as Gauge, Undetermined as Undetermined
from ._points import Points as Points
from ._words import (
    undetermined_sentence as undetermined_sentence,
)
