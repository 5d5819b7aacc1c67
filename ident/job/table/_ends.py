"""What readings leave open of a table: beyond the last of them, and in a gap that halves them."""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ...readings import Readings
from ..result._result import Remark
from ._draft import TableDraft
from ._layout import grid_keys, grid_words, same_nodes
from ._plan import Plan
from ._run_remarks import TINY

_Gap = tuple[int, int, Int[np.ndarray, " n"], str]
"""A master, a direction, the nodes along it that nobody read, and what the table does there."""
_PART = 0.1
"""Share of a table over which readings must lie at least."""
_TOUCHED = 0.25
"""Share of a cell at its end that readings must reach into for the node beyond it to be read."""
_FOLLOWS = "follows the other direction"
_SHIFTED = 0.1
"""Share of the way of all readings by which ends of measurements may differ (remove = "line")."""
_EMPTY = 0.9
"""Share of the way of all readings that one gap takes where they stand at two places."""


def held_beyond(draft: TableDraft) -> TableDraft:
    """Return a table that goes on beyond its readings as the controller does.

    There the smoothness would go on straight, or bend. Where the other direction was read the
    table follows that, as far from it as where both were read; else it holds its edge. How far
    that moves a node joins its deviation: either may be right.
    """
    plan, estimate = draft.plan, draft.estimate
    masters, branches = plan.table.nodes, plan.table.branches
    shape = branches, *(len(nodes.positions) for nodes in reversed(masters))
    # What was measured is held; with constraints the entries are, so that they keep them.
    base = np.zeros(shape)
    if plan.inequalities is not None:
        base = plan.acting_offset.reshape(shape)
    values = estimate.values.reshape(shape) - base
    deviation = estimate.standard_deviation.reshape(shape).copy()
    gaps = list[_Gap]()
    if branches == 2 and plan.inequalities is None:
        _follow(draft, values, deviation, gaps)
    for k, line in enumerate(masters):
        if plan.table.periodic:
            break
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
                    gaps.append(
                        (k, branch, way[1:2], "goes on as the last readings do")
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
                curves[branch, way[1:]] = gone
                sd[branch, way[1:]] = np.hypot(sd[branch, way[1:]], moved)
                held = "holds its edge"
                if plan.active and plan.inequalities is None:
                    held = "keeps its old shape, moved as its edge is"
                if max(moved.max(), np.abs(gone - edge).max()) > TINY:
                    gaps.append((k, branch, way[1:][seen], _FOLLOWS))
                    gaps.append((k, branch, way[1:][~seen], held))
    estimate = dataclasses.replace(
        estimate,
        values=(values + base).reshape(estimate.values.shape),
        standard_deviation=deviation.reshape(estimate.values.shape),
    )
    remarks = *draft.said, *_unread(draft, gaps), *_datum_beyond(draft)
    return dataclasses.replace(draft, estimate=estimate, said=remarks)


def _follow(
    draft: TableDraft,
    values: Float[np.ndarray, "2 n"],
    deviation: Float[np.ndarray, "2 n"],
    gaps: list[_Gap],
) -> None:
    """Move a direction where only the other one was read between nodes where both were."""
    table = draft.plan.table
    nodes = table.nodes[0].positions
    read = [_nodes_read(draft, 0, branch) for branch in range(2)]
    both = read[0] & read[1]
    for branch, own in enumerate(read if both.any() else ()):
        gap = read[1 - branch] & ~own
        if not table.periodic:  # beyond the last one its end is held
            inside = np.flatnonzero(own)
            gap[: inside[0]] = gap[inside[-1] :] = False
        apart = (values[branch] - values[1 - branch])[both]
        turn = float(np.ptp(nodes)) if table.periodic else None
        gone = values[1 - branch] + np.interp(nodes, nodes[both], apart, period=turn)
        moved = np.where(gap, np.abs(gone - values[branch]), 0.0)
        values[branch, gap] = gone[gap]
        deviation[branch] = np.hypot(deviation[branch], moved)
        if moved.max() > TINY:
            gaps.append((0, branch, np.flatnonzero(gap), _FOLLOWS))


def _unread(draft: TableDraft, gaps: Sequence[_Gap]) -> Iterator[Remark]:
    """Yield where nodes have no readings and what the table does there, each once."""
    words, table = dict[str, None](), draft.plan.table
    for k, branch, unread, does in gaps:
        if not len(unread):
            continue
        nodes = table.nodes[k].positions
        low, high = sorted(nodes[unread[[0, -1]]].tolist())
        inside = (nodes >= low) & (nodes <= high)
        place = f"at {draft.plan.fit.over[k]} = {low:g}"
        place += f" to {high:g}" * (high > low)
        where, other = "", 1 - branch
        if does == _FOLLOWS or (
            other < table.branches
            and _touched(nodes, _places(draft, k, other))[inside].all()
        ):
            where = f" in {'+−'[branch]} direction"
        begin = f"No reading{where} lies {place}: there nobody measured"
        if _touched(nodes, _places(draft, k, branch, wild=True))[inside].all():
            begin = f"Only wild readings{where} lie {place}: there none counts"
        words[f"{begin}, and the table {does}. Measure there as well."] = None
    yield from map(Remark.warning, words)


def _datum_beyond(draft: TableDraft) -> Iterator[Remark]:
    """Yield that the instrument was set to zero more than a node beyond all readings."""
    plan = draft.plan
    lines = zip(plan.fit.over, plan.table.nodes, plan.datum or (), strict=False)
    for k, (name, line, at) in enumerate(() if plan.table.periodic else lines):
        nodes = line.positions
        branches = range(plan.table.branches)
        places = [_places(draft, k, branch, datum=False) for branch in branches]
        read = np.flatnonzero(_touched(nodes, np.concatenate(places)))
        if not read.size:  # all of it wild
            continue
        first, last = nodes[[max(read[0] - 1, 0), min(read[-1] + 1, len(nodes) - 1)]]
        if not first <= at <= last:
            yield Remark.warning(
                f"Nothing was read at {name} = {at:g}, where the instrument was set to zero"
                " (datum): by what the error does on the way there all of the table is off."
                " Measure as far as the datum."
            )


def _places(
    draft: TableDraft,
    master: int,
    branch: int,
    *,
    wild: bool = False,
    datum: bool = True,
) -> Float[np.ndarray, " n"]:
    """Return where a direction was read along a master, within the table; and its datum.

    At the datum the error is zero as the job says, which nobody needs to read.
    """
    plan, readings, fit = draft.plan, draft.readings, draft.estimate
    nodes = plan.table.nodes[master].positions
    rows = np.ones(len(readings.error), bool)
    if len(fit.wild) == len(rows) and not wild:
        rows = ~fit.wild
    if plan.table.branches == 2 and readings.direction is not None:
        rows = rows & (readings.direction == (1, -1)[branch])
    places = readings.positions[rows, master]
    if plan.datum is not None and datum:
        places = np.append(places, plan.datum[master])
    first, last = nodes[[0, -1]].tolist()
    if plan.table.periodic:
        return np.asarray(first + (places - first) % (last - first))
    return np.asarray(np.clip(places, first, last))


def _touched(
    nodes: Float[np.ndarray, " n"], places: Float[np.ndarray, " t"]
) -> Bool[np.ndarray, " n"]:
    """Return the nodes that were read: a reading at the other end of a cell is far from one."""
    cell = np.clip(np.searchsorted(nodes, places, "right") - 1, 0, len(nodes) - 2)
    share = (places - nodes[cell]) / np.diff(nodes)[cell]
    read = np.zeros(len(nodes), bool)
    read[cell[share < 1.0 - _TOUCHED]] = True
    read[cell[share > _TOUCHED] + 1] = True
    return read


def _nodes_read(draft: TableDraft, master: int, branch: int) -> Bool[np.ndarray, " n"]:
    """Return the nodes along a master that a direction was read at."""
    nodes = draft.plan.table.nodes[master].positions
    read = _touched(nodes, _places(draft, master, branch))
    if draft.plan.table.periodic:  # its last node is the first one again
        read[[0, -1]] = read[0] | read[-1]
    return read


def _part_read(
    draft: TableDraft, master: int, branch: int
) -> tuple[int, int, float, float]:
    """Return the first and the last node along a master that were read.

    The shares of the cells beyond that readings reach follow.
    """
    nodes = draft.plan.table.nodes[master].positions
    places, read = _places(draft, master, branch), _nodes_read(draft, master, branch)
    if not read.any():  # all of it wild
        return 0, len(nodes) - 1, 0.0, 0.0
    first, last = np.flatnonzero(read)[[0, -1]].tolist()
    widths = np.diff(nodes)
    before = (nodes[first] - places.min()) / widths[max(first - 1, 0)]
    after = (places.max() - nodes[last]) / widths[min(last, len(widths) - 1)]
    return first, last, max(float(before), 0.0), max(float(after), 0.0)


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
        if not plan.active:
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


def refuse_other_stretches(plan: Plan, readings: Readings) -> None:
    """Raise where lines were taken off measurements that go over different stretches.

    Where the error bends, each stretch has another line, and the parts no longer fit.
    """
    specs = plan.job.spec.measurements
    lines = [
        (name, rows)
        for name, rows in readings.slices.items()
        if specs[name].remove == "line" and rows.stop > rows.start
    ]
    for master, places in zip(plan.fit.over, readings.positions.T, strict=True):
        ends = {name: (places[at].min(), places[at].max()) for name, at in lines}
        apart = np.ptp([*ends.values()], axis=0).max() if ends else 0.0
        if apart > _SHIFTED * np.ptp(places):
            stretches = ", ".join(
                f"{name!r} {low:.6g} to {high:.6g}"
                for name, (low, high) in ends.items()
            )
            reason = (
                f'found remove = "line" of measurements over different stretches of {master}'
                f" ({stretches}): where the error bends each has a slope of its own, and what is"
                f" left of one does not go on in the other. Expected one set-up over all of"
                f' {master}, or remove = "offset" (or a datum) where the slope is the machine\'s'
            )
            raise plan.refusal(reason)


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
    if few or same_nodes(nodes, grid) or plan.active:
        return ""
    return f" Nodes that suit these readings: {grid_words(grid)}."
