"""A positioning test in words: what its figures say, for a caption or a report."""

import math
from collections.abc import Mapping

from ..units import small_unit
from ._iso230_types import Iso230, Iso230Position


def describe_iso230(tests: Mapping[str, Iso230], *, unit: str = "mm") -> str:
    """Return what the tests show, in a few sentences with figures.

    Args:
        tests: Evaluations by name; of several, the first and the last are compared.
        unit: ``mm`` or ``deg``, the unit of the evaluations.
    """
    long = "°" if unit == "deg" else " mm"
    names, last = list(tests), list(tests.values())[-1]
    first = next(iter(tests.values()))
    parts: list[str] = []
    scatter = [value for value in (last.R_up, last.R_down) if value is not None]
    if len(tests) > 1:
        changes = [
            f"{with_arrows(key)} {amount(old, unit)} → {amount(new, unit)}"
            for key in ("A", "E", "B", "M", "R", "A_up", "E_up", "A_down", "E_down")
            if (old := getattr(first, key)) is not None
            and (new := getattr(last, key)) is not None
            and (len(key) == 1 or not last.bidirectional)
        ]
        parts.append(f"From '{names[0]}' to '{names[-1]}': {', '.join(changes)}.")
        if scatter:
            parts.append(
                f"The scatter (4 s = {amount(max(scatter), unit)}) is what no table "
                "removes."
            )
    name, accuracy = last.judged()
    systematic = last.E if last.E is not None else last.E_up or last.E_down
    if accuracy is not None and systematic is not None and scatter and len(tests) == 1:
        parts.append(
            f"Of {with_arrows(name)} = {amount(accuracy, unit)}, the means alone span "
            f"{amount(systematic, unit)}: that part a compensation table can remove. "
            f"The scatter, up to 4 s = {amount(max(scatter), unit)}, stays under any "
            "table."
        )
        doubt = _doubt_of_means(last)
        if doubt > 0.25 * systematic:
            parts.append(
                f"The means are themselves known only to ±{amount(doubt, unit)} "
                "(s/√n): measure more runs before a table is made of them."
            )
    widest = widest_reversal(last)
    if len(tests) == 1 and widest is not None and widest.B is not None:
        parts.append(
            f"The two directions lie furthest apart at {widest.target:g}{long}: "
            f"B = {amount(abs(widest.B), unit)}."
        )
    drift = describe_drift(last, unit=unit)
    return " ".join([*parts, drift] if drift else parts)


_FINEST = 5e-5
"""0.05 µm: what is printed as 0.0 is nothing to speak of."""


def describe_drift(test: Iso230, *, unit: str = "mm") -> str:
    """Return a sentence where whole runs lie apart beyond their scatter, else ``""``.

    A run's mean over n readings scatters by s/√n; runs that differ by more than four
    times that (at a quarter of R or more) have drifted, by warming up or a loose
    reference.
    """
    offsets = list(test.run_offsets.values())
    scatter = [value for value in (test.R_up, test.R_down) if value is not None]
    if len(offsets) < 2 or not scatter:
        return ""
    spread = max(offsets) - min(offsets)
    within = _within_runs(test)
    readings = sum(run.error.size for run in test.runs) / len(offsets)
    if (
        spread < _FINEST
        or spread < 0.25 * max(scatter)
        or spread < 4.0 * within / math.sqrt(readings)
    ):
        return ""
    return (
        f"Whole runs lie up to {amount(spread, unit)} apart: drift between runs "
        "(warm-up, loose reference), which R counts as scatter."
    )


def widest_reversal(test: Iso230) -> Iso230Position | None:
    """Return the position with the largest reversal, or None without two directions."""
    both = [item for item in test.positions if item.B is not None]
    return max(both, key=lambda item: abs(item.B or 0.0)) if both else None


def with_arrows(name: str) -> str:
    """Return the name of a figure as the standard prints it: ``R_up`` is R↑."""
    return name.replace("_up", "↑").replace("_down", "↓")


def amount(value: float, unit: str) -> str:
    """Return a deviation in mm or ° as text, in µm or m° with one decimal."""
    return f"{value * 1e3:.1f} {small_unit(unit)}"


def _doubt_of_means(test: Iso230) -> float:
    """Return the largest standard error s/√n of a mean in mm."""
    return max(
        s / math.sqrt(n)
        for p in test.positions
        for s, n in ((p.s_up, p.runs_up), (p.s_down, p.runs_down))
        if s is not None
    )


def _within_runs(test: Iso230) -> float:
    """Return the scatter in mm that is left when each run's offset is taken off."""
    means = {
        (p.target, side): mean
        for p in test.positions
        for side, mean in ((1, p.mean_up), (-1, p.mean_down))
    }
    residual = [
        value - (means[target, run.direction] or 0.0) - test.run_offsets[run.run]
        for run in test.runs
        for target, value in zip(run.target.tolist(), run.error.tolist(), strict=True)
    ]
    return math.sqrt(sum(value**2 for value in residual) / max(len(residual) - 1, 1))
