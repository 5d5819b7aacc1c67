"""Crosstalk: acceleration events in, tests of modes 1 to 3 out.

Read before: `_events` (accelerations cut out of a log, one value each), `_tests` (where the
tests stand, by events held out).
"""

import dataclasses
import functools
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import chdtrc, ndtri  # scipy.stats takes long to load

from .... import models
from ....models import LegacyCrosstalk, surface_through
from ...core import FitError, filled, one_blas_thread
from ...fit.joint import Crosstalk
from . import BRANCHES, SAFE_TESTS
from ._events import Events
from ._tests import TOUCHED, choose_tests, fitted, held_out

_CHANCE = 0.05
"""Probability under equal directions below which they differ."""
_SURE = 0.0027
"""Probability of three standard deviations, shared by all values that are looked at."""
_DIRECTED, _UNDIRECTED = (0, 1, 2, 3), (0, 0, 1, 1)
"""Values per branch: each its own, or both directions alike."""
_SAME = 1e-6
"""mm within which two tests stand at the same place."""


@dataclasses.dataclass(frozen=True)
class CrosstalkFit:
    """The crosstalk from a master to a slave; signs are those of the *error*.

    Attributes:
        effect: Its form, as of a joint fit: axes, tests, specified accelerations and rules.
        values: Error at the specified accelerations in mm, rows as `BRANCHES`; NaN where the
            readings do not tell it.
        standard_deviation: Of the values; inf where the readings do not tell it.
        support: Events that touch each value.
        noise: Standard deviation of one event of median weight in mm, per row of `BRANCHES`.
        events: All that were cut out; their positions are those of the adaptation axes.
        predicted: What values fitted to other events leave of each, in mm.
        converged: Whether the robust passes converged.
        active: The list that was active while measuring, to which this one adds; or None.
    """

    effect: Crosstalk
    values: Float[np.ndarray, "4 p"]
    standard_deviation: Float[np.ndarray, "4 p"]
    support: Int[np.ndarray, "4 p"]
    noise: Float[np.ndarray, "4"]
    events: Events
    predicted: Float[np.ndarray, " n"]
    converged: bool
    active: models.Crosstalk | None = None

    @property
    def complete(self) -> Bool[np.ndarray, " p"]:
        """Tests of which all four values are measured: only these can be written."""
        return np.asarray(np.isfinite(self.values).all(axis=0))

    @property
    def full(self) -> Float[np.ndarray, " n"]:
        """Size of the specified acceleration that each event is a part of, in mm/s²."""
        rates = np.array([self.effect.acceleration, -self.effect.deceleration])
        return np.asarray(rates[self.events.branch // 2])

    @property
    def significant(self) -> bool:
        """Whether any value is more than chance over all of them would show."""
        rows = slice(None) if self.effect.velocity_dependent else slice(0, 4, 2)
        value, spread = self.values[rows], self.standard_deviation[rows]
        finite = np.isfinite(value) & np.isfinite(spread)
        if not finite.any():
            return False
        limit = -float(ndtri(0.5 * _SURE / int(finite.sum())))
        return bool((np.abs(value[finite]) > limit * spread[finite]).any())

    @property
    def directed(self) -> bool:
        """Whether values differ by direction, by more than chance or as far as is known."""
        difference = self.values[::2] - self.values[1::2]
        spread = np.hypot(self.standard_deviation[::2], self.standard_deviation[1::2])
        finite = np.isfinite(difference)
        if not finite.any(axis=1).all():
            return True
        square = float(np.square(difference[finite] / spread[finite]).sum())
        return bool(chdtrc(int(finite.sum()), square) < _CHANCE)

    @property
    def kept(self) -> Bool[np.ndarray, " p"]:
        """Tests that are written: all four values measured, or known from the active list."""
        if self.active is None:
            return self.complete
        installed = np.asarray(self.active.surface.points)
        return np.asarray(self.complete | are_among(self.effect.points, installed))

    def compensation(self) -> models.Crosstalk | None:
        """Return the list that takes this error away, as the controller runs it.

        Without a filter, and with values of its own for each direction. None where no test
        is kept, or where those that are span no surface.
        """
        kept, effect, active = self.kept, self.effect, self.active
        if not kept.any():
            return None
        points = effect.points[kept]
        offset = np.where(self.complete, -self.values, 0.0)[:, kept]
        if active is not None:
            offset = offset + full_offsets(active, active, points)
        try:
            form = dataclasses.replace(
                effect, positions=points, velocity_dependent=True
            )
            return form.to_model(offset, float(effect.rules.crosstalk_sign))
        except FitError:
            return None


def are_among(
    points: Float[np.ndarray, "q k"], tests: Float[np.ndarray, "p k"]
) -> Bool[np.ndarray, " q"]:
    """Return which of these places are tests of another list."""
    distance = np.abs(points[:, None, :] - tests[None, :, :])
    return np.asarray((distance <= _SAME).all(axis=-1).any(axis=-1))


def full_offsets(
    model: models.Crosstalk | LegacyCrosstalk,
    by: models.Crosstalk,
    points: Float[np.ndarray, "p k"] | None = None,
) -> Float[np.ndarray, "4 p"]:
    """Return what a list adds at full acceleration at each place, by row of `BRANCHES`.

    Args:
        model: The list.
        by: A list that says what full acceleration is, and what is deceleration.
        points: Places of the adaptation axes in mm; left out: the tests of that list.
    """
    places = np.asarray(by.surface.points if points is None else points, dtype=float)
    count = len(places)
    velocity = np.repeat([1.0, -1.0, 1.0, -1.0], count)
    pull = np.repeat([float(by.acceleration), float(by.deceleration)], 2 * count)
    if by.by_speed:
        pull = pull * velocity
    offset = model.offset(pull, velocity, np.tile(places, (4, 1)))
    return np.asarray(offset).reshape(4, count)


@one_blas_thread()
def fit_crosstalk(
    events: Events,
    form: Crosstalk,
    adaptation: tuple[str, ...],
    *,
    mode: int | str = "auto",
    positions: Float[np.ndarray, "p k"] | None = None,
    velocity_dependent: bool | Literal["auto"] = "auto",
    most_tests: int = SAFE_TESTS,
    loss: str = "student",
) -> CrosstalkFit:
    """Fit the tests of a crosstalk list to acceleration events of a log.

    The values of events are the readings of a table over the adaptation axes, one per sign of
    the acceleration and direction.

    Args:
        events: Of a log.
        form: What is known of its form: axes, specified accelerations and rules.
        adaptation: Axes on which it may depend, as the columns of positions.
        mode: 1, 2 or 3 (number of adaptation axes + 1), or ``"auto"``: events held out choose.
        positions: Of the tests in mm, one column per adaptation axis (of the mode; of the
            readings where that is ``"auto"``); None = chosen from the events.
        velocity_dependent: Values of their own per direction; ``"auto"``: if they differ.
        most_tests: Tests at most, 1 to 15.
        loss: ``"student"``, ``"huber"`` or ``"gauss"``.

    Raises:
        FitError: If the arguments cannot be met.
    """
    if isinstance(velocity_dependent, str):
        fit = functools.partial(
            fit_crosstalk, events, form, adaptation, mode=mode, positions=positions,
            most_tests=most_tests, loss=loss,
        )  # fmt: skip
        directed = fit(velocity_dependent=True)
        return directed if directed.directed else fit(velocity_dependent=False)
    groups = _DIRECTED if velocity_dependent else _UNDIRECTED
    group = np.array(groups)[events.branch]
    if positions is not None:
        axes, points = tuple(range(positions.shape[1])), positions
    else:
        available = tuple(range(1, events.positions.shape[1] + 2))
        modes = (mode,) if isinstance(mode, int) else available
        axes, points = choose_tests(events, group, modes, most_tests)
    places = events.positions[:, list(axes)]
    try:
        stencil = surface_through(points).stencil(jnp.asarray(filled(places)))
    except ValueError as error:
        raise FitError(str(error)) from error
    columns = np.array(stencil.matrix())[: len(events)]
    shape = len(BRANCHES), len(points)
    values, deviation = np.full(shape, np.nan), np.full(shape, np.inf)
    support, noise = np.zeros(shape, np.int64), np.full(len(BRANCHES), np.nan)
    wild, converged = np.zeros(len(events), bool), True
    for number, members, result in fitted(events, group, columns, loss):
        rows = np.array(groups) == number
        wild[members] = result.wild
        converged &= result.converged
        counts = (columns[members][~result.wild] > TOUCHED).sum(axis=0)
        determined = ~result.undetermined & (counts > 0)
        values[rows] = np.where(determined, result.coefficients, np.nan)
        deviation[rows] = np.where(determined, result.standard_deviation, np.inf)
        support[rows], noise[rows] = np.where(determined, counts, 0), result.noise.white
    return CrosstalkFit(
        effect=dataclasses.replace(
            form,
            adaptation=tuple(adaptation[k] for k in axes),
            positions=points,
            velocity_dependent=velocity_dependent,
        ),
        values=values,
        standard_deviation=deviation,
        support=support,
        noise=noise,
        events=dataclasses.replace(events, positions=places, wild=wild),
        predicted=held_out(events, group, columns, np.arange(len(events)), wild),
        converged=converged,
    )
