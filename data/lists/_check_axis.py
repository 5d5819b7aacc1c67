"""Rules that the entries of one axis list show together."""

from ._check_view import ListView
from ._registry import registry


def check_axis_list(view: ListView) -> None:
    """Judge what only the entries of one axis list together can show."""
    known = registry().by_key
    selected = view.integer("lr_param.anwahl_losekomp")
    if selected and not largest_backlash(view):
        row = known["getriebe[].lose"]
        view.add(
            "warning",
            "backlash compensation is on, but the backlash is 0",
            view.place("lr_param.anwahl_losekomp"),
            parameter=row,
            found="0",
            expected="the size of the backlash",
        )
    heated = [
        key
        for key in ("lr_param.temp_comp_offset_0", "lr_param.temp_comp_coefficient")
        if view.given(key)
    ]
    if heated and view.integer("lr_param.temp_comp") == 0:
        row = known["lr_param.temp_comp"]
        view.add(
            "warning",
            f"{heated[0]} is set, but {row.key} does not switch the temperature "
            "compensation on",
            view.place(row.key if row.key in view.columns else heated[0]),
            parameter=row,
            found=view.text(row.key) or "no entry",
            expected="1",
        )


def largest_backlash(axis: ListView) -> int:
    """Return the backlash of the largest size among the gears, in list units."""
    rows = axis.rows("getriebe[].lose")
    values = [] if rows is None else [value or 0 for value in rows.integers]
    return max(values, key=abs, default=0)
