"""Rules for names and spelling: unknown entries, and the anomalies of the text."""

from collections import Counter

from ._check_view import ListView
from ._finding import Level
from ._registry import registry
from ._remarks import REMARKS, RemarkCode

_REMARK_LIMIT = 20
_UNKNOWN_LIMIT = 50
"""Unknown names that are named, and compared with the known ones; comparing is slow."""


def check_remarks(view: ListView) -> None:
    """Turn the remarks of the text layer into findings, the first few of each sort."""
    if not view.file.remarks:
        return
    counts: Counter[str] = Counter()
    totals = Counter(remark.code for remark in view.file.remarks)
    for remark in view.file.remarks:
        counts[remark.code] += 1
        if counts[remark.code] > _REMARK_LIMIT + 1:
            continue
        rule = REMARKS[remark.code]
        level: Level = rule.level
        line = view.line(remark.line)
        message = f"{rule.message}: {remark.text}" if remark.text else rule.message
        if remark.code == RemarkCode.NO_VALUE and line.key in registry().by_key:
            level = "error"
        elif remark.code == RemarkCode.NO_VALUE and _is_cut(
            view, remark.line, line.key
        ):
            level = "error"
            words = "the file is cut off: its last line is the beginning of an entry"
            message = f"{words}: {remark.text}"
        if counts[remark.code] > _REMARK_LIMIT:
            further = totals[remark.code] - _REMARK_LIMIT
            message = f"{rule.message}; {further} such places from here on"
        view.add(
            level,
            message,
            line.key,
            place=(remark.line, remark.column),
            found=remark.text,
            expected=rule.expected,
        )


def _is_cut(view: ListView, line: int, key: str) -> bool:
    """Whether a line is the last one, has no end, and begins the name of a parameter."""
    text = view.file.dumps()
    last = line == len(text.splitlines()) and not text.endswith((b"\n", b"\r"))
    return (
        last and bool(key) and any(known.startswith(key) for known in registry().by_key)
    )


def check_names(view: ListView) -> None:
    """Report entries that no manual names, with the nearest name that one does."""
    manual, kind = registry(), view.file.kind
    unknown = [key for key in view.columns if key not in manual.by_key]
    if not unknown:
        return
    is_compensation = kind == "compensation"
    candidates = [key for key, row in manual.by_key.items() if row.kind == kind]
    candidates += [name for name in manual.aliases if manual.kind(name) == kind]
    if not is_compensation:
        # These lists hold a thousand entries of other manuals: only what is all but a
        # known name is worth a look.
        slips = {slip for name in candidates for slip in _slips(name)}
        unknown = [key for key in unknown if not slips.isdisjoint(_slips(key))]
    elif len(unknown) > _UNKNOWN_LIMIT:
        further = unknown[_UNKNOWN_LIMIT:]
        view.add(
            "info",
            f"{len(further)} further unknown names from here on",
            place=view.name_place(view.columns[further[0]], 0),
            found=further[0],
            expected="parameters of the manuals",
        )
    for key in unknown[:_UNKNOWN_LIMIT]:
        rows = view.columns[key]
        nearest = _nearest(key, candidates)
        likely = nearest is not None and _is_misspelling(key, nearest)
        if not is_compensation and not likely:
            continue
        amount = f" ({len(rows.lines)} entries)" if len(rows.lines) > 1 else ""
        hint = f"; did you mean {nearest}?" if likely else ""
        level: Level = "warning" if is_compensation and likely else "info"
        view.add(
            level,
            f"unknown entry {key}{amount}, which the kernel does not take over{hint}",
            place=view.name_place(rows, 0),
            found=key,
            expected=nearest or "a parameter of the manuals",
        )


def _slips(name: str) -> set[str]:
    """Return the name, and the name with any one character left out.

    Two names that share one of these differ by a single slip at most: one character too
    many, too few, or another, or two that changed places.
    """
    return {name, *(name[:at] + name[at + 1 :] for at in range(len(name)))}


def _nearest(key: str, candidates: list[str]) -> str | None:
    """Return the known name most like ``key``, None where none is."""
    stem = key.split(".")[0]
    close = [name for name in candidates if abs(len(name) - len(key)) <= 12]
    siblings = [name for name in close if name.startswith(stem)]
    import difflib  # only where a name is unknown: start-up time counts

    matches = difflib.get_close_matches(key, siblings or close, n=1, cutoff=0.6)
    return matches[0] if matches else None


def _is_misspelling(key: str, near: str) -> bool:
    """Return whether ``key`` is so like a known name that it was probably meant."""
    if abs(len(key) - len(near)) > 2:
        return False
    import difflib  # see above

    return difflib.SequenceMatcher(None, key, near).ratio() >= 0.9
