"""One fit of a job as a section of the page: words, tables and plots in their order."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from ..job import (
    AbstractResult,
    Code,
    ErrorFigures,
    Verdict,
    some_of,
)
from ..kinds import kind
from ._body import Body
from ._scale import Scale, count, percent, scale_of
from ._verdict import Headline, headline_of

_MOST = 8
"""Values that are not determined and named one by one."""

_COLUMNS = {
    "before": ("before", "measured"),
    "predicted": ("predicted", "computed on readings left out of the fit"),
    "from_file": ("from the file", "computed: the written file, read back"),
    "verified": ("verified", "measured with the list active"),
    "measured_again": ("measured again", "with the list active"),
}

_ROWS = {
    "rms": "root mean square",
    "max": "largest magnitude",
    "rms, all": "with wild readings",
    "max, all": "with wild readings",
    "A": "accuracy of positioning: everything, both directions",
    "R": "repeatability: scatter, which no table takes away, and what both directions differ by",
    "B": "reversal value: largest difference of the directions",
    "E": "systematic positional deviation: range of the means",
    "M": "range of the mean of both directions",
}
ISO = frozenset("AREBM")
"""Figures of ISO 230-2, which knows no wild readings."""


@dataclasses.dataclass(frozen=True)
class Section:
    """Everything that the page says of one fit, in its display units.

    Attributes:
        name: In anchors and names of files.
        heading: With its place in the job.
        stages: Stages of the error that are shown.
        rows: Figures of the error by name, as `figure_rows` has them.
    """

    name: str
    heading: str
    verdict: Headline
    stages: Sequence[str]
    rows: Mapping[str, tuple[str, list[str]]]
    body: Body
    fit: AbstractResult
    scale: Scale

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Heading of each stage, and what kind of number it is."""
        return [_COLUMNS[stage] for stage in self.stages]

    @property
    def iso(self) -> bool:
        """Whether figures of ISO 230-2 are among them."""
        return not ISO.isdisjoint(self.rows)

    @property
    def refuted(self) -> bool:
        """Whether a second measurement showed that the list does not do what it was to."""
        judgement = self.fit.judgement
        return judgement.verdict is Verdict.REJECTED and judgement.has(Code.DIAGNOSED)


def section_of(fit: AbstractResult, place: int) -> Section:
    """Return the section of one fit; ``place`` counts the fits of the job from 1."""
    scale = scale_of(fit.unit)
    over = " over " + ", ".join(fit.over) if fit.over else ""
    stages, rows = figure_rows(fit.error, scale)
    # In a file name and an anchor.
    safe = "".join(c if c.isascii() and c.isalnum() else "_" for c in fit.axis)
    return Section(
        name=f"{place}-{fit.compensation}-{safe}",
        heading=f"{place}. {fit.compensation.capitalize()} of {fit.axis}{over}",
        verdict=headline_of(fit, scale),
        stages=stages,
        rows=rows,
        body=body_of(fit, scale),
        fit=fit,
        scale=scale,
    )


def figure_rows(
    error: Mapping[str, ErrorFigures], scale: Scale
) -> tuple[list[str], dict[str, tuple[str, list[str]]]]:
    """Return the stages of an error that are shown, and its figures by name.

    Of each figure what it means, and its values as they are printed, one per stage.
    """
    stages = [stage for stage in _COLUMNS if stage in error]
    wild = any(each.without_wild is not None for each in error.values())
    columns: list[dict[str, float]] = []
    for figures in (error[stage] for stage in stages):
        sound = {"rms": figures.sound.rms, "max": figures.sound.max}
        columns.append(sound | dict(figures.iso230 or {}))
        if wild:
            columns[-1] |= {"rms, all": figures.rms, "max, all": figures.max}
    rows = {}
    for name, meaning in _ROWS.items():
        values = [column.get(name) for column in columns]
        if set(values) - {None}:
            meaning += "; with wild readings" * (wild and name in ISO)
            shown = ["–" if value is None else scale.figure(value) for value in values]
            rows[name] = meaning, shown
    return stages, rows


def summary_row(section: Section) -> tuple[str, ...]:
    """Return the line of a fit in the overview: before, predicted, verified, gate."""
    _, rms = section.rows.get("rms", ("", []))
    cells = dict(zip(section.stages, rms, strict=bool(rms)))
    before, after = section.fit.error.get("before"), section.fit.error.get("predicted")
    gain = "–"
    if before and after and after.sound.rms < before.sound.rms:
        gain = percent(1 - after.sound.rms / before.sound.rms)
    return (
        cells.get("before", "–"),
        cells.get("predicted", "–"),
        gain,
        cells.get("verified", "no" if section.fit.again else "not yet"),
    )


def body_of(fit: AbstractResult, scale: Scale) -> Body:
    """Return plots, facts and wild readings of a fit."""
    if not fit.left_out:
        return kind(fit.compensation).page.body(fit, scale)
    # Whatever kind it was to be: its readings do not tell it, and nothing was written.
    from ..job import LeftOutResult

    assert isinstance(fit, LeftOutResult)
    facts, part = [], fit.part
    if part is not None:
        touched = part.support > 0
        words = (
            f"{np.sum(part.determined & touched)} of {count(len(part.values), 'value')}"
        )
        words += f" are determined; readings touch {np.sum(touched)} of them."
        facts.append(("Values", words))
        unknown = np.flatnonzero(~part.determined & np.isinf(part.standard_deviation))
        if unknown.size:
            names = some_of([part.effect.labels[int(k)] for k in unknown], _MOST)
            facts.append(("Not determined", f"{names}."))
    facts.append(("As written", "Nothing: see the remarks above."))
    return Body(plots=[], facts=facts)
