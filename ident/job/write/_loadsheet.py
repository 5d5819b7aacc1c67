"""What a person does with the files: the load sheet, and the NC programs of a first run.

The sheet says which file goes where, in which order, how to see it and go back; its sentences
stand in ``load_sheet.txt.jinja``. A first run is started at the machine after the reload, one
program per channel: it checks that each compensation is initialised and active ([001] p.95),
switches it off and on (p.94), waits in between, and leaves it as it was; nothing moves by
itself. Its text stands in ``first_run.nc.jinja``. `#VAR`, ``V.L.`` and ``#CHANNEL INIT`` are
those of the programming manual of TF5200.
"""

import dataclasses
import re
from collections.abc import Sequence
from typing import Any

from ....data.units import small_unit
from ..._templates import templates
from ...diagnosis import AXIS_WORD, OBJECTS, SCOPE, CompState, declared, numbered
from ...kinds import Kind
from .._draft import AbstractDraft
from ..file._load import Job
from ..result._job_result import LoadStep
from ..result._result import AbstractResult
from ..result._verdict import Code, Verdict
from ._lists import AxisFiles

_DIAL = 1e-3
"""mm or °: what a dial does not show settles no sign."""
_Step = tuple[Kind, list[CompState]]
"""A compensation, and the axes on which it is switched at once."""


def _line(job: Job, draft: AbstractDraft, result: AbstractResult) -> dict[str, Any]:
    """Return what the sheet says of a written fit.

    It is ``refuted`` where a second measurement speaks against it.
    """
    kind, word, judged = draft.kind, job.spec.nc_word(draft.axis), result.judgement
    open_ = [reason for reason in judged.reasons if reason.code is Code.ASSUMED]
    assumed = open_[0].fields["conventions"] if open_ else ()
    expected = result.expectation if open_ else None
    seen: dict[str, Any] = {"expected": None}
    if expected is not None and (kind.adds_current or abs(expected.value) >= _DIAL):
        places = {job.spec.nc_word(name): at for name, at in expected.places.items()}
        unit, factor = expected.unit, 1.0
        if unit in {"mm", "deg"}:
            unit, factor = small_unit(unit), 1e3
        seen = {"value": factor * expected.value, "unit": unit}
        seen["expected"] = dataclasses.replace(expected, places=places)
    worse = judged.has(Code.DIAGNOSED) or judged.has(Code.NO_BETTER)
    words = [job.spec.nc_word(axis) for axis in sorted(together(job, draft.axis))]
    return seen | {
        "pair": words if len(words) > 1 else [],
        "off": " ".join(f"{each}[COMP OFF {kind.keyword}]" for each in words),
        "on": " ".join(f"{each}[COMP ON {kind.keyword}]" for each in words),
        "name": draft.fit.name,
        "axis": draft.axis,
        "word": word,
        "keyword": kind.keyword,
        "variable": f"{kind.variable}.{word}",
        "current": kind.adds_current,
        "manual": bool(draft.fit.manual_activation),
        "needs": draft.needs,
        "refuted": worse and judged.verdict is Verdict.REJECTED,
        "length": job.spec.axes[draft.axis].unit,
        "conventions": assumed,
        "beside": [rule.name for rule in result.rests_on if rule.name in assumed],
    }


def load_sheet(
    job: Job,
    files: Sequence[AxisFiles],
    results: Sequence[AbstractResult],
    programs: Sequence[str],
) -> tuple[LoadStep, ...]:
    """Return the steps that bring the lists of a job onto the controller.

    The first ones settle signs that are assumed, the last one measures again. Axes whose
    lists failed the gate have no step.
    """
    drafts = sorted((d for axis in files for d in axis.drafts), key=lambda d: d.index)
    pairs = [(d, r) for d, r in zip(drafts, results, strict=True) if d.written]
    lines = [_line(job, draft, result) for draft, result in pairs]
    # What the job asked for is not known: the list in the folder is a part of it.
    withheld = {
        draft.axis: reason.fields["message"]
        for draft, result in pairs
        for reason in result.judgement.reasons
        if reason.code is Code.ERROR
    }
    let_out = [
        axis
        for axis in files
        if axis.lists and not axis.failed and axis.axis not in withheld
    ]
    axes = [axis.axis for axis in let_out]
    written = [line for line in lines if line["axis"] in axes]
    changed = [
        axis for axis in let_out if any(name not in axis.same for name, _ in axis.lists)
    ]
    demanded: dict[str, list[str]] = {}
    for draft, _ in pairs:
        if draft.axis in axes and draft.kind.demanded:
            demanded.setdefault(draft.axis, []).append(draft.kind.keyword)
    template = templates(__package__ or "").get_template("load_sheet.txt.jinja")
    text = template.render(
        job=job.path.name,
        axes=job.spec.axes,
        rejected=[axis.axis for axis in files if axis.failed],
        refuted=[line["name"] for line in written if line["refuted"]],
        files=let_out,
        withheld=withheld,
        unsettled=[line for line in written if line["conventions"]],
        plc_objects={
            axis.axis: " and ".join(
                name for name in axis.extra if name.endswith(".TcPOU")
            )
            for axis in let_out
        },
        restarts=[axis for axis in let_out if axis.restart],
        changed=changed,
        by_hand=[
            axis.machine_name
            for axis in changed
            if axis.machine is not None and axis.existing.machine is None
        ],
        programs=programs,
        nameless=[(axis, repr(job.spec.nc_word(axis))) for axis in nameless(job, axes)],
        written=written,
        demanded=[f"{axis}: {' | '.join(own)}" for axis, own in demanded.items()],
        shown=[line["variable"] for line in written if not line["current"]],
        currents=[line["variable"] for line in written if line["current"]],
        unproven=[draft.kind for draft, result in pairs if not result.confirmed],
        scope=SCOPE,
        objects=OBJECTS,
    )
    steps = [part.splitlines() for part in re.split(r"^## ", text, flags=re.M)[1:]]
    return tuple(LoadStep(action, " ".join(lines)) for action, *lines in steps)


def program_names(job: Job) -> tuple[str, ...]:
    """Return the names of all programs that a job may write."""
    channels = {job.spec.axes[fit.axis].channel for fit in job.spec.fits}
    return tuple(f"first_run_{channel}.nc" for channel in sorted(channels))


def first_run_programs(job: Job, files: Sequence[AxisFiles]) -> dict[str, str]:
    """Return the programs of a job in ASCII, by name of the file.

    Axes whose lists failed have no part in them, nor have axes without a word that an NC
    program understands (`nameless`).
    """
    unnamed = nameless(job, [axis.axis for axis in files])
    let_out = [
        axis
        for axis in files
        if axis.lists and not (axis.failed or axis.axis in unnamed)
    ]
    drafts = [draft for axis in let_out for draft in axis.drafts if draft.written]
    channels: dict[int, dict[tuple[frozenset[str], Kind], list[CompState]]] = {}
    for draft in sorted(drafts, key=lambda draft: draft.index):
        # Both axes of a gantry at once: one of them alone would twist it.
        switched = together(job, draft.axis), draft.kind
        steps = channels.setdefault(job.spec.axes[draft.axis].channel, {})
        state = CompState(job.spec.nc_word(draft.axis), draft.kind.keyword)
        steps.setdefault(switched, []).append(state)
    title = job.spec.title or job.path.stem
    return {
        f"first_run_{channel}.nc": _program(
            channel, [(kind, states) for (_, kind), states in steps.items()], title
        )
        for channel, steps in sorted(channels.items())
    }


def together(job: Job, axis: str) -> frozenset[str]:
    """Return an axis with its partners in a gantry of the same channel."""
    axes = job.spec.axes
    every = (axis, *job.spec.partners(axis))
    return frozenset(n for n in every if axes[n].channel == axes[axis].channel)


def nameless(job: Job, axes: Sequence[str]) -> tuple[str, ...]:
    """Return those axes whose word no NC program understands."""
    return tuple(
        axis for axis in axes if not re.fullmatch(AXIS_WORD, job.spec.nc_word(axis))
    )


def _program(channel: int, steps: Sequence[_Step], title: str) -> str:
    states = [state for _, axes in steps for state in axes]
    template = templates(__package__ or "").get_template("first_run.nc.jinja")
    # Words are checked, the title is a comment.
    text = template.render(
        channel=channel,
        steps=steps,
        declared=declared(states),
        words=list(dict.fromkeys(state.word for state in states)),
        title=title,
    )
    return numbered(text.splitlines())
