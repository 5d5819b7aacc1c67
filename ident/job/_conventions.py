"""Which rules of the controller a result rests on, and which of them are verified."""

from ._load import Job
from ._result import ConventionState


def convention_states(
    job: Job, prefixes: tuple[str, ...]
) -> tuple[ConventionState, ...]:
    """Return the conventions whose names begin with one of these words."""
    return tuple(
        ConventionState(
            name=rule.name,
            value=str(rule.value),
            state="verified" if rule.name in job.verified else "assumed",
            meaning=f"{rule.meaning} ({rule.rule})",
        )
        for rule in job.conventions.listing()
        if rule.name.startswith(prefixes)
    )
