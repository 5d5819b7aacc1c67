"""A friction fit to a recorded trace as several tests want it: its job, and one law of it."""

from axcomp.ident.core import one_blas_thread
from axcomp.ident.friction import DriveSamples, FrictionFit, Stribeck
from axcomp.ident.friction._equation import Equation, record
from axcomp.ident.friction._inverse import fit_carried, fit_equation
from axcomp.ident.friction._structures import AbstractStructure
from axcomp.ident.friction._weights import weigh

_JOB = """\
{head}
[axes.X]
number = 1
{axis}
[measurements.trace]
file = "{file}"
[measurements.trace.columns]
time = {{ column = "t", unit = "s" }}
"X.position" = {{ column = "x", unit = "mm" }}
"X.current" = {{ column = "i", unit = "{unit}" }}
[[fits]]
compensation = "friction"
axis = "X"
measurement = "trace"
{keys}
"""


def friction_job(
    keys: str = "",
    *,
    head: str = "",
    axis: str = "",
    file: str = "trace.csv",
    unit: str = "A",
) -> str:
    """Return a job: keys of the fit, tables before the axis, keys of the axis."""
    return _JOB.format(keys=keys, head=head, axis=axis, file=file, unit=unit)


@one_blas_thread()
def fit_inverse(
    samples: DriveSamples,
    structure: AbstractStructure | None = None,
    *,
    inertia: float | None = None,
    loss: str = "trim",
    decimate: int | None = None,
    carried: bool = True,
) -> FrictionFit:
    """Return what `choose_law` fits of one kind of law, without windows held out.

    Not ``carried``: all of the law, whatever the rows say of its drop and exponent.
    """
    recording = record(samples, inertia, decimate)
    equation = Equation(recording, structure or Stribeck())
    fit = fit_carried if carried else fit_equation
    return fit(equation, weigh(recording, loss))
