"""What changes over a recording of friction, or over its places, and no law of friction knows."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d

from ...friction import DriveSamples, FrictionFit
from ...job.result._result import Remark

_LOOKED_AT, _PARTS = 3_000, 10
"""Samples that are looked at, and stretches of the recording that are left out in turn."""
_BY_PLACE, _BY_TIME, _VARIES = 0.05, 0.1, 0.15
"""Shares of the friction from which on is told: a load that changes with the position, friction
that changes over the recording, and both that are not the same everywhere or all the time."""
_LATE, _SHIFTS, _BETTER, _STRETCH = 0.05, 20, 0.95, 30_000
"""Seconds by which a current may be late or early, how many are tried each way, and what it must
leave of the variance of how many readings: behind each reversal all friction is missing, and
twice."""
_OTHER, _ONE_HALF, _FEW = 0.1, 0.7, 20
"""Share of an inertia by which another one shows, the correlation that shows it, and windows."""
_ONE_SINE = 0.99
"""Correlation of acceleration and position from which on one stands for the other."""
_SURE = 3.0
"""Standard deviations from which on a change is one."""
_ROWS, _ALIKE = 10, 1e-11
"""Samples per column that tell a change; share of the largest eigenvalue of their sums that is
none: columns may be alike, as the law and the speed are."""


def changes(samples: DriveSamples, fit: FrictionFit, unit: str) -> Iterator[Remark]:
    """Yield what the current of a recording, in its unit, does beside the law that was found.

    Load and friction are parabolas over the place; over the time friction is a straight line, and
    the load a level in each third. What they change by depends on no single stretch of the
    recording: its deviation is that of the jackknife.
    """
    assert samples.position is not None  # of a recording
    inertia = fit.parameters.get("inertia", 0.0)
    friction, push = fit.friction(samples.velocity), inertia * samples.acceleration
    late = _late(samples, friction + push)
    way = np.sign(samples.velocity) * samples.in_motion
    starts = np.flatnonzero(np.diff(way, prepend=0.0) != 0.0)
    rows = np.flatnonzero(samples.in_motion)
    rows = rows[(rows + late >= 0) & (rows + late < len(samples.time))]
    rows = rows[:: -(-len(rows) // _LOOKED_AT)]
    speed, time = samples.velocity[rows], np.arange(1, len(rows) + 1) / len(rows)
    size = float(np.sqrt(np.mean(friction[rows] ** 2))) or 1.0
    law = friction[rows] / size  # all loads are in shares of the friction
    columns = [law * time, *(np.ceil(3.0 * time) == k for k in (1, 2, 3))]
    place = samples.position[rows]
    low, travel = float(place.min()), float(np.ptp(place))
    share = (place - low) / max(travel, 1e-9)
    columns += [share, share**2, law * share, law * share**2]
    # A filter of the current takes friction away behind a start, whatever comes late.
    began = samples.time[starts[np.searchsorted(starts, rows, "right") - 1]]
    columns.append(law * (samples.time[rows] - began < _LATE))
    # Where the far places were passed fast alone, the law has taken them for the speed: what
    # a speed shows beside it stands in columns of its own.
    columns += [law, np.sign(speed), speed / np.abs(speed).max()]
    current = samples.current[rows + late]
    # Not as a column: a noisy acceleration shows too small an inertia, and the place, which
    # goes with it where an axis goes to and fro, would take the rest.
    window = max(round(_LATE / samples.cycle), 1)
    quiet = uniform_filter1d(samples.acceleration, window)[rows]
    other = 0.0
    if fit.inertia is not None:
        left = samples.current - friction - push
        other = _other_inertia(samples, left, inertia, window)
    if other:
        yield Remark.warning(
            f"The recording shows an inertia of about {inertia + other:.3g} {unit} per"
            f" {samples.unit}/s², where the job states {inertia:.3g}: what it does not"
            " explain is taken for friction. Leave inertia out, or correct it."
        )
    current = current - (inertia + other) * samples.acceleration[rows]
    if travel > 0.0 and -np.corrcoef(quiet, place)[0, 1] > _ONE_SINE:
        yield Remark.info(
            "The axis went to and fro as a single sine, whose acceleration goes with the"
            " position: what a spring or a cable does is in the inertia. Record several"
            " speeds, or other ways, to tell them apart."
        )
    if len(rows) < _ROWS * len(columns):
        return
    # Sums of what the columns and the current have in common, less those of each stretch.
    known = np.stack([*columns, current / size], axis=1)
    sums = np.stack([part.T @ part for part in np.array_split(known, _PARTS)])
    sums = sums.sum(axis=0) - sums
    inverse = np.linalg.pinv(sums[:, :-1, :-1], rcond=_ALIKE, hermitian=True)
    factors = (inverse @ sums[:, :-1, -1:])[:, :, 0]

    def told(change: Float[np.ndarray, " p"]) -> float:
        """Return a change; 0 where it depends on the stretch that is left out."""
        spread = float(np.std(change)) * (_PARTS - 1) ** 0.5
        mean = float(np.mean(change))
        return mean if abs(mean) > _SURE * spread else 0.0

    grid = np.linspace(0.0, 1.0, 21)
    of_load, of_law = (factors[:, k : k + 2] @ [grid, grid**2] for k in (4, 6))
    change = told(np.ptp(of_load, axis=1))
    if change > _BY_PLACE:
        yield Remark.warning(
            f"The load changes by {change * size:.3g} {unit} over the positions"
            " driven, as a spring, a cable or a lever does: that is no friction, and the"
            " law, the inertia and what differs between the directions hold a part of"
            " it. Record on a short way to and fro."
        )
    least, most = (int(f(of_law.mean(axis=0))) for f in (np.argmin, np.argmax))
    change = told(of_law[:, most] - of_law[:, least])
    if change > _VARIES:
        yield Remark.warning(
            f"Friction is {change:.0%} larger about {low + travel * grid[most]:.4g}"
            f" {samples.unit} than about {low + travel * grid[least]:.4g}: a list knows"
            " no place and holds the mean. Look at lubrication, covers and the fit of the"
            " guides there."
        )
    change = told(factors[:, 0])
    if abs(change) > _BY_TIME:
        yield Remark.warning(
            f"Friction {'falls' if change < 0 else 'grows'} by {abs(change):.0%} over the"
            " recording, as it does while an axis warms: the list holds the mean. Run the"
            " axis warm first, and record it then."
        )
    change = told(np.ptp(factors[:, 1:4], axis=1))
    if change > _VARIES:
        yield Remark.warning(
            f"The constant load changes by {change * size:.3g} {unit} over the recording, as"
            " a workpiece, a clamp or a counterweight does: that is no friction, and the"
            " law holds a part of it. Record with one load."
        )


def _other_inertia(
    samples: DriveSamples, left: Float[np.ndarray, " t"], inertia: float, window: int
) -> float:
    """Return the inertia beside the known one in what is left of the current, or 0.

    By means over so many samples.
    """
    whole = uniform_filter1d(samples.in_motion.astype(float), window) > 0.999
    push, rest = (
        uniform_filter1d(x, window)[whole] for x in (samples.acceleration, left)
    )
    if len(push) < _FEW * window:
        return 0.0
    slope = float(np.cov(push, rest)[0, 1] / max(np.var(push, ddof=1), 1e-300))
    sure = abs(np.corrcoef(push, rest)[0, 1]) > _ONE_HALF
    return slope if sure and abs(slope) > _OTHER * abs(inertia) else 0.0


def _late(samples: DriveSamples, law: Float[np.ndarray, " t"]) -> int:
    """Return by how many samples the current comes later than the motion that it is of."""
    # Few readings stand behind a reversal: those of one stretch, and not one in so many.
    rows = np.flatnonzero(samples.in_motion)[:_STRETCH]
    most = round(_LATE / samples.cycle)
    step = max(1, most // _SHIFTS)
    rows = rows[(rows >= most) & (rows < len(samples.time) - most)]
    left = {
        shift: float(np.var(samples.current[rows + shift] - law[rows]))
        for shift in range(-(most // step) * step, most + 1, step)
        if rows.size
    }
    best = min(left, key=lambda shift: left[shift], default=0)
    return best if left and left[best] < _BETTER * left[0] else 0
