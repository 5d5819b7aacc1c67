"""How files and PLC objects of a temperature compensation are called."""

import re


def plain_name(text: str) -> str:
    """Return a name that is safe in a file name and an identifier of the PLC."""
    # IEC 61131-3 knows neither doubled underscores nor one at the end.
    plain = re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_")
    return plain or "axis"


def block_names(axis: str) -> tuple[str, str]:
    """Return the names of the function blocks of an axis: the law, and what is called."""
    name = plain_name(axis)
    return f"FB_TempCompLaw_{name}", f"FB_TempComp_{name}"


def temperature_names(axis: str) -> tuple[str, str, str, str]:
    """Return the names of the table of an axis, its PLC program, and its blocks for XAE."""
    name = plain_name(axis)
    law, access = block_names(axis)
    return (
        f"temperature_{name}.csv",
        f"temperature_{name}.st",
        f"{law}.TcPOU",
        f"{access}.TcPOU",
    )
