"""What a fit has to say for itself, in sentences."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ....data.measurements import Measurement
from ...exchange import AbstractTable
from ...readings import Readings
from ..result._result import Remark, SampleView, some_of, wild_remark
from ._run_remarks import SEEN, TINY, run_remarks

if TYPE_CHECKING:
    from ._draft import TableDraft
    from ._plan import Plan

_SPARSE = 1.5
"""Readings per node up to which no place was measured twice to speak of."""

_SHORT = 0.1
"""Share of the travel that a table may leave out before it is said."""

_TELLING, _WANDERS = 40, 0.4
"""Readings of places that were read again that tell a wander from noise; share of the mean square
of their changes that neighbours in time leave, below which there is one."""

LOG = 1000
"""Readings from which on nobody went from place to place to read them."""
_STRETCHES, _CELLS, _FEW = 8, 20, 5
"""Stretches of a log, cells along each master, and cells that a stretch must have passed."""
_MOVED = 0.5
"""Share of the scatter within cells that stretches of a log may lie apart."""

_TURNED = 3.0
"""Scatters of the readings of a kind from which every second one is of the other direction."""

_WIDE = 0.75
"""Share of the distance of nodes that readings may lie apart, and nodes be too far apart."""
_EDGE, _SURE = 1e-3, 4.0
"""Share of the distance of nodes within which a reading lies at the last one; deviations of the
mean of what a table leaves there that are not by chance."""

_OVERRUN = 0.01
"""Share of the travel by which a reading may lie beyond the limits: runs begin before them."""

_COPIED = 8
"""Different readings from which on it is no chance that all of them come again."""
_DOUBTED = 2.0
"""Deviation of a node, in the usual one, from which on it is doubted by readings that agree."""
_MOST, _MOST_WILD = 6, 20
"""Nodes, and wild readings, that are named one by one."""


def fit_remarks(
    draft: "TableDraft", count: int, wild: int, beyond: int, places: Sequence[str]
) -> Iterator[Remark]:
    """Return gaps, suspicious nodes and runs, and what each run was allowed.

    So many of its readings are wild, in these places where somebody kept them, or lie beyond
    the table.
    """
    fit = draft.estimate
    empty = int(np.sum(fit.support == 0))
    if empty:
        why = "were not measured"
        if wild:
            why = "rest on no reading (not measured, or only wild ones)"
        yield Remark.warning(
            f"{empty} of {fit.support.size} node values{_stretches(draft)} {why}; what they"
            " say is assumed, and their support is 0."
        )
    yield from _log_remarks(draft)
    yield from _copies(draft)
    yield from _turn_remarks(draft)
    yield from _wide_nodes(draft)
    for name, nodes in zip(draft.fit.over, draft.plan.table.nodes, strict=True):
        limits, (low, high) = draft.job.spec.axes[name].limits, nodes.positions[[0, -1]]
        if limits is None or draft.plan.table.periodic:
            continue
        short = max(low - limits[0], 0.0) + max(limits[1] - high, 0.0)
        if short > _SHORT * (limits[1] - limits[0]):
            yield Remark.warning(
                f"The table covers {name} = {low:g} to {high:g} of a travel from"
                f" {limits[0]:g} to {limits[1]:g} (limits): beyond it its edge is held,"
                " which nobody has measured there."
            )
    if beyond:
        words = f"{beyond} of {count} readings lie outside the table, where its edge is held."
        doubt = doubt_of_places(beyond, count) + _pulled_ends(draft)
        yield Remark("warning" if doubt else "info", words + doubt)
    if wild:
        yield wild_remark(wild, count, draft.fit.loss)
    if places:
        times = Counter(places).items()
        names = [place + (f" ({n} of them)" if n > 1 else "") for place, n in times]
        words = f"Wild readings lie at {some_of(names, _MOST_WILD)}."
        yield Remark.info(words)
    if fit.suspect_nodes:
        words = some_of([_node(draft, k) for k in fit.suspect_nodes], _MOST)
        read = [k for k in fit.suspect_nodes if fit.support.flat[k]]
        lost = float(fit.standard_deviation.flat[read].max(initial=0.0))
        again = (
            " Those beside each other agree: if they are right, and no fault of the"
            f" instrument, the table is off there by up to {draft.small(lost)}, which its"
            " standard deviations hold. Measure there again."
        )
        # A doubt that all nodes have in common is none of these readings.
        usual = float(np.median(fit.standard_deviation[fit.support > 0]))
        words += "." + again * (lost > max(SEEN * fit.noise, _DOUBTED * usual))
        yield Remark.warning(f"Readings contradict their surroundings at {words}")
    yield from run_remarks(draft)
    if not fit.runs and draft.run_effects == "none":
        read_at = np.unique(draft.readings.positions.round(2), axis=0)
        if count <= _SPARSE * min(fit.support.size, len(read_at)):
            clause = "is not in the standard deviations"
            if fit.line_offset:
                clause = (
                    "stands in the standard deviations only as an assumed offset of every"
                    f" line of readings, {draft.small(fit.line_offset, '.1f')} (1 sd)"
                )
            yield Remark.info(
                "Nothing was measured twice: what changes from one measurement to the"
                f" next {clause}. A second measurement, given together with the first,"
                " brings it in."
            )
    if not fit.converged or fit.loss != draft.fit.loss:
        yield Remark.warning(fit.message)


def _stretches(draft: "TableDraft") -> str:
    """Return where nodes of a line have no readings, or how far those of a surface go on."""
    (nodes, *more), name = draft.plan.table.nodes, draft.fit.over[0]
    if more:
        assumed = draft.estimate.values[draft.estimate.support == 0]
        words = [draft.small(end, ".3g") for end in (assumed.min(), assumed.max())]
        return f" (errors of {' to '.join(words)})"
    places = nodes.positions
    bare = draft.estimate.support.reshape(-1, len(places)) == 0
    edges = np.flatnonzero(np.diff(bare.any(axis=0), prepend=False, append=False))
    ends = zip(places[edges[::2]], places[edges[1::2] - 1], strict=True)
    words = [f"{low:g}" + f" to {high:g}" * int(high > low) for low, high in ends]
    return f" ({name} = {some_of(words, _MOST)})"


def _pulled_ends(draft: "TableDraft") -> str:
    """Return by how much readings beyond a line of nodes move its ends from those beside them.

    They tell the edge that is held there. Where the error goes on, an end node is between both.
    """
    (nodes, *more), fit = draft.plan.table.nodes, draft.estimate
    readings = draft.readings
    if more or draft.plan.table.periodic or len(fit.residual) != len(readings.error):
        return ""
    keep = np.isfinite(fit.residual) & ~fit.wild
    place, left = readings.positions[keep, 0], np.asarray(fit.residual)[keep]
    moved = list[str]()
    for end, next_one in (nodes.positions[:2], nodes.positions[:-3:-1]):
        inside = (place - end) / (next_one - end)
        beside = left[(np.abs(inside) <= _EDGE) | ((inside >= 0.0) & (inside <= 0.5))]
        if (inside < -_EDGE).any() and len(beside) > 1:
            off = abs(float(beside.mean()))
            sure = _SURE * float(beside.std(ddof=1)) / np.sqrt(len(beside))
            if off > max(sure, TINY):
                moved.append(f"{draft.fit.over[0]} = {end:g} by {draft.small(off)}")
    if not moved:
        return ""
    return (
        f" They move the table away from the readings at {' and '.join(moved)}: let it reach as"
        " far as they do, or leave them out."
    )


def limit_remarks(
    plan: "Plan", positions: Float[np.ndarray, "t d"], *, log: bool = False
) -> Iterator[Remark]:
    """Return a doubt where readings lie where the software limits let no axis go.

    Of a log in pieces some are looked at only.
    """
    for axis, places in zip(plan.fit.over, positions.T, strict=True):
        limits = plan.job.spec.axes[axis].limits
        if limits is None:
            continue
        allowed = _OVERRUN * (limits[1] - limits[0])
        beyond = np.maximum(limits[0] - places, places - limits[1]) > allowed
        if count := int(np.sum(beyond)):
            readings = "readings looked at" if log else "readings"
            yield Remark.warning(
                f"{count} of {len(places)} {readings} lie beyond the limits of {axis}"
                f" ({limits[0]:g} to {limits[1]:g}), where it cannot go. Are column, unit and"
                " origin of its positions right?"
            )


def wander_remarks(
    plan: "Plan", measured: Sequence[Measurement], readings: Readings
) -> Iterator[Remark]:
    """Return a doubt where readings without runs change from one visit of a place to the next.

    A place is that of all axes, approached in one direction. What white noise makes of its
    readings does not go on to the next place.
    """
    if readings.run is not None or len(readings.error) >= LOG:
        return
    every = [one.values.with_gaps() for one in measured]
    usable = [{*values} - {*values.unusable} for values in every]
    columns = []
    for role in {
        role for roles in usable for role in roles if role.endswith(".position")
    }:
        parts = zip(every, usable, measured, strict=True)
        places = [v[role] if role in own else np.zeros(m.rows) for v, own, m in parts]
        columns.append(np.concatenate(places))
    if readings.direction is not None:
        columns.append(readings.direction)
    error, order = readings.error, readings.order
    number, counts = _places_in(np.column_stack(columns))
    mean = np.bincount(number, error) / counts
    again = (counts > 1)[number]
    change = (error - mean[number])[again][np.argsort(order[again], kind="stable")]
    if len(change) < _TELLING:
        return
    scatter, whole = float(np.mean(np.diff(change) ** 2)) / 2.0, float(np.var(change))
    if scatter < _WANDERS * whole:
        yield Remark.warning(
            f"Readings of the same place wander in time by {plan.small(np.sqrt(whole - scatter))}"
            f" rms, beside {plan.small(np.sqrt(scatter))} of scatter. The standard deviations do"
            " not hold that: state what was a run of its own (run), or that the instrument"
            " drifts (drift, with a group)."
        )


def _places_in(
    columns: Float[np.ndarray, "t c"],
) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, " p"]]:
    """Return the number of the place of each reading, and how often each is read."""
    _, number, counts = np.unique(
        columns.round(6), axis=0, return_inverse=True, return_counts=True
    )
    return number.reshape(-1), counts


def _copies(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where every reading stands there again, to the last digit."""
    readings = draft.readings
    # Of millions of rows a look at the errors alone is soon done.
    if np.unique(readings.error.round(9), return_counts=True)[1].min() < 2:
        return
    columns = [*readings.positions.T, readings.error]
    if readings.direction is not None:
        columns.append(readings.direction)
    rows, counts = np.unique(
        np.stack(columns, axis=1).round(9), axis=0, return_counts=True
    )
    # A dial of coarse steps shows few values, and these again.
    values = np.unique(rows[:, readings.positions.shape[1]])
    if counts.min() > 1 and 2 * len(values) > len(rows) > _COPIED:
        times = " to ".join(map(str, sorted({counts.min(), counts.max()})))
        yield Remark.warning(
            f"Each of {len(rows)} readings stands there {times} times, the same to the last"
            " digit: written more than once? Copies tell nothing; take them out, or all"
            " standard deviations are too small."
        )


def _log_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where what a table leaves of a log changes from stretch to stretch.

    Stretches are compared cell by cell: what a table misses at a place is no change in time.
    """
    readings, residual = draft.readings, draft.estimate.residual
    if readings.run is not None or len(residual) < LOG:
        return
    keep = np.isfinite(residual) & ~draft.estimate.wild
    when = np.argsort(np.argsort(readings.order[keep], kind="stable"), kind="stable")
    stretch = when * _STRETCHES // len(when)
    places, left = readings.positions[keep], residual[keep]
    low, span = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    cells = np.minimum((places - low) / span * _CELLS, _CELLS - 1).astype(np.int64)
    if readings.direction is not None:
        cells = np.column_stack([cells, readings.direction[keep]])
    cell = np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)
    key = cell * _STRETCHES + stretch
    size = int(cell.max() + 1) * _STRETCHES
    counts = np.bincount(key, minlength=size)
    sums = np.bincount(key, left, size), np.bincount(key, left**2, size)
    mean = np.where(counts > 1, sums[0] / np.maximum(counts, 1), np.nan)
    within = float(np.sum((sums[1] - counts * mean**2)[counts > 1]))
    scatter = np.sqrt(within / max(float((counts - 1)[counts > 1].sum()), 1.0))
    table = mean.reshape(-1, _STRETCHES)
    table = table[np.isfinite(table).sum(axis=1) > 1]
    seen = np.isfinite(table).sum(axis=0)
    if (seen < _FEW).any():
        return
    moved = np.nanmean(table - np.nanmean(table, axis=1, keepdims=True), axis=0)
    if (apart := float(np.std(moved))) > max(_MOVED * scatter, TINY):
        yield Remark.warning(
            f"What the table leaves of the log wanders in time by {draft.small(apart)} rms"
            f" from stretch to stretch, beside {draft.small(scatter)} of scatter: the zero"
            " of the instrument moved, or something else that no list of this axis follows."
            " The standard deviations do not hold that. Cut the log where it jumps, state its"
            " parts as runs (run), or that the instrument drifts (drift, with a group)."
        )


def _turn_remarks(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where a table of one direction is the mean of readings of both.

    Where an axis went there and back, every second reading of a place lies to one side.
    """
    readings = draft.readings
    way = readings.direction
    if len(readings.error) >= LOG or draft.plan.table.branches == 2:
        return
    order = np.argsort(readings.order, kind="stable")
    error = readings.error[order]
    place, visits = _places_in(readings.positions[order])
    if way is not None and len(np.unique(way)) > 1:
        turn, state = way[order] < 0, "bilateral = true"
        first, second = "Readings in + direction lie", "those in − direction"
    else:
        turn = np.empty(len(error), bool)
        alternate = [np.arange(count) % 2 == 1 for count in visits]
        turn[np.argsort(place, kind="stable")] = np.concatenate(alternate)
        first, second = "Every second reading of a place lies", "the others"
        second += ", as where an axis goes there and back"
        state = f'bilateral = true and their direction ("{draft.axis}.direction")'
    cell = 2 * place + turn
    counts = np.bincount(cell, minlength=2 * len(visits))
    told = way is not None and len(visits) >= _FEW
    if counts.min() < (1 if told else 2):
        return
    mean = np.bincount(cell, error) / counts
    between, free = mean[::2] - mean[1::2], len(error) - len(counts)
    scatter = float(np.sqrt(np.sum((error - mean[cell]) ** 2) / max(free, 1)))
    if not free:  # one pass each way: by what both differ by from place to place
        scatter = float(np.std(between, ddof=1)) / np.sqrt(2.0)
    apart = abs(float(np.mean(between)))
    remedy = f"State {state}, or fit a backlash beside it."
    if not hasattr(draft.fit, "bilateral"):
        over = " and ".join(draft.fit.over)
        remedy = (
            f"No {draft.fit.compensation} list holds a difference of directions: look at the play"
            f" and the guides of {over}."
        )
    if apart > max(_TURNED * scatter, TINY):
        yield Remark.warning(
            f"{first} {draft.small(apart)} from {second} (those of a kind scatter by"
            f" {draft.small(scatter)}): the table is the mean of both. {remedy}"
        )


def _wide_nodes(draft: "TableDraft") -> Iterator[Remark]:
    """Return a doubt where readings that repeat lie beside the table, between its nodes."""
    readings, fit, table = draft.readings, draft.estimate, draft.plan.table
    keep = np.isfinite(fit.residual) & ~fit.wild
    keep &= ~outside(table, readings.positions)  # no node follows those
    if len(readings.error) >= LOG or not keep.any():
        return
    positions, left = readings.positions[keep].round(6), np.asarray(fit.residual)[keep]
    branch = draft.plan.branch(readings.direction)
    columns = [positions] if branch is None else [positions, branch[keep, None]]
    cell, counts = _places_in(np.hstack(columns))
    # Nodes that take up each place can miss none of them.
    if len(counts) <= np.sum(fit.support > 0) or len(left) < 2 * len(counts):
        return
    mean = np.bincount(cell, left) / counts
    variance = float(np.sum((left - mean[cell]) ** 2)) / (len(left) - len(counts))
    square = float(counts @ mean**2 - variance * len(counts)) / len(left)
    if square <= max(variance, TINY**2):
        return
    for k, (name, nodes) in enumerate(zip(draft.fit.over, table.nodes, strict=True)):
        gap = float(np.median(np.diff(np.unique(positions[:, k]))))
        wide = float(np.median(np.diff(nodes.positions)))
        if gap < _WIDE * wide:
            yield Remark.warning(
                f"Readings of a place repeat within {draft.small(variance**0.5)}, and the table"
                f" misses their means by {draft.small(square**0.5)} rms: along {name} its nodes"
                f" lie {wide:.4g} apart, the readings {gap:.4g}. Closer nodes follow them."
            )


def doubt_of_places(beyond: int, count: int) -> str:
    """Return a question where most of the readings lie outside the table; else nothing."""
    if beyond <= 0.5 * count:
        return ""
    return " Are unit and origin of their positions right?"


def outside(
    table: AbstractTable, positions: Float[np.ndarray, "t d"]
) -> Bool[np.ndarray, " t"]:
    """Tell which readings lie outside the nodes."""
    beyond = np.zeros(len(positions), dtype=bool)
    if table.periodic:
        return beyond
    for k, nodes in enumerate(table.nodes):
        ends = nodes.positions[[0, -1]]
        column = positions[:, k]
        # A node lies at a whole list unit, the reading meant for it perhaps beside it.
        edge = _EDGE * float(np.diff(nodes.positions).min())
        beyond |= (column < ends[0] - edge) | (column > ends[1] + edge)
    return beyond


def places_of(
    readings: SampleView, mask: Bool[np.ndarray, " t"], masters: Sequence[str]
) -> tuple[str, ...]:
    """Return where some of the readings lie: positions, direction and run, in words."""
    places = []
    for k in np.flatnonzero(mask):
        words = [
            f"{name} = {round(place, 4) + 0.0:.7g}"
            for name, place in zip(masters, readings.positions[k], strict=True)
        ]
        if readings.direction is not None:
            words.append("positive" if readings.direction[k] > 0 else "negative")
        if readings.run is not None:
            words.append(f"run {readings.run[k]}")
        places.append(", ".join(words))
    return tuple(places)


def _node(draft: "TableDraft", index: int) -> str:
    """Return a node of the flattened table in words."""
    table, over = draft.plan.table, draft.fit.over
    place = np.unravel_index(index, table.layout.shape)
    at = [int(k) for k in place[-len(table.nodes) :]]
    words = ", ".join(
        f"{name} = {nodes.positions[k]:g}"
        for name, nodes, k in zip(over, table.nodes, reversed(at), strict=True)
    )
    if table.branches == 2:
        words += " (positive)" if place[0] == 0 else " (negative)"
    return words
