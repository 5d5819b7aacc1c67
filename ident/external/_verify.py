"""What a controller did with an external compensation, against the tables it was made of."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from ...data.lists import ListFile
from ...data.measurements import EXTERNAL_LOG, ControllerLog
from ...models import Conventions, OffsetStack
from ..exchange import (
    ExchangeError,
    Reading,
    axes_in_use,
    machine_lists,
)
from ..proof import Verdict
from ._law import external_from_lists, from_interface

_LINE = re.compile(
    rb"ext_comp\[0\]\.(initialized|registered|state|extcomp_(?:input|output)\[(\d+)\])"
    rb"[ \t]*:?[ \t]+(-?\d+)"
)
_UNITS = 2e-8
"""mm or ° by which the code may miss the model: roundings of the interface."""
_CLOSE = 0.02
"""Factors that differ by less are one; a ramp or a software limit may be at work beyond."""
_FACTORS = {-1.0: "sign", 2.0: "twice"} | dict.fromkeys(
    (0.1, 10.0, 0.01, 100.0, 0.001, 1000.0), "unit"
)


@final
@dataclasses.dataclass(frozen=True)
class Snapshot:
    """The general part of ``diagdata.txt`` about the external compensation.

    Attributes:
        flags: ``initialized``, ``registered``, ``state``, as far as they are there.
        positions: Of the first ten axes, in the order of their numbers, in mm or °.
        offsets: Likewise.
    """

    flags: dict[str, int]
    positions: Float[np.ndarray, " a"]
    offsets: Float[np.ndarray, " a"]


def read_snapshot(path: Path) -> Snapshot | None:
    """Return what a ``diagdata.txt`` says of the external compensation; None: it is none.

    Raises:
        ExchangeError: If it has no position or no offset.
        OSError: If it cannot be read.
    """
    if path.suffix.lower() != ".txt":
        return None
    found = {m[1].decode(): int(m[3]) for m in _LINE.finditer(path.read_bytes())}
    if not found:
        return None
    sides = []
    for side in ("input", "output"):
        row: list[int] = []
        while (name := f"extcomp_{side}[{len(row)}]") in found:
            row.append(found[name])
        try:
            sides.append(from_interface(np.array(row, dtype=np.int64)))
        except OverflowError:
            raise ExchangeError(
                where=str(path),
                found=f"{max(row, key=abs)} as extcomp_{side}",
                expected="integers of 64 bits",
            ) from None
    if not len(sides[0]) or len(sides[0]) != len(sides[1]):
        raise ExchangeError(
            where=str(path),
            found=f"{len(sides[0])} values of extcomp_input, {len(sides[1])} of"
            " extcomp_output",
            expected="the same number of both: the general diagnostic data",
        )
    flags = {name: value for name, value in found.items() if "[" not in name}
    return Snapshot(flags, *sides)


def verify_snapshot(
    lists: Sequence[ListFile],
    snapshot: Snapshot,
    reading: Reading,
) -> tuple[Verdict, ...]:
    """Return what one moment of a controller tells of an external compensation.

    Args:
        lists: What it was exported from, and the axis lists of all other axes.
        snapshot: From `read_snapshot`.
        reading: How the lists are read.

    Raises:
        ExchangeError: If a list makes no table, or there are more axes than values.
    """
    numbers = _numbers(lists, reading.conventions)
    if len(numbers) > len(snapshot.positions):
        raise ExchangeError(
            where="diagdata",
            found=f"{len(snapshot.positions)} axes",
            expected=f"at least the {len(numbers)} that the lists name",
        )
    law = external_from_lists(lists, reading, axes=numbers)
    count = len(numbers)
    wanted = np.asarray(law.offsets(snapshot.positions[None, :count]))
    idle = [name for name, value in snapshot.flags.items() if value != 1]
    return tuple(
        _judged(axis, snapshot.offsets[[k]], wanted[:, k], _UNITS, idle)
        for k, axis in enumerate(numbers)
        if wanted[0, k] or snapshot.offsets[k]
    )


def verify_external(
    lists: Sequence[ListFile],
    log: ControllerLog,
    reading: Reading,
) -> tuple[tuple[Verdict, ...], ControllerLog]:
    """Return what a log of ``EXTC[0].actual_offset`` tells, and the log without it.

    Args:
        lists: What the compensation was exported from.
        log: From `read_log`, with axes A1, A2, … after their logical numbers.
        reading: How the lists are read.

    Raises:
        ExchangeError: If a column names no axis, the position of a master is missing, or a
            list makes no table.
    """
    columns = [one for one in log.offsets if one.compensation == EXTERNAL_LOG]
    rest = tuple(one for one in log.offsets if one.compensation != EXTERNAL_LOG)
    without = dataclasses.replace(log, offsets=rest)
    # Recordings of all objects hold zeros where no external compensation is.
    if not any(one.values.any() for one in columns):
        return (), without
    numbers = _numbers(lists, reading.conventions)
    law = external_from_lists(lists, reading, axes=numbers)
    stack = law.law
    assert isinstance(stack, OffsetStack)
    masters = {column for part in stack.parts for column in part.masters}
    rows = [
        log.motion.require(f"A{axis}.position")
        if k in masters
        else np.zeros(len(columns[0].values))
        for k, axis in enumerate(numbers)
    ]
    wanted = np.asarray(law.offsets(np.stack(rows, axis=1)))
    verdicts = []
    for one in columns:
        number = (one.axis or "").removeprefix("A")
        if not number.isdecimal() or int(number) not in numbers:
            raise ExchangeError(
                where=str(log.source),
                found=f"column {one.column!r}",
                expected=f"an axis before it: {', '.join(f'A{n}' for n in numbers)}",
            )
        at = wanted[:, numbers.index(int(number))]
        verdicts.append(_judged(int(number), one.values, at, max(one.step, 1e-5)))
    return tuple(verdicts), without


def _numbers(lists: Sequence[ListFile], conventions: Conventions) -> tuple[int, ...]:
    machine = machine_lists(lists)
    return axes_in_use(machine.in_use(conventions), machine)


def _judged(
    axis: int,
    found: Float[np.ndarray, " t"],
    wanted: Float[np.ndarray, " t"],
    step: float,
    idle: Sequence[str] = (),
) -> Verdict:
    """Return the verdict on the offsets of one axis, which may miss by a step and 2 %."""

    def verdict(words: tuple[str, ...], value: float | None, text: str) -> Verdict:
        return Verdict(axis, "external", words, (value,) if words else (), text, {})

    if idle:
        return verdict((), None, f"not active: {', '.join(idle)} is not 1")
    size = float(np.sqrt(np.mean(wanted**2)))
    if size <= 2.0 * step:
        if np.abs(found).max() <= 2.0 * step:
            return verdict((), None, "cannot tell: the tables add nothing here")
        return verdict((), None, "adds what is in no table of these lists")
    if np.abs(found).max() <= 2.0 * step:
        return verdict((), None, f"adds nothing, the tables {1e3 * size:.2g} µm")
    factor = float(found @ wanted / (wanted @ wanted))
    left = float(np.sqrt(np.mean((found - factor * wanted) ** 2)))
    if left > step + _CLOSE * max(abs(factor), 1.0) * size:
        text = f"does not follow the tables: {1e3 * left:.2g} of {1e3 * size:.2g} µm differ"
        return verdict((), None, text)
    miss = step / size + _CLOSE
    if abs(factor - 1.0) <= miss:
        within = float(np.abs(found - wanted).max())
        return verdict(("agrees",), within, f"agrees within {1e3 * within:.2g} µm")
    for known, word in _FACTORS.items():
        if abs(factor - known) <= step / size + _CLOSE * abs(known):
            text = f"adds {known:g} times what the tables say"
            level = f"{text}: a LEVEL, or a wrong unit"
            return verdict((word,), known, level if 0.0 < known < 1.0 else text)
    # A LEVEL is a share of 0 to 1.
    level = "a LEVEL, or a software limit near"
    why = level if 0.0 < factor < 1.0 else "other tables, or axes in another order"
    return verdict((), None, f"adds {factor:.2g} times what the tables say: {why}")
