"""``summary.html``: one page over all machines, no network, readable on paper."""

import html
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...data.files import write_atomically

if TYPE_CHECKING:
    from ._summary import Summary

NAME = "summary.html"
_MOST = 200
"""Lines of a table; all of them stand in summary.json."""
_WORDS = {
    "before": "as measured",
    "predicted": "predicted",
    "from_file": "under the file",
}
_COLOURS = {"before": "#b5541c", "predicted": "#7a7a7a", "from_file": "#1f6f8b"}
_STYLE = """
body { font: 15px/1.45 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; margin: 0.8em 0; }
td, th { padding: 0.15em 0.8em 0.15em 0; text-align: right; border-bottom: 1px solid #ccc; }
td:first-child, th:first-child { text-align: left; }
svg { max-width: 100%; height: auto; }
"""


def write_page(
    folder: Path,
    summary: "Summary",
    errors: Mapping[tuple[str, str], Mapping[str, np.ndarray]],
) -> Path:
    """Write the page.

    Args:
        folder: Of the batch.
        summary: Its figures.
        errors: By compensation and unit, and stage: errors (rms) of all fits.
    """
    parts = [
        f"<h1>Batch summary{_headline(summary)}</h1>",
        f"<p>{summary.jobs} jobs: {summary.failed} wrote no list, {summary.rejected} fits did"
        f" not pass their gate or checks, {summary.unverified} fits lie in"
        " <code>unverified/</code>: the conventions of their machines are assumed, and a wrong"
        " sign would double every error. Verify one machine of each kind before loading"
        " them.</p>",
    ]
    for spread in summary.spreads:
        parts += _spread(
            spread.compensation, spread.unit, spread.count, spread.percentiles
        )
        parts.append(_picture(errors[spread.compensation, spread.unit], spread.unit))
        parts.append(
            "<p>Share of all fits whose error is at most that large. The line under the file"
            " should lie left of the one as measured all the way up.</p>"
        )
    if summary.gate:
        parts.append("<h2>Failed checks of the gate</h2>")
        parts.append(_table(("check", "fits"), summary.gate.items()))
    if summary.reasons:
        parts.append("<h2>Why jobs failed</h2>")
        parts.append(_table(("reason", "jobs"), summary.reasons.items()))
    parts += _outliers(summary)
    parts += _trends(summary)
    text = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f"<title>Batch summary</title><style>{_STYLE}</style></head><body>"
        + "\n".join(parts)
        + "</body></html>\n"
    )
    path = folder / NAME
    write_atomically(path, text.encode())
    return path


def _headline(summary: "Summary") -> str:
    """Return what nobody may overlook: how many lists rest on a sign that is assumed."""
    count = summary.verdicts.get("unproven", 0)
    return f": {count} fits computed; sign unproven" if count else ""


def _spread(
    compensation: str, unit: str, count: int, percentiles: Mapping[str, Sequence[float]]
) -> list[str]:
    shown, factor = _unit(unit)
    rows = [
        (_WORDS[stage], *(f"{factor * value:.2f}" for value in values))
        for stage, values in percentiles.items()
        if values
    ]
    head = (
        "error (rms)",
        *(f"{name}, {shown}" for name in ("median", "90 %", "99 %", "max")),
    )
    return [f"<h2>{html.escape(compensation)}, {count} fits</h2>", _table(head, rows)]


def _outliers(summary: "Summary") -> list[str]:
    if not summary.outliers:
        return []
    rows = [
        (
            one.machine or "–", one.axis, one.compensation, one.job, _WORDS[one.stage],
            "{1:.2f} {0}".format(*_scaled(one.rms, one.unit)), f"{one.times:.1f}",
        )
        for one in summary.outliers[:_MOST]
    ]  # fmt: skip
    head = (
        "machine",
        "axis",
        "compensation",
        "job",
        "stage",
        "rms",
        "times the median",
    )
    return [f"<h2>Outliers ({len(summary.outliers)})</h2>", _table(head, rows)]


def _trends(summary: "Summary") -> list[str]:
    if not summary.trends:
        return []
    rows = [
        (
            one.machine, one.axis, one.compensation, one.measurements, one.first, one.last,
            "{1:+.2f} {0}".format(*_scaled(one.per_year, one.unit)),
        )
        for one in summary.trends[:_MOST]
    ]  # fmt: skip
    head = (
        "machine",
        "axis",
        "compensation",
        "measured",
        "first",
        "last",
        "rms per year",
    )
    words = "<p>Axes whose measured error moves one way from measurement to measurement.</p>"
    return [f"<h2>Trends ({len(summary.trends)})</h2>", words, _table(head, rows)]


def _scaled(value: float, unit: str) -> tuple[str, float]:
    shown, factor = _unit(unit)
    return shown, factor * value


def _unit(unit: str) -> tuple[str, float]:
    return {"mm": ("µm", 1e3), "deg": ("0.001°", 1e3)}.get(unit, (unit, 1.0))


def _table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    return f"<table><tr>{top}</tr>{body}</table>"


def _picture(errors: Mapping[str, np.ndarray], unit: str) -> str:
    """Return the distribution of the errors as SVG."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    shown, factor = _unit(unit)
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.add_subplot()
    for stage, values in errors.items():
        known = np.sort(values[np.isfinite(values) & (values > 0)]) * factor
        if not len(known):
            continue
        # A curve of a few hundred points says as much as one of a hundred thousand.
        index = np.unique(np.linspace(0, len(known) - 1, 400).astype(int))
        share = 100.0 * (index + 1) / len(known)
        axes.plot(known[index], share, color=_COLOURS[stage], label=_WORDS[stage])
    axes.set_xscale("log")
    axes.set_xlabel(f"error (rms), {shown}")
    axes.set_ylabel("share of fits, %")
    axes.grid(True, color="#dddddd")
    axes.legend(frameon=False)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()[buffer.getvalue().index("<svg") :]
