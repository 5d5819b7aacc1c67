"""What the controller does with a compensation list, differentiable (pure JAX).

Importing this package switches JAX to 64-bit floats (`jax_enable_x64`) for the whole
process, before any of its arrays exists: 0.1 µm over 10 m needs more than single
precision has.

Inside: mm (rotary axes: degree) in, mm out. One room per compensation:

* `Plane`, `Cross`, `Leadscrew`: the table compensations, over `Stencil` and the nodes
  `EquidistantNodes`, `Setpoints`, `ModuloNodes`.
* `Conventions`: every rule of the controller that the manuals leave open, by name.
"""

from . import _precision as _precision  # first: before any array
from ._conventions import (
    Convention as Convention,
    ConventionError as ConventionError,
    Conventions as Conventions,
)
from ._cross import Cross as Cross
from ._leadscrew import Leadscrew as Leadscrew
from ._nodes import (
    AbstractNodes as AbstractNodes,
    EquidistantNodes as EquidistantNodes,
    ModuloNodes as ModuloNodes,
    Setpoints as Setpoints,
)
from ._plane import Plane as Plane
from ._primitive import interpolate as interpolate
from ._stencil import Stencil as Stencil
