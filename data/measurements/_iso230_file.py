"""A positioning test in a file: read, evaluated, and held against a tolerance."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float

from ._derive import derive_error
from ._direction import explain_direction
from ._errors import MeasurementError
from ._iso230 import iso230
from ._iso230_types import Iso230
from ._iso230_words import amount, with_arrows
from ._measurement import measurement
from ._read import read_table
from ._roles import ColumnSpec, find_role
from ._table import Table

_PAIRS = 5
"""Targets with two readings that tell whether these are of one approach."""
_ABSURD = 0.05
"""Growth of the error per position that no machine has."""


@final
@dataclasses.dataclass(frozen=True)
class Iso230Verdict:
    """Whether the accuracy of a test lies within a tolerance.

    Attributes:
        passed: It does, and nothing is missing.
        figure: The figure that was judged: A, or A of one direction.
        value: Of the figure, in the unit of the test.
        tolerance: Likewise.
        sentence: All of it in words.
    """

    passed: bool
    figure: str
    value: float
    tolerance: float
    sentence: str


@final
@dataclasses.dataclass(frozen=True)
class Iso230Test:
    """The test in one file.

    Attributes:
        path: The file.
        figures: With all remarks on the file.
        unit: Of the figures, ``mm`` or ``deg``.
        axis: Its name; empty where the file does not say.
        missing: Readings that the file announces and lacks.
        twice: By how much in the unit the second reading of a target lies off the first, where
            both count as one approach and do not look like one; else 0.
    """

    path: Path
    figures: Iso230
    unit: str
    axis: str
    missing: int
    twice: float = 0.0

    def verdict(self, tolerance: float) -> Iso230Verdict:
        """Return the verdict: A against the tolerance, the figure named.

        A test with missing readings or approaches does not pass: the figures of the whole
        one are larger.

        Raises:
            MeasurementError: If the data give no accuracy to judge.
        """
        name, value = self.figures.judged()
        if value is None:
            reason = "found one run only, expected at least two: no accuracy A to judge"
            raise MeasurementError(str(self.path), reason)
        within, single = value <= tolerance, self.figures.single_targets()
        fewer = self.figures.incomplete_targets()
        passed = within and not (self.missing or single or fewer or self.twice)
        sentence = (
            f"{'PASS' if passed else 'NOT JUDGED' if within else 'FAIL'}:"
            f" {with_arrows(name)} = {amount(value, self.unit)} {'≤' if within else '>'}"
            f" tolerance {amount(tolerance, self.unit)} ({self.path.name})"
        )
        if within and self.missing:
            sentence += (
                f", but {self.missing} readings that the file announces are missing"
            )
        elif within and single:
            places = ", ".join(f"{target:g}" for target in single[:8])
            sentence += f", but it leaves out targets with a single approach: {places}"
        elif within and self.twice:
            sentence += (
                f", but the second reading of a target lies {amount(self.twice, self.unit)}"
                " off the first: if they were approached from both sides, state the direction"
            )
        elif within and fewer:
            places = ", ".join(f"{target:g}" for target in fewer[:8])
            sentence += (
                f", but targets {places} have fewer approaches than others: repeat them,"
                " or leave those targets out"
            )
        return Iso230Verdict(passed, name, value, tolerance, sentence)


def read_iso230(
    path: Path,
    columns: Mapping[str, ColumnSpec] | None = None,
    axis: str | None = None,
    turn: float | None = None,
) -> Iso230Test:
    """Return the positioning test in a file.

    Args:
        path: The file.
        columns: Column of each role, as for `measurement`; none: as the file says.
        axis: Which one, where the file holds several.
        turn: mm or ° of a turn, where the axis goes round.

    Raises:
        MeasurementError: If the file holds no such test, or several.
    """
    table = read_table(path)
    if not columns:
        axis = axis or _only_axis(table)
    axis = axis or table.axis
    name = axis or "axis"
    turns = None if turn is None else {name: turn}
    data = measurement(table, columns or {}, axis=name, turns=turns)
    position = data.require(f"{name}.position", "for an ISO 230-2 evaluation")
    direction = explain_direction(data, name)
    error = derive_error(data, name)
    _refuse_absurd(path, position, error)
    result = iso230(position, error, data.get("run"), direction.values)
    skipped = (
        f"Skipped line {row.line}: {row.reason}."
        for row in table.skipped
        if row.reason != "comment"
    )
    remarks = (*data.remarks, *direction.remarks, *skipped, *result.remarks)
    figures = dataclasses.replace(result, remarks=remarks)
    unit = data.units[f"{name}.position"]
    twice = 0.0
    if direction.source != "column":
        twice = _twice(position, error, data.get("run"), direction.values)
    return Iso230Test(path, figures, unit, axis or "", table.missing, twice)


def _refuse_absurd(
    path: Path, position: Float[np.ndarray, " t"], error: Float[np.ndarray, " t"]
) -> None:
    """Raise where errors grow along the axis as those of no machine do.

    Raises:
        MeasurementError: If they do.
    """
    known = np.isfinite(position + error)
    if not known.any() or not np.ptp(position[known]):
        return
    slope = float(np.polyfit(position[known], error[known], 1)[0])
    if abs(slope) > _ABSURD:
        remedy = "state the unit of the column that is wrong (--column)"
        if abs(slope + 2.0) < _ABSURD:
            remedy = (
                "the instrument counts the other way than the axis, turn its readings"
            )
        reason = (
            f"found errors that grow by {slope:.3g} times the position, expected next to"
            f" none: {remedy}"
        )
        raise MeasurementError(str(path), reason)


def _twice(
    position: Float[np.ndarray, " t"],
    error: Float[np.ndarray, " t"],
    run: np.ndarray | None,
    direction: np.ndarray,
) -> float:
    """Return by how much second readings of a target lie off the first in a run.

    0: no more than they scatter, or there are few.
    """
    runs = np.zeros(position.size) if run is None else run
    place = np.column_stack([position.round(6), runs, direction])
    _, at, count = np.unique(place, axis=0, return_inverse=True, return_counts=True)
    at = at.reshape(-1)
    order = np.argsort(at, kind="stable")
    order = order[(count == 2)[at[order]]]
    apart = error[order][1::2] - error[order][::2]
    if apart.size < _PAIRS or abs(apart.mean()) < 2.0 * apart.std():
        return 0.0
    return float(abs(apart.mean()))


def _only_axis(table: Table) -> str | None:
    """Return the one axis with a position and an error or actual; None for bare roles.

    Raises:
        MeasurementError: If there are several, or none.
    """
    roles = [column.role for column in table.columns if column.role]
    if "position" in roles:
        return None
    named = [role for text in roles if (role := find_role(text)) and role.axis]
    axes = sorted(
        {
            role.axis or ""
            for role in named
            if role.kind in ("error", "actual") and f"{role.axis}.position" in roles
        }
    )
    if len(axes) == 1:
        return axes[0]
    columns = ", ".join(column.name for column in table.columns[:12])
    found = f"axes {', '.join(axes)}" if axes else f"columns {columns}"
    expected = (
        "--axis with one of them"
        if axes
        else "target, error (or actual), run, direction; or X.position, X.error …;"
        " --column ROLE=COLUMN tells which is which"
    )
    raise MeasurementError(str(table.path), f"found {found}, expected {expected}")
