"""The resolved job as the user would write it: TOML, one line per key."""

import json
from collections.abc import Iterator, Mapping
from typing import Any


def job_text(job: Mapping[str, Any]) -> str:
    """Return a resolved job as TOML.

    Tables of tables (``[axes.X]``) and lists of tables (``[[fits]]``) get headings;
    whatever lies deeper stands inline.
    """
    plain = {key: value for key, value in job.items() if not _is_table(value)}
    blocks = [list(_lines(plain))] if plain else []
    for key, value in job.items():
        if isinstance(value, Mapping):
            blocks += _tables(_key(key), value)
        elif _is_table(value):
            blocks += [[f"[[{_key(key)}]]", *_lines(each)] for each in value]
    return "\n\n".join("\n".join(block) for block in blocks if block)


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
    # TOML has no word for "nothing": a key without a value is left out.
    return (
        f"{_key(key)} = {_value(value)}"
        for key, value in table.items()
        if value is not None
    )


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else json.dumps(key, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    # Strings, numbers and truth values are written alike in JSON and TOML.
    return json.dumps(value, ensure_ascii=False, default=str)
