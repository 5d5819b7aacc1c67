"""The parts of a compensation that a job and a report ask for: what a colleague writes.

A folder ``kinds/<name>/`` has these modules, each imported on first use:

* ``keys`` (`KeysPart`): the keys of a fit as a class ``Spec``, and what is wrong with them.
  Light: it loads nothing that computes.
* ``job`` (`SinglePart`): a fit that stands alone, from its plan to a draft.
* ``group`` (`GroupPart`): a fit of a group, from its effect to the same draft.
* ``page`` (`PagePart`): what the report shows of its result.

A table (`Kind.table`) needs no ``job`` and no ``page``: all tables share theirs.

A draft (`AbstractDraft`) is what a job writes, judges and proves; it makes the result
(`AbstractResult`) that stands in ``result.json`` and in the report.
"""

from typing import TYPE_CHECKING, Any, Protocol, cast, runtime_checkable

from . import kind
from ._keys import FitSpec

if TYPE_CHECKING:
    from ..job._draft import AxisLists, Planned
    from ..job._load import Job
    from ..job._source import Tables
    from ..job.joint._member import AbstractMember
    from ..report._body import Body
    from ..report._scale import Scale


@runtime_checkable
class KeysPart(Protocol):
    """The module ``keys`` of a compensation."""

    Spec: type[FitSpec]
    """The keys of a fit, its ``compensation`` a literal."""


@runtime_checkable
class SinglePart(Protocol):
    """The module ``job`` of a compensation; ``fit`` is of its own class of keys."""

    def plan(
        self, job: "Job", tables: "Tables", index: int, fit: Any, lists: "AxisLists"
    ) -> "Planned":
        """Plan a fit; what it returns fits it.

        Args:
            job: The job.
            tables: Its measurement files.
            index: Of the fit in the job.
            fit: Its keys.
            lists: What the axis has already.

        Raises:
            JobError: If keys or existing lists do not suit; of what it returns: likewise
                for readings.
            FitError: Of what it returns: if the readings do not determine the fit.
        """
        ...


@runtime_checkable
class GroupPart(Protocol):
    """The module ``group`` of a compensation."""

    def member(
        self, job: "Job", tables: "Tables", index: int, fit: Any, lists: "AxisLists"
    ) -> "AbstractMember":
        """Plan a fit of a group; arguments and errors as `SinglePart.plan`."""
        ...


@runtime_checkable
class PagePart(Protocol):
    """The module ``page`` of a compensation."""

    def body(self, fit: Any, scale: "Scale") -> "Body":
        """Return plots, sentences and wild readings of a result.

        Args:
            fit: The result that its draft made.
            scale: Units in which a person reads the error.
        """
        ...


def keys_of(name: str) -> type[FitSpec]:
    """Return the class of the keys of a compensation."""
    return cast(KeysPart, kind(name).part("keys")).Spec


def single_of(name: str) -> SinglePart:
    """Return how a fit of a compensation is planned that stands alone."""
    if kind(name).table:
        from ..job import _table_draft

        return _table_draft
    return cast(SinglePart, kind(name).part("job"))


def group_of(name: str) -> GroupPart:
    """Return how a fit of a group is planned."""
    return cast(GroupPart, kind(name).part("group"))


def page_of(name: str) -> PagePart:
    """Return how the report shows a compensation."""
    if kind(name).table:
        from ..report import _table_body

        return _table_body
    return cast(PagePart, kind(name).part("page"))
