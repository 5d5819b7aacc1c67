"""The load sheet: which file goes where, in which order, how to see it and go back."""

from collections.abc import Iterator, Sequence

from ..diagnosis import OBJECTS, SCOPE
from ._draft import AbstractDraft
from ._first_run import first_run_programs, nameless
from ._job_result import LoadStep
from ._lists import AxisFiles
from ._load import Job
from ._result import AbstractResult, Expectation
from ._verdict import Code

_SYNCHRONISED = (
    "After: drives on, axes referenced, and in each channel #CHANNEL INIT [CMDPOS] first:"
    " until it has asked for its positions, start no program in quick succession and"
    " exchange no axis."
)
"""What [001] p.27 asks for after start-up and reload."""


def load_sheet(
    job: Job,
    files: Sequence[AxisFiles],
    drafts: Sequence[AbstractDraft],
    results: Sequence[AbstractResult],
    rejected: Sequence[str],
) -> tuple[LoadStep, ...]:
    """Return the steps that bring the lists of a job onto the controller.

    The first ones settle signs that are assumed, the last one measures again.

    Args:
        job: The job.
        files: Lists by axis.
        drafts: All fits.
        results: What came of them, in the same order.
        rejected: Axes whose lists failed the gate: they have no step.
    """
    steps: list[LoadStep] = []
    for axis in rejected:
        steps.append(
            LoadStep(
                "Do not load",
                f"The list of {axis} failed the gate and lies in rejected/.",
            )
        )
    let_out = [one for one in files if one.axis not in rejected and one.lists]
    if not let_out:
        return tuple(steps)
    steps += sign_steps(job, drafts, results)
    for one in let_out:
        steps += _files_of(job, one)
    steps += _loading(job, let_out)
    steps += _first_run(job, let_out, drafts)
    for one in let_out:
        steps += _switching(job, one, drafts)
    steps += _watching(job, let_out, drafts)
    steps.append(
        LoadStep(
            "Go back",
            "COMP OFF for the axis, or the kept copies and a reload"
            " (a restart where a size changed).",
        )
    )
    return (*steps, *_measuring(job, drafts, results))


def _measuring(
    job: Job, drafts: Sequence[AbstractDraft], results: Sequence[AbstractResult]
) -> list[LoadStep]:
    """Return the second measurement, where none has shown yet what the lists do."""
    unproven = [
        draft.kind
        for draft, one in zip(drafts, results, strict=True)
        if draft.written and not one.confirmed
    ]
    if not unproven:
        return []
    if all(kind.adds_current for kind in unproven):
        return [
            LoadStep(
                "Measure once more with the list active",
                "A circle without and with it: a wrong sign would make the marks at"
                " reversals larger. A log of the controller settles the sign (axcomp"
                " verify --save).",
            )
        ]
    return [
        LoadStep(
            "Measure once more with the list active",
            "Until then the error after is computed, not verified: a wrong sign would"
            " double the error. Put the second measurement into a job AFTER.toml (same axes and"
            " measurements, list = the file that was loaded, active = what was on):"
            f" axcomp fit {job.path.name} --after AFTER.toml, with the same --out, says"
            " what became of each error and settles the signs.",
        )
    ]


def _files_of(job: Job, one: AxisFiles) -> Iterator[LoadStep]:
    if one.compensation is not None:
        yield from _compensation_list(job, one)
    if one.machine is not None:
        yield _axis_list(job, one)
    for name in one.extra:
        if name.endswith(".TcPOU"):
            continue  # the same program as the .st, whose step names it
        yield _for_the_plc(job, one, name)


def _loading(job: Job, files: Sequence[AxisFiles]) -> list[LoadStep]:
    """Return the one restart or reload that takes over the lists of all axes."""
    reasons = [f"{one.axis}: {one.restart}." for one in files if one.restart]
    if reasons:
        return [LoadStep("Restart the controller", " ".join([*reasons, _SYNCHRONISED]))]
    changed = [
        one for one in files if any(name not in one.same for name, _ in one.lists)
    ]
    if not changed:
        return []
    axes = ", ".join(one.axis for one in changed)
    detail = (
        f"No size of a table of {axes} changes. Before: end all NC programs, stop all"
        f" axes, drives off. {_SYNCHRONISED}"
    )
    by_hand = [
        one.machine_name
        for one in changed
        if one.machine is not None and job.spec.axes[one.axis].machine_data is None
    ]
    if by_hand:
        detail += (
            f" A restart instead where a line of {', '.join(by_hand)} was not in the axis"
            " list yet: axis lists are not updated at run time."
        )
    return [LoadStep("Reload the lists", detail)]


def _compensation_list(job: Job, one: AxisFiles) -> list[LoadStep]:
    axis = job.spec.axes[one.axis]
    if one.is_new:
        return [
            LoadStep(
                f"Put {one.compensation_name} in place",
                f"It is the whole compensation list of {one.axis} (axis {axis.number})."
                " Only where this axis has no list yet: copied over another one, it"
                " would lose that one's other compensations. Announce it by the"
                " entries in hochlauf.add.lis, or as the System Manager does.",
            )
        ]
    if one.compensation_name in one.same:
        return [_leave(axis.listing, one.compensation_name)]
    return [
        LoadStep(f"Keep a copy of {axis.listing}", "It is the way back."),
        LoadStep(
            f"Replace {axis.listing} by {one.compensation_name}",
            "Only the entries of the new tables differ (axcomp diff shows them).",
        ),
    ]


def _leave(own: str | None, name: str) -> LoadStep:
    return LoadStep(f"Leave {own} as it is", f"It says what {name} says.")


def _axis_list(job: Job, one: AxisFiles) -> LoadStep:
    axis = job.spec.axes[one.axis]
    if one.machine_name in one.same:
        return _leave(axis.machine_data, one.machine_name)
    if axis.machine_data is not None:
        return LoadStep(
            f"Put {one.machine_name} in place",
            f"Keep a copy of {axis.machine_data}, then replace it.",
        )
    return LoadStep(
        f"Enter the lines of {one.machine_name}",
        f"By hand into the axis list of {one.axis}; the file holds these"
        " entries only and must not be copied over it.",
    )


def _for_the_plc(job: Job, one: AxisFiles, name: str) -> LoadStep:
    if name.endswith(".st"):
        objects = " and ".join(each for each in one.extra if each.endswith(".TcPOU"))
        return LoadStep(
            f"Take {name} into the PLC project",
            f"In TwinCAT XAE: POUs, Add, Existing Item, {objects}, which hold the same."
            " Its function block FB_TempComp_… is called in every cycle of a PLC task"
            " with the temperatures and their fault bits; it needs the library"
            " Tc2_System. It writes TEMPC::position_0, offset_0 and coefficient of"
            f" {one.axis} (index offsets of axis"
            f" {job.spec.axes[one.axis].number}: compare with the object browser)."
            " Load the axis list first: without the program it corrects nothing. A PLC"
            " that stops leaves its last values in the CNC: COMP OFF TEMP then.",
        )
    return LoadStep(
        f"Keep {name}",
        "The same law for people and for axcomp simulate: °C, mm, µm/m. Nothing reads"
        " it on the machine.",
    )


def _first_run(
    job: Job, files: Sequence[AxisFiles], drafts: Sequence[AbstractDraft]
) -> list[LoadStep]:
    """Return the programs that go through the compensations of each channel."""
    steps = [
        LoadStep(
            f"Start {name}",
            "Alone in its channel, axes referenced. It checks that each compensation is"
            " initialised and active, switches it off and on with NO_MOVE, waits at each"
            " M00, and leaves it as it was. Read it first: its axis words are those of"
            " the job (nc_name, or the key).",
        )
        for name in first_run_programs(job, files, drafts, ())
    ]
    return steps + [
        LoadStep(
            f"Give {axis} a word",
            f"No NC program understands {job.spec.nc_word(axis)!r}: set nc_name in"
            f" [axes.{axis}], and a first run goes through its compensations too.",
        )
        for axis in nameless(job, [one.axis for one in files])
    ]


def _switching(
    job: Job, one: AxisFiles, drafts: Sequence[AbstractDraft]
) -> list[LoadStep]:
    """Return how the compensations of an axis are switched on, one by one."""
    name = job.spec.nc_word(one.axis)
    steps = []
    for draft in drafts:
        if draft.axis != one.axis or not draft.written:
            continue
        word = draft.kind.keyword
        detail = f"{draft.needs}. {name}[COMP ON {word}] switches it on"
        if draft.fit.manual_activation:
            detail += " and is needed in every NC program (manual_activation 1)"
        else:
            detail += " where it was switched off; after COMP OFF it does not return"
            detail += " by itself"
        detail += (
            f". Check: $IF V.A.{word}_COMP_ACTIVE.{name} != TRUE … $ENDIF. Wait for"
            " standstill before switching."
        )
        steps.append(LoadStep(f"Switch on {draft.compensation} of {one.axis}", detail))
    return steps


def _watching(
    job: Job, files: Sequence[AxisFiles], drafts: Sequence[AbstractDraft]
) -> Iterator[LoadStep]:
    names = {one.axis for one in files}
    words: dict[str, list[str]] = {}
    shown: list[str] = []
    currents: list[str] = []
    for draft in drafts:
        if draft.axis not in names or not draft.written:
            continue
        kind = draft.kind
        if kind.demanded:
            words.setdefault(draft.axis, []).append(kind.keyword)
        name = job.spec.nc_word(draft.axis)
        own = currents if kind.adds_current else shown
        own.append(f"{kind.variable}.{name}")
    demands = "; ".join(f"{axis}: {' | '.join(own)}" for axis, own in words.items())
    if demands:
        yield LoadStep(
            "Demand them in automatic mode",
            "lr_param.prog_movement_requires_compensations (P-AXIS-00465) stops a"
            f" program that moves without them: {demands}.",
        )
    if shown:
        yield LoadStep(
            "See that it works",
            f"Read {', '.join(shown)} at a few positions and compare with axcomp"
            " simulate. Displays have the compensation removed; the positions on the"
            f" drive bus contain it. {SCOPE} records what {OBJECTS} lists: complete the"
            " positions in TwinCAT Scope, move, export as text; axcomp verify --log"
            " judges the export as it is.",
        )
    if currents:
        yield LoadStep(
            "See that it works",
            f"Read {', '.join(currents)} at a few speeds in both directions and"
            " compare with axcomp simulate. It is a current: no position contains"
            " it.",
        )


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
        judged, kind = result.judgement, draft.kind
        if not draft.written or not judged.has(Code.ASSUMED):
            continue
        open_ = next(r for r in judged.reasons if r.code is Code.ASSUMED)
        words = (
            f"Computed; sign unproven: {', '.join(open_.fields['conventions'])} assumed,"
            " no measurement has settled that."
        )
        if not kind.adds_current:
            words += (
                f" Load the lists of axcomp probe {job.path.name} instead: one log or"
                " one dial settles every table."
            )
        axis = job.spec.axes[draft.axis]
        unit = f"{axis.unit}/s"
        expected = result.expectation
        if expected is not None:
            start = "" if kind.adds_current else " Or, with the new lists in place: "
            word = job.spec.nc_word(draft.axis)
            words += start + _move(word, kind.keyword, expected, unit)
        steps.append(
            LoadStep(
                f"Settle the sign first: {draft.compensation} of {draft.axis}", words
            )
        )
    return steps


def _move(axis: str, keyword: str, expected: Expectation, per_second: str) -> str:
    """Return the slow move that shows a sign, and what to see; speeds in that unit."""
    unit, factor = _SHOWN.get(expected.unit, (expected.unit, 1.0))
    off, on = (f"{axis}[COMP {word} {keyword}]" for word in ("OFF", "ON"))
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
