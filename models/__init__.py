"""What the controller does with a compensation list, differentiable (pure JAX).

Importing this package switches JAX to 64-bit floats (`jax_enable_x64`) for the whole
process, before any of its arrays exists: 0.1 µm over 10 m needs more than single
precision has.

Inside: mm (rotary axes: degree) in, mm out. For each compensation:

* `Plane`, `Cross`, `Leadscrew`: the table compensations, over `Stencil` and the nodes
  `EquidistantNodes`, `Setpoints`, `ModuloNodes`.
* `Backlash`, `TemperatureLine`: laws of direction and of temperature.
* `VolumetricGrid`, `GeometricErrors`: offsets over three axes, as a grid and as the 21
  errors of a machine; no list holds them, `ExternalCompensation` does.
* `PositionController`: all compensations of a machine's axes (`AxisCompensations`) over
  `Motion`, with `SineSquaredFilter`, activation (`commanded`) and homing: `Offsets`.
* `Conventions`: every rule of the controller that the manuals leave open, by name.
"""

from . import _precision as _precision  # first: before any array
from ._backlash import Backlash as Backlash, BacklashState as BacklashState
from ._controller import (
    ControllerState as ControllerState,
    PositionController as PositionController,
)
from ._controller_axis import (
    AbstractOffset as AbstractOffset,
    AxisCompensations as AxisCompensations,
    Coupled as Coupled,
)
from ._controller_commands import (
    CompCommand as CompCommand,
    ProgramEnd as ProgramEnd,
    commanded as commanded,
)
from ._conventions import (
    Convention as Convention,
    ConventionError as ConventionError,
    Conventions as Conventions,
)
from ._cross import Cross as Cross
from ._crosstalk import (
    AbstractCrosstalk as AbstractCrosstalk,
    Crosstalk as Crosstalk,
    LegacyCrosstalk as LegacyCrosstalk,
)
from ._direction import (
    DirectionState as DirectionState,
    directions as directions,
    first_motion as first_motion,
)
from ._external import (
    ExternalCompensation as ExternalCompensation,
    OffsetPart as OffsetPart,
    OffsetStack as OffsetStack,
    StartPoint as StartPoint,
)
from ._external_limits import (
    Answer as Answer,
    ExternalLimits as ExternalLimits,
    LimitState as LimitState,
)
from ._filter import (
    Delay as Delay,
    Past as Past,
    SineSquaredFilter as SineSquaredFilter,
    step_response as step_response,
)
from ._friction import (
    AbstractFriction as AbstractFriction,
    FrictionTable as FrictionTable,
    linear_weights as linear_weights,
    sample_friction as sample_friction,
)
from ._friction_compensation import (
    FrictionCompensation as FrictionCompensation,
    FrictionState as FrictionState,
)
from ._friction_stribeck import (
    StribeckFriction as StribeckFriction,
    stribeck_columns as stribeck_columns,
)
from ._geometric import GeometricErrors as GeometricErrors
from ._leadscrew import Leadscrew as Leadscrew
from ._lookup import AbstractLookup as AbstractLookup
from ._motion import (
    COMPENSATIONS as COMPENSATIONS,
    Motion as Motion,
    Offsets as Offsets,
    Rows as Rows,
)
from ._nodes import (
    AbstractNodes as AbstractNodes,
    EquidistantNodes as EquidistantNodes,
    ModuloNodes as ModuloNodes,
    Setpoints as Setpoints,
)
from ._plane import Plane as Plane
from ._primitive import interpolate as interpolate
from ._stencil import Stencil as Stencil
from ._surface import (
    AbstractSurface as AbstractSurface,
    BilinearGrid as BilinearGrid,
    grid_through as grid_through,
)
from ._surface_delaunay import (
    DelaunaySurface as DelaunaySurface,
    surface_through as surface_through,
)
from ._surface_thin_plate import ThinPlateSurface as ThinPlateSurface
from ._temperature import (
    AbstractParameter as AbstractParameter,
    ConstantParameter as ConstantParameter,
    TemperatureCurve as TemperatureCurve,
    TemperatureLine as TemperatureLine,
)
from ._volumetric import VolumetricGrid as VolumetricGrid
