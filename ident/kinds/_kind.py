"""The facts of one compensation: what is special about it, as data."""

import dataclasses
import functools
import importlib
from types import ModuleType
from typing import TYPE_CHECKING, Literal, cast, final

if TYPE_CHECKING:
    from ..proof.verify import AbstractChannel
    from ._keys import FitSpec
    from ._protocol import AbstractEntries, AbstractProbe, PagePart, PlanPart


@final
@dataclasses.dataclass(frozen=True)
class Kind:
    """What is known of one compensation before any list or measurement is read.

    Attributes:
        name: As in a job: ``cross``.
        holder: Kind of the list that holds its values.
        prefix: Beginning of their entries there: ``kw.crosscomp``.
        activation: Entry of the axis list that switches it on.
        keyword: Of the NC command ``COMP`` and of ``V.A.…_COMP_ACTIVE``.
        channel: Object of the CNC that shows the same, in increments; None: there is none.
        cycles: Entry that spreads its coming and going, and the largest value of it; None:
            it has none.
        shows_init: Whether ``V.A.…_COMP_INIT`` tells that it is initialised.
        demanded: Whether P-AXIS-00465 can demand it in automatic mode.
        adds_current: It adds to the current of the motor, and not to a position.
        follows: What it acts over: ``position``, ``direction``, ``velocity`` or
            ``acceleration`` of axes, ``temperature`` of sensors.
        table: Its values lie at nodes over positions: its readings may be read in pieces,
            and what acts beside it taken off them.
        takes_constant: Rank by which it takes the constant error of an axis over from
            others of its group; None: its list cannot hold one.
        fitted_first: It is fitted before the tables of its axis, which take what it leaves.
        partial: It may be written without what its readings do not tell.
        often_open: Readings may not tell it even where it is the only fit of its axis.
        conventions: Beginnings of the names of the rules that its sign and owner rest on.
        manual: Entry that makes it wait for COMP ON; None: it has none.
        owner: Rule that says in whose list it stands, its own axis's or its master's; None:
            in that of its own axis.
        by_plc: A PLC may make its law instead of the axis list.
        adds: What the controller does with its entries, in a sentence.
        raw_tables: Names of its tables that are shown with their entries as they stand.
        unseen: Why a second measurement does not judge it, in words; empty: it does.
        build: First one of the controller that knows its keyword ([001] p.94); empty: all do.
    """

    name: str
    holder: Literal["compensation", "axis"]
    prefix: str
    activation: str
    keyword: str
    channel: str | None
    conventions: tuple[str, ...]
    cycles: tuple[str, int] | None = None
    shows_init: bool = True
    demanded: bool = True
    adds_current: bool = False
    follows: frozenset[str] = frozenset()
    table: bool = False
    takes_constant: int | None = None
    fitted_first: bool = False
    partial: bool = False
    often_open: bool = False
    manual: str | None = None
    owner: str | None = None
    by_plc: bool = False
    adds: str = ""
    raw_tables: tuple[str, ...] = ()
    unseen: str = ""
    build: str = ""

    @property
    def variable(self) -> str:
        """NC variable of what it adds, in mm or °."""
        return f"V.A.{self.keyword}_COMP_CURR"

    def part(self, name: str) -> ModuleType:
        """Return a module of its folder (``entries``, ``page``), imported on first use."""
        return importlib.import_module(f".{self.name}.{name}", __package__)

    @functools.cached_property
    def entries(self) -> "AbstractEntries":
        """Between its list and its model."""
        return cast("AbstractEntries", self.part("entries").ENTRIES)

    @property
    def log_channel(self) -> "type[AbstractChannel]":
        """What a log shows of it."""
        return cast("type[AbstractChannel]", self.part("seen").CHANNEL)

    @functools.cached_property
    def probe(self) -> "AbstractProbe":
        """Its step of a probe."""
        return cast("AbstractProbe", self.part("seen").PROBE)

    @property
    def keys(self) -> "type[FitSpec]":
        """The keys of a fit in a job."""
        return cast("type[FitSpec]", self.part("keys").Spec)

    @property
    def planner(self) -> "PlanPart":
        """How a fit is planned."""
        if self.table:
            from ..job.table import _plan

            return _plan
        return cast("PlanPart", self.part("plan"))

    @property
    def page(self) -> "PagePart":
        """How the report shows it."""
        if self.table:
            from ..report import table

            return table
        return cast("PagePart", self.part("page"))
