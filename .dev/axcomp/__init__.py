"""Turn measurements of a machine tool into compensation lists that are proven to work.

The library at a glance; each name is loaded when it is first used:

* `read`: a measurement file in mm, °, s, °C. `fit`: a stack of effects from it
  (`Leadscrew`, `Cross`, `Plane`, `Backlash`, `Temperature`, `Crosstalk`, `Friction`).
* `fit_model`: any equinox module, by optimistix or IPOPT; `fit_linear`: a linear stack,
  differentiable to any order.
* `fit_volumetric`: errors over the volume of three axes (`Geometry`, the 21 errors of a
  machine; `Volumetric`, a grid) from measured `Points`.
* `load_model`, `write`: lists of the controller ↔ models (`AxisModels`, `ModelUnit`).
  `export_external`: models as C of an external compensation.
* `AxcompError`: what is raised where input cannot be used, in words that say what to do.

Three parts, imported by their own names so that a command which only reads lists never
pays for what only a fit needs:

* `axcomp.models`: what the controller does with a list, differentiable (JAX).
* `axcomp.data`: what was measured, and what a list says (no JAX).
* `axcomp.ident`: from measurement to list: fits, proofs, reports, jobs, command line.
"""

from typing import TYPE_CHECKING

from .ident._lazy import homes_of, importer

if TYPE_CHECKING:
    from .data.errors import AxcompError as AxcompError
    from .ident._fit_linear import fit_linear as fit_linear
    from .ident._fit_model import fit_model as fit_model
    from .ident._library import Fit as Fit, fit as fit
    from .ident._model_fit import ModelFit as ModelFit
    from .ident._readings import Friction as Friction, read as read
    from .ident.exchange import (
        AxisModels as AxisModels,
        ModelUnit as ModelUnit,
        load_model as load_model,
        write_lists as write_lists,
    )
    from .ident.external import export_external as export_external
    from .ident.fit.joint import (
        Backlash as Backlash,
        Cross as Cross,
        Crosstalk as Crosstalk,
        Leadscrew as Leadscrew,
        Plane as Plane,
        Temperature as Temperature,
    )
    from .ident.volumetric import (
        Geometry as Geometry,
        Points as Points,
        Volumetric as Volumetric,
        fit_volumetric as fit_volumetric,
    )

    write = write_lists

__version__ = "0.1.0"

__getattr__ = importer(__name__)


def __dir__() -> list[str]:
    """Return all names of the library, those not loaded yet too."""
    return sorted(homes_of(__name__))
