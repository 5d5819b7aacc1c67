"""What readings leave open of a table: beyond the last of them, and in a gap that halves them."""

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ...readings import Readings
from ..result._result import Remark
from ._draft import TableDraft
from ._layout import grid_keys, grid_words, same_nodes
from ._plan import Plan
from ._run_remarks import SEEN, TINY

_PART = 0.1
"""Share of a table over which readings must lie at least."""
_TOUCHED = 0.25
"""Share of a cell at its end that readings must reach into for the node beyond it to be read."""
_EMPTY = 0.9
"""Share of the way of all readings that one gap takes where they stand at two places."""


def held_beyond(draft: TableDraft) -> TableDraft:
    """Return a table that goes on beyond its readings as the controller does.

    There the smoothness would go on straight, or bend. Where the other direction was read the
    table follows that, as far from it as at the last reading; else it holds its edge. How far
    that moves a node joins its deviation: either may be right.
    """
    plan, estimate = draft.plan, draft.estimate
    masters, branches = plan.table.nodes, plan.table.branches
    if plan.table.periodic:
        return draft
    shape = branches, *(len(nodes.positions) for nodes in reversed(masters))
    values = estimate.values.reshape(shape).copy()
    deviation = estimate.standard_deviation.reshape(shape).copy()
    least = max(SEEN * estimate.noise, TINY)
    said = dict[tuple[str, float, float, str], list[str]]()

    def say(branch: int, name: str, beyond: Float[np.ndarray, " n"], does: str) -> None:
        key = name, float(beyond.min()), float(beyond.max()), does
        said.setdefault(key, []).append("+−"[branch])

    for k, (name, line) in enumerate(zip(plan.fit.over, masters, strict=True)):
        nodes = line.positions
        parts = [_part_read(draft, k, branch) for branch in range(branches)]
        fitted, curves, sd = (
            np.moveaxis(array, -1 - k, 1)
            for array in (values.copy(), values, deviation)
        )
        for branch, (first, last, *shares) in enumerate(parts):
            begin, end, *_ = parts[branch - 1]
            ways = np.arange(first, -1, -1), np.arange(last, len(nodes))
            for share, way in zip(shares, ways, strict=True):
                if len(way) < 2:
                    continue
                step = fitted[branch, way[1]] - fitted[branch, way[0]]
                rest = (1.0 - share) * np.abs(step)
                edge = fitted[branch, way[0]] + share * step
                if (share * rest > np.maximum(TINY, sd[branch, way[1]])).any():
                    # Held at the last reading, the straight cell would miss those before it.
                    sd[branch, way[1]] = np.hypot(sd[branch, way[1]], rest)
                    say(
                        branch, name, nodes[way[1:2]], "goes on as the last readings do"
                    )
                    edge, way = fitted[branch, way[1]], way[1:]
                if len(way) < 2:
                    continue
                # Without another direction it is itself, which was not read there. Along what
                # follows it, constraints would judge what nobody measured.
                seen = (way >= begin) & (way <= end) & (plan.inequalities is None)
                seen = np.logical_and.accumulate(seen)[1:]
                change = np.diff(fitted[branch - 1, way], axis=0)
                change[~seen] = 0.0
                gone = edge + np.cumsum(change, axis=0)
                moved = np.abs(fitted[branch, way[1:]] - gone)
                if max(moved.max(), np.abs(gone - edge).max()) <= least:
                    continue
                curves[branch, way[1:]] = gone
                sd[branch, way[1:]] = np.hypot(sd[branch, way[1:]], moved)
                does = "holds its edge"
                if seen.any():
                    does = "follows the other direction"
                elif plan.old is not None:
                    does = "keeps its old shape, moved as its edge is"
                say(branch, name, nodes[way[1:]], does)
    remarks = [
        Remark.warning(
            f"No reading{f' in {signs[0]} direction' * (len(signs) < branches)} lies at {name} ="
            f" {low:g}{f' to {high:g}' * (high > low)}: there nobody measured, and the table"
            f" {does}. Measure there as well."
        )
        for (name, low, high, does), signs in said.items()
    ]
    estimate = dataclasses.replace(
        estimate,
        values=values.reshape(estimate.values.shape),
        standard_deviation=deviation.reshape(estimate.values.shape),
    )
    remarks += _datum_beyond(draft)
    return dataclasses.replace(draft, estimate=estimate, said=(*draft.said, *remarks))


def _datum_beyond(draft: TableDraft) -> Iterator[Remark]:
    """Yield that the instrument was set to zero more than a node beyond all readings."""
    plan = draft.plan
    lines = zip(plan.fit.over, plan.table.nodes, plan.datum or (), strict=False)
    for k, (name, line, at) in enumerate(lines):
        nodes = line.positions
        parts = [_part_read(draft, k, branch) for branch in range(plan.table.branches)]
        first, last = min(part[0] for part in parts), max(part[1] for part in parts)
        if not nodes[max(first - 1, 0)] <= at <= nodes[min(last + 1, len(nodes) - 1)]:
            yield Remark.warning(
                f"Nothing was read at {name} = {at:g}, where the instrument was set to zero"
                " (datum): by what the error does on the way there all of the table is off."
                " Measure as far as the datum."
            )


def _part_read(
    draft: TableDraft, master: int, branch: int
) -> tuple[int, int, float, float]:
    """Return the first and the last node along a master that were read.

    A node that readings touch from afar, at the other end of its cell, is beyond them: the
    shares of the cells beyond that readings reach follow.
    """
    table, readings, wild = draft.plan.table, draft.readings, draft.estimate.wild
    nodes = table.nodes[master].positions
    rows = np.ones(len(readings.error), bool)
    if len(wild) == len(rows):
        rows = ~wild
    if table.branches == 2 and readings.direction is not None:
        rows = rows & (readings.direction == (1, -1)[branch])
    places = np.clip(readings.positions[rows, master], nodes[0], nodes[-1])
    if not len(places):
        return 0, len(nodes) - 1, 0.0, 0.0
    low, high = float(places.min()), float(places.max())
    widths = np.diff(nodes)
    first = int(np.searchsorted(nodes[1:] - _TOUCHED * widths, low, "right"))
    last = int(np.searchsorted(nodes[:-1] + _TOUCHED * widths, high))
    first, last = min(first, last), max(first, last)
    before = (nodes[first] - low) / widths[max(first - 1, 0)]
    after = (high - nodes[last]) / widths[min(last, len(widths) - 1)]
    return first, last, max(before, 0.0), max(after, 0.0)


def two_places(plan: Plan, readings: Readings) -> Iterator[Remark]:
    """Yield that readings stand at two ends of a master, where nodes lie between.

    Raises:
        JobError: If there is no old table whose nodes must stay.
    """
    lines = zip(plan.fit.over, plan.table.nodes, readings.positions.T, strict=True)
    for name, line, positions in lines:
        nodes = line.positions
        places = np.sort(np.clip(positions, nodes[0], nodes[-1]))
        widest = int(np.argmax(np.diff(places, append=places[-1])))
        low, high = places[widest], places[min(widest + 1, len(places) - 1)]
        within = (nodes > low) & (nodes < high)
        small = high - low < _EMPTY * float(np.ptp(places))
        if small or plan.table.periodic or not within.any():
            continue
        words = (
            f"no reading lies between {name} = {low:.6g} and {high:.6g}, and those beside stand"
            " too close together to tell how the error goes there"
        )
        if plan.old is None:
            words += (
                ", expected no node between (the controller goes straight), or readings"
            )
            raise plan.refusal(words)
        yield Remark.warning(f"The old table keeps its shape in a gap: {words}.")


def refuse_small_part(plan: Plan, readings: Readings) -> None:
    """Raise where readings lie in so small a part of the table that their unit must be wrong."""
    if plan.table.periodic:
        return
    lines = zip(plan.fit.over, plan.table.nodes, readings.positions.T, strict=True)
    for name, nodes, places in lines:
        low, high = float(places.min()), float(places.max())
        first, last = nodes.positions[[0, -1]].tolist()
        # Inches are a 25th of millimetres. Those of a single place are refused as such.
        if 0.0 < high - low < _PART * (last - first):
            words = (
                f"found readings at {name} = {low:.6g} to {high:.6g}, expected them over"
                f" more than a tenth of the table, which goes from {first:g} to {last:g}: is"
                f" the unit of {name}.position right (columns)? A table for that part alone"
                " holds its edge beyond it"
            )
            raise plan.refusal(words)


def better_nodes(plan: Plan, readings: Readings) -> str:
    """Return nodes that suit readings better, in words; nothing where a job cannot have them."""
    over, axes = plan.fit.over, plan.job.spec.axes
    if any(axes[name].modulo is not None for name in over):
        return ""  # they must cover the turn
    # What a cross table does beyond its ends is not documented (S-12).
    crosses = len(over) == 1 and not plan.fit.lengths
    limits = axes[over[0]].limits if crosses else None
    reach = None if limits is None else (limits[0], limits[1])
    grid = grid_keys([*readings.positions.T], reach)
    nodes = [line.positions for line in plan.table.nodes]
    few = np.min(grid["points"]) < 4  # each is left out in turn
    if few or same_nodes(nodes, grid) or plan.old is not None:
        return ""
    return f" Nodes that suit these readings: {grid_words(grid)}."
