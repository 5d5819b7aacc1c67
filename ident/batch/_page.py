"""``summary.html``: one page over all machines, no network, readable on paper."""

import io
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from ...data.files import write_atomically
from ..report._scale import scale_of

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
    environment = jinja2.Environment(autoescape=True, trim_blocks=True)
    source = resources.files("axcomp.ident.batch").joinpath("summary.html.jinja")
    pictures = [
        _picture(errors[spread.compensation, spread.unit], spread.unit)
        for spread in summary.spreads
    ]
    text = environment.from_string(source.read_text("utf-8")).render(
        summary=summary,
        pictures=pictures,
        scale_of=scale_of,
        words=_WORDS,
        most=_MOST,
    )
    path = folder / NAME
    write_atomically(path, text.encode())
    return path


def _picture(errors: Mapping[str, np.ndarray], unit: str) -> str:
    """Return the distribution of the errors as SVG."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    scale = scale_of(unit)
    figure = Figure(figsize=(7.0, 3.4), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.add_subplot()
    for stage, values in errors.items():
        known = np.sort(values[np.isfinite(values) & (values > 0)]) * scale.factor
        if not len(known):
            continue
        # A curve of a few hundred points says as much as one of a hundred thousand.
        index = np.unique(np.linspace(0, len(known) - 1, 400).astype(int))
        share = 100.0 * (index + 1) / len(known)
        axes.plot(known[index], share, color=_COLOURS[stage], label=_WORDS[stage])
    axes.set_xscale("log")
    axes.set_xlabel(f"error (rms), {scale.error}")
    axes.set_ylabel("share of fits, %")
    axes.grid(True, color="#dddddd")
    axes.legend(frameon=False)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()[buffer.getvalue().index("<svg") :]
