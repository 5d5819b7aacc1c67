"""The page of a new job: axes, measurements, fits and gate, with what they ask."""

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...data.lists import ListFile
from ...data.measurements import PROBED_HEIGHTS, CellError, ColumnSpec, Table
from .._job_text import job_line
from ..job import (
    Job,
    JobFile,
    asks_for_owner,
    is_negligible,
    trend_words,
)
from ..kinds import kind
from ..proof import GateLimits
from ..readings import Observation
from ._columns import Meaning, Unclear, own_roles
from ._fits import Suggestion, trend_in
from ._text import JobPage


@dataclasses.dataclass(frozen=True)
class Source:
    """A measurement of the job: its name, its file, what that means, and damaged lines of it."""

    name: str
    table: Table
    meaning: Meaning
    damaged: Sequence[CellError] = ()

    @property
    def roles(self) -> dict[str, ColumnSpec]:
        """Column of each role, the likeliest where it is not clear."""
        return self.meaning.likeliest or own_roles(self.table, self.meaning.axis)


WHOLE_TURN = [0.0, 360.0]
"""Range in ° of an axis whose display begins anew."""


@dataclasses.dataclass(frozen=True)
class Axis:
    """What is known of an axis.

    Attributes:
        number: Of the controller; None: not known.
        lists: Its files by key of the job, each as given and as read.
        rotary: Its positions are angles.
        endless: They begin anew in motion.
        assumed: Column that is taken for its own although nobody says so, or None.
        span: Smallest and largest position in the measurements, or None.
    """

    number: int | None
    lists: Mapping[str, tuple[Path, ListFile]]
    rotary: bool = False
    endless: bool = False
    assumed: str | None = None
    span: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True)
class _Holder:
    """A list that holds a compensation already.

    Attributes:
        name: Of the file.
        over: Axes that its table follows, as far as it names them.
        same_axes: The new table follows the same, as far as the numbers of axes are known.
    """

    name: str
    over: tuple[str, ...]
    same_axes: bool


@dataclasses.dataclass(frozen=True)
class Contents:
    """What a job is written of.

    Attributes:
        job: With the likeliest answers, through which the readings were looked at.
        observation: Its readings.
        sources: Its measurements.
        axes: By name.
        fits: That the readings would bear, the plain ones active.
    """

    job: Job
    observation: Observation
    sources: Sequence[Source]
    axes: Mapping[str, Axis]
    fits: Sequence[Suggestion]

    def units(self, name: str, role: str) -> list[str]:
        """Return the units that the column of a role may have."""
        meaning = next(each.meaning for each in self.sources if each.name == name)
        pairs = [*meaning.columns.items()]
        pairs += [pair for each in meaning.unclear for pair in each.choices]
        return [each.unit for text, each in pairs if text == role and each.unit]


def relative(file: Path, job: Path) -> str:
    """Return the path of a file as it stands in a job."""
    return Path(os.path.relpath(file, job.parent)).as_posix()


def page_of(contents: Contents) -> JobPage:
    """Return the job with its questions, all but its head."""
    page = JobPage()
    for name, axis in contents.axes.items():
        _write_axis(page, contents.job.path, name, axis)
    for source in contents.sources:
        _write_measurement(page, contents, source)
    for fit in contents.fits:
        _write_fit(page, contents, fit)
    if not any(fit.plain for fit in contents.fits):
        page.note("No compensation suits what was measured: see the columns above.", "")
    if any(not fit.plain for fit in contents.fits):
        page.note("What the readings ask for, in place of the fits above, is found by:")
        page.add(
            f"#     axcomp discover {contents.job.path.name} --write fits.toml", ""
        )
    page.add("[gate]")
    page.note("Limits that a list must keep to be written; these are the defaults.")
    for name, limit in GateLimits():
        if limit is not None:
            page.key(f"# {job_line(name, limit)}", "")
    return page


def _write_axis(page: JobPage, job: Path, name: str, axis: Axis) -> None:
    page.add(f"[axes.{name}]")
    if axis.number is not None:
        page.key(job_line("number", axis.number), "kopf.achs_nr")
    else:
        words = f"Which axis of the controller is {name} (kopf.achs_nr of its list)?"
        if axis.assumed is not None:
            words = (
                f'The file does not say of which axis "{axis.assumed}" is; it is called'
                f" {name} here. If it is another one, write the job anew with --axis and"
                f" its name. {words}"
            )
        page.ask(f"axes.{name}.number", words, ["number ="])
    for key, (path, _) in axis.lists.items():
        page.key(job_line(key, relative(path, job)), "as it is: edited, all else stays")
    if "list" not in axis.lists:
        file = f"achskw{axis.number or '<number>'}.lis"
        page.key(
            f'# list = "{file}"', "the list that is there now, if any: it is edited"
        )
    if axis.rotary:
        page.add(job_line("type", "rotary"))
    if axis.endless:
        page.key(job_line("modulo", WHOLE_TURN), "its positions begin anew in motion")
    elif axis.rotary:
        page.ask(
            f"axes.{name}.modulo",
            f"Does {name} go round without end? Without an answer it has two ends. If it goes"
            f" round, a leadscrew table of {name} covers the whole turn: modulo = true, and"
            " points with both ends of it.",
            [job_line("modulo", WHOLE_TURN)],
            needed=False,
        )
    if axis.span is not None and not axis.endless:
        low, high = (float(f"{end:.6g}") for end in axis.span)
        page.key(
            f"# limits = [{low:g}, {high:g}]", "software limits; here: as measured"
        )
    page.add("")


def _write_measurement(page: JobPage, contents: Contents, source: Source) -> None:
    table, meaning = source.table, source.meaning
    mine = [fit for fit in contents.fits if source.name in fit.sources and fit.plain]
    page.add(f"[measurements.{source.name}]")
    count = len(table.skipped)
    page.key(
        job_line("file", relative(table.path, contents.job.path)),
        f"{table.format}, {table.rows} rows, {count or 'no'} line{'s' * (count != 1)}"
        " skipped",
    )
    if not meaning.likeliest:
        page.note(*table.remarks)
    if source.damaged:
        _write_damaged(page, source)
    if meaning.axis is not None:
        page.key(job_line("axis", meaning.axis), "whose error it is")
    _write_active(page, source.name, contents.axes, mine)
    _write_zero(page, contents, source.name, mine)
    head = f"[measurements.{source.name}.columns]"
    if meaning.likeliest:
        page.add(head)
    elif source.roles:
        page.note("The columns name themselves; to change that, state all of them:")
        page.add(
            f"# {head}", *(f"# {_column_line(*each)}" for each in source.roles.items())
        )
    for text, spec in meaning.columns.items():
        page.add(_column_line(text, spec))
    for each in meaning.unclear:
        answers = [_column_line(text, spec) for text, spec in each.choices]
        about = f"measurements.{source.name}.columns"
        page.ask(about, _unclear_words(each), answers)
    if meaning.unused:
        page.note(f"Not used: {', '.join(meaning.unused)}.")
    page.add("")


def _write_damaged(page: JobPage, source: Source) -> None:
    lines = sorted(each.line for each in source.damaged)
    first = min(source.damaged, key=lambda each: each.line)
    more = f", and {len(lines) - 1} more" if len(lines) > 1 else ""
    page.ask(
        f"measurements.{source.name}.skip",
        f"Line {first.line}: {first.reason}{more}. Is the file to be repaired (the answer"
        " is not needed then), or are the lines left out?",
        [job_line("skip", lines)],
    )


def _column_line(role: str, spec: ColumnSpec) -> str:
    return job_line(role, spec.of_job())


_ASKED = {
    "role": "No column says that it is the {what} of {axis}. Which one is it?",
    "drift": 'No column says that it is an error: beside temperatures "{column}" is taken'
    " for what the axis at rest drifts by. Counts are of the unit inc, and need the axis's"
    " increment.",
    "probed": 'No column says that it is an error: beside the other positions "{column}"'
    " hardly moves, and is taken for what was probed.",
    "height": PROBED_HEIGHTS,
    "sign": "Corrections (trims), and targets less what was reached, are the negative of"
    " errors: sign = -1.",
    "instrument": 'Is "{column}" what an instrument outside of the machine showed (actual),'
    " or the machine's own reading (encoder)?",
    "direction": "{turned}",
    "positive": 'Which of the two in "{column}" is motion towards larger positions?',
    "column": "Which of these columns counts?",
    "unit": 'The file states no unit of "{column}", whose largest value is {largest:.4g}.'
    " Which one is it?",
}
"""What a column is asked, in the order of asking."""


def _unclear_words(each: Unclear) -> str:
    axis, _, kind = each.choices[0][0].partition(".")
    fields = {
        "axis": axis,
        "what": {"actual": "error or the actual position"}.get(kind, kind),
        "column": each.column,
        "largest": each.largest,
        "turned": "" if each.apart is None else _turned_words(each, *each.apart),
    }
    words = [text.format(**fields) for ask, text in _ASKED.items() if ask in each.asks]
    return " ".join(words)


def _turned_words(each: Unclear, apart: float, scatter: float) -> str:
    """Return the question for the direction of runs that no column names."""
    unit = each.choices[0][1].unit if "unit" not in each.asks else None
    one, back = (
        " ".join(filter(None, (f"{value:.2g}", unit))) for value in (scatter, apart)
    )
    seen = f"Every second run lies {back} from the others on the mean"
    if math.isfinite(scatter):
        seen += f", where those of a kind scatter by {one}"
    asked = (
        "No column says in which direction its run was measured: all in one, or there and"
        " back in turn (direction = 1 and -1)?"
    )
    if each.in_turn:
        return f"{asked} {seen}: they look like runs in turn."
    return f"{asked} {seen}. In turn, the table is one of both: bilateral = true."


def _write_active(
    page: JobPage, name: str, axes: Mapping[str, Axis], fits: Sequence[Suggestion]
) -> None:
    held = [(fit, holder) for fit in fits if (holder := _holder(axes, fit)) is not None]
    for fit, holder in held[:1]:
        over = f" over {' and '.join(holder.over)}" if holder.over else ""
        summed = "the new values are old + measured"
        if not holder.same_axes:
            summed = (
                f"nothing over {' and '.join(fit.over)} adds to it: measure without it"
            )
        page.ask(
            f"measurements.{name}.active",
            f"{holder.name} holds {fit.compensation} of {fit.axis}{over} already. Was it on"
            f" while measuring ({summed}), or off (they replace the old)?",
            [job_line("active", [fit.compensation]), job_line("active", [])],
        )
    if not held:
        page.key(job_line("active", []), "what was on while measuring; [] = all off")


def _holder(axes: Mapping[str, Axis], one: Suggestion) -> _Holder | None:
    """Return the list that holds a compensation already, or None."""
    facts = kind(one.compensation)
    key = "list" if facts.holder == "compensation" else "machine_data"
    path, listing = axes[one.axis].lists.get(key, (None, None))
    if path is None or listing is None:
        return None
    if not any(each.key.startswith(f"{facts.prefix}.") for each in listing.entries):
        return None
    masters = facts.entries.named_masters(listing)
    by_number = {axis.number: name for name, axis in axes.items()}
    over = tuple(by_number.get(number, f"axis {number}") for number in masters)
    return _Holder(path.name, over, not over or set(over) == set(one.over))


def _write_zero(
    page: JobPage, contents: Contents, name: str, fits: Sequence[Suggestion]
) -> None:
    """Ask whose constant and slope are, where they stand out of the readings of any fit.

    Also where they hardly do but would move the table, in a measurement beside one that is
    asked, and in one with a list that is there already: any zero is arbitrary.
    """
    quiet = []
    for fit in fits:
        trends = {
            source: trend_in(contents.job, contents.observation, fit, source)
            for source in fit.sources
        }
        if (own := trends[name]) is None:
            continue
        spec = contents.job.spec.model_dump(by_alias=True, exclude_none=True)
        of_job: Any = JobFile.model_validate(spec | {"fits": [fit.of_job]}).fits[0]
        words = trend_words(contents.job, of_job, own)
        needed = asks_for_owner(contents.job, own)
        beside = any(t and asks_for_owner(contents.job, t) for t in trends.values())
        held = _holder(contents.axes, fit) is not None
        if beside or held or not is_negligible(contents.job, own):
            _ask_for_owner(page, contents, name, fit, words, needed=needed)
            return
        quiet.append(words)
    if quiet:
        page.note(
            f"The readings show {quiet[0]}: both are negligible, and nothing has to be"
            ' answered here (by datum = { at = … }, or remove = "none", "offset" or "line").'
        )


def _ask_for_owner(
    page: JobPage,
    contents: Contents,
    name: str,
    one: Suggestion,
    words: str,
    *,
    needed: bool,
) -> None:
    observation = contents.observation
    rows = observation.data.source == observation.names.index(name)
    first = [
        round(float(observation.data.position[axis][rows][0]), 3) for axis in one.over
    ]
    at = {"at": first[0] if len(first) == 1 else first}
    remarks = {
        job_line("remove", "none"): "both are the machine's",
        job_line(
            "remove", "offset"
        ): "the constant is the instrument's, set to any zero",
        job_line("remove", "line"): "constant and slope are the instrument's",
        job_line("datum", at): "the machine's but for a constant: zero at this place",
    }
    asked = f"which the {one.compensation} table would take over. Whose are they?"
    if not needed:
        asked = (
            "which do not stand out; without an answer both are the machine's. Whose are"
            " they? Of one instrument, answer alike for all its measurements."
        )
    page.ask(
        f"measurements.{name}.remove",
        f"The readings show {words}, {asked}",
        [f"{line:<29} # {remark}" for line, remark in remarks.items()],
        needed=needed,
    )


def _write_fit(page: JobPage, contents: Contents, one: Suggestion) -> None:
    """Write a fit, as a remark where it is not the plain one."""
    holder = _holder(contents.axes, one)
    stay = holder is not None and holder.same_axes
    mark = "" if one.plain else "# "
    if one.plain:
        page.note(f"{one.compensation} of {one.axis}: {one.why}.")
    else:
        page.note(f"Another one that the readings would bear, since {one.why}:")
    page.add(f"{mark}[[fits]]")
    for key, value in one.of_job.items():
        kept = stay and key in one.nodes
        page.add(f"{'# ' if kept else mark}{job_line(key, value)}")
    if holder is not None and stay and one.nodes:
        page.note(f"Without {', '.join(one.nodes)} the nodes of {holder.name} stay.")
    if one.plain and kind(one.compensation).adds_current:
        _write_current(page, contents, one)
    if one.plain and len(contents.observation.data.temperature) > 1:
        sensors = ", ".join(contents.observation.data.temperature)
        page.note(f"Sensors of the file: {sensors}.")
    page.add("")


_RATED = {"A": ("rated_current", "A"), "Nm": ("rated_torque", "Nm")}


def _write_current(page: JobPage, contents: Contents, one: Suggestion) -> None:
    """Ask for the rated value of a drive, without which no list is written."""
    page.note(
        "level is the share of the friction that the list gives: 0.15 until a measurement"
        " has settled the sign of the current, 1.0 then. A recorded current that opposes"
        " the motion, as torque feedback does, is turned round by itself."
    )
    page.key("# level = 0.15")
    units = contents.units(one.sources[0], f"{one.axis}.current")
    rated = [_RATED[unit] for unit in units if unit in _RATED]
    page.ask(
        "fits.torque_unit",
        "What is the rated value of the drive, and which share of it is one unit of its"
        " additive command value? Without both, the law is reported and no list written.",
        [
            *(
                f"{key} =                      # {unit}, of the drive"
                for key, unit in rated
            ),
            "torque_unit = 0.001          # one unit is a thousandth, as on most drives",
        ],
        needed=False,
    )
