"""Writes the report: one HTML page that needs nothing else, and its plots as files."""

from collections.abc import Iterable
from pathlib import Path

import markupsafe

from ...data.files import write_atomically, write_together
from .._job_text import job_text
from .._templates import templates
from ..job import JobResult, by_level, signed
from . import _style as style
from ._body import Plot
from ._group import group_section
from ._overview import overview_plot
from ._scale import count, number, percent, scale_of
from ._section import section_of, summary_row
from ._verdict import front_of


def write_report(result: JobResult, out: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``plots/*.svg`` into a folder and return their paths, page first.

    The folder is made where it is missing. Each file is replaced atomically.
    """
    files: dict[str, str] = {}

    def draw(name: str, plots: Iterable[Plot]) -> None:
        # At once, and each figure is let go: all of them are a million objects.
        for plot in plots:
            files[name + plot.name] = style.to_svg(plot.figure, name + plot.name)

    with style.house_style():
        sections = []
        for place, fit in enumerate(result.fits):
            sections.append(section_of(fit, place + 1))
            draw(f"{sections[-1].name}-", sections[-1].body.plots)
        groups = []
        for place, group in enumerate(result.groups):
            groups.append(group_section(group, place + 1, sections))
            draw(f"{groups[-1].name}-", [groups[-1].plot])
        # A single fit shows its before and after in its own section.
        several = len(result.fits) > 1 or result.second
        overview = overview_plot(result.fits) if several else None
        draw("", [overview] if overview else [])
    template = templates(__package__ or "", html=True).get_template("report.html.jinja")
    # Everything that came from a user is escaped; only our own drawings are not.
    svgs = {k: markupsafe.Markup(style.to_inline(text)) for k, text in files.items()}
    headed = [(section.heading, section.fit) for section in sections]
    page = template.render(
        job=result,
        front=front_of(headed, result.verdict),
        overview=overview,
        groups=groups,
        sections=sections,
        by_level=by_level,
        count=count,
        summary_row=summary_row,
        number=number,
        percent=percent,
        scale_of=scale_of,
        svgs=svgs,
        job_text=job_text(result.job),
    )
    plots = [out / "plots" / f"{name}.svg" for name in files]
    (out / "plots").mkdir(parents=True, exist_ok=True)
    write_together(dict(zip(plots, map(signed, files.values()), strict=True)))
    # The page comes last: where it stands, its plots do too.
    write_atomically(out / "report.html", signed(page))
    return (out / "report.html", *plots)
