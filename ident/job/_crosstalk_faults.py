"""What the keys of a crosstalk fit must fulfil beyond their types."""

from collections.abc import Iterator

from ._fit_schema import CrosstalkSpec
from ._lines import Path as KeyPath
from ._schema import JobFile

_MOST_TESTS = 14
"""What satisfies both statements of the manuals (S-39)."""


def named_axes(fit: CrosstalkSpec) -> tuple[tuple[str, str], ...]:
    """Return the axes that a fit names beside the compensated one, each with its key."""
    given = fit.adaptation
    names = [given] if isinstance(given, str) else list(given or ())
    return (("master", fit.master), *(("adaptation", name) for name in names))


def crosstalk_faults(
    job: JobFile, fit: CrosstalkSpec, where: KeyPath
) -> Iterator[tuple[KeyPath, str]]:
    """Yield what is wrong, each with its key."""
    names = [name for key, name in named_axes(fit) if key == "adaptation"]
    if fit.master == fit.axis:
        reason = f"found {fit.axis!r}, the compensated axis itself, expected another"
        yield (*where, "master"), reason
    for key, name in (("axis", fit.axis), *named_axes(fit)):
        if name in job.axes and job.axes[name].kind != "linear":
            yield (
                (*where, key),
                f"found the {job.axes[name].kind} axis {name}, expected a linear one:"
                " the units of a crosstalk list are not defined for others",
            )
    if len(names) > 2 or len(set(names)) < len(names):
        yield (*where, "adaptation"), f"found {names}, expected one or two axes"
    if isinstance(fit.mode, int) and fit.mode - 1 > len(names):
        yield (
            (*where, "adaptation"),
            f"found {len(names)} axes for mode {fit.mode}, expected {fit.mode - 1}",
        )
    if fit.max_points is not None and fit.max_points > _MOST_TESTS:
        reason = f"found {fit.max_points} tests, expected at most {_MOST_TESTS}"
        yield (*where, "max_points"), reason
    if fit.positions is None:
        return
    widths = {len(place) for place in fit.positions}
    if widths != {len(names)}:
        yield (
            (*where, "positions"),
            f"found {' and '.join(map(str, sorted(widths))) or 'no'} numbers per"
            f" test, expected {len(names)}, one per adaptation axis",
        )
    if len(fit.positions) > _MOST_TESTS:
        reason = f"found {len(fit.positions)}, expected at most {_MOST_TESTS} tests"
        yield (*where, "positions"), reason
