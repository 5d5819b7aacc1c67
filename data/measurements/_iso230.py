"""Accuracy and repeatability of positioning by ISO 230-2 (editions 2006 and 2014).

R and E are those of the standard, not the one-sided ones that some public tools
compute.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from ._errors import MeasurementError
from ._iso230_types import Iso230, Iso230Position, Iso230Run

EDITION = "ISO 230-2:2014"
_Approach = tuple[float, int, int, float]  # target, run, side, deviation
_SAME_TARGET = 6  # decimals: targets closer than 1 nm are one


def iso230(
    target: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    run: Int[np.ndarray, " t"] | None,
    direction: Int[np.ndarray, " t"] | None,
) -> Iso230:
    """Return the figures of ISO 230-2 from deviations in mm (or °), rows in any order.

    Several readings of one run at one target from one side are one approach: their mean
    counts, since they say nothing about repeatability. Targets may have different numbers
    of runs.

    Args:
        target: Commanded position per reading.
        error: Actual − commanded per reading.
        run: Number of the run per reading; None: every reading is an approach of its
            own.
        direction: +1 or −1 per reading; None: all from one side, taken as +1.

    Raises:
        MeasurementError: If there are no readings.
    """
    rows = _approaches(target, error, run, direction)
    positions = _positions(rows)
    remarks: list[str] = []
    if direction is None:
        remarks.append("No direction given: all readings are taken as from one side.")
    remarks += _gaps(positions, [item for item in positions if item.B is not None])
    return Iso230(
        **_overall(positions),
        positions=positions,
        runs=_runs(rows),
        run_offsets=_offsets(rows),
        remarks=tuple(remarks),
    )


def iso230_figures(
    target: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    run: Int[np.ndarray, " t"] | None,
    direction: Int[np.ndarray, " t"] | None,
) -> dict[str, float | None]:
    """Return the overall figures alone, by name; arguments and errors as `iso230`."""
    return _overall(_positions(_approaches(target, error, run, direction)))


def _overall(positions: Sequence[Iso230Position]) -> dict[str, float | None]:
    reversals = [p.B for p in positions if p.B is not None]
    middles = [p.mean for p in positions if p.mean is not None]
    repeat = [p.R for p in positions if p.R is not None]
    sides = [(p.mean_up, p.mean_down) for p in positions if p.B is not None]
    means = [mean for pair in sides for mean in pair if mean is not None]
    up = _one_side([(p.mean_up, p.s_up) for p in positions])
    down = _one_side([(p.mean_down, p.s_down) for p in positions])
    finite = bool(reversals) and math.isfinite(up.high) and math.isfinite(down.high)
    width = max(up.high, down.high) - min(up.low, down.low)
    return {
        "A": width if finite else None,
        "R": max(repeat) if repeat else None,
        "B": max(map(abs, reversals)) if reversals else None,
        "B_mean": float(np.mean(reversals)) if reversals else None,
        "E": _range(means),
        "M": _range(middles),
        "R_up": up.repeatability,
        "R_down": down.repeatability,
        "A_up": up.accuracy,
        "A_down": down.accuracy,
        "E_up": up.systematic,
        "E_down": down.systematic,
    }


def _enumerated(
    target: Float[np.ndarray, " t"], sides: Int[np.ndarray, " t"]
) -> Int[np.ndarray, " t"]:
    """Return 1, 2, … for the readings at each target from each side."""
    counts: dict[tuple[float, int], int] = {}
    runs = np.empty(target.size, np.int64)
    keys = zip(np.round(target, _SAME_TARGET).tolist(), sides.tolist(), strict=True)
    for at, key in enumerate(keys):
        counts[key] = counts.get(key, 0) + 1
        runs[at] = counts[key]
    return runs


def _approaches(
    target: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    run: Int[np.ndarray, " t"] | None,
    direction: Int[np.ndarray, " t"] | None,
) -> list[_Approach]:
    """Return one deviation per target, run and side, ascending: the mean of its readings.

    Raises:
        MeasurementError: If there are no readings.
    """
    if not target.size:
        reason = "found no readings, expected at least one"
        raise MeasurementError(EDITION, reason)
    sides = np.ones(target.size, np.int64) if direction is None else direction
    runs = _enumerated(target, sides) if run is None else run
    columns = [np.round(target, _SAME_TARGET) + 0.0, np.asarray(runs), sides]
    order = np.lexsort(columns[::-1])
    columns = [column[order] for column in columns]
    differ = [column[1:] != column[:-1] for column in columns]
    starts = [0, *(np.flatnonzero(np.logical_or.reduce(differ)) + 1).tolist()]
    values = error[order].tolist()
    # Exact sums: the figures do not depend on the order of the rows.
    means = [
        math.fsum(values[start:end]) / (end - start)
        for start, end in zip(starts, [*starts[1:], len(values)], strict=True)
    ]
    return list(
        zip(*(column[starts].tolist() for column in columns), means, strict=True)
    )


def _positions(rows: Sequence[_Approach]) -> tuple[Iso230Position, ...]:
    """Return the figures at each target; targets ascend as the rows do."""
    targets: dict[float, tuple[list[float], list[float]]] = {}
    for place, _, side, value in rows:
        if side in (1, -1):
            targets.setdefault(place, ([], []))[side < 0].append(value)
    return tuple(_position(place, up, down) for place, (up, down) in targets.items())


def _mean_and_s(values: list[float]) -> tuple[float | None, float | None]:
    if not values:
        return None, None
    count = len(values)
    mean = math.fsum(values) / count
    if count < 2:
        return mean, None
    return mean, math.sqrt(math.fsum([(v - mean) ** 2 for v in values]) / (count - 1))


def _position(target: float, up: list[float], down: list[float]) -> Iso230Position:
    (mean_up, s_up), (mean_down, s_down) = _mean_and_s(up), _mean_and_s(down)
    reversal = mean = repeat = None
    if mean_up is not None and mean_down is not None:
        reversal, mean = mean_up - mean_down, (mean_up + mean_down) / 2.0
        if s_up is not None and s_down is not None:
            repeat = max(2 * s_up + 2 * s_down + abs(reversal), 4 * s_up, 4 * s_down)
    return Iso230Position(
        target=target,
        mean_up=mean_up,
        mean_down=mean_down,
        s_up=s_up,
        s_down=s_down,
        runs_up=len(up),
        runs_down=len(down),
        R_up=None if s_up is None else 4 * s_up,
        R_down=None if s_down is None else 4 * s_down,
        R=repeat,
        B=reversal,
        mean=mean,
    )


@dataclasses.dataclass(frozen=True)
class _OneSide:
    """Unidirectional figures; `high` and `low` are the ends of the band x̄ ± 2s."""

    repeatability: float | None
    accuracy: float | None
    systematic: float | None
    high: float
    low: float


def _one_side(pairs: Sequence[tuple[float | None, float | None]]) -> _OneSide:
    """Return the figures of one direction from mean and deviation at each target."""
    spread = [(mean, s) for mean, s in pairs if mean is not None and s is not None]
    means = [mean for mean, _ in pairs if mean is not None]
    if not spread:
        return _OneSide(None, None, _range(means), -math.inf, math.inf)
    high = max([mean + 2 * s for mean, s in spread])
    low = min([mean - 2 * s for mean, s in spread])
    largest = 4 * max([s for _, s in spread])
    return _OneSide(largest, high - low, _range(means), high, low)


def _range(values: Sequence[float]) -> float | None:
    return max(values) - min(values) if values else None


def _gaps(
    positions: Sequence[Iso230Position], both: Sequence[Iso230Position]
) -> list[str]:
    """Return sentences on what the standard asks for and the data lack."""
    remarks = []
    if both and len(both) < len(positions):
        one_sided = [f"{item.target:g}" for item in positions if item.B is None]
        remarks.append(
            f"Targets {', '.join(one_sided[:8])} were approached from one side only; "
            "B, E, M and R leave them out."
        )
    counts = [n for p in positions for n in (p.runs_up, p.runs_down) if n]
    single = [f"{p.target:g}" for p in positions if 1 in (p.runs_up, p.runs_down)]
    if max(counts) < 2:
        remarks.append(
            "One run only: s, R and A need at least two runs (the standard, five)."
        )
    elif single:
        remarks.append(
            f"Targets {', '.join(single[:8])} have a single approach: no s there."
        )
    if max(counts) >= 2 and min(counts) < 5:
        remarks.append(
            f"The standard asks for five runs; some targets have {min(counts)}."
        )
    if min(counts) != max(counts):
        remarks.append(f"The numbers of runs differ: {min(counts)} to {max(counts)}.")
    if len(positions) < 5:
        remarks.append(f"The standard asks for five targets; found {len(positions)}.")
    return remarks


def _runs(rows: Sequence[_Approach]) -> tuple[Iso230Run, ...]:
    runs: dict[tuple[int, int], tuple[list[float], list[float]]] = {}
    for place, run, side, value in rows:
        places, values = runs.setdefault((run, side), ([], []))
        places.append(place)
        values.append(value)
    return tuple(
        Iso230Run(run, side, np.array(runs[run, side][0]), np.array(runs[run, side][1]))
        for run, side in sorted(runs, key=lambda k: (k[0], -k[1]))
    )


def _offsets(rows: Sequence[_Approach]) -> dict[int, float]:
    cells: dict[tuple[float, int], list[float]] = {}
    for place, _, side, value in rows:
        cells.setdefault((place, side), []).append(value)
    means = {key: math.fsum(values) / len(values) for key, values in cells.items()}
    offsets: dict[int, list[float]] = {}
    for place, run, side, value in rows:
        offsets.setdefault(run, []).append(value - means[place, side])
    return {
        run: math.fsum(values) / len(values) for run, values in sorted(offsets.items())
    }
