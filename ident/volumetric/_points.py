"""Measured points in the volume of a machine."""

import dataclasses
from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

from ...data.measurements import Measurement
from ..core import FitError, Readings

_AXES = "XYZ"

Rows = Any
"""Array or lists of numbers: an array of floats once they are checked."""


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Points:
    """Errors measured at positions of three axes.

    Attributes:
        position: Commanded X, Y and Z in mm, shape ``(t, 3)``.
        error: Actual − commanded place of the tool in mm: as vectors, shape ``(t, 3)``, NaN
            where a component was not measured; or along `direction`, shape ``(t,)``.
        direction: Of each reading along a line (laser, ball bar), any length but 0; None for
            vectors.
        tool: From the point that positions name to the measured one in mm, for all alike or one
            a point; None: no tool.
        run: Number or name of the set-up of each point. What a set-up leaves unknown is its own:
            the zero of a line, length and centre of a ball bar, the origin of vectors. None:
            nothing is unknown of it.
    """

    position: Rows
    error: Rows
    direction: Float[np.ndarray, "t 3"] | None = None
    tool: Float[np.ndarray, "*t 3"] | None = None
    run: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Check that the arrays belong together.

        Raises:
            FitError: If they do not.
        """
        for name in ("position", "error"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.float64))
        count = len(self.position)
        if not count or self.position.shape != (count, 3):
            msg = f"position: found shape {self.position.shape}, expected (points, 3)"
            raise FitError(msg)
        shape = (count, 3) if self.direction is None else (count,)
        if self.error.shape != shape:
            msg = (
                f"error: found shape {self.error.shape}, expected {shape} "
                f"({'vectors' if self.direction is None else 'along the direction'})"
            )
            raise FitError(msg)
        for name in ("direction", "tool", "run"):
            values = getattr(self, name)
            if values is None or (name == "tool" and np.shape(values) == (3,)):
                continue
            rows = len(np.atleast_1d(values))
            if rows != count:
                msg = f"{name}: found {rows} rows, expected {count}, one per point"
                raise FitError(msg)
            shape = (count,) if name == "run" else (count, 3)
            if np.shape(values) != shape:
                msg = f"{name}: found shape {np.shape(values)}, expected {shape}"
                raise FitError(msg)
        if self.direction is not None:
            none = int((~np.any(self.direction, axis=1)).sum())
            if none:
                msg = f"direction: found {none} of length 0, expected one per point"
                raise FitError(msg)

    @classmethod
    def of(cls, data: Measurement) -> "Points":
        """Return the points of a measurement: ``X.position`` … ``Z.error`` and ``run``.

        Raises:
            MissingRole: If a position or an error is missing.
        """
        full = data.with_gaps()
        position, error = (
            np.column_stack(
                [full.require(f"{axis}.{kind}", "for a volume") for axis in _AXES]
            )
            for kind in ("position", "error")
        )
        return cls(position, error, run=full.get("run"))

    @property
    def tools(self) -> Float[np.ndarray, "t 3"]:
        """The tool of each point."""
        tool = np.zeros(3) if self.tool is None else np.asarray(self.tool, float)
        return np.array(np.broadcast_to(tool, self.position.shape))

    @property
    def runs(self) -> Int[np.ndarray, " t"]:
        """Number of the set-up of each point, from 0."""
        if self.run is None:
            return np.zeros(len(self.position), np.int64)
        return np.unique(self.run, return_inverse=True)[1].astype(np.int64)

    @property
    def order(self) -> Float[np.ndarray, " r"]:
        """Place of each of the `readings` in the order of the points.

        The components of vectors err each by itself: one follows the other, far apart.
        """
        along = self.readings.inputs["along"]
        if self.direction is not None:
            return np.arange(float(len(along)))
        component = along.argmax(axis=1)
        place = 2.0 * len(self.position) * component
        for own in (component == axis for axis in range(3)):
            place[own] += np.arange(np.count_nonzero(own))
        return np.asarray(place)

    @property
    def readings(self) -> Readings:
        """One reading per number that was measured; see `readings_at` for the inputs."""
        count = len(self.position)
        if self.direction is None:
            rows, along = np.repeat(np.arange(count), 3), np.tile(np.eye(3), (count, 1))
        else:
            rows, along = np.arange(count), np.asarray(self.direction, float)
            with np.errstate(invalid="ignore", divide="ignore"):
                along = along / np.linalg.norm(along, axis=1)[:, None]
        place = readings_at(
            self.position[rows], along, self.tools[rows], self.runs[rows]
        )
        value = np.asarray(self.error, float).reshape(-1)
        good = np.isfinite(value)
        for values in place.inputs.values():
            good &= np.isfinite(values.reshape(len(values), -1)).all(axis=1)
        if not good.any():
            msg = "found no point with a position and an error"
            raise FitError(msg)
        return Readings(value, place.inputs).take(good)


def readings_at(
    position: Float[np.ndarray, "t 3"],
    along: Float[np.ndarray, "t 3"],
    tool: Float[np.ndarray, "t 3"],
    run: Int[np.ndarray, " t"],
) -> Readings:
    """Return readings of the value 0 with the inputs that volumetric effects know."""
    inputs = {
        "position": np.asarray(position, float),
        "along": along,
        "tool": tool,
        "run": run,
    }
    return Readings(np.zeros(len(along)), inputs)
