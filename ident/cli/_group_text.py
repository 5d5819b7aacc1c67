"""A group of fits in a terminal: the sum per axis, its effects, what stays open."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..report._scale import Scale, number, scale_of
from ._said import print_remarks, tell

if TYPE_CHECKING:
    from rich.console import Console

    from ..job import AbstractResult, EffectShare, GroupResult

_STAGES = ("before", "predicted", "from_file")


def print_group(
    console: "Console", group: "GroupResult", fits: Sequence["AbstractResult"]
) -> None:
    """Print what was identified together, what of it is written, and what is not told.

    Args:
        console: Where to.
        group: The group.
        fits: All fits of the job.
    """
    _print_sums(console, group)
    _print_effects(console, group, fits)
    lost = dict.fromkeys(pair.sentence for pair in group.lost)
    for sentence in lost:
        tell(console, f"not told: {sentence}")
    said = " ".join(lost)
    for each in group.effects:
        if each.written and each.why and each.name not in said:
            tell(console, f"not told: of the {each.name}: {each.why}")
    for freedom in group.freedoms:
        tell(console, f"free: {freedom.sentence} {freedom.rule}")
    print_remarks(console, [r for r in group.remarks if r.message not in lost])


def without_pairs(message: str, group: "GroupResult") -> str:
    """Return a remark without the sentences that the group has said already."""
    for pair in group.lost:
        message = message.replace(pair.sentence, "").strip()
    return message


def _print_sums(console: "Console", group: "GroupResult") -> None:
    from rich.table import Table

    count = len(group.fits)
    fits = "one fit" if count == 1 else f"{count} fits as one"
    table = Table(title=f"group {group.name}: {fits}, rms", title_justify="left")
    table.add_column("error of")
    for words in (
        "before",
        "predicted",
        "from file",
        "one reading",
        "readings",
        "wild",
    ):
        table.add_column(words, justify="right")
    for one in group.axes:
        scale = scale_of(one.unit)
        figures = [one.error[stage].sound.rms for stage in _STAGES]
        table.add_row(
            f"{one.axis}, {scale.error}",
            *(number(scale.factor * value) for value in (*figures, one.noise)),
            str(len(one.rows)),
            str(int(one.wild.sum())),
        )
    console.print(table)


def _print_effects(
    console: "Console", group: "GroupResult", fits: Sequence["AbstractResult"]
) -> None:
    from rich.table import Table

    scales = {one.axis: scale_of(one.unit) for one in group.axes}
    table = Table()
    table.add_column("effect")
    table.add_column("over")
    table.add_column("rms", justify="right")
    table.add_column("told apart", justify="right")
    table.add_column("list")
    for each in group.effects:
        scale = scales.get(each.axis, scale_of("mm"))
        over = fits[each.index].over if each.index is not None else ()
        table.add_row(
            each.name,
            ", ".join(over) or "–",
            _size(each, fits, scale),
            f"{each.information:.0%}",
            _fate(each, fits),
        )
    console.print(table)


def _size(each: "EffectShare", fits: Sequence["AbstractResult"], scale: Scale) -> str:
    if not each.determined or (each.index is not None and fits[each.index].left_out):
        return "not known"
    return f"{number(scale.factor * each.rms)} {scale.error}"


def _fate(each: "EffectShare", fits: Sequence["AbstractResult"]) -> str:
    if each.index is None:
        return f"none: {each.why}"
    if fits[each.index].left_out:
        return "LEFT OUT"
    if not each.written:
        return "nothing to write"
    return "written in part" if each.why else "written"
