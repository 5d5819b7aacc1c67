"""First steps of a load sheet: one slow move per sign that nothing has settled."""

from collections.abc import Sequence

from ._draft import AbstractDraft, Switch
from ._job_result import LoadStep
from ._load import Job
from ._result import AbstractResult, Expectation
from ._verdict import Code

_SHOWN = {"mm": ("µm", 1e3), "deg": ("· 0.001°", 1e3)}


def sign_steps(
    job: Job, drafts: Sequence[AbstractDraft], results: Sequence[AbstractResult]
) -> list[LoadStep]:
    """Return what settles the signs that are assumed: the probe, or a slow move each.

    Args:
        job: The job.
        drafts: All fits.
        results: What came of them, in the same order.
    """
    steps: list[LoadStep] = []
    for draft, result in zip(drafts, results, strict=True):
        judged, switch = result.judgement, draft.switch
        if switch is None or not judged.has(Code.ASSUMED):
            continue
        open_ = next(r for r in judged.reasons if r.code is Code.ASSUMED)
        words = (
            f"Computed; sign unproven: {', '.join(open_.fields['conventions'])} assumed,"
            " no measurement has settled that."
        )
        if not switch.adds_current:
            words += (
                f" Load the lists of axcomp probe {job.path.name} instead: one log or"
                " one dial settles every table."
            )
        axis = job.spec.axes[draft.axis]
        unit = "mm/s" if axis.kind == "linear" else "°/s"
        expected = result.expectation
        if expected is not None:
            start = "" if switch.adds_current else " Or, with the new lists in place: "
            words += start + _move(job.spec.nc_word(draft.axis), switch, expected, unit)
        steps.append(
            LoadStep(
                f"Settle the sign first: {draft.compensation} of {draft.axis}", words
            )
        )
    return steps


def _move(axis: str, switch: Switch, expected: Expectation, per_second: str) -> str:
    """Return the slow move that shows a sign, and what to see; speeds in that unit."""
    unit, factor = _SHOWN.get(expected.unit, (expected.unit, 1.0))
    off, on = (f"{axis}[COMP {word} {switch.keyword}]" for word in ("OFF", "ON"))
    if expected.speed is not None:
        return (
            f" Move {axis} positive at {expected.speed:g} {per_second}, {off}, then {on}: the list"
            f" adds {expected.value:+.3g} {unit}, so the current that the controller asks"
            f" for beside it must fall by as much. Where it rises instead, the sign is"
            " wrong: take the list out."
        )
    value = factor * expected.value
    if expected.reversal:
        (place,) = expected.places.values()
        return (
            f"come to {axis} = {place:.4g} slowly from one side, {off}, set a dial on"
            f" {axis} to zero, overshoot by some mm and come back from the other side: the"
            f" dial is off by {value:.1f} {unit}; with {on} by 0, and by {2 * value:.1f}"
            f" {unit} where the sign is wrong."
        )
    where = " and ".join(f"{name} = {at:.6g}" for name, at in expected.places.items())
    come = f"move slowly to {where}" if where else f"stop {axis} anywhere"
    if expected.direction is not None:
        come += f" in {'positive' if expected.direction > 0 else 'negative'} direction"
    if expected.temperatures:
        warm = ", ".join(
            f"{name} at {at:.1f} °C" for name, at in expected.temperatures.items()
        )
        come += f" with {warm}"
    return (
        f"{come}, {off}, set a dial on {axis} to zero, {on}: it must show {axis} moved by"
        f" {value:+.1f} {unit}. Where it shows {-value:+.1f} {unit}, the sign is wrong:"
        " take the list out."
    )
