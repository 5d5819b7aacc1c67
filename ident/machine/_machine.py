"""A machine whose errors are known: it takes lists, and instruments measure it.

The instruments scatter, drift and round; their files are as instruments leave them.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ...data.errors import FoundError
from ...data.lists import ListFile
from ...models import Conventions, Motion, PositionController, TemperatureLine
from ..exchange import Reading as ListReading, controller_from_lists
from ._instruments import Instrument
from ._sources import Column, Columns, ErrorSource, State


@dataclasses.dataclass(frozen=True, eq=False)
class VirtualMachine:
    """Axes with known errors behind a controller that applies lists.

    A new compensation needs one more source of error; what its list does, the
    controller model knows.

    Attributes:
        axes: Logical number by axis name.
        sources: Causes of error; those of one axis add up.
        controller: Has the lists that are loaded, a column per axis; None: no list.
        conventions: Rules that the controller follows.
    """

    axes: Mapping[str, int]
    sources: tuple[ErrorSource, ...]
    controller: PositionController | None = None
    conventions: Conventions = dataclasses.field(default_factory=Conventions)

    def with_lists(
        self,
        listings: Iterable[ListFile],
        lines: Mapping[int, TemperatureLine] | None = None,
    ) -> "VirtualMachine":
        """Return the machine with these lists loaded and active, and no others.

        Args:
            listings: Compensation lists and axis lists; without an axis list everything
                in a compensation list is active.
            lines: Temperature lines as a PLC makes them, by axis number.

        Raises:
            ExchangeError: If a list makes no table, or names an axis that the machine
                does not have.
        """
        lists = list(listings)
        if not lists and not lines:
            return dataclasses.replace(self, controller=None)
        controller = controller_from_lists(
            lists,
            ListReading(self.conventions, lines=lines or {}, commanded=True),
            axes=tuple(self.axes.values()),
        )
        return dataclasses.replace(self, controller=controller)

    def true_error(self, axis: str, state: State) -> Column:
        """Return the error of the bare machine in a state in mm: actual − encoder."""
        if axis not in self.axes:
            where, axes = "virtual machine", ", ".join(self.axes)
            raise FoundError(where, f"axis {axis}", f"one of {axes}")
        parts = (each.error(state) for each in self.sources if each.axis == axis)
        return sum(parts, np.zeros(state.rows))

    def error(
        self, axis: str, positions: Columns, direction: Int[np.ndarray, " t"]
    ) -> Column:
        """Return the error of an axis at standstill in mm with the active lists.

        Asked for at commanded positions in mm of all axes that matter to it, after a last
        motion of the axis in a direction of ±1.
        """
        total = self.true_error(axis, State(positions, {axis: direction}))
        if self.controller is None:
            return total
        zeros = np.zeros(len(direction))
        where = np.stack([positions.get(name, zeros) for name in self.axes], axis=1)
        sign = np.repeat(np.asarray(direction, dtype=float)[:, None], len(self.axes), 1)
        still = jnp.zeros(where.shape)
        motion = Motion(jnp.asarray(where), still, still, direction=jnp.asarray(sign))
        column = list(self.axes).index(axis)
        added = np.asarray(self.controller.settled(motion).offset)[:, column]
        return np.asarray(total + added)


@dataclasses.dataclass(frozen=True)
class Reading:
    """A finished measurement with the truth behind it; lengths in mm.

    Attributes:
        positions: Commanded, one column per axis that moved, shape ``(t, d)``.
        reading: Error as the instrument shows it.
        truth: Error that the machine really had.
        direction: ±1 per reading.
        run: 1, 2, … per reading.
    """

    positions: Float[np.ndarray, "t d"]
    reading: Column
    truth: Column
    direction: Int[np.ndarray, " t"]
    run: Int[np.ndarray, " t"]


def measure(
    machine: VirtualMachine,
    axis: str,
    moved: tuple[str, ...],
    points: Float[np.ndarray, "p d"],
    instrument: Instrument,
    seed: int,
    *,
    runs: int = 1,
    ways: tuple[int, ...] = (1,),
) -> Reading:
    """Measure the error of an axis at points in mm of the axes that are moved.

    Each run goes over the points in their order (way 1), back over them (−1), or both.
    """
    single = np.concatenate([points[::step] for step in ways])
    run = np.repeat(np.arange(runs), len(single))
    positions = np.tile(single, (runs, 1))
    direction = np.tile(np.repeat(ways, len(points)), runs)
    where = {name: positions[:, column] for column, name in enumerate(moved)}
    truth = machine.error(axis, where, direction)
    rng = np.random.default_rng(seed)
    reading, _ = instrument.read(truth, positions[:, 0], run, rng)
    return Reading(positions, reading, truth, direction, run + 1)


def write_reading(path: Path, header: str, reading: Reading) -> None:
    """Write a measurement as CSV, with positions in mm and errors in µm.

    The header names the columns: ``run`` and ``direction``, where they are wanted, the
    positions, and the error.
    """
    stated = {"run": (reading.run, "%d"), "direction": (reading.direction, "%+d")}
    used = [stated[name] for name in header.split(",") if name in stated]
    columns = [column for column, _ in used]
    table = np.column_stack([*columns, reading.positions, 1000 * reading.reading])
    forms = [form for _, form in used]
    forms += ["%.3f"] * (table.shape[1] - len(forms))
    np.savetxt(path, table, forms, ",", header=header, comments="")
