"""Whether a compensation acted while its measurements were taken."""

from pathlib import Path

from ..kinds._keys import FitSpec
from ._load import Job


def refuse_unstated(job: Job, fit: FitSpec, holder: str | None, on: str) -> None:
    """Raise where a list has the compensation already and a measurement does not say more.

    What was measured is then either the whole error or what that list leaves of it.

    Args:
        job: The job.
        fit: The fit.
        holder: The list of the axis that holds its compensation, or None.
        on: What follows where it acted while measuring.

    Raises:
        JobError: Naming the measurement and the answers.
    """
    for name in fit.sources:
        if holder is None or "active" in job.spec.measurements[name].model_fields_set:
            continue
        kind = fit.compensation
        raise job.error(
            ("measurements", name),
            f"found no active, and {Path(holder).name} holds {kind} of {fit.axis} already, expected"
            f' active = ["{kind}"] if it was on while measuring ({on}), or active = [] if'
            " it was off (the new values replace the old)",
        )


def was_active(job: Job, index: int, fit: FitSpec, holder: str | None) -> bool:
    """Return whether the compensation of a fit was on in all its measurements.

    Args:
        job: The job.
        index: Of the fit.
        fit: Its specification.
        holder: The list of the axis that holds this compensation already, or None.

    Raises:
        JobError: If it was on in some of them only, or there is a list with it and a
            measurement does not say.
    """
    refuse_unstated(job, fit, holder, "the new values are old + measured")
    kind = fit.compensation
    states = {kind in job.spec.measurements[name].active for name in fit.sources}
    if len(states) > 1:
        raise job.error(
            ("fits", index),
            f"found measurements with {kind} on and off (active), expected one state"
            " for all that are joined",
        )
    return states == {True}
