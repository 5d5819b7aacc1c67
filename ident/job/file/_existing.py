"""The lists that the axes of a job have already."""

from typing import TYPE_CHECKING

from ....data.lists import ListFile
from ...exchange import AxisLists, ExchangeError, axis_number

if TYPE_CHECKING:
    from ._load import Job

_TABLES = ("kw.", "frict_comp.")
"""What only a compensation list holds."""


def existing_lists(job: "Job") -> dict[str, AxisLists]:
    """Return the lists that the axes have already, by axis.

    Raises:
        JobError: If a file is another kind of list, or that of another axis.
    """
    found = {}
    for name, axis in job.spec.axes.items():
        pair = {"list": axis.listing, "machine_data": axis.machine_data}
        read: dict[str, ListFile | None] = {}
        for key, file in pair.items():
            read[key] = None
            if file is not None:
                listing = ListFile.read(job.file(file))
                _refuse_other_kind(job, name, key, listing)
                _refuse_other_axis(job, name, key, listing)
                read[key] = listing
        both = read["list"], read["machine_data"]
        found[name] = AxisLists(axis.number, *both, job.reading)
    return found


def _refuse_other_kind(job: "Job", name: str, key: str, listing: ListFile) -> None:
    """Raise where a file is none of the lists that the key asks for.

    An axis list edited as a compensation list, or a table of readings, would come back
    looking like a valid one. An empty list, or one of comments, is one to be filled.
    """
    expected = {"list": "compensation", "machine_data": "axis"}[key]
    kind = listing.kind
    if kind == expected or not any(map(_says_something, listing.lines)):
        return
    if expected == "axis" and listing.entries and kind != "startup":
        # Its header alone counts as that of a compensation list, and most of its
        # entries are none that the manuals name.
        if not any(one.key.startswith(_TABLES) for one in listing.entries):
            return
    words = f"a{'n' if kind == 'axis' else ''} {kind} list"
    if kind == "unknown":
        words = "none of the entries of such a list"
    raise job.error(
        ("axes", name, key),
        f"found {words} in {listing.source}, expected a"
        f"{'n' if expected == 'axis' else ''} {expected} list",
    )


def _says_something(line: str) -> bool:
    text = line.strip()
    return bool(text) and not text.startswith(("#", ";", "(", "//", "/*"))


def _refuse_other_axis(job: "Job", name: str, key: str, listing: ListFile) -> None:
    number = job.spec.axes[name].number
    try:
        found = axis_number(listing)
    except ExchangeError:
        return  # The file does not say; the job does.
    stated = listing.integer("kopf.achs_nr")
    if stated is not None and found != number:
        raise job.error(
            ("axes", name, key),
            f"found a list of axis {found} (kopf.achs_nr), expected axis {number}",
        )
