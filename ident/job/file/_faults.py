"""What pydantic finds in a job file, in our words and with the line."""

import datetime
import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pydantic

from ....data.toml import TomlError, line_of
from ...kinds import NAMES, kind
from ...kinds._keys import JobPart, KeyPath
from ...proof import GateLimits
from ._schema import (
    Axis,
    ColumnChoice,
    ColumnOfRun,
    Controller,
    Datum,
    JobFile,
    Machine,
    MeasurementSpec,
    Verify,
)

_TYPE = re.compile(r"str|int|float|bool|list|constrained|literal|Column|\[key\]")
"""How branches of a union begin: "str", "float", "ColumnChoice", "constrained-float", …"""


class JobError(TomlError):
    """A job that cannot be run: where in the job file, what was found and expected."""


class MissingFileError(JobError):
    """A job that names a file that is not there."""


def error_at(path: Path, text: str, where: KeyPath, reason: str) -> JobError:
    """Return the error that a key is, or without one the job as a whole, ready to raise."""
    # As it would be written: ``fits[0].start``.
    key = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in where)
    words = f"{key.removeprefix('.')}: {reason}" if where else reason
    return JobError(str(path), line_of(text, where), words)


def _part(where: KeyPath, values: Any) -> type[JobPart] | None:
    """Return the class that describes a table of the job file."""
    match where:
        case ():
            return JobFile
        case ("machine",):
            return Machine
        case ("controller",):
            return Controller
        case ("gate",):
            return GateLimits
        case ("verify",):
            return Verify
        case ("axes", _):
            return Axis
        case ("measurements", _):
            return MeasurementSpec
        case ("measurements", _, "datum"):
            return Datum
        case ("measurements", _, "columns", _):
            return ColumnChoice
        case ("measurements", _, "columns", _, int()):
            return ColumnOfRun
        case ("fits", int(k)):
            name = values["fits"][k].get("compensation")
            return kind(name).keys if name in NAMES else None
        case ("fits", int(k), str(key)):
            return kind(values["fits"][k]["compensation"]).keys.parts.get(key)
    return None


def first_fault(
    path: Path, error: pydantic.ValidationError, values: dict[str, Any], text: str
) -> JobError:
    """Return the first thing that pydantic found, in our words."""
    errors = error.errors(include_url=False)
    places = [_clean(item["loc"], values) for item in errors]
    # A column may be a name or a table: pydantic reports both attempts. The one that
    # went further into the value is the one that was meant.
    strange = [k for k, item in enumerate(errors) if item["type"] == "extra_forbidden"]
    below = [k for k, at in enumerate(places) if at[: len(places[0])] == places[0]]
    number = strange[0] if strange else max(below, key=lambda k: len(places[k]))
    first, where = errors[number], places[number]
    kind, context = first["type"], first.get("ctx", {})
    value = _quoted(first.get("input"))
    if kind == "extra_forbidden":
        part = _part(where[:-1], values)
        fields = part.model_fields.items() if part else ()
        keys = [field.alias or name for name, field in fields]
        reason = f"unknown key{_nearest(str(where[-1]), keys, 0.0)}"
    elif kind == "missing":
        reason = "found nothing, expected this key"
    elif kind == "union_tag_not_found" and (
        close := difflib.get_close_matches("compensation", first["input"], 1)
    ):
        where, reason = (*where, close[0]), "unknown key (nearest: 'compensation')"
    elif kind in ("union_tag_invalid", "union_tag_not_found"):
        where = (*where, "compensation")
        tag = str(context.get("tag", ""))
        reason = f"found {tag!r}" if tag else "found nothing"
        reason += f", expected one of {', '.join(NAMES)}"
        reason += _nearest(tag, NAMES, 0.0) if tag else ""
    elif kind == "value_error":
        reason = f"found {value}, {first['msg'].removeprefix('Value error, ')}"
    elif kind == "literal_error" and places.count(where) == 1:
        expected = str(context["expected"])
        near = _nearest(str(first.get("input")), re.findall(r"'([^']*)'", expected))
        reason = f"found {value}, expected {expected}{near}"
    elif kind in ("too_short", "too_long"):
        limit = context.get("min_length", context.get("max_length"))
        reason = f"found {context.get('actual_length')} values, expected {limit}"
    else:
        # A union reports every branch that it tried.
        pairs = zip(errors, places, strict=True)
        wishes = [_expected(item["msg"]) for item, at in pairs if at == where]
        reason = f"found {value}, expected {' or '.join(dict.fromkeys(wishes))}"
    return error_at(path, text, where, reason)


def _nearest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str:
    """Return in words which of the known names is meant; nothing where none is close."""
    close = difflib.get_close_matches(name, known, 1, cutoff)
    return f" (nearest: {close[0]!r})" if close else ""


def _clean(loc: tuple[int | str, ...], values: dict[str, Any]) -> KeyPath:
    """Return a location without what is no key: tags of unions and names of types."""
    where: list[int | str] = []
    at: Any = values
    for part in loc:
        if isinstance(at, dict) and not isinstance(part, int):
            if part in at:
                at = at[part]
            elif part != loc[-1] or (where and where[0] == "fits" and part in NAMES):
                continue
            elif _TYPE.match(part):
                continue
            where.append(part)
        elif isinstance(at, list) and isinstance(part, int) and part < len(at):
            at = at[part]
            where.append(part)
    return tuple(where)


def _expected(message: str) -> str:
    """Return what pydantic expected, in the words of TOML."""
    for begin in ("Input should be ", "String should have "):
        message = message.removeprefix(begin)
    expected = message.replace("a valid ", "")
    return "a table" if expected.startswith("dictionary or instance") else expected


def _quoted(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, datetime.date | datetime.time):
        return str(value)
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
