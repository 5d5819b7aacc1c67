"""What a batch says over all machines, as JSON and as one page to read or to print."""

import dataclasses
import itertools
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.files import write_atomically
from .._templates import templates
from ..report._scale import scale_of
from ._table import read_results

_FIGURES = "summary.json"
_STAGES = ("before", "predicted", "from_file")
_SHARES = (50, 90, 99, 100)
_FAR = 5.0
"""Robust standard deviations, of the logarithm, from which on a machine is an outlier."""
_LEAST, _STEADY = 4, 0.9
"""Measurements that a trend needs, and share of pairs that must agree on its direction."""
_YEAR = 365.25

_Fit = dict[str, Any]
"""The columns that count here of a row of a fit."""
_Kind = tuple[str, str]
"""Compensation and unit."""


@dataclasses.dataclass(frozen=True)
class Spread:
    """Errors (rms) of all fits of one kind.

    Attributes:
        compensation: Kind of fit.
        unit: Of the errors.
        count: Fits.
        percentiles: By stage (``before``, ``predicted``, ``from_file``): median, 90th and 99th
            percentile, maximum.
    """

    compensation: str
    unit: str
    count: int
    percentiles: dict[str, list[float]]


@dataclasses.dataclass(frozen=True)
class Outlier:
    """A fit whose error is far beyond that of its kind: ``times`` the median."""

    job: str
    machine: str | None
    axis: str
    compensation: str
    stage: str
    rms: float
    times: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Trend:
    """An axis whose measured error grows (or shrinks) from measurement to measurement."""

    machine: str
    axis: str
    compensation: str
    measurements: int
    first: str
    last: str
    per_year: float
    unit: str


@dataclasses.dataclass(frozen=True)
class Summary:
    """Figures over a whole batch.

    Attributes:
        jobs: Jobs of the batch; ``failed`` of them wrote nothing.
        failed: See `jobs`.
        reasons: Why, by reason with names and numbers left out, most frequent first.
        rejected: Fits whose list must not be loaded.
        gate: Checks that failed, by name.
        unverified: Fits whose list lies in ``unverified/``.
        verdicts: Fits by verdict; ``unproven``: computed, no measurement has settled
            the sign.
        spreads: By kind of fit.
        outliers: Machines to look at, worst first.
        trends: Axes that change steadily, fastest first.
    """

    jobs: int
    failed: int
    reasons: dict[str, int]
    rejected: int
    gate: dict[str, int]
    unverified: int
    verdicts: dict[str, int]
    spreads: tuple[Spread, ...]
    outliers: tuple[Outlier, ...]
    trends: tuple[Trend, ...]


def summarise(folder: Path, history: Sequence[Path] = ()) -> Summary:
    """Return the figures of a batch, and write ``summary.json`` and ``summary.html``.

    Args:
        folder: Of the batch, its table written.
        history: Folders of earlier batches, for the trends.
    """
    columns = [
        *("job", "state", "reason", "passed", "verified", "verdict", "machine_id"),
        *("measured_at", "compensation", "axis", "unit", "gate_failed"),
        *(f"{stage}_rms" for stage in _STAGES),
    ]
    table = read_results(folder).select(columns)
    rows: list[_Fit] = table.to_pylist()
    fits = [row for row in rows if row["state"] == "done"]
    earlier = [
        row
        for other in history
        for row in read_results(other).select(columns).to_pylist()
        if row["state"] == "done"
    ]
    failed = [row for row in rows if row["state"] == "failed"]
    kinds: dict[_Kind, list[_Fit]] = defaultdict(list)
    for row in fits:
        kinds[row["compensation"], row["unit"]].append(row)
    reasons = Counter(_plain_reason(row["reason"]) for row in failed)
    gate = Counter(
        itertools.chain.from_iterable(row["gate_failed"] or () for row in fits)
    )
    summary = Summary(
        jobs=len({row["job"] for row in rows}),
        failed=len(failed),
        reasons=dict(reasons.most_common(20)),
        rejected=sum(not row["passed"] for row in fits),
        gate=dict(gate.most_common()),
        unverified=sum(not row["verified"] for row in fits),
        verdicts=dict(Counter(row["verdict"] for row in fits if row["verdict"])),
        spreads=tuple(_spread(*kind, own) for kind, own in kinds.items()),
        outliers=tuple(
            sorted(
                itertools.chain.from_iterable(map(_outliers, kinds.values())),
                key=lambda one: -one.times,
            )
        ),
        trends=tuple(_trends([*earlier, *fits])),
    )
    text = json.dumps(dataclasses.asdict(summary), indent=1) + "\n"
    write_atomically(folder / _FIGURES, text.encode())
    write_atomically(folder / _PAGE, _page(summary, kinds).encode())
    return summary


def _plain_reason(reason: str | None) -> str:
    """Return a reason without its file and line, so that equal ones count together."""
    words = (reason or "").split(": ", 1)
    return "".join("#" if sign.isdigit() else sign for sign in words[-1])[:160]


def _errors(rows: Sequence[_Fit]) -> dict[str, np.ndarray]:
    return {
        stage: np.array([row[f"{stage}_rms"] for row in rows], dtype=float)
        for stage in _STAGES
    }


def _spread(compensation: str, unit: str, rows: Sequence[_Fit]) -> Spread:
    found = {}
    for stage, values in _errors(rows).items():
        known = values[np.isfinite(values)]
        shares = np.percentile(known, _SHARES) if len(known) else np.zeros(0)
        found[stage] = [float(value) for value in shares]
    return Spread(compensation, unit, len(rows), found)


def _outliers(rows: Sequence[_Fit]) -> Iterable[Outlier]:
    """Yield fits whose error lies far above those of the same kind."""
    if len(rows) < 10:
        return
    for stage, values in _errors(rows).items():
        if stage == "predicted":
            continue  # what it finds, the file finds too
        logs = np.log(np.maximum(values, 1e-12))
        middle = float(np.nanmedian(logs))
        # A fleet of one make may be so alike that any difference stands out.
        width = max(1.4826 * float(np.nanmedian(np.abs(logs - middle))), 0.1)
        for k in np.flatnonzero(logs > middle + _FAR * width):
            row = rows[int(k)]
            yield Outlier(
                row["job"], row["machine_id"], row["axis"], row["compensation"], stage,
                float(values[k]), float(np.exp(logs[k] - middle)), row["unit"],
            )  # fmt: skip


def _trends(rows: Sequence[_Fit]) -> list[Trend]:
    """Return axes whose measured error moves one way, by the medians of all slopes.

    Source: P. K. Sen, J. Am. Stat. Assoc. 63, 1968 (slope); M. G. Kendall, 1938 (pairs).
    """
    axes: dict[tuple[str, str, str, str], dict[Any, float]] = defaultdict(dict)
    for row in rows:
        if row["machine_id"] is not None and row["measured_at"] is not None:
            key = (row["machine_id"], row["axis"], row["compensation"], row["unit"])
            axes[key][row["measured_at"]] = row["before_rms"]
    found = []
    for (machine, axis, compensation, unit), own in axes.items():
        if len(own) < _LEAST:
            continue
        days = sorted(own)
        when = np.array([day.toordinal() for day in days], dtype=float)
        values = np.array([own[day] for day in days])
        first, second = np.triu_indices(len(days), 1)
        slopes = (values[second] - values[first]) / (when[second] - when[first])
        slope = float(np.median(slopes))
        if np.mean(np.sign(slopes) == np.sign(slope)) >= _STEADY and slope:
            found.append(
                Trend(
                    machine, axis, compensation, len(days), str(days[0]), str(days[-1]),
                    slope * _YEAR, unit,
                )
            )  # fmt: skip
    return sorted(found, key=lambda one: -abs(one.per_year))


_PAGE = "summary.html"
_MOST = 200
"""Lines of a table; all of them stand in summary.json."""
_WORDS = {
    "before": "as measured",
    "predicted": "predicted",
    "from_file": "under the file",
}
_COLOURS = {"before": "#b5541c", "predicted": "#7a7a7a", "from_file": "#1f6f8b"}


def _page(summary: Summary, kinds: Mapping[_Kind, Sequence[_Fit]]) -> str:
    """Return the page; of the fits by compensation and unit it shows the errors (rms)."""
    page = templates(__package__ or "", html=True).get_template("summary.html.jinja")
    return page.render(
        summary=summary,
        pictures=[_picture(_errors(own), unit) for (_, unit), own in kinds.items()],
        scale_of=scale_of,
        words=_WORDS,
        most=_MOST,
    )


def _picture(errors: Mapping[str, np.ndarray], unit: str) -> str:
    """Return the distribution of the errors as SVG."""
    from ..report._style import new_figure, to_inline, to_svg

    scale = scale_of(unit)
    figure, (axes,) = new_figure(3.4)
    for stage, values in errors.items():
        known = np.sort(values[np.isfinite(values) & (values > 0)]) * scale.factor
        if len(known):
            # A curve of a few hundred points says as much as one of a hundred thousand.
            index = np.unique(np.linspace(0, len(known) - 1, 400).astype(int))
            share = 100.0 * (index + 1) / len(known)
            axes.plot(known[index], share, color=_COLOURS[stage], label=_WORDS[stage])
    axes.set_xscale("log")
    axes.set_xlabel(f"error (rms), {scale.error}")
    axes.set_ylabel("share of fits, %")
    axes.grid(True, color="#dddddd")
    axes.legend(frameon=False)
    return to_inline(to_svg(figure, f"errors in {unit}"))
