"""What a job found of one fit: the structure behind its part of result.json and report."""

import abc
import dataclasses
import functools
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Int

from ...fit import TableFit
from ...proof import ErrorFigures, GateCheck, RunTable, error_figures
from ...readings import Readings
from ._second import MeasuredAgain, SecondMeasurement
from ._verdict import Code, Judgement, Verdict, judgement_of

Array = np.ndarray
STAGES = ("before", "predicted", "from_file")
"""Of an error: as measured, held out, and under the file as written."""
_MANY_WILD = 0.05
"""Share of wild readings from which on the instrument deserves a look."""


@dataclasses.dataclass(frozen=True)
class Remark:
    """Something that the user must know: ``level`` is error, warning or info."""

    level: str
    message: str

    @classmethod
    def error(cls, message: str) -> "Remark":
        """Return what must be seen to before anything is loaded."""
        return cls("error", message)

    @classmethod
    def warning(cls, message: str) -> "Remark":
        """Return what must be known before anything is loaded."""
        return cls("warning", message)

    @classmethod
    def info(cls, message: str) -> "Remark":
        """Return how the result came about."""
        return cls("info", message)


def by_level(remarks: Iterable[Remark]) -> tuple[Remark, ...]:
    """Return remarks, errors first."""
    levels = ("error", "warning", "info")
    return tuple(sorted(remarks, key=lambda remark: levels.index(remark.level)))


def some_of(names: Sequence[str], limit: int) -> str:
    """Return a few of many names, and how many more there are."""
    omitted = len(names) - limit
    return "; ".join(names[:limit]) + (f" and {omitted} more" if omitted > 0 else "")


def wild_remark(wild: int, count: int, loss: str = "student") -> Remark:
    """Return that so many of all readings are wild: a warning from one in twenty on."""
    them, are = ("them", "are") if wild > 1 else ("it", "is")
    does = f"limits the pull of {them}" if loss == "huber" else f"leaves {them} out"
    return Remark(
        "warning" if wild > _MANY_WILD * count else "info",
        f"{wild} of {count} readings {are} wild: the fit {does}. rms and max are"
        f" given with and without {them}.",
    )


def largest_wild(
    error: Float[Array, " t"], wild: Bool[Array, " t"]
) -> Int[Array, " n"]:
    """Return the rows of the largest wild readings, at most a dozen."""
    rows = np.flatnonzero(wild)
    return rows[np.argsort(-np.abs(error[rows]), kind="stable")][:12]


def staged(
    before: Float[Array, " t"],
    predicted: Float[Array, " t"],
    from_file: Float[Array, " t"],
    wild: Bool[Array, " t"],
    runs: RunTable | None = None,
) -> dict[str, ErrorFigures]:
    """Return the figures of an error by stage; arguments as `error_figures`."""
    stages = zip(STAGES, (before, predicted, from_file), strict=True)
    return {name: error_figures(error, runs, wild) for name, error in stages}


@dataclasses.dataclass(frozen=True)
class ConventionState:
    """A rule of the controller that was used, with the value taken.

    Attributes:
        state: ``assumed`` or ``verified``.
        meaning: One line.
        decides: ``sign``, ``owner`` or ``zero`` where a list is unproven without it, else
            empty.
    """

    name: str
    value: str
    state: str
    meaning: str = ""
    decides: str = ""


@dataclasses.dataclass(frozen=True)
class Expectation:
    """What a person sees on the machine where a sign is as the list takes it.

    Attributes:
        places: Positions of axes in mm or °, by name.
        direction: ±1 from which the axis comes, or None where it does not matter.
        value: What the list adds there, in mm, ° or the unit of the current.
        unit: ``mm``, ``deg`` or the unit of the current.
        temperatures: Of sensors in °C, by name.
        speed: In mm/s or °/s, for what acts in motion.
        reversal: The value is what a reversal no longer loses.
    """

    places: Mapping[str, float]
    direction: int | None
    value: float
    unit: str
    temperatures: Mapping[str, float] = dataclasses.field(default_factory=dict)
    speed: float | None = None
    reversal: bool = False


@dataclasses.dataclass(frozen=True, kw_only=True)
class SampleView(Readings):
    """The readings of a table with what became of them, in mm or °.

    Attributes:
        predicted: Error left under the list fitted *without* this reading's run or
            block.
        from_file: Error left when the written file, read back, is evaluated by the
            controller's rules.
        predicted_sd: Standard deviation predicted for a held-out reading.
        wild: Readings that the loss rejected.
    """

    predicted: Float[Array, " t"]
    from_file: Float[Array, " t"]
    predicted_sd: Float[Array, " t"]
    wild: Bool[Array, " t"]

    @property
    def sound(self) -> Bool[Array, " t"]:
        """Readings that are neither wild nor without a prediction."""
        return np.asarray(~self.wild & np.isfinite(self.predicted))

    @property
    def signs(self) -> Int[Array, " t"]:
        """Direction of each reading, ±1; 0 where the table does not ask for it."""
        none = np.zeros(len(self.error), dtype=np.int64)
        return none if self.direction is None else self.direction

    @property
    def before(self) -> Float[Array, " t"]:
        """Error as measured (after `remove`, `datum`, reduction to the reference temperature)."""
        return self.error


@dataclasses.dataclass(frozen=True, kw_only=True)
class AbstractResult(abc.ABC):
    """One compensation of one axis: error before and after, gate, files.

    Attributes:
        axis_number: Logical number of the compensated axis.
        unit: Of the error: ``mm``, ``deg``, or the unit of the current.
        error: Keys ``before``, ``predicted``, ``from_file``.
        gate: All checks; ``passed`` is true when every one passed.
        remarks: What the user must know.
        conventions: Rules used.
        rests_on: Rules of what will act beside it and was off while measuring: what it adds was
            taken off the readings, and with another sign it adds something else.
        files: Files written for this fit, relative to the output folder; those of a
            failed gate lie in ``rejected/``.
        findings: What `axcomp check` says of the files, in its JSON shape.
        held_out: What the prediction left out together: ``run``, ``block``, …
        again: What a second measurement with the list active says of it, or None.
        group: Fits that it was identified together with, by the name of their group:
            the error before is then what these leave; None = alone.
        no_effect: The readings show nothing that its list would correct.
    """

    compensation: str
    axis: str
    axis_number: int
    unit: str
    error: Mapping[str, ErrorFigures]
    gate: tuple[GateCheck, ...]
    remarks: tuple[Remark, ...]
    conventions: tuple[ConventionState, ...]
    files: tuple[Path, ...]
    findings: tuple[Mapping[str, Any], ...] = ()
    held_out: str = "block"
    again: MeasuredAgain | None = None
    group: str | None = None
    no_effect: bool = False
    rests_on: tuple[ConventionState, ...] = ()

    @property
    def rules(self) -> tuple[ConventionState, ...]:
        """All rules that what it promises rests on, its own first."""
        return (*self.conventions, *self.rests_on)

    @property
    def passed(self) -> bool:
        """Whether every check of the gate passed."""
        return all(check.passed for check in self.gate)

    @functools.cached_property
    def judgement(self) -> Judgement:
        """The verdict on it and its reasons."""
        return judgement_of(self)

    @property
    def sign(self) -> int:
        """With which the controller adds its entries."""
        signs = [r.value for r in self.conventions if r.name.endswith("_sign")]
        return int(signs[0]) if signs else 1

    @property
    def measured(self) -> SecondMeasurement | None:
        """The readings with the list active, or None."""
        return None if self.again is None else self.again.readings

    @property
    def confirmed(self) -> bool:
        """Whether a second measurement shows that the list does what it says."""
        again, judged = self.again, self.judgement
        if again is None or judged.verdict is Verdict.REJECTED:
            return False
        if judged.has(Code.UNOWNED) or judged.has(Code.BESIDE):
            return False
        return again.acts or judged.verdict is Verdict.GOOD

    @property
    def subject(self) -> str:
        """What its figures are of, in words."""
        return f"the error of {self.axis}"

    @property
    def measured_as(self) -> str:
        """What these readings may be called: ``verified`` only where they show it."""
        return "verified" if self.confirmed else "measured again"

    def unsettled(self, settled: Collection[str]) -> tuple[Remark, ...]:
        """Return the remarks, less those that ask for rules which a measurement has settled."""
        return self.remarks

    @property
    def expectation(self) -> Expectation | None:
        """What settles its sign at the machine; None where nothing written is seen there."""
        return None

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose positions it acts, where these are others than its own."""
        return ()

    @property
    def left_out(self) -> bool:
        """Whether the readings do not tell it, so that nothing of it is written."""
        return False

    @abc.abstractmethod
    def details(self) -> dict[str, Any]:
        """Return what result.json says of this kind: parameters, deviations, support."""


@final
@dataclasses.dataclass(frozen=True, kw_only=True)
class TableResult(AbstractResult):
    """A plane, cross or leadscrew table with its uncertainty.

    Attributes:
        masters: Axes whose positions enter the table (leadscrew: the axis itself),
            master 1 first.
        units: Of each one's positions, ``mm`` or ``°``.
        limits: Software limits of the masters that have some.
        nodes: Node positions per master in its unit.
        table: Written table by branch name in ``unit`` and with the sign of the list
            entries: ``{"": …}`` for plane (shape ``[j, i]``) and cross,
            ``{"pos": …, "neg": …}`` for a bilateral leadscrew, ``{"pos": …}`` for a
            unilateral one.
        standard_deviation: Like ``table``.
        support: Samples per node, like ``table``; 0 = not measured.
        fit: The estimate behind it (sign of the error).
        samples: The readings with before / predicted / from file.
        rounding: Largest effect of rounding to list units, in ``unit``.
        readings: Number of readings of the fit.
        wild: How many of them it leaves out.
        cycles: Value chosen for P-AXIS-00243, None where the table has one branch.
        every: One reading in so many is among the samples, where they were read in pieces;
            None: all readings were in memory.
    """

    masters: tuple[str, ...]
    units: tuple[str, ...]
    limits: Mapping[str, Sequence[float]]
    nodes: tuple[Float[Array, " _n"], ...]
    table: Mapping[str, Float[Array, "..."]]
    standard_deviation: Mapping[str, Float[Array, "..."]]
    support: Mapping[str, Int[Array, "..."]]
    fit: TableFit
    samples: SampleView
    rounding: float
    readings: int
    wild: int
    cycles: int | None = None
    every: int | None = None

    @property
    def over(self) -> tuple[str, ...]:
        """Axes over whose positions it acts, where these are others than its own."""
        return () if self.masters == (self.axis,) else self.masters

    @property
    def expectation(self) -> Expectation | None:
        """The largest offset of the written list at a measured node that an axis may go to."""
        best: Expectation | None = None
        for branch, entries in self.table.items():
            way = {"pos": 1, "neg": -1}.get(branch) if len(self.table) > 1 else None
            free = (self.support[branch] > 0) & self._free(way)
            if not free.any():
                continue
            reached = np.where(free, np.abs(entries), -1.0)
            index = np.unravel_index(int(np.argmax(reached)), reached.shape)
            value = self.sign * float(entries[index])
            if best is None or abs(value) > abs(best.value):
                places = zip(self.masters, self.nodes, reversed(index), strict=True)
                best = Expectation(
                    {name: float(nodes[int(k)]) for name, nodes, k in places},
                    way,
                    value,
                    self.unit,
                )
        return best

    def _free(self, way: int | None) -> Bool[np.ndarray, "..."]:
        """Return the nodes that its masters may go to, and its axis come to in a direction."""
        free = []
        for name, nodes in zip(self.masters, self.nodes, strict=True):
            low, high = self.limits.get(name, (-np.inf, np.inf))
            inside = (nodes >= low) & (nodes <= high)
            if name == self.axis and way is not None and inside.any():
                inside[np.flatnonzero(inside)[0 if way > 0 else -1]] = False
            free.append(inside)
        return np.asarray(functools.reduce(np.multiply.outer, reversed(free)))

    def details(self) -> dict[str, Any]:
        """Return parameters, deviations and support for result.json."""
        parameters: dict[str, Any] = {"table": _values(self.table), "nodes": self.nodes}
        if self.cycles is not None:
            parameters["n_backlash_cyc"] = self.cycles
        return {
            "masters": self.masters,
            "parameters": parameters,
            "standard_deviations": {"table": _values(self.standard_deviation)},
            "support": _values(self.support),
            "noise": self.fit.noise,
            "line_offset": self.fit.line_offset,
            "smoothness": self.fit.smoothness,
            "loss": self.fit.loss,
            "runs": self.fit.runs,
            "message": self.fit.message,
            "rounding": self.rounding,
            "route": "in memory" if self.every is None else "stream",
            "readings": self.readings,
        }


def _values(branches: Mapping[str, np.ndarray]) -> Any:
    """Return a table as an array, or as ``{pos, neg}`` where it has named branches."""
    return branches[""] if "" in branches else dict(branches)
