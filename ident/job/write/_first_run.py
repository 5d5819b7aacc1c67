"""The NC program of a first run: what a person at the machine starts after the reload.

One program per channel. It checks that each compensation is initialised and active ([001]
p.95), switches it off and on (p.94), waits in between, and leaves it as it was; nothing moves
by itself. The text stands in ``first_run.nc.jinja``. `#VAR`, ``V.L.`` and ``#CHANNEL INIT`` are
those of the programming manual of TF5200.
"""

import re
from collections.abc import Sequence

from ..._templates import templates
from ...diagnosis import AXIS_WORD, CompState, declared, numbered
from ...kinds import Kind
from ..file._load import Job
from ._lists import AxisFiles

_Step = tuple[Kind, list[CompState]]
"""A compensation, and the axes on which it is switched at once."""


def program_name(channel: int) -> str:
    """Return the name of the program of a channel."""
    return f"first_run_{channel}.nc"


def program_names(job: Job) -> tuple[str, ...]:
    """Return the names of all programs that a job may write."""
    channels = {job.spec.axes[fit.axis].channel for fit in job.spec.fits}
    return tuple(program_name(channel) for channel in sorted(channels))


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
    steps: dict[tuple[int, frozenset[str], Kind], list[CompState]] = {}
    for draft in sorted(drafts, key=lambda draft: draft.index):
        channel, kind = job.spec.axes[draft.axis].channel, draft.kind
        # Both axes of a gantry at once: one of them alone would twist it.
        step = steps.setdefault((channel, together(job, draft.axis), kind), [])
        step.append(CompState(job.spec.nc_word(draft.axis), kind.keyword))
    channels: dict[int, list[_Step]] = {}
    for (channel, _, kind), states in steps.items():
        channels.setdefault(channel, []).append((kind, states))
    title = job.spec.title or job.path.stem
    return {
        program_name(channel): _program(channel, probes, title)
        for channel, probes in sorted(channels.items())
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
    # Words are checked, the title is a comment.
    template = templates(__package__ or "").get_template("first_run.nc.jinja")
    text = template.render(
        channel=channel,
        steps=steps,
        declared=declared(states),
        words=list(dict.fromkeys(state.word for state in states)),
        title=title,
    )
    return numbered(text.splitlines())
