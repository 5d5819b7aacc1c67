"""What a crosstalk list may do to the slave before it is let out."""

from collections.abc import Sequence

import numpy as np

from ....models import Crosstalk
from ...proof import GateCheck, GateLimits, gate_check, reversal_dynamics
from ._quadrants import SHORT, four_offsets, full_offsets, largest_jump, reversal_jumps

_STEPS = 60
"""Places along each adaptation axis at which the surface is looked at."""


def judge_crosstalk(
    model: Crosstalk,
    names: Sequence[str],
    cycle_time: float,
    limits: GateLimits,
    change: np.ndarray | None,
) -> tuple[GateCheck, ...]:
    """Return every line of the gate.

    Args:
        model: As it is written.
        names: Of its adaptation axes.
        cycle_time: In s.
        limits: Of the job.
        change: Against the list that was there, by entry, in mm; None = not known.
    """
    points = np.asarray(model.surface.points)
    full = full_offsets(model)
    row, test = divmod(int(np.argmax(np.abs(full))), full.shape[1])
    where = f"{SHORT[row]}{_at(names, points[test])}"
    checks = [
        gate_check(
            "max_correction", abs(full[row, test]), limits.max_correction, "mm", where
        )
    ]
    turns = reversal_jumps(full, model.by_speed)
    test = int(np.argmax(turns.max(axis=0)))
    where = f"where the master turns under full acceleration{_at(names, points[test])}"
    checks.append(
        gate_check("max_reversal", turns.max(), limits.max_reversal, "mm", where)
    )
    jump = largest_jump(full, model.by_speed)
    fast, hard = reversal_dynamics(jump, model.cycles, cycle_time)
    where = (
        f"if the acceleration of the master steps, spread over {model.cycles} cycles"
    )
    checks += [
        gate_check("max_velocity", fast, limits.max_velocity, "mm/s", where),
        gate_check("max_acceleration", hard, limits.max_acceleration, "mm/s²", where),
    ]
    if names:
        checks += _along(model, names, points, limits)
    if change is not None and limits.max_change is not None:
        value = float(np.max(np.abs(change)))
        words = "against the list that was there"
        checks.append(gate_check("max_change", value, limits.max_change, "mm", words))
    return tuple(checks)


def _along(
    model: Crosstalk, names: Sequence[str], points: np.ndarray, limits: GateLimits
) -> list[GateCheck]:
    """Return what moving along the adaptation axes under full acceleration does."""
    lines = [
        np.linspace(low, high, _STEPS + 1)
        for low, high in zip(points.min(axis=0), points.max(axis=0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    four = four_offsets(
        model, float(model.acceleration), float(model.deceleration), model.by_speed,
        grid.reshape(-1, len(names)),
    ).reshape(4, *grid.shape[:-1])  # fmt: skip
    steepest, along = 0.0, names[0]
    for axis, (name, line) in enumerate(zip(names, lines, strict=True), start=1):
        step = float(line[1] - line[0])
        if step > 0:
            slope = float(np.max(np.abs(np.diff(four, axis=axis)))) / step
            steepest, along = max((steepest, along), (slope, name))
    where = f"along {along} under full acceleration"
    added = steepest * limits.feed / 60.0
    return [
        gate_check("max_slope", 1e3 * steepest, limits.max_slope, "µm/mm", where),
        gate_check(
            "max_velocity by position", added, limits.max_velocity, "mm/s", where
        ),
    ]


def _at(names: Sequence[str], place: np.ndarray) -> str:
    words = [f"{name} = {value:g}" for name, value in zip(names, place, strict=True)]
    return f" at {', '.join(words)}" if words else ""
