"""One fit of whatever compensation: planned, then fitted, alone or in a group, not yet written."""

import abc
import dataclasses
import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...data.lists import ListFile, Value
from ...models import Conventions, TemperatureLine
from ..exchange import AxisLists, ListTarget
from ..kinds import kind
from ..kinds._keys import FitSpec
from ..kinds._kind import Kind
from ..proof import GateCheck
from .file._faults import JobError
from .file._load import Job
from .result._result import AbstractResult, ConventionState, Remark
from .result._second import SecondMeasurement

if TYPE_CHECKING:
    from ..fit.joint import AbstractEffect, JointData, JointFit, Part
    from ..readings import Tables
    from ._acting import Acting
    from .joint._recording import GroupRecording
    from .joint._share import Share
    from .write._lists import AxisFiles

    Leftovers = Mapping[tuple[int, str], Sequence[Acting]]
else:  # loads what draws on this module
    Leftovers = Mapping
"""By fit and measurement: what acts beside it, and did not in the readings that it is made of."""


_ALONE = "found in a group, expected it alone"


@dataclasses.dataclass(frozen=True)
class AbstractOfFit(abc.ABC):
    """What belongs to one fit of the job, with its index there."""

    job: Job
    index: int
    fit: FitSpec

    @property
    def lists(self) -> AxisLists:
        """What the axis has already."""
        return self.job.lists[self.axis]

    @property
    def target(self) -> ListTarget:
        """The compensation list that its entries are written for."""
        build, rules = self.job.spec.controller.build, self.job.conventions
        return ListTarget(self.lists.compensation, self.fit.max_points, build, rules)

    @property
    def manual_entry(self) -> dict[str, Value]:
        """The entry that makes it wait for COMP ON, or not; empty where the job leaves it."""
        manual, entry = self.fit.manual_activation, self.kind.manual
        return {} if manual is None or entry is None else {entry: int(manual)}

    def small(self, value: float, form: str = ".2g") -> str:
        """Return a length in mm, or an angle in °, as thousandths with their unit."""
        return f"{1e3 * value:{form}} {self.job.spec.axes[self.axis].small_unit}"

    def refusal(self, reason: str) -> JobError:
        """Return the error that the fit is, ready to raise."""
        return self.job.error(("fits", self.index), reason)

    @property
    def axis(self) -> str:
        """Name of the compensated axis in the job."""
        return self.fit.axis

    @property
    def kind(self) -> Kind:
        """The facts of the compensation."""
        return self.fit.kind

    @property
    def compensation(self) -> str:
        """Name of the compensation, as in the job."""
        return self.fit.compensation

    @property
    def name(self) -> str:
        """Compensation and axis, for messages."""
        return self.fit.name


@dataclasses.dataclass(frozen=True)
class AbstractPlan(AbstractOfFit):
    """A planned fit: its existing lists read, its keys understood.

    What is asked of a fit in a group follows `fit_single`; a kind that has no part in one leaves
    it as it is.
    """

    def fit_single(self, tables: "Tables", left: Leftovers) -> "AbstractDraft":
        """Fit it to its own measurements, as if there was no other: a group of one.

        Raises:
            JobError: If the readings do not suit.
            FitError: If they do not determine the fit.
            ExchangeError: If the result fits no list.
        """
        from .joint._group import fit_group_of_one  # takes long to load
        from .joint._recording import read_group

        return self.draft(fit_group_of_one(self, read_group(tables, [self])))

    @property
    def inputs(self) -> Mapping[str, tuple[str, ...]]:
        """Axes (sensors) of which it uses ``position``, ``direction``, … of a `JointData`."""
        return {}

    @property
    def without_position(self) -> str:
        """What a job may ask for where no position was recorded, to end a sentence."""
        return ""

    @property
    def shifting(self) -> bool:
        """Whether a temperature moves the whole axis, as an offset of a run does."""
        return False

    @property
    def takes_line(self) -> bool:
        """Whether its list can hold a line over the position of the axis."""
        return self.kind.table and self.fit.lengths

    def nodes_beside(self, data: "JointData") -> Float[np.ndarray, " n"]:
        """Return the nodes of a curve over the axis beside which it shows what is its own.

        Fewer than two: it needs none.
        """
        return np.zeros(0)

    def unfit(self, recording: "GroupRecording") -> str:
        """Return why these readings tell nothing of it, whatever they are; else nothing."""
        return ""

    def undetermined(self, data: "JointData") -> str:
        """Return why the motion of its masters does not tell it; else nothing."""
        return ""

    def confused(
        self, members: Sequence["AbstractPlan"], recording: "GroupRecording"
    ) -> str:
        """Return in words which effect without a fit the readings cannot tell from it, or nothing.

        The members are all that are fitted to these readings.
        """
        return ""

    def may_be_written(self, part: "Part", fit: "JointFit") -> bool:
        """Return whether the readings tell its part of the joint fit."""
        from .joint._share import undetermined_values  # takes long to load

        return bool(part.determined.any()) and not undetermined_values(part, fit)

    def effect(
        self, recording: "GroupRecording", left: Float[np.ndarray, " t"] | None
    ) -> "AbstractEffect | None":
        """Return the effect; None where its form needs what the other effects leave of the error.

        Raises:
            FitError: If the readings do not tell its form.
        """
        raise self.refusal(_ALONE)

    def draft(self, share: "Share") -> "AbstractDraft":
        """Return its draft.

        Raises:
            FitError: If the readings cannot carry it.
            ExchangeError: If it fits no list.
        """
        raise self.refusal(_ALONE)

    def left_out(self, why: str, share: "Share | None" = None) -> "AbstractDraft":
        """Return what stands for it where its readings do not tell it: the rest is written.

        Args:
            why: In words; empty: what the readings do not tell is said.
            share: Its part of the joint fit; None where it was not fitted at all.
        """
        from .joint._share import LeftOutDraft  # takes long to load

        return LeftOutDraft(self.job, self.index, self.fit, why, share)


class Foreseen(NamedTuple):
    """The error of each reading in mm, ° or the unit of the current.

    Attributes:
        before: As it is.
        predicted: With a list that was fitted without that reading.
        wild: Readings that are the instrument's fault.
    """

    before: Float[np.ndarray, " t"]
    predicted: Float[np.ndarray, " t"]
    wild: Bool[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True)
class AbstractDraft(AbstractOfFit):
    """A compensation of one axis, fitted and not yet written.

    Attributes:
        beside: Compensations that will act beside it and did not in its readings: what they
            add was taken off these.
    """

    beside: tuple[str, ...] = dataclasses.field(default=(), kw_only=True)

    @property
    def written(self) -> bool:
        """Whether there is anything to write; entries, gate and jump are asked only then."""
        return True

    @property
    def needs(self) -> str:
        """What must hold before it works: ``Works once its masters are referenced``."""
        return ""

    @property
    def partial(self) -> bool:
        """Whether it is written without what its readings do not tell, and says so."""
        return False

    @property
    def converged(self) -> bool:
        """Whether the iterations of its fit came to rest; else its gate fails."""
        return True

    def entries(self) -> dict[str, Value]:
        """Return the entries of the compensation list; empty where it needs none.

        Raises:
            ExchangeError: If it fits no list of the controller's build.
        """
        return {}

    def machine_entries(self, cycles: int | None) -> dict[str, Value]:
        """Return the entries of the axis list; ``cycles`` is P-AXIS-00243 of the axis.

        Raises:
            ExchangeError: If it fits none.
        """
        return {self.kind.activation: 1}

    def machine_remarks(self) -> Iterable[Remark]:
        """Return what the user must know of changes to the axis list."""
        return ()

    def extra_files(self) -> Mapping[str, bytes]:
        """Return further files by name, such as those for the PLC."""
        return {}

    @property
    def cycles(self) -> int | None:
        """The cycles that its jump at reversal wants, or None."""
        return None

    @property
    def jump(self) -> float:
        """By how much it moves the standing axis at most where it comes or goes.

        In mm or °; 0 where nothing is added at standstill.
        """
        return 0.0

    @property
    def in_memory(self) -> bool:
        """Whether its readings fit into memory; else they are read in pieces."""
        return True

    @property
    def lags(self) -> Mapping[str, float]:
        """Time constants in s by which the controller filters its sensors, by name."""
        return {}

    @property
    def warmth(self) -> Mapping[str, Float[np.ndarray, " t"]]:
        """Temperature in °C behind the sensors that it follows at its readings, lag included."""
        return {}

    def line(self, machine: ListFile | None) -> TemperatureLine | None:
        """Return the temperature line that a PLC makes of it, or None.

        Args:
            machine: The axis list that is written, or the entries to add to it.
        """
        return None

    @property
    def predicted(self) -> float | None:
        """Rms on readings that the fit did not see, about their middle; None: unknown."""
        return None

    @property
    def unit(self) -> str:
        """Unit of its error, in plain letters."""
        return self.job.spec.axes[self.axis].plain_unit

    @property
    def foreseen(self) -> "Foreseen | None":
        """The error before, and what is predicted of it; None where nothing is predicted."""
        return None

    def gate(self, cycles: int | None) -> tuple[GateCheck, ...]:
        """Return the lines of the gate that its kind has of its own."""
        return ()

    def second_measurement(
        self, tables: "Tables", fit: FitSpec
    ) -> SecondMeasurement | None:
        """Return the error that a second measurement shows, the list active.

        None where no such measurement shows what this compensation does. The tables and the
        specification are those of the second job.

        Raises:
            AxcompError: If the measurement does not suit the fit.
        """
        return None

    def stays_on(self) -> Iterator[Remark]:
        """Yield that what the axis has already stays on, where nothing is written instead.

        What acted while measuring is in the readings, and asks for no word.
        """
        name, measured = self.compensation, self.job.spec.measurements
        acted = any(name in measured[source].active for source in self.fit.sources)
        if not (self.written or acted) and self.lists.acts(name):
            yield Remark.error(
                f"Nothing is written, and the {name} of {self.axis} in"
                f" {self.lists.used[name].listing.source} stays on. It was off while these"
                " readings were taken: with it the axis does not do what they show. Switch"
                f' it off there, or measure again with it on (active = ["{name}"]).'
            )

    @abc.abstractmethod
    def prove(self, done: "AxisFiles") -> AbstractResult:
        """Return the result, with the lists of the axis as they lie in the folder.

        What there is to say of these lists is not among its remarks.
        """

    def frame(self, done: "AxisFiles") -> dict[str, Any]:
        """Return what every result says alike, as arguments of its class."""
        rules = self.job.conventions, self.job.verified
        beside = tuple(b for name in self.beside for b in kind(name).conventions)
        names = {done.machine_name, *self.fit.plc_files}
        if self.kind.holder == "compensation":
            names.add(done.compensation_name)
        return {
            "compensation": self.compensation,
            "axis": self.axis,
            "axis_number": done.number,
            "unit": self.unit,
            "gate": done.gates[self.index],
            "conventions": _convention_states(*rules, self.kind.conventions),
            "rests_on": _convention_states(*rules, beside),
            "files": tuple(n for n in done.written if self.written and n.name in names),
            "findings": tuple(dataclasses.asdict(item) for item in done.findings),
        }


@functools.lru_cache(maxsize=64)
def _convention_states(
    conventions: Conventions, verified: frozenset[str], prefixes: tuple[str, ...]
) -> tuple[ConventionState, ...]:
    """Return the conventions whose names begin with one of these words."""
    # Kept: all machines of a batch have much the same ones.
    return tuple(
        ConventionState(
            name=rule.name,
            value=str(rule.value),
            state="verified" if rule.name in verified else "assumed",
            meaning=f"{rule.meaning} ({rule.rule})",
            decides=rule.decides,
        )
        for rule in conventions.listing()
        if rule.name.startswith(prefixes)
    )
