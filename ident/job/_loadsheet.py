"""The load sheet: which file goes where, in which order, how to see it and go back."""

from collections.abc import Sequence

from ._draft import AbstractDraft
from ._lists import AxisFiles
from ._load import Job
from ._result import LoadStep


def load_sheet(
    job: Job,
    files: Sequence[AxisFiles],
    drafts: Sequence[AbstractDraft],
    rejected: Sequence[str],
) -> tuple[LoadStep, ...]:
    """Return the steps that bring the lists of a job onto the controller.

    Args:
        job: The job.
        files: Lists by axis.
        drafts: All fits.
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
    for one in let_out:
        steps += _files_of(job, one)
    for one in let_out:
        steps += _switching(job, one, drafts)
    steps += _watching(job, let_out, drafts)
    return tuple(steps)


def _files_of(job: Job, one: AxisFiles) -> list[LoadStep]:
    steps: list[LoadStep] = []
    if one.compensation is not None:
        steps += _compensation_list(job, one)
    if one.machine is not None:
        steps.append(_axis_list(job, one))
    for name in one.extra:
        steps.append(_for_the_plc(job, one, name))
    if one.restart is None:
        action, detail = (
            "Reload the lists",
            f"No size of a table of {one.axis} changes.",
        )
    else:
        action, detail = "Restart the controller", f"{one.axis}: {one.restart}."
    steps.append(LoadStep(action, detail))
    return steps


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
    return [
        LoadStep(f"Keep a copy of {axis.listing}", "It is the way back."),
        LoadStep(
            f"Replace {axis.listing} by {one.compensation_name}",
            "Only the entries of the new tables differ (axcomp diff shows them).",
        ),
    ]


def _axis_list(job: Job, one: AxisFiles) -> LoadStep:
    axis = job.spec.axes[one.axis]
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
        return LoadStep(
            f"Take {name} into the PLC project",
            "Its function block FB_TempComp_… is called in every cycle of a PLC task"
            " with the temperatures and their fault bits; it needs the library"
            " Tc2_System. It writes TEMPC::position_0, offset_0 and coefficient of"
            f" {one.axis} (index offsets of axis"
            f" {job.spec.axes[one.axis].number}: compare with the object browser)."
            " Load the axis list first: without the program it corrects nothing.",
        )
    return LoadStep(
        f"Keep {name}",
        "The same law for people and for axcomp simulate: °C, mm, µm/m. Nothing reads"
        " it on the machine.",
    )


def _switching(
    job: Job, one: AxisFiles, drafts: Sequence[AbstractDraft]
) -> list[LoadStep]:
    """Return how the compensations of an axis are switched on, one by one."""
    name = job.spec.axes[one.axis].name or one.axis
    steps = []
    for draft in drafts:
        switch = draft.switch
        if draft.axis != one.axis or switch is None:
            continue
        word = switch.keyword
        detail = f"{switch.needs}. {name}[COMP ON {word}] switches it on"
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
) -> list[LoadStep]:
    names = {one.axis for one in files}
    words: dict[str, list[str]] = {}
    shown: list[str] = []
    for draft in drafts:
        switch = draft.switch
        if draft.axis not in names or switch is None:
            continue
        if switch.demanded:
            words.setdefault(draft.axis, []).append(switch.keyword)
        name = job.spec.axes[draft.axis].name or draft.axis
        shown.append(f"V.A.{switch.keyword}_COMP_CURR.{name}")
    demands = "; ".join(f"{axis}: {' | '.join(own)}" for axis, own in words.items())
    readings = ", ".join(shown)
    steps = []
    if demands:
        steps.append(
            LoadStep(
                "Demand them in automatic mode",
                "lr_param.prog_movement_requires_compensations (P-AXIS-00465) stops a"
                f" program that moves without them: {demands}.",
            )
        )
    return [
        *steps,
        LoadStep(
            "See that it works",
            f"Read {readings} at a few positions and compare with axcomp simulate."
            " Displays have the compensation removed; the positions on the drive bus"
            " contain it.",
        ),
        LoadStep(
            "Measure once more with the list active",
            "Until then the error after is computed, not verified: a wrong sign would"
            " double the error, and only a second measurement or a log shows it.",
        ),
        LoadStep(
            "Go back",
            "COMP OFF for the axis, or the kept copies and a reload"
            " (a restart where a size changed).",
        ),
    ]
