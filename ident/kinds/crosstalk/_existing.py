"""The crosstalk that an axis has already, and the list that a fit stands for."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ....data.lists import ListFile
from ....models import Conventions, Crosstalk, LegacyCrosstalk, surface_through
from ...exchange import (
    ExchangeError,
    crosstalk_from_list,
    crosstalk_masters,
    has_crosstalk,
)
from ...fit import FitError
from ...job._draft import AxisLists
from ...job._load import Job
from ...job._plan import was_active
from ._gate import four_offsets, rates_of
from .effect import CrosstalkFit
from .keys import Spec

_SAME = 1e-6
"""mm within which two tests stand at the same place."""


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
