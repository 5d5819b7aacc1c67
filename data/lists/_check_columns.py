"""Rules of one table column: ascending, inside its size, complete.

A column is looked at as a whole, single entries only where something is wrong.
"""

import operator
from collections.abc import Sequence

from ._check_view import ListView, shorten
from ._entry import Rows
from ._parameter import Parameter
from ._registry import registry


def check_ascending(
    view: ListView, key: str, count: int, title: str, number: int | None = None
) -> None:
    """Report a column whose first ``count`` values do not ascend strictly.

    A missing entry counts as 0, as it does in the kernel ([001] p. 43, defaults), which
    nearly always breaks the order; where it does not, it is reported all the same. A
    value that cannot be read has a finding of its own and is passed over.
    """
    number = registry().by_key[key].number if number is None else number
    rows = view.rows(key)
    absent, which = absent_indices(rows, count)
    if rows is None or absent > 1:
        view.add(
            "error",
            f"{title} do not ascend: {which} of {count} are missing and count as 0",
            key,
            place=view.place(key) if rows is None else view.value_place(rows, 0),
            number=number,
            found=f"{absent} missing",
            expected=f"{count} ascending values",
        )
        return
    values = column_values(rows, count)
    at: Sequence[int] = range(count)
    if None in rows.integers:
        unreadable = {i for (i,), k in rows.last.items() if rows.integers[k] is None}
        at = [i for i in at if i not in unreadable]
        values = [values[i] for i in at]
    if all(map(operator.lt, values, values[1:])):
        check_complete(view, key, count)
        return
    k = next(k for k in range(1, len(values)) if values[k - 1] >= values[k])
    place = rows.last.get((at[k],), rows.last.get((at[k - 1],), 0))
    view.add(
        "error",
        f"{title} do not ascend: [{at[k - 1]}] = {values[k - 1]}, "
        f"[{at[k]}] = {values[k]}"
        + (f" ({which} is missing and counts as 0)" if absent else ""),
        key,
        place=view.value_place(rows, place),
        number=number,
        found=f"{values[k - 1]}, {values[k]}",
        expected="ascending values",
    )


def absent_indices(rows: Rows | None, count: int) -> tuple[int, str]:
    """Return how many indices below a count a column lacks, and the first few in words."""
    present = {index for (index,) in rows.last if index < count} if rows else set()
    length = max(count, 0) - len(present)
    if not length:
        return 0, ""
    # At most len(present) + 3 steps: every step finds one or meets one present.
    missing = (index for index in range(count) if index not in present)
    return length, shorten(missing, length)


def column_values(rows: Rows, count: int) -> list[int]:
    """Return the values of indices 0 … count − 1, 0 where missing or unreadable."""
    values = [0] * count
    integers = rows.integers
    for (index,), at in rows.last.items():
        if index < count:
            values[index] = integers[at] or 0
    return values


def check_size(
    view: ListView, key: str, count: int, sizer: Parameter, *, tolerated: bool = False
) -> None:
    """Report entries of a one-dimensional column at or beyond ``count``.

    Args:
        view: The list.
        key: Column.
        count: Number of entries that the list says the table has.
        sizer: Parameter that says so.
        tolerated: Whether one statement of the manuals allows index ``count`` itself.
    """
    rows = view.rows(key)
    if rows is None or not rows.indices or max(rows.last)[0] < count:
        return
    limit = count + 1 if tolerated and count else count
    beyond = [at for at, (index,) in enumerate(rows.indices) if index >= limit]
    edge = [at for at, (index,) in enumerate(rows.indices) if count <= index < limit]
    size = f"{sizer.name} = {view.value(sizer.key)}"
    note = "" if sizer.key in view.columns else " (left out)"
    if beyond:
        listed = shorten((rows.indices[at][0] for at in beyond), len(beyond))
        view.add(
            "error",
            f"{key} goes beyond the table's end: index {listed}, but {size}{note}",
            key,
            place=view.name_place(rows, beyond[0]),
            found=f"index {listed}",
            expected=f"indices 0 to {count - 1}" if count else "no entry",
        )
    if edge:
        view.add(
            "warning",
            f"{key} has index {count}, which only one of two statements of the manuals "
            f"allows where {size}{note}",
            key,
            place=view.name_place(rows, edge[0]),
            found=f"index {count}",
            expected=f"indices 0 to {count - 1}",
        )


def check_complete(
    view: ListView,
    key: str,
    count: int,
    *,
    absent: int | None = None,
    strict: bool = False,
) -> None:
    """Report entries that a one-dimensional column lacks; they count as 0.

    Args:
        view: The list.
        key: Column.
        count: Number of entries that it should have.
        absent: What the controller reports where the whole column is missing.
        strict: Whether the manuals demand every entry (modulo axes).
    """
    rows = view.rows(key)
    missing, which = absent_indices(rows, count)
    if not missing:
        return
    refused = rows is None and absent is not None
    number = absent if refused else (70431 if strict else None)
    view.add(
        "error" if refused or strict else "warning",
        f"{key} lacks {missing} of {count} entries, which count as 0: index {which}",
        key,
        place=view.place(key) if rows is None else view.name_place(rows, 0),
        number=number,
        found=f"{count - missing} entries",
        expected=f"{count} entries",
    )


def usable(count: int | None) -> bool:
    """Return whether a table size makes sense; others have a finding of their own."""
    return count is not None and 0 <= count <= 2**31
