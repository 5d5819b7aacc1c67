"""A job file as text: written from its values, or edited so that all else stays.

Everything that writes a job uses this module: the report shows the resolved job,
`Fit.write` and a fleet's table make new ones, ``discover --write`` edits the user's.
"""

import datetime
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np


def job_text(job: Mapping[str, Any]) -> str:
    """Return a job as TOML, one line per key, without a line end behind the last.

    Tables of tables (``[axes.X]``) and lists of tables (``[[fits]]``) get headings;
    whatever lies deeper stands inline. TOML has no word for "nothing": a key whose value
    is None is left out.

    Args:
        job: Values by key; NumPy's numbers and arrays count as those of Python.
    """
    plain = {key: value for key, value in job.items() if not _is_table(value)}
    blocks = [list(_lines(plain))] if plain else []
    for key, value in job.items():
        if isinstance(value, Mapping):
            blocks += _tables(_key(key), value)
        elif _is_table(value):
            blocks += [[f"[[{_key(key)}]]", *_lines(each)] for each in value]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def edited_job(
    text: str,
    measurements: Mapping[str, Mapping[str, Any]],
    fits: Sequence[Mapping[str, Any]],
) -> str:
    """Return a job with other fits and other keys of its measurements.

    What is not named stays as it is: order, comments, layout.

    Args:
        text: The job file.
        measurements: By name, the keys to set; a key whose value is None is removed.
        fits: All ``[[fits]]``, in the place of those that are there.
    """
    import tomlkit  # takes long to load
    from tomlkit.items import Array, Table

    document = tomlkit.parse(text)
    former = document.pop("fits", None)
    remark = former.trivia.comment if isinstance(former, Array) else ""
    for name, keys in measurements.items():
        table: Any = document["measurements"]
        table = table[name]
        # Comments and tables behind the last key stay behind the new ones.
        behind = list[tuple[Any, Any]]()
        body = table.value.body if isinstance(table, Table) else ()
        while body and (body[-1][0] is None or isinstance(body[-1][1], Table)):
            behind.append(body[-1])
            if body[-1][0] is not None:
                table.remove(body[-1][0])  # leaves an empty place
            body.pop()
        for key, value in keys.items():
            behind = [(k, item) for k, item in behind if k is None or k.key != key]
            if value is not None:
                table[key] = tomlkit.value(_value(value))
            elif key in table:
                del table[key]
        if behind:
            table.value.parsing(True)  # as they were written: without new empty lines
        for place, item in reversed(behind):
            table.raw_append(place, item)
    kept = tomlkit.dumps(document).rstrip()
    written = job_text({"fits": list(fits)})
    return "\n\n".join([kept, *filter(None, [remark]), f"{written}\n"])


def job_line(key: str, value: object) -> str:
    """Return one key of a job with its value, as it stands in the file."""
    return f"{_key(key)} = {_value(value)}"


def _is_table(value: object) -> bool:
    if isinstance(value, list):
        return bool(value) and all(isinstance(each, Mapping) for each in value)
    return isinstance(value, Mapping)


def _tables(name: str, table: Mapping[str, Any]) -> Iterator[list[str]]:
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    if inner and len(inner) == len(table):
        for key, value in inner.items():
            yield [f"[{name}.{_key(key)}]", *_lines(value)]
    elif table:
        yield [f"[{name}]", *_lines(table)]


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    return (job_line(key, value) for key, value in table.items() if value is not None)


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else json.dumps(key, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(_lines(value))
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, np.ndarray | np.generic):
        return _value(value.tolist())
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, float):
        return repr(value)  # infinities, too, as TOML writes them
    # Strings, whole numbers and truth values are written alike in JSON and TOML.
    return json.dumps(value, ensure_ascii=False)
