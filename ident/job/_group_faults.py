"""What fits that are identified together must have in common."""

from collections.abc import Iterator

from ..kinds._keys import Fault, FitSpec
from ._schema import JobFile


def groups_of(job: JobFile) -> dict[str, tuple[int, ...]]:
    """Return the fits of each group, by its name.

    A group of one is that fit alone, unless its measurement drifts: that is allowed for
    in groups.
    """
    found: dict[str, tuple[int, ...]] = {}
    for k, fit in enumerate(job.fits):
        if fit.group is not None:
            found[fit.group] = (*found.get(fit.group, ()), k)
    return {
        name: own
        for name, own in found.items()
        if len(own) > 1 or any(_drifts(job, job.fits[k]) for k in own)
    }


def _drifts(job: JobFile, fit: FitSpec) -> bool:
    named = [job.measurements.get(name) for name in fit.sources]
    return any(one is not None and one.drift > 0 for one in named)


def group_faults(job: JobFile) -> Iterator[Fault]:
    """Yield what is wrong, each with its key."""
    for k, fit in enumerate(job.fits):
        if fit.group is not None and fit.kind.adds_current:
            yield (
                ("fits", k, "group"),
                f"found {fit.compensation} in group {fit.group!r}: it works on the current of the"
                " drive and not on the position, expected no group",
            )
    groups = groups_of(job)
    together = {
        name for own in groups.values() for k in own for name in job.fits[k].sources
    }
    for name, measured in job.measurements.items():
        if measured.drift and job.fits and name not in together:
            yield (
                ("measurements", name, "drift"),
                "found for a measurement of no group, expected it where fits name a group",
            )
    for name, members in groups.items():
        yield from _unlike(job, name, members)
        yield from _beside(job, name, members)


def _unlike(job: JobFile, name: str, members: tuple[int, ...]) -> Iterator[Fault]:
    first = job.fits[members[0]]
    for key in ("loss", "smoothness"):
        own = [k for k in members if key not in job.fits[k].lacking]
        for k in own[1:]:
            mine, theirs = getattr(job.fits[k], key), getattr(job.fits[own[0]], key)
            if mine != theirs:
                yield (
                    ("fits", k, key),
                    f"found {mine!r} in group {name!r}, of which fits[{own[0]}] has"
                    f" {theirs!r}, expected one for all: they are one fit",
                )
    for k in members[1:]:
        fit, where = job.fits[k], ("fits", k)
        if set(fit.sources) != set(first.sources):
            yield (
                (*where, "measurement"),
                f"found {', '.join(fit.sources)} in group {name!r}, whose first fit"
                f" (fits[{members[0]}]) has {', '.join(first.sources)}, expected the"
                " same measurements for all",
            )
    for k in members:
        yield from job.fits[k].faults_in_group(("fits", k))
    for source in first.sources:
        measured = job.measurements.get(source)
        if measured is not None and measured.datum is not None:
            yield (
                ("measurements", source, "datum"),
                f"found for group {name!r}, of which no single effect is zero there,"
                ' expected remove = "offset" or nothing',
            )


def _beside(job: JobFile, name: str, members: tuple[int, ...]) -> Iterator[Fault]:
    own: list[FitSpec] = [job.fits[k] for k in members]
    axes = {fit.axis for fit in own}
    sources = set(own[0].sources)
    for k, fit in enumerate(job.fits):
        if k in members or fit.kind.adds_current or fit.axis not in axes:
            continue
        shared = sources & set(fit.sources)
        if shared:
            yield (
                ("fits", k, "measurement"),
                f"found {', '.join(sorted(shared))}, from which group {name!r} explains"
                f" the whole error of {fit.axis}, expected this fit in the group as"
                " well, or a measurement of its own",
            )
