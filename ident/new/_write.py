"""What a new job says of axes, measurements and fits; ``job.toml.jinja`` is its text."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

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
from ..readings import Observation, away_from
from ._columns import Meaning, own_roles
from ._fits import Suggestion, trend_in
from ._names import says_compensated
from ._text import JobPage, Question


@dataclasses.dataclass(frozen=True)
class Source:
    """A measurement of the job: its name, its file, what that means, and damaged lines of it."""

    name: str
    table: Table
    meaning: Meaning
    damaged: Sequence[CellError] = ()

    @property
    def state(self) -> tuple[int, str] | None:
        """First line above the rows that speaks of a compensation as on or off, or None."""
        lines = self.table.titles.items()
        return next((line for line in lines if says_compensated(line[1])), None)

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
    """

    number: int | None
    lists: Mapping[str, tuple[Path, ListFile]]
    rotary: bool = False
    endless: bool = False
    assumed: str | None = None


@dataclasses.dataclass(frozen=True)
class Holder:
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
class Zero:
    """The constant and the slope of a measurement.

    Attributes:
        compensation: Whose table would take them over.
        words: Both with their deviations.
        place: Where the first reading was taken: a number, or one per master.
        asked: The job asks whose they are.
        needed: It is not written without an answer.
    """

    compensation: str
    words: str
    place: float | list[float]
    asked: bool
    needed: bool


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

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors of temperature."""
        return list(self.observation.data.temperature)

    def span(self, axis: str) -> tuple[float, float] | None:
        """Return the smallest and largest position of an axis, None where it has none."""
        place = self.observation.data.position.get(axis)
        return None if place is None else (np.nanmin(place), np.nanmax(place))

    def relative(self, file: Path) -> str:
        """Return the path of a file as it stands in the job."""
        return relative(file, self.job.path)

    def plain(self, source: Source) -> list[Suggestion]:
        """Return the active fits of a measurement."""
        return [fit for fit in self.fits if source.name in fit.sources and fit.plain]

    def holder(self, one: Suggestion) -> Holder | None:
        """Return the list that holds a compensation already, or None."""
        facts = kind(one.compensation)
        key = "list" if facts.holder == "compensation" else "machine_data"
        path, listing = self.axes[one.axis].lists.get(key, (None, None))
        if path is None or listing is None:
            return None
        if not any(each.key.startswith(f"{facts.prefix}.") for each in listing.entries):
            return None
        masters = facts.entries.named_masters(listing)
        by_number = {axis.number: name for name, axis in self.axes.items()}
        over = tuple(by_number.get(number, f"axis {number}") for number in masters)
        return Holder(path.name, over, not over or set(over) == set(one.over))

    def held(self, source: Source) -> tuple[Suggestion, Holder] | None:
        """Return the first fit of a measurement that a list holds already, with that list."""
        held = ((fit, self.holder(fit)) for fit in self.plain(source))
        return next(((fit, holder) for fit, holder in held if holder is not None), None)

    def warm(self, source: Source) -> dict[str, float]:
        """Return the °C of each sensor of lengths that were read off 20 °C; else none."""
        lengths = any(fit.over == (fit.axis,) for fit in self.plain(source))
        data = self.observation.data
        rows = data.source == self.observation.names.index(source.name)
        reference = self.job.spec.measurements[source.name].reference_temperature
        warm = {sensor: each[rows] for sensor, each in data.temperature.items()}
        return away_from(reference, warm) if lengths else {}

    def zero(self, source: Source) -> Zero | None:
        """Return the constant and slope that stand out of the readings of a fit, if any do.

        They are asked for also where they hardly do but would move the table, in a
        measurement beside one that is asked, and in one with a list that is there already:
        any zero is arbitrary.
        """
        job, quiet = self.job, None
        for fit in self.plain(source):
            trends = {
                name: trend_in(job, self.observation, fit, name) for name in fit.sources
            }
            if (own := trends[source.name]) is None:
                continue
            spec = job.spec.model_dump(by_alias=True, exclude_none=True)
            of_job: Any = JobFile.model_validate(spec | {"fits": [fit.of_job]}).fits[0]
            data = self.observation.data
            rows = data.source == self.observation.names.index(source.name)
            first = [round(float(data.position[axis][rows][0]), 3) for axis in fit.over]
            beside = any(t and asks_for_owner(job, t) for t in trends.values())
            held = self.holder(fit) is not None
            zero = Zero(
                fit.compensation,
                trend_words(job, of_job, own),
                first[0] if len(first) == 1 else first,
                asked=beside or held or not is_negligible(job, own),
                needed=asks_for_owner(job, own),
            )
            if zero.asked:
                return zero
            quiet = quiet or zero
        return quiet

    def adds_current(self, one: Suggestion) -> bool:
        """Whether a fit adds to the current of a drive."""
        return kind(one.compensation).adds_current

    def rated(self, one: Suggestion) -> list[str]:
        """Return the lines that state the rated value of a drive, by units of its current."""
        (meaning,) = (s.meaning for s in self.sources if s.name == one.sources[0])
        pairs = [*meaning.columns.items()]
        pairs += [pair for each in meaning.unclear for pair in each.choices]
        units = [spec.unit for text, spec in pairs if text == f"{one.axis}.current"]
        return [
            *(
                f"{_RATED[unit]} =                      # {unit}, of the drive"
                for unit in units
                if unit in _RATED
            ),
            "torque_unit = 0.001          # one unit is a thousandth, as on most drives",
        ]


_RATED = {"A": "rated_current", "Nm": "rated_torque"}


def relative(file: Path, job: Path) -> str:
    """Return the path of a file as it stands in a job."""
    return Path(os.path.relpath(file, job.parent)).as_posix()


def written(contents: Contents, names: str) -> tuple[str, tuple[Question, ...]]:
    """Return the job of files of these names, and its questions."""
    page = JobPage()
    text = page.rendered(
        contents=contents,
        names=names,
        limits=list(GateLimits()),
        whole_turn=WHOLE_TURN,
        probed_heights=PROBED_HEIGHTS,
        job_line=job_line,
        column_lines=lambda choices: [
            job_line(text, spec.of_job()) for text, spec in choices
        ],
    )
    return text, tuple(page.questions)
