"""What a batch says over all machines, as JSON and as one page to read or to print."""

import dataclasses
import itertools
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...data.files import write_atomically
from .._templates import templates
from ..report._scale import scale_of
from ._table import read_results

_FIGURES, _PAGE = "summary.json", "summary.html"
_MOST = 200
"""Lines of a table on the page; all of them stand in summary.json."""
_CURVE = np.linspace(0.0, 1.0, 401)
"""Shares of the fits at which the page draws their errors."""
_SHARES = [0.5, 0.9, 0.99, 1.0]
_WORDS = {
    "before": "as measured",
    "predicted": "predicted",
    "from_file": "under the file",
    "table": "table turned round",
}
_COLOURS = {"before": "#b5541c", "predicted": "#7a7a7a", "from_file": "#1f6f8b"}

_SPREADS = """
SELECT compensation, unit, count(*) AS count, {
    before: coalesce(quantile_cont(before_rms, $shares), []),
    predicted: coalesce(quantile_cont(predicted_rms, $shares), []),
    from_file: coalesce(quantile_cont(from_file_rms, $shares), [])} AS percentiles
FROM fits GROUP BY compensation, unit ORDER BY compensation, unit
"""
_OUTLIERS = """
WITH sizes AS (
    SELECT *, ln(greatest(rms, 1e-12)) AS size
    FROM (SELECT *, before_rms AS rms, 'before' AS stage FROM fits UNION ALL
          SELECT *, from_file_rms AS rms, 'from_file' AS stage FROM fits)
    WHERE rms IS NOT NULL
), judged AS (
    SELECT *, count(*) OVER kind AS fits, median(size) OVER kind AS middle,
        1.4826 * mad(size) OVER kind AS width
    FROM sizes WINDOW kind AS (PARTITION BY compensation, unit, stage)
)
SELECT job, machine_id AS machine, axis, compensation, stage, rms,
    exp(size - middle) AS times, unit
FROM judged WHERE fits >= 10 AND (size > middle + 5 * greatest(width, 0.1)
    OR stage = 'before' AND size < middle - greatest(5 * width, ln(20)))
ORDER BY abs(ln(times)) DESC
"""
"""Five robust standard deviations of the logarithm above the median of the kind; or as far
below it, and less than a twentieth of it, as measured: readings in another unit than stated.

Their least is 0.1: a fleet of one make may be so alike that any difference stands out.
"""
_TRENDS = """
WITH figures AS (
    SELECT *, row_number() OVER () AS place, 'rms' AS figure, before_rms AS size FROM every
    UNION ALL
    SELECT *, row_number() OVER () AS place, 'B' AS figure, before_B AS size FROM every
), days AS (
    SELECT machine_id AS machine, axis, compensation, unit, figure, measured_at AS first,
        arg_max(size, place) AS size
    FROM figures
    WHERE machine_id IS NOT NULL AND measured_at IS NOT NULL AND size IS NOT NULL
    GROUP BY ALL
), pairs AS (
    SELECT *, days.first AS day, later.first AS last,
        (later.size - days.size) / (later.first - days.first) AS slope
    FROM days JOIN days AS later USING (machine, axis, compensation, unit, figure)
    WHERE later.first > days.first
), judged AS (
    SELECT *, median(slope)
        OVER (PARTITION BY machine, axis, compensation, unit, figure) AS middle
    FROM pairs
)
SELECT machine, axis, compensation, figure, 1 + count(DISTINCT day) AS measurements,
    min(day)::VARCHAR AS first, max(last)::VARCHAR AS last,
    365.25 * any_value(middle) AS per_year, unit
FROM judged GROUP BY machine, axis, compensation, unit, figure
HAVING measurements >= 4 AND per_year <> 0
    AND avg((sign(slope) = sign(middle))::INTEGER) >= 0.9
ORDER BY abs(per_year) DESC
"""
"""Axes whose error, or its lost motion, moves one way, by the medians of all slopes.

Source: P. K. Sen, J. Am. Stat. Assoc. 63, 1968 (slope); M. G. Kendall, 1938 (pairs).
"""
_TWINS = """
SELECT list(job ORDER BY job) AS jobs, any_value(axis) AS axis,
    any_value(compensation) AS compensation
FROM fits WHERE before_rms > 0
GROUP BY before_rms, before_max, compensation
HAVING count(DISTINCT (coalesce(machine_id, job), axis_number)) > 1 ORDER BY jobs
"""
"""Jobs of different axes that hold the same readings: no two of them scatter alike."""

_TABLES = """
SELECT job, machine_id AS machine, axis, compensation, unit, "table" FROM fits
WHERE len("table") BETWEEN 1 AND 1000
"""
"""Tables that are compared; larger ones of a large fleet would fill the memory."""
_FLEET, _TURNED = 10, 0.5
"""Fits of a kind that make a fleet, and the part of its median table that each holds, or that one
holds turned round."""

_Rows = tuple[dict[str, Any], ...]


@dataclasses.dataclass(frozen=True)
class Summary:
    """Figures over a whole batch.

    Attributes:
        jobs: Jobs of the batch; ``failed`` of them wrote nothing.
        failed: See `jobs`.
        reasons: Why, most frequent first; those that differ in numbers alone count as one.
        rejected: Fits whose list must not be loaded.
        gate: Checks that failed, by name.
        unverified: Fits that passed and whose list lies in ``unverified/``.
        no_gain: Of these, fits of which nothing shows that their list helps.
        verdicts: Fits by verdict; ``unproven``: computed, no measurement has settled
            the sign.
        spreads: Errors (rms) by ``compensation`` and ``unit``: ``count`` of the fits, and by
            stage median, 90th and 99th percentile, and maximum.
        outliers: Fits whose error is ``times`` the median of their kind, worst first; also
            those that measured next to nothing. Before them, where tables of a fleet are
            alike, those that hold them turned round (stage ``table``, negative ``times``): a
            sign, or readings of the other direction.
        trends: Axes whose measured error (``figure``: rms, or B of ISO 230-2) grows or shrinks
            steadily, fastest first.
        twins: Jobs of different axes that hold the same readings: one has the file of another.
    """

    jobs: int
    failed: int
    reasons: dict[str, int]
    rejected: int
    gate: dict[str, int]
    unverified: int
    no_gain: int
    verdicts: dict[str, int]
    spreads: _Rows
    outliers: _Rows
    trends: _Rows
    twins: _Rows


def summarise(folder: Path, history: Sequence[Path] = ()) -> Summary:
    """Return the figures of a batch, and write ``summary.json`` and ``summary.html``.

    Args:
        folder: Of the batch, its table written.
        history: Folders of earlier batches, for the trends.
    """
    import duckdb
    import pyarrow as pa
    import pyarrow.compute as pc

    done = pc.field("state") == "done"
    rows = read_results(folder)
    fits = rows.filter(done)
    earlier = [read_results(other).filter(done) for other in history]
    with duckdb.connect() as connection:
        connection.register("fits", fits)
        every = [table.select(fits.column_names) for table in (*earlier, fits)]
        connection.register("every", pa.concat_tables(every))

        def found(question: str, **values: object) -> _Rows:
            relation = connection.sql(question, params=values)
            return tuple(relation.to_arrow_table().to_pylist())

        spreads = found(_SPREADS, shares=_SHARES)
        curves = found(_SPREADS, shares=_CURVE.tolist())
        outliers, trends, twins = map(found, (_OUTLIERS, _TRENDS, _TWINS))
        turned = _turned(found(_TABLES))
    failures = rows.filter(~done)["reason"].to_pylist()
    alike = Counter(map(_plain_reason, failures))
    # As one of the jobs has it, with its numbers.
    sample = {_plain_reason(reason): _short_reason(reason) for reason in failures}
    reasons = {sample[plain]: number for plain, number in alike.most_common(20)}
    failed = filter(None, fits["gate_failed"].to_pylist())
    gate = Counter(itertools.chain.from_iterable(failed))
    waiting = fits.filter(pc.field("passed") & ~pc.field("verified"))
    summary = Summary(
        jobs=len(rows["job"].unique()),
        failed=len(failures),
        reasons=reasons,
        rejected=len(fits) - sum(map(bool, fits["passed"].to_pylist())),
        gate=dict(gate.most_common()),
        unverified=len(waiting),
        no_gain=sum("no_gain" in (why or ()) for why in waiting["reasons"].to_pylist()),
        verdicts=dict(Counter(filter(None, fits["verdict"].to_pylist()))),
        spreads=spreads,
        outliers=(*turned, *outliers),
        trends=trends,
        twins=twins,
    )
    text = json.dumps(dataclasses.asdict(summary), indent=1) + "\n"
    write_atomically(folder / _FIGURES, text.encode())
    page = templates(__package__ or "", html=True).get_template("summary.html.jinja")
    html = page.render(
        summary=summary,
        pictures=[_picture(kind["percentiles"], kind["unit"]) for kind in curves],
        scale_of=scale_of,
        words=_WORDS,
        most=_MOST,
    )
    write_atomically(folder / _PAGE, html.encode())
    return summary


def _turned(fits: _Rows) -> _Rows:
    """Return the fits whose table is that of the others of its kind turned round."""
    kinds: dict[tuple[str, str, int], list[dict[str, Any]]] = {}
    for row in fits:
        kind = row["compensation"], row["axis"], len(row["table"])
        kinds.setdefault(kind, []).append(row)
    found = []
    for rows in kinds.values():
        tables = np.array([row["table"] for row in rows])
        middle = np.median(tables, axis=0)
        if len(rows) < _FLEET or not (middle @ middle > 0.0):
            continue
        parts = tables @ middle / (middle @ middle)
        for row, part in zip(rows, parts.tolist(), strict=True):
            if np.median(parts) > _TURNED and part < -_TURNED:
                rms = float(np.sqrt(np.mean(np.square(row.pop("table")))))
                found.append(row | {"stage": "table", "rms": rms, "times": part})
    return tuple(found)


def _short_reason(reason: str | None) -> str:
    """Return a reason without its file and line."""
    return (reason or "").split(": ", 1)[-1][:160]


def _plain_reason(reason: str | None) -> str:
    """Return it without numbers, so that equal ones count together."""
    return re.sub(r"\d", "#", _short_reason(reason))


def _picture(errors: Mapping[str, Sequence[float]], unit: str) -> str:
    """Return the distribution of the errors as SVG."""
    from matplotlib.ticker import LogLocator

    from ..report._style import new_figure, to_inline, to_svg

    scale = scale_of(unit)
    figure, (axes,) = new_figure(3.4)
    for stage, values in errors.items():
        if values:
            sizes = scale.factor * np.array(values)
            axes.plot(sizes, 100.0 * _CURVE, color=_COLOURS[stage], label=_WORDS[stage])
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")  # powers are no plain text
    axes.xaxis.set_minor_formatter("")
    axes.set_xlabel(f"error (rms), {scale.error}")
    axes.set_ylabel("share of fits, %")
    axes.grid(True, color="#dddddd")
    axes.legend(frameon=False)
    return to_inline(to_svg(figure, f"errors in {unit}"))
