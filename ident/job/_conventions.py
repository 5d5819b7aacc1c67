"""Which rules of the controller a result rests on, and which of them are verified."""

import functools

from ...models import Conventions
from ._load import Job
from ._result import ConventionState


def convention_states(
    job: Job, prefixes: tuple[str, ...]
) -> tuple[ConventionState, ...]:
    """Return the conventions whose names begin with one of these words."""
    return _states(job.conventions, job.verified, prefixes)


@functools.lru_cache(maxsize=64)
def _states(
    conventions: Conventions, verified: frozenset[str], prefixes: tuple[str, ...]
) -> tuple[ConventionState, ...]:
    # All machines of a batch have much the same ones.
    return tuple(
        ConventionState(
            name=rule.name,
            value=str(rule.value),
            state="verified" if rule.name in verified else "assumed",
            meaning=f"{rule.meaning} ({rule.rule})",
            decides=rule.decides,
        )
        for rule in conventions.listing()
        if rule.name.startswith(prefixes)
    )
