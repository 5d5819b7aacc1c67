"""What stays when all that was found is taken off: drifts, fine periods, structure."""

from collections.abc import Iterator, Sequence

import numpy as np

from ..core import node_shares
from ._columns import smooth
from ._data import Drift, Unexplained
from ._doubts import SLIGHT, SLIGHT_SHARE
from ._select import Selection

_PIECES = (1, 2, 3, 4, 6, 8, 12, 16, 20)
"""Straight pieces that a drift may have."""
_WORTH = 0.25
"""Of the scatter of a reading: what is smaller is left where it is."""
_BINS = 4096
"""Places along a position between which readings are not told apart."""
_CHANCE = 1e-4
"""Probability that noise alone shows a line as strong, over all periods."""
_COARSE = 24
"""Periods per travel up to which the features hold them."""
_FINEST = 0.25
"""Cycles per bin up to which a period is looked for."""
_MOST_NODES = 1000
"""Entries of a table over one position that every build has."""
_STRUCTURE = 1.15
"""Scatter, relative to that of neighbouring readings, at which something is left."""
_ENOUGH, _PAIRS = 1000, 300
"""Readings, and neighbours among them, from which on that is told."""


def amount(found: Selection, rms: float) -> str:
    """Return a length or angle as a person writes it."""
    view = found.view
    return f"{1e3 * rms:.2g} {'µm' if view.data.unit(view.axis) == 'mm' else 'm°'}"


def stays(
    found: Selection,
    what: str,
    masters: Sequence[str],
    rms: float,
    sentence: str,
    share: float | None = None,
    known: bool = True,
) -> Unexplained:
    """Return what stays: no compensation holds it, or several could (``known`` false)."""
    view = found.view
    if share is None:
        share = min(rms**2 / found.square, 1.0)
    return Unexplained(
        view.axis, what, tuple(dict.fromkeys(masters)), rms, share,
        view.data.unit(view.axis),
        "the kernel cannot express this" if known else "the data cannot tell", sentence,
    )  # fmt: skip


def drifts(found: Selection) -> Iterator[Drift]:
    """Yield the drift of each measurement of an axis in which there is one.

    How large it is, the evidence says; its pieces are the fewest that follow it.
    """
    view, course, time = found.view, found.drift, found.view.data.time
    if time is None or not found.columns.drift.shape[1]:
        return
    for rows in view.sources:
        clock, rms = time[rows], float(np.std(course[rows]))
        # Runs have an offset each, which a fit allows for.
        several = len(np.unique(view.data.run[rows])) > 1
        if several or not np.ptp(clock) > 0 or rms <= _WORTH * found.noise:
            continue
        pieces = _PIECES[-1]
        for pieces in _PIECES:
            knots = np.linspace(clock.min(), clock.max(), pieces + 1)
            lines = node_shares(clock, knots)
            left = course[rows] - lines @ np.linalg.lstsq(lines, course[rows])[0]
            if float(np.std(left)) <= _WORTH * found.noise:
                break
        yield _drift(found, int(view.data.source[rows[0]]), pieces, rms)


def _drift(found: Selection, source: int, pieces: int, rms: float) -> Drift:
    """Return a slow change in time, and whether it is much for an instrument."""
    axis = found.view.axis
    follow = f"{pieces} straight pieces follow it."
    if pieces == 1:
        follow = "one straight piece follows it."
    sentence = (
        f"Beside what was found the error of {axis} wanders in time by"
        f" {amount(found, rms)} rms, as the zero of an instrument does: {follow}"
    )
    if rms >= max(SLIGHT * found.noise, SLIGHT_SHARE * np.sqrt(found.square)):
        sentence += (
            " That is much for an instrument: something may have warmed whose"
            " temperature was not recorded, or cannot be told from this."
        )
    return Drift(axis, source, pieces, rms, found.view.data.unit(axis), sentence)


def ripples(found: Selection) -> Iterator[Unexplained]:
    """Yield the strongest periodic error over each position that a table is too coarse for."""
    view = found.view
    for master, (low, high) in view.span.items():
        turns, amplitude = _ripple(found, master)
        if not turns:
            continue
        own, unit = master == view.axis, view.data.unit(view.axis)
        # Six entries per period follow it.
        nodes = int(np.ceil(6.0 * turns)) + 1
        remedy = f"more than the {_MOST_NODES} that a list has by default."
        if nodes <= _MOST_NODES:
            kind = "leadscrew" if own else "cross"
            remedy = f"so a {kind} table of that many would hold it."
        rms = amplitude / float(np.sqrt(2.0))
        sentence = (
            f"The error of {view.axis} repeats every {(high - low) / turns:.4g} {unit} of"
            f" {master} ({amount(found, rms)} rms), finer than a table that follows"
            f" the rest: it takes {nodes} nodes, {remedy}"
        )
        what = f"periodic error of {view.axis} over {master}"
        yield stays(found, what, () if own else (master,), rms, sentence)


def _ripple(found: Selection, axis: str) -> tuple[float, float]:
    """Return periods per travel and amplitude in mm or ° of a fine period; 0 where none."""
    view, none = found.view, (0.0, 0.0)
    u = view.scaled(axis)
    known = np.isfinite(u)
    last = min(int(_FINEST * _BINS), view.places(axis) // 4)
    if view.places(axis) < 8 * _COARSE or last <= _COARSE + 1:
        return none
    u, block = u[known], view.block[known]
    left = np.clip(found.residual[known], -4.0 * found.noise, 4.0 * found.noise)
    # Where places lie in rows, what is slow over them would show as fine lines.
    slow = np.stack([wave(u) for wave in smooth(2 * _COARSE)], axis=1)
    left = left - slow @ np.linalg.lstsq(slow, left)[0]
    bins = np.minimum((u * _BINS).astype(np.int64), _BINS - 1)
    # What is there is there in either half of the recording, with the same phase.
    halves = [block % 2 == k for k in (0, 1)]
    lines = [np.fft.rfft(np.bincount(bins[h], left[h], _BINS)) for h in halves]
    whole, total = lines[0] + lines[1], float(left @ left)
    power = np.abs(whole[_COARSE + 1 : last]) ** 2
    at = _COARSE + 1 + int(np.argmax(power))
    if not power.max() >= total * np.log((last - _COARSE - 1) / _CHANCE) > 0:
        return none
    values = [
        2.0 * line[at] / max(int(half.sum()), 1)
        for line, half in zip(lines, halves, strict=True)
    ]
    amplitude = 2.0 * float(abs(whole[at])) / len(u)
    agreement = float(np.real(values[0] * np.conj(values[1])))
    if amplitude / np.sqrt(2.0) < found.least or agreement < 0.25 * amplitude**2:
        return none
    tried = at + np.linspace(-1.0, 1.0, 41)
    fits = [abs(left @ np.exp(-2j * np.pi * each * u)) for each in tried]
    return float(tried[int(np.argmax(fits))]), amplitude


def structure_left(
    found: Selection, periods: Sequence[Unexplained]
) -> Iterator[Unexplained]:
    """Yield what is left beyond the scatter of neighbours, unless it is slight."""
    view = found.view
    if view.data.time is None or len(view.error) < _ENOUGH:
        return
    step, same = np.diff(view.data.clock), np.diff(view.data.source) == 0
    near = same & (step <= np.median(step[same]))
    apart = np.diff(found.residual)[near]
    if len(apart) < _PAIRS:
        return
    white = 1.4826 * float(np.median(np.abs(apart))) / np.sqrt(2.0)
    known = sum(each.rms**2 for each in periods)
    extra = float(np.sqrt(max(found.noise**2 - white**2 - known, 0.0)))
    if np.hypot(white, extra) >= _STRUCTURE * white and extra >= 3.0 * found.least:
        text = (
            f"Another {amount(found, extra)} rms of the error of {view.axis} is no"
            " scatter of single readings, and nothing that was recorded explains it."
        )
        yield stays(found, f"rest of the error of {view.axis}", (), extra, text)
