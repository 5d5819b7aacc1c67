"""Fits of no group that their readings do not tell: named, and the rest is written."""

from ._draft import AbstractDraft
from ._faults import key_words
from ._load import Job
from ._rooms import Plans
from ._source import Tables


def left_out(job: Job, plans: Plans, k: int, reason: str) -> AbstractDraft:
    """Return what stands for a fit that its readings do not tell: the rest is written."""
    from .joint import LeftOutDraft

    spec = job.spec.fits[k]
    start = f"{spec.name} from {', '.join(spec.sources)}: "
    why = reason.removeprefix(f"{key_words(('fits', k))}: ").removeprefix(start)
    return LeftOutDraft(k, spec, plans.lists[spec.axis], spec.name, why)


def untold_alone(job: Job, tables: Tables, plans: Plans) -> dict[int, str]:
    """Return which fits of no group their readings do not tell apart, and why."""
    fits = job.spec.fits
    several = len({fits[k].axis for k in plans.single}) < len(plans.single)
    if not several and not any(fits[k].kind.often_open for k in plans.single):
        return {}
    from .joint import untold_apart

    return untold_apart(job, tables, list(plans.single), plans.lists)
