"""The documentation of the parameters, written from the registry.

``python -m axcomp.data.lists._document > docs/parameters.md`` renews the page; a test
holds it to the registry.
"""

from collections.abc import Iterable

from ._parameter import Interval, Parameter
from ._registry import registry
from ._remarks import REMARKS
from ._values import INTEGER_LIMITS

_TITLES = {
    "kopf": "Header of a compensation list (`kopf.*`)",
    "kw.crosscomp": "Cross compensation (`kw.crosscomp.*`)",
    "kw.crosscomp2": "Plane compensation (`kw.crosscomp2.*`)",
    "kw.ssfk": "Leadscrew error compensation (`kw.ssfk.*`)",
    "frict_comp": "Friction compensation (`frict_comp.*`)",
    "kw.crosstalk": "Crosstalk compensation (`kw.crosstalk.*`)",
    "axis": "Axis list",
    "startup": "Start-up list",
    "unknown": "Named in passing only",
}

_HEAD = """# Parameters

Every parameter that the controller manuals name, as `axcomp check` and the writer
know it. Written from `data/lists/parameters.toml` by `python -m
axcomp.data.lists._document`; do not edit this page.

Indices of a table stand as `[]`. **T** is the unit in lists of linear axes, **R, S**
that of rotary axes and spindles. *Errors* are the numbers that the controller reports
for a defective value, a missing entry or (restart) a change after start-up. S-numbers
are decisions where the manuals contradict each other; what is called *plausible* is
ours, and a warning outside of it. Sources: [000] TF5200 axis
compensation parameters 1.24, [001] TF5200 axis compensation functional description
1.51, [002] ISG parameter manual axis compensation, [003] and [004] TF5200 interface
to external compensation.
"""

_COLUMNS = (
    "| Id | Name | Meaning | Type | Range | Unit | Default | Notes | Errors | Source |"
)


def document() -> str:
    """Return the page of all parameters, as Markdown."""
    parts = [_HEAD]
    for section, title in _TITLES.items():
        rows = [row for row in registry().rows if _section(row) == section]
        parts.append(f"\n## {title}\n\n{_COLUMNS}\n{'|---' * 10}|\n")
        parts.extend(f"{_line(row)}\n" for row in rows)
    parts.append(_spelling())
    return "".join(parts)


def _spelling() -> str:
    """Return the section on anomalies of the text."""
    lines = [
        "\n## Spelling\n\nWhat is read although the manuals ask for something else.\n\n"
        "| Code | Level | What is found | What is expected | Decision |\n"
        f"{'|---' * 5}|\n"
    ]
    for code, rule in REMARKS.items():
        cells = (rule.level, rule.message, rule.expected, rule.semantics or "")
        lines.append(f"| `{code}` | {' | '.join(cells)} |\n")
    return "".join(lines)


def _section(row: Parameter) -> str:
    return row.structure if row.kind == "compensation" else row.kind


def _line(row: Parameter) -> str:
    cells = (
        row.id or "",
        f"`{row.key}`" if row.key else "",
        row.text,
        row.type,
        _range(row),
        _unit(row),
        "" if row.default is None else str(row.default),
        "; ".join(_notes(row)),
        ", ".join(_errors(row)),
        ", ".join(row.source),
    )
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def _range(row: Parameter) -> str:
    if row.words:
        return ", ".join(row.words)
    if row.values:
        return ", ".join(map(str, row.values))
    if row.length is not None:
        return f"at most {row.length} characters"
    if row.type == "BOOLEAN":
        return "0, 1"
    if row.range is None:
        return ""
    also = "".join(f", or {value}" for value in row.also)
    return _interval(row.range, row.type) + also


def _interval(interval: Interval, type_name: str) -> str:
    """Return an interval in words, the ends of its type as MIN and MAX."""
    text = str(interval)
    for limit, name in zip(
        INTEGER_LIMITS.get(type_name, ()), ("MIN", "MAX"), strict=False
    ):
        if limit:
            text = text.replace(str(limit), name)
    return text


def _unit(row: Parameter) -> str:
    linear, rotary = row.unit
    if not linear and not rotary:
        return ""
    if linear == rotary:
        return linear
    return f"T: {linear}; R, S: {rotary}" if rotary else f"T: {linear}"


def _notes(row: Parameter) -> Iterable[str]:
    if row.generation == "old":
        yield "older generation, read only"
    if row.discontinued is not None:
        yield f"discontinued in {row.discontinued}"
    if row.axes and row.axes != ("T", "R", "S"):
        yield f"axis types {', '.join(row.axes)}"
    if row.wide_range is not None:
        yield f"another statement allows {row.wide_range}"
    if row.narrow_type is not None:
        yield f"another statement gives {row.narrow_type}"
    if row.plausible is not None:
        yield f"plausible {_interval(row.plausible, row.type)}"
    if row.step is not None:
        slope = f", slopes up to {row.step.slope} µm/mm" if row.step.slope else ""
        yield f"plausible steps up to {row.step.largest}{slope}"
    if row.jump is not None:
        yield f"plausibly within {row.jump.largest} of `{row.jump.against}`"
    if row.needed == "true":
        always = row.structure == "kopf"
        yield "always needed" if always else "needed where the function is in use"
    elif row.needed is not None:
        yield f"needed where `{row.needed}`"
    for condition in row.conditions:
        yield condition.expected
    if row.zero_is_default:
        yield "0 counts as left out"
    for alias in row.aliases:
        yield f"also `{alias.name}` ({alias.note})"
    if row.since is not None:
        note = f" ({row.since_note})" if row.since_note else ""
        yield f"as of build {row.since}{note}"
    if row.semantics:
        yield ", ".join(row.semantics)


def _errors(row: Parameter) -> Iterable[str]:
    for number in row.error_numbers:
        yield f"{number} (restart)" if number == row.changed else str(number)


if __name__ == "__main__":
    print(document(), end="")
