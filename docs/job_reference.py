"""Writes the reference of the job file from its schema: a page, and a JSON schema (``make docs``).

A test holds ``job.md`` and ``job.schema.json`` to the schema.
"""

import ast
import functools
import inspect
import json
import sys
import textwrap
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from axcomp.ident.job.file._schema import JobFile
from axcomp.ident.kinds._keys import FitSpec, JobPart

_HEAD = """# Job reference

Every key of a job file. Written from the schema by `make docs`; do not edit this page. An
editor that knows JSON schemas completes and checks jobs with `job.schema.json`, which lies
beside this page. Lengths are in mm, angles in °, times in s, temperatures in °C, unless a
key says otherwise. A key that stands in no table here is an error that names the nearest one.
"""
_TITLES = {
    "JobFile": "The job",
    "Machine": "`[machine]`",
    "Controller": "`[controller]`",
    "Axis": "`[axes.NAME]`",
    "MeasurementSpec": "`[measurements.NAME]`",
    "ColumnChoice": "A column: `[measurements.NAME.columns]`",
    "ColumnOfRun": "A column per run: `[measurements.NAME.columns]`",
    "Datum": "`datum`",
    "GateLimits": "`[gate]`",
    "Verify": "`[verify]`",
    "FitSpec": "`[[fits]]`: keys of every compensation",
    "Plateau": "`steady`",
}


def document() -> str:
    """Return the page of all keys, as Markdown."""
    text = [_HEAD]
    for part in parts(JobFile):
        title = _TITLES.get(part.__name__)
        if title is None:
            named = typing.get_args(part.model_fields["compensation"].annotation)
            title = f'`[[fits]]` with `compensation = "{named[0]}"`'
        about = (inspect.getdoc(part) or "").split("\n\n")[0]
        text.append(f"\n## {title}\n\n{about}\n")
        rows = list(_rows(part))
        if rows:
            text.append(
                "\n| Key | Type | Default | Meaning | Example |\n|---|---|---|---|---|\n"
            )
            text.extend(rows)
    return "".join(text)


def schema() -> str:
    """Return the JSON schema of a job, with what each key means."""
    tree = JobFile.model_json_schema(by_alias=True)
    for part in parts(JobFile):
        # As pydantic calls it: the classes of all fits have the same name.
        long = f"{part.__module__}.{part.__qualname__}".replace(".", "__")
        places = tree["$defs"] | {JobFile.__name__: tree}
        node = places.get(long) or places.get(part.__name__)
        if node is None:  # what all fits share stands in each of them
            continue
        for name, field in part.model_fields.items():
            meaning, _ = described(part, name)
            node["properties"][field.alias or name]["description"] = meaning
    return json.dumps(tree, indent=1, ensure_ascii=False) + "\n"


def described(part: type[JobPart], name: str) -> tuple[str, str]:
    """Return what a key means, and an example of its value as TOML (or an empty text)."""
    for each in part.__mro__:
        if issubclass(each, JobPart) and name in (words := _docstrings(each)):
            meaning, _, example = words[name].partition(" Example: ")
            return meaning, example.rstrip(".").strip("`")
    return "", ""


@functools.cache
def parts(part: type[JobPart]) -> tuple[type[JobPart], ...]:
    """Return a table of the job and all below it; what all fits share before each fit."""
    found: dict[type[JobPart], None] = {part: None}
    for field in part.model_fields.values():
        for below in _tables_in(field.annotation):
            if issubclass(below, FitSpec):
                found[FitSpec] = None
            found |= dict.fromkeys(parts(below))
    return tuple(found)


def _tables_in(annotation: Any) -> Iterator[type[JobPart]]:
    if isinstance(annotation, type) and not isinstance(annotation, types.GenericAlias):
        if issubclass(annotation, JobPart):
            yield annotation
        return
    for inner in typing.get_args(annotation):
        yield from _tables_in(inner)


def _rows(part: type[JobPart]) -> Iterator[str]:
    shared = FitSpec.model_fields if issubclass(part, FitSpec) else {}
    nodes = part.model_json_schema(by_alias=True)
    properties = nodes.get("properties") or nodes["$defs"][part.__name__]["properties"]
    for name, field in part.model_fields.items():
        if name in shared and part is not FitSpec:
            continue
        key = field.alias or name
        meaning, example = described(part, name)
        default = field.get_default(call_default_factory=True, validated_data={})
        shown = "needed" if field.is_required() else _toml(default)
        cells = [f"`{key}`", _type_words(properties[key]), shown, meaning]
        cells.append(f"`{example}`" if example else "")
        yield f"| {' | '.join(cell.replace('|', '&#124;') for cell in cells)} |\n"


def _toml(value: Any) -> str:
    if value is None or isinstance(value, JobPart):
        return ""
    return f"`{json.dumps(value)}`"


def _type_words(node: Mapping[str, Any]) -> str:
    """Return a type of a JSON schema in words."""
    options = [one for one in node.get("anyOf", ()) if one.get("type") != "null"]
    if options:
        return " or ".join(dict.fromkeys(map(_type_words, options)))
    if "const" in node or "enum" in node:
        values = node.get("enum", [node.get("const")])
        return " or ".join(f'`"{value}"`' for value in values)
    if "items" in node:
        few, many = node.get("minItems"), node.get("maxItems")
        count = f"{few} × " if few is not None and few == many else ""
        return f"list of {count}{_type_words(node['items'])}"
    if {"$ref", "oneOf"} & set(node) or node.get("type") == "object":
        return "table"
    words = {"string": "text", "number": "number", "integer": "whole number",
             "boolean": "true or false"}  # fmt: skip
    limits = [
        f"{sign} {node[key]:g}"
        for key, sign in (
            ("exclusiveMinimum", ">"), ("minimum", "≥"),
            ("exclusiveMaximum", "<"), ("maximum", "≤"),
        )
        if key in node
    ]  # fmt: skip
    return " ".join([words.get(node.get("type", ""), "any"), ", ".join(limits)]).strip()


@functools.cache
def _docstrings(part: type[JobPart]) -> dict[str, str]:
    """Return the texts that stand below the fields of a class, by field."""
    (found,) = ast.parse(textwrap.dedent(inspect.getsource(part))).body
    assert isinstance(found, ast.ClassDef)
    texts: dict[str, str] = {}
    for field, below in zip(found.body, found.body[1:], strict=False):
        match field, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str() as text)),
            ):
                texts[name] = " ".join(text.split())
    return texts


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "job.md").write_text(document(), "utf-8")
    (folder / "job.schema.json").write_text(schema(), "utf-8")
