"""How files and PLC objects of a temperature compensation are called."""

import re


def plain_name(text: str) -> str:
    """Return a name that is safe in a file name and an identifier of the PLC."""
    # IEC 61131-3 knows neither doubled underscores nor one at the end.
    plain = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return plain or "axis"


def temperature_names(axis: str) -> tuple[str, str]:
    """Return the names of the table and of the PLC program of an axis."""
    name = plain_name(axis)
    return f"temperature_{name}.csv", f"temperature_{name}.st"
