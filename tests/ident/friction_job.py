"""The job of a friction fit to a recorded trace, as several tests want it."""

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
