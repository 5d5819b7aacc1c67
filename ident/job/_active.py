"""Whether a compensation acted while its measurements were taken."""

from ._fit_schema import FitSpec
from ._load import Job


def was_active(job: Job, index: int, fit: FitSpec) -> bool:
    """Return whether the compensation of a fit was on in all its measurements.

    Raises:
        JobError: If it was on in some of them only.
    """
    kind = fit.compensation
    states = {kind in job.spec.measurements[name].active for name in fit.sources}
    if len(states) > 1:
        raise job.error(
            ("fits", index),
            f"found measurements with {kind} on and off (active), expected one state"
            " for all that are joined",
        )
    return states == {True}
