"""Writes the report: one HTML page that needs nothing else, and its plots as files."""

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path

import jinja2
import markupsafe

from .._job_text import job_text
from ..job import JobResult, write_atomically
from . import _style as style
from ._group_section import GroupSection, group_section
from ._overview import overview_plot
from ._plot import Plot
from ._section import Section, section_of, summary_row
from ._verdict import front_of

_TEMPLATE = "report.html.jinja"
_LEVELS = {"error": 0, "warning": 1, "info": 2}


def write_report(result: JobResult, out: Path) -> tuple[Path, ...]:
    """Write ``report.html`` and ``plots/*.svg`` into a folder and return their paths.

    Args:
        result: What the job found.
        out: Folder of the report; it is made where it is missing.

    Returns:
        The page first, then the plots. Each file is replaced atomically.
    """
    with style.house_style():
        sections = [section_of(fit, place + 1) for place, fit in enumerate(result.fits)]
        groups = [
            group_section(group, place + 1, sections)
            for place, group in enumerate(result.groups)
        ]
        # A single fit shows its before and after in its own section.
        several = len(result.fits) > 1 or result.second
        overview = overview_plot(result.fits) if several else None
        files = _svg_files(overview, [*groups, *sections])
    page = _render(result, overview, groups, sections, files)
    plots = out / "plots"
    plots.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in files.items():
        path = plots / f"{name}.svg"
        write_atomically(path, text.encode())
        written.append(path)
    # The page comes last: where it stands, its plots do too.
    write_atomically(out / "report.html", page.encode())
    return (out / "report.html", *written)


def _svg_files(
    overview: Plot | None, sections: Sequence[Section | GroupSection]
) -> dict[str, str]:
    """Return all plots as SVG texts by file name."""
    plots = {} if overview is None else {overview.name: overview}
    for section in sections:
        plots |= {f"{section.name}-{plot.name}": plot for plot in section.plots}
    return {name: style.to_svg(plot.figure, name) for name, plot in plots.items()}


def _render(
    result: JobResult,
    overview: Plot | None,
    groups: list[GroupSection],
    sections: list[Section],
    files: Mapping[str, str],
) -> str:
    # Everything that came from a user is escaped; only our own drawings are not.
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    source = (
        resources.files("axcomp.ident.report").joinpath(_TEMPLATE).read_text("utf-8")
    )
    return environment.from_string(source).render(
        job=result,
        front=front_of([(one.heading, one.fit) for one in sections], result.verdict),
        overview=overview,
        groups=groups,
        sections=sections,
        remarks=sorted(result.remarks, key=lambda r: _LEVELS.get(r.level, 3)),
        summary_row=summary_row,
        svgs={
            name: markupsafe.Markup(style.to_inline(text))
            for name, text in files.items()
        },
        job_text=job_text(result.job),
    )
