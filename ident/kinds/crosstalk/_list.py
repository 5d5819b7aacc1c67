"""The crosstalk that an axis has, the list that a fit stands for, and what lists may do."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ....data.lists import ListFile
from ....models import Conventions, Crosstalk, LegacyCrosstalk, surface_through
from ...exchange import ExchangeError
from ...fit import FitError
from ...job._draft import AxisLists
from ...job._load import Job
from ...job._plan import was_active
from ...proof import GateCheck, GateLimits, gate_check, reversal_dynamics
from .effect import CrosstalkFit, CrosstalkReadings, cut_events
from .entries import crosstalk_from_list, crosstalk_masters, has_crosstalk
from .keys import Spec

_SAME = 1e-6
"""mm within which two tests stand at the same place."""
SHORT = ("accelerating +", "accelerating −", "decelerating +", "decelerating −")
"""Words for the rows of `Crosstalk.values`: what the master does, and its direction."""
_STEPS = 60
"""Places along each adaptation axis at which the surface is looked at."""


@dataclasses.dataclass(frozen=True)
class Existing:
    """Crosstalk of the list that is there.

    Attributes:
        model: As the controller runs it; None: there is none, or none that can be read.
        masters: Logical numbers: the axis that accelerates, then adaptation axes.
        unread: Why it cannot be read, or nothing.
        active: The same where it was active while measuring.
    """

    model: Crosstalk | LegacyCrosstalk | None = None
    masters: tuple[int, ...] = ()
    unread: str = ""
    active: Crosstalk | None = None


def read_existing(listing: ListFile | None, rules: Conventions) -> Existing:
    """Return the crosstalk of a list."""
    if listing is None or not has_crosstalk(listing):
        return Existing()
    try:
        model = crosstalk_from_list(listing, rules)
        return Existing(model, crosstalk_masters(listing))
    except ExchangeError as error:
        return Existing(unread=str(error))


def existing_crosstalk(job: Job, index: int, fit: Spec, lists: AxisLists) -> Existing:
    """Return the crosstalk of the list that is there, and whether it was active.

    Raises:
        JobError: If it was, and cannot be added to.
    """
    found = read_existing(lists.compensation, job.conventions)
    holder = None
    if found.model is not None or found.unread:
        holder = job.spec.axes[fit.axis].listing
    if not was_active(job, index, fit, holder):
        return found
    where, axes = ("fits", index), job.spec.axes
    if found.model is None:
        raise job.error(
            ("axes", fit.axis, "list"),
            "crosstalk was active while measuring, but no list with its tests is given"
            f"{f' ({found.unread})' if found.unread else ''}, expected list = the file"
            " that was loaded",
        )
    if not isinstance(found.model, Crosstalk):
        raise job.error(
            where,
            "crosstalk was active by a list of the older form, to which no tests can be"
            " added, expected a measurement with COMP OFF CROSSTALK",
        )
    named = tuple(axes[name].number for name in (fit.master, *fit.adapts_to))
    if named != found.masters:
        raise job.error(
            where,
            f"found master and adaptation axes {list(named)}, expected"
            f" {list(found.masters)} as in the list that was active",
        )
    rates = zip(("acceleration", "deceleration"), rates_of(found.model), strict=True)
    for key, own in rates:
        given = getattr(fit, key)
        if given is not None and given != own:
            reason = f"found {given:g}, expected {own:g} as in the list that was active"
            raise job.error((*where, key), reason)
    return dataclasses.replace(found, active=found.model)


def are_among(
    points: Float[np.ndarray, "q k"], others: Float[np.ndarray, "p k"]
) -> Bool[np.ndarray, " q"]:
    """Return which of these places are tests of another list."""
    apart = np.abs(points[:, None, :] - others[None, :, :])
    return np.asarray((apart <= _SAME).all(axis=-1).any(axis=-1))


def wished_points(
    model: Crosstalk, wished: Float[np.ndarray, "q k"] | None
) -> Float[np.ndarray, "q k"]:
    """Return the tests of the list that follows an active one: its own, or more.

    Raises:
        FitError: If the wished ones lack one of these.
    """
    own = np.asarray(model.surface.points, dtype=float)
    if wished is None:
        return own
    if wished.shape[1] == own.shape[1] and are_among(own, wished).all():
        return wished
    msg = (
        "positions: found others than the tests of the list that was active while"
        " measuring, expected those and, if you like, more."
    )
    raise FitError(msg)


def kept_tests(fit: CrosstalkFit, active: Crosstalk | None) -> Bool[np.ndarray, " p"]:
    """Return which tests are written: all four values measured, or known from before.

    Args:
        fit: The estimate.
        active: The list that was active while measuring: its tests keep what they hold
            where nothing was measured.
    """
    if active is None:
        return fit.complete
    own = np.asarray(active.surface.points, dtype=float)
    return np.asarray(fit.complete | are_among(fit.points, own))


def list_model(
    fit: CrosstalkFit, active: Crosstalk | None, rules: Conventions
) -> Crosstalk:
    """Return the list of the kept tests as the controller runs it, without a filter."""
    kept = kept_tests(fit, active)
    points = fit.points[kept]
    offset = np.where(fit.complete, -fit.values, 0.0)[:, kept]
    if active is not None:
        rates = fit.acceleration, fit.deceleration
        offset = offset + four_offsets(active, rates, active.by_speed, points)
    return Crosstalk(
        surface_through(points),
        jnp.asarray(rules.crosstalk_sign * offset),
        jnp.asarray(fit.acceleration),
        jnp.asarray(fit.deceleration),
        velocity_dependent=True,
        **rules.of_crosstalk,
    )


def coverage_of(
    model: Crosstalk, workspace: Float[np.ndarray, "k 2"], resolution: int = 41
) -> float:
    """Return the share of a workspace that lies among the tests, 0 to 1.

    Args:
        model: The list.
        workspace: From where to where each adaptation axis goes, in mm.
        resolution: Places looked at along each axis.
    """
    if not len(workspace):
        return 1.0
    lines = [np.linspace(low, high, resolution) for low, high in workspace]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    return float(np.mean(np.asarray(model.covers(grid.reshape(-1, len(lines))))))


def four_offsets(
    model: Crosstalk | LegacyCrosstalk,
    rates: tuple[float, float],
    by_speed: bool,
    points: Float[np.ndarray, "p k"],
) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at each place, by row of the entries.

    Args:
        model: The list.
        rates: Specified acceleration and deceleration in mm/s².
        by_speed: Rule by which the controller tells one from the other.
        points: Places of the adaptation axes in mm.
    """
    velocity = np.array([1.0, -1.0, 1.0, -1.0])
    pull = np.repeat(rates, 2) * (velocity if by_speed else 1.0)
    every = np.tile(points, (4, 1))
    count = len(points)
    added = model.offset(np.repeat(pull, count), np.repeat(velocity, count), every)
    return np.asarray(added).reshape(4, count)


def rates_of(model: Crosstalk) -> tuple[float, float]:
    """Return specified acceleration and deceleration of a list in mm/s²."""
    return float(model.acceleration), float(model.deceleration)


def full_offsets(model: Crosstalk) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at its tests, by row of the entries."""
    points = np.asarray(model.surface.points, dtype=float)
    return four_offsets(model, rates_of(model), model.by_speed, points)


def reversal_jumps(
    four: Float[np.ndarray, "4 p"], by_speed: bool
) -> Float[np.ndarray, "2 p"]:
    """Return how far the value jumps where the master turns under full acceleration."""
    # A turn keeps the sign of the acceleration and changes the direction.
    pairs = ((0, 3), (2, 1)) if by_speed else ((0, 1), (2, 3))
    return np.stack([np.abs(four[a] - four[b]) for a, b in pairs])


def largest_jump(four: Float[np.ndarray, "4 p"], by_speed: bool) -> float:
    """Return the largest jump in mm when the master's acceleration steps at will."""
    braking = np.abs(four[[0, 1]] - four[[2, 3]])
    sizes = [np.abs(four), braking, reversal_jumps(four, by_speed)]
    return max(float(each.max(initial=0.0)) for each in sizes)


def events_under(
    readings: CrosstalkReadings,
    added: Float[np.ndarray, " t"],
    acceleration: float,
    deceleration: float,
    rules: Conventions,
) -> Float[np.ndarray, " n"]:
    """Return the value of every event in mm where a list adds this to the slave."""
    left = CrosstalkReadings(
        readings.time, readings.acceleration, readings.velocity,
        readings.error + added, readings.positions,
    )  # fmt: skip
    events = cut_events(left, acceleration, deceleration, conventions=rules)
    return np.array([event.value for event in events])


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
    places = grid.reshape(-1, len(names))
    four = four_offsets(model, rates_of(model), model.by_speed, places)
    four = four.reshape(4, *grid.shape[:-1])
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
