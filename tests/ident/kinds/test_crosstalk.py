"""Planted crosstalk comes back from acceleration events cut out of a log."""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.data.signals import filtered_motion
from axcomp.ident.fit import FitError
from axcomp.ident.fit.joint import Crosstalk, JointData
from axcomp.ident.kinds.crosstalk._events import cut_events, specified
from axcomp.ident.kinds.crosstalk._tests import columns_of
from axcomp.ident.kinds.crosstalk.effect import CrosstalkFit, fit_crosstalk
from axcomp.models import Conventions, surface_through

FULL = 2000.0  # mm/s²
CYCLE = 0.004  # s
NOISE = 5e-4  # mm
BY_QUADRANT = np.array([0.010, 0.012, -0.011, -0.009])  # mm at full acceleration
BOTH_WAYS = np.array([0.010, 0.010, -0.011, -0.011])

Law = Callable[[np.ndarray, np.ndarray], np.ndarray]


def mode_1(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Error in mm at full acceleration, per branch and place."""
    return np.asarray(BY_QUADRANT[branch] + 0.0 * places[:, 0])


def alike(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
    return np.asarray(BOTH_WAYS[branch] + 0.0 * places[:, 0])


def mode_2(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
    bend = np.interp(places[:, 1], [0.0, 200.0, 400.0], [0.0, 0.8, 0.3])
    return np.asarray(BY_QUADRANT[branch] * (1.0 + bend))


def mode_3(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
    along = places[:, 0] / 400.0
    bend = np.interp(places[:, 1], [0.0, 200.0, 400.0], [0.0, 1.0, 0.2])
    return np.asarray(BY_QUADRANT[branch] * (1.0 + 0.6 * along * bend))


def log(
    seed: int,
    law: Law,
    *,
    moves: int = 60,
    at: np.ndarray | None = None,
    ways: tuple[int, ...] = (1, -1),
    noise: float = NOISE,
) -> JointData:
    """Moves of the master X to and fro, at random places of A and B or given ones.

    The slave drifts and bends besides: that is no crosstalk.
    """
    rng = np.random.default_rng(seed)
    pieces, places = [], []
    for move in range(moves):
        place = rng.uniform(0.0, 400.0, 2) if at is None else at[move % len(at)]
        for way in ways:
            rows = int(rng.integers(20, 35))
            push = way * FULL * rng.uniform(0.6, 1.0) * np.ones(rows)
            still, cruise = np.zeros(30), np.zeros(20)
            pieces.append(np.concatenate([still, push, cruise, -push, still]))
            places.append(np.tile(place, (len(pieces[-1]), 1)))
    acceleration, positions = np.concatenate(pieces), np.concatenate(places)
    velocity = CYCLE * np.cumsum(acceleration)
    velocity[np.abs(velocity) < 1e-6] = 0.0
    time = CYCLE * np.arange(len(acceleration))
    branch = 2 * (acceleration < 0) + (velocity < 0)
    error = np.abs(acceleration) / FULL * law(branch, positions)
    error += 0.01 * np.sin(time / 20.0) + 0.003 * np.sin(positions[:, 0] / 60.0)
    error += noise * rng.normal(size=len(time))
    over = dict(zip("AB", positions.T, strict=True))
    return recorded(time, acceleration, velocity, error, over)


def recorded(
    time: np.ndarray,
    acceleration: np.ndarray,
    velocity: np.ndarray,
    error: np.ndarray,
    over: dict[str, np.ndarray],
) -> JointData:
    """A log of the error of Z and the motion of X."""
    x, y = {"X": velocity}, {"X": acceleration}
    return JointData(over, {"Z": error}, velocity=x, acceleration=y, time=time)


def over(readings: JointData, *names: str) -> JointData:
    """The log with the positions of some axes only."""
    places = {name: readings.position[name] for name in names}
    return dataclasses.replace(readings, position=places)


FORM = Crosstalk("Z", "X", FULL, -FULL)


def fitted(
    readings: JointData,
    acceleration: float | None = FULL,
    deceleration: float | None = -FULL,
    conventions: Conventions | None = None,
    **options: Any,
) -> CrosstalkFit:
    """The crosstalk of Z from X, over A and B where these were recorded."""
    rates = specified(readings.acceleration["X"], acceleration, deceleration)
    form = Crosstalk("Z", "X", *rates, conventions=conventions)
    names = tuple(readings.position)
    return fit_crosstalk(cut_events(readings, form, names), form, names, **options)


def truth_at(law: Law, points: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
    places = np.zeros((len(points), 2))
    places[:, list(axes)] = points
    return np.array([law(np.full(len(points), row), places) for row in range(4)])


@pytest.mark.parametrize(
    ("law", "mode", "axes"),
    [(mode_1, 1, ()), (mode_2, 2, (1,)), (mode_3, 3, (0, 1))],
)
def test_events_held_out_choose_the_mode_and_the_axes(
    law: Law, mode: int, axes: tuple[int, ...]
) -> None:
    fit = fitted(log(1, law))
    assert fit.effect.mode == mode
    assert fit.effect.adaptation == tuple("AB"[axis] for axis in axes)
    assert fit.complete.all()
    assert fit.effect.velocity_dependent
    assert 1 <= len(fit.effect.points) <= 14
    truth = truth_at(law, fit.effect.points, axes)
    # 60 events per row of 0.12 µm scatter: 0.1 µm at a test; and what a bilinear cell leaves
    # of the planted surface where a test stands beside its bend.
    np.testing.assert_allclose(fit.values, truth, atol=6e-4)


def test_planted_values_lie_within_the_stated_deviations_at_the_right_rate() -> None:
    distances = []
    for seed in range(8):
        readings = over(log(seed, mode_1, moves=12))
        fit = fitted(
            readings,
            mode=1,
            velocity_dependent=True,
        )
        values = fit.values[:, 0]
        distances += list((values - BY_QUADRANT) / fit.standard_deviation[:, 0])
    # 95 % of 32 within two deviations; 6 misses have a chance below 1 %.
    assert (np.abs(distances) < 2.0).mean() > 0.82
    assert (np.abs(distances) < 1.0).mean() < 0.9  # and not because they are too wide


@pytest.mark.heavy
def test_deviations_over_a_polygon_hold_too() -> None:
    distances = []
    for seed in range(7):
        fit = fitted(
            log(seed, mode_2, moves=40),
            positions=np.array([[0.0, 0.0], [400.0, 0.0], [0.0, 200.0], [400.0, 200.0],
                                [0.0, 400.0], [400.0, 400.0]]),
            velocity_dependent=True,
        )  # fmt: skip
        truth = truth_at(mode_2, fit.effect.points, (0, 1))
        distances += list(((fit.values - truth) / fit.standard_deviation).ravel())
    # 168 values; a rate of 95 % is seen as more than 90 %.
    assert (np.abs(distances) < 2.0).mean() > 0.9
    assert (np.abs(distances) < 1.0).mean() < 0.85


def test_over_one_axis_three_tests_are_chosen_where_two_would_do() -> None:
    def straight(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
        return np.asarray(BY_QUADRANT[branch] * (1.0 + places[:, 1] / 400.0))

    fit = fitted(log(11, straight))
    # One statement of the manuals has three in mode 2, and the check warns of others.
    assert (fit.effect.mode, len(fit.effect.points)) == (2, 3)


def test_places_that_recur_are_those_of_the_tests() -> None:
    def along(branch: np.ndarray, places: np.ndarray) -> np.ndarray:
        return np.asarray(BOTH_WAYS[branch] * (1.0 + places[:, 1] / 800.0))

    at = np.array([[0.0, 0.0], [0.0, 200.0], [0.0, 400.0]])
    for seed in range(6):
        fit = fitted(over(log(seed, along, moves=12, at=at), "B"))
        np.testing.assert_array_equal(fit.effect.points, at[:, 1:])
        truth = truth_at(along, fit.effect.points, (1,))
        # 4 or 8 events of 0.12 µm scatter at a test, 72 values: 4 deviations.
        np.testing.assert_allclose(fit.values, truth, atol=4 * 1.2e-4 / 2.0)


@pytest.mark.parametrize(("law", "apart"), [(mode_1, True), (alike, False)])
def test_directions_get_values_of_their_own_only_where_they_differ(
    law: Law, apart: bool
) -> None:
    fit = fitted(over(log(2, law)))
    assert fit.effect.velocity_dependent is apart
    if not apart:
        np.testing.assert_array_equal(fit.values[0], fit.values[1])
        np.testing.assert_array_equal(fit.values[2], fit.values[3])


def test_one_event_of_a_kind_bears_no_tests_along_an_axis() -> None:
    readings = log(11, mode_1, moves=2)
    last = slice(*(int(each[-1]) for each in cut_rows(readings)))
    error = readings.error["Z"].copy()
    error[last] = np.nan
    fit = fitted(dataclasses.replace(readings, error={"Z": error}))
    assert fit.effect.mode == 1
    assert sorted(np.bincount(fit.events.branch)) == [1, 2, 2, 2]


def test_an_axis_that_stands_still_is_none_to_adapt_to() -> None:
    # What an encoder shows of an axis that is clamped, 0.1 µm.
    readings = log(1, mode_1, at=np.array([[100.0, 0.0], [100.0, 400.0]]))
    place = readings.position["A"] + 1e-4 * np.random.default_rng(0).normal(
        size=len(readings)
    )
    with pytest.raises(FitError, match="do not spread over the adaptation axes"):
        fitted(dataclasses.replace(readings, position={"A": place}), mode=2)


@pytest.mark.parametrize("places", [[50.0, 350.0], [20.0, 60.0, 350.0]])
@pytest.mark.parametrize("mode", ["auto", 2])
def test_tests_stand_where_the_adaptation_axis_stood(
    places: list[float], mode: int | str
) -> None:
    stops = np.column_stack([np.zeros(len(places)), places])
    readings = over(log(1, mode_2, at=stops), "B")
    # What a drive shows at standstill, 1 µm.
    scatter = 1e-3 * np.random.default_rng(0).normal(size=len(readings))
    at = {"B": readings.position["B"] + scatter}
    fit = fitted(dataclasses.replace(readings, position=at), mode=mode)
    # The mean of 20 and more events of 20 readings each, to 0.01 mm.
    np.testing.assert_array_equal(fit.effect.points[:, 0], places)
    assert fit.complete.all()
    truth = truth_at(mode_2, fit.effect.points, (1,))
    # 30 events of 0.25 µm per value.
    np.testing.assert_allclose(fit.values, truth, atol=4e-4)


def test_no_test_stands_where_one_kind_of_event_never_took_place() -> None:
    places = np.array([[0.0, 50.0], [0.0, 50.0], [0.0, 350.0], [0.0, 350.0]])
    readings = over(log(1, mode_2, at=places), "B")
    _, stop = cut_rows(readings)
    # The first stroke begins at 200 mm; no other event does.
    place = readings.position["B"].copy()
    place[: int(stop[0]) + 5] = 200.0
    fit = fitted(dataclasses.replace(readings, position={"B": place}), mode=2)
    assert fit.effect.points[:, 0].tolist() == [50.0, 350.0]
    assert fit.complete.all()


def cut_rows(readings: JointData) -> tuple[np.ndarray, np.ndarray]:
    """Rows in which events begin and end."""
    events = cut_events(readings, FORM)
    return events.start, events.stop


def test_every_event_is_shown_with_its_place_sign_and_direction() -> None:
    readings = log(3, mode_2, moves=5)
    events = cut_events(readings, FORM, ("A", "B"))
    assert events.branch.tolist() == [0, 2, 3, 1] * 5
    for start, stop in zip(events.start, events.stop, strict=True):
        assert (np.abs(readings.acceleration["X"][start:stop]) > 0).all()
    places = np.stack(list(readings.position.values()), axis=1)[events.start]
    np.testing.assert_allclose(events.positions, places)
    # 20 to 35 rows of 0.5 µm against as many beside them, at 60 % of the acceleration.
    assert (np.abs(events.value - mode_2(events.branch, places)) < 1e-3).all()
    assert (events.peak * np.where(events.branch < 2, 1, -1) > 0).all()


@pytest.mark.parametrize(("rows", "noise"), [(9, 0.0), (9, 0.2), (15, 0.2)])
def test_a_filtered_acceleration_shows_as_many_events_as_took_place(
    rows: int, noise: float
) -> None:
    readings = over(log(3, mode_1, moves=18))
    # A filter smears every acceleration over the standstill beside it, where the
    # velocity is 0 or, differentiated from a position, its own noise in mm/s.
    window = np.hanning(rows + 2)[1:-1]
    smeared = np.convolve(readings.acceleration["X"], window / window.sum(), "same")
    velocity = readings.velocity["X"] + noise * np.random.default_rng(0).normal(
        size=len(smeared)
    )
    filtered = dataclasses.replace(
        readings, acceleration={"X": smeared}, velocity={"X": velocity}
    )
    events = cut_events(filtered, FORM)
    assert events.branch.tolist() == [0, 2, 3, 1] * 18
    value, truth = events.value, BY_QUADRANT[events.branch]
    # 0.35 µm per event with its edges; one counted as an event was off by 13 µm.
    assert np.abs(value - truth).max() < 1.2e-3
    # All together are right: least squares through smeared edges made them 2.4 % and 4.7 %
    # too large. Their noise is 0.2 %, and a row at rest takes the entry of the other way.
    assert value @ truth / (truth @ truth) == pytest.approx(1.0, abs=7e-3)


def test_an_acceleration_derived_from_positions_makes_no_value_larger() -> None:
    push, still = np.full(50, FULL), np.zeros(150)
    acceleration = np.tile(np.concatenate([still, push, still, -push]), 6)
    time = 1e-3 * np.arange(len(acceleration))
    motion = filtered_motion(time, 1e-6 * np.cumsum(np.cumsum(acceleration)))
    # Derived from sums to the left, it comes one sample early.
    error = np.roll(acceleration, -1) / FULL * 0.03
    error += 1e-4 * np.random.default_rng(0).normal(size=len(time))
    events = cut_events(
        recorded(time, motion.acceleration, motion.velocity, error, {}), FORM
    )
    sign = np.where(events.branch < 2, 1.0, -1.0)
    # What rings for longer than half an event is 0.04 %, noise 0.02 %. With edges left out
    # as wild the mean was 0.3 % too large, without the ringing 0.7 % too small.
    assert float(np.mean(events.value * sign)) == pytest.approx(0.03, rel=1e-3)


def test_a_turn_under_one_acceleration_is_an_event_in_each_direction() -> None:
    time = CYCLE * np.arange(300)
    acceleration = np.where((time > 0.3) & (time < 0.9), FULL, 0.0)
    velocity = np.clip(FULL * (time - 0.6), -600.0, 600.0)
    branch = 2 * (acceleration < 0) + (velocity < 0)
    error = acceleration / FULL * BY_QUADRANT[branch]
    error += 1e-5 * np.random.default_rng(0).normal(size=300)
    events = cut_events(recorded(time, acceleration, velocity, error, {}), FORM)
    assert events.branch.tolist() == [1, 0]
    # 70 rows of 0.01 µm each against a level: a few nm.
    assert events.value[0] == pytest.approx(BY_QUADRANT[1], abs=2e-5)
    assert events.value[1] == pytest.approx(BY_QUADRANT[0], abs=2e-5)


def test_the_list_that_the_fit_stands_for_takes_the_error_away() -> None:
    readings = log(4, mode_3)
    fit = fitted(readings)
    model = fit.compensation()
    assert model is not None
    offset = model.offset(
        readings.acceleration["X"],
        readings.velocity["X"],
        np.stack([readings.position[name] for name in fit.effect.adaptation], axis=1),
    )
    error = {"Z": readings.error["Z"] + np.asarray(offset)}
    left = dataclasses.replace(readings, error=error)
    before, after = (cut_events(each, FORM).value for each in (readings, left))
    # What is left is the noise of the events, 0.15 µm, and a little of the surface.
    assert np.sqrt(np.mean(after**2)) < 0.05 * np.sqrt(np.mean(before**2))


def test_the_sign_of_the_entries_follows_the_convention() -> None:
    readings = over(log(4, mode_1, moves=12))
    plain = fitted(readings).compensation()
    turned = fitted(readings, conventions=Conventions(crosstalk_sign=-1)).compensation()
    assert plain is not None
    assert turned is not None
    np.testing.assert_array_equal(np.asarray(plain.values), -np.asarray(turned.values))
    a, v = np.array([1500.0, -1500.0]), np.array([10.0, 10.0])
    np.testing.assert_array_equal(
        np.asarray(plain.offset(a, v)), np.asarray(turned.offset(a, v))
    )


def test_accelerating_by_speed_sorts_events_by_whether_the_master_gets_faster() -> None:
    rules = Conventions(crosstalk_accelerate="speed")
    events = cut_events(
        log(3, mode_2, moves=2), dataclasses.replace(FORM, conventions=rules)
    )
    # To: faster, slower; fro: faster, slower, both in negative direction.
    assert events.branch.tolist() == [0, 2, 1, 3] * 2


def test_a_master_that_moves_one_way_only_leaves_the_other_unknown() -> None:
    readings = over(log(5, mode_1, ways=(1,)))
    fit = fitted(readings)
    assert not fit.complete.all()
    assert fit.compensation() is None
    assert np.isnan(fit.values[1]).all()
    assert np.isinf(fit.standard_deviation[1]).all()
    np.testing.assert_allclose(fit.values[0], BY_QUADRANT[0], atol=3e-4)


def test_one_way_is_enough_where_directions_are_taken_as_alike() -> None:
    readings = over(log(5, alike, ways=(1,)))
    fit = fitted(readings, velocity_dependent=False)
    assert fit.complete.all()


def test_a_test_without_events_is_left_out_whole() -> None:
    readings = log(6, mode_2, at=np.array([[0.0, 0.0], [0.0, 100.0], [0.0, 200.0]]))
    places = over(readings, "B")
    fit = fitted(
        places,
        positions=np.array([[0.0], [100.0], [200.0], [300.0]]),
    )
    assert fit.complete.tolist() == [True, True, True, False]
    assert not fit.complete.all()
    model = fit.compensation()
    assert model is not None
    assert model.values.shape == (4, 3)


def test_single_acceleration_tests_become_entries_as_they_are() -> None:
    at = np.array([[0.0, 0.0], [400.0, 50.0], [200.0, 400.0]])
    fit = fitted(
        log(7, mode_3, moves=3, at=at),
        positions=at,
        velocity_dependent=True,
    )
    assert fit.effect.mode == 3
    assert (fit.support == 1).all()
    truth = truth_at(mode_3, at, (0, 1))
    # One event each, of 0.2 to 0.3 µm; four of them.
    np.testing.assert_allclose(fit.values, truth, atol=1.2e-3)
    assert np.isfinite(fit.standard_deviation).all()
    assert 5e-5 < np.median(fit.standard_deviation) < 5e-4


def test_a_wild_event_is_named_and_moves_nothing() -> None:
    readings = over(log(8, mode_1))
    events = cut_events(readings, FORM)
    error = readings.error["Z"].copy()
    error[events.start[20] : events.stop[20]] += 0.2
    fit = fitted(dataclasses.replace(readings, error={"Z": error}))
    assert np.flatnonzero(fit.events.wild)[0] == 20
    np.testing.assert_allclose(fit.values[:, 0], BY_QUADRANT, atol=3e-4)


def test_single_wild_readings_do_not_spoil_the_events_that_they_lie_in() -> None:
    readings, rng = over(log(8, mode_1, moves=20)), np.random.default_rng(0)
    error = readings.error["Z"].copy()
    wild = rng.random(len(error)) < 0.01
    error[wild] += rng.uniform(-1.0, 1.0, wild.sum())
    fit = fitted(dataclasses.replace(readings, error={"Z": error}))
    sound = fitted(readings)
    # 1 % of the readings fewer: a tenth of σ; spoiled events were off by 1 µm.
    assert np.abs(fit.values - sound.values).max() < 5e-5
    assert np.max(fit.standard_deviation / sound.standard_deviation) < 1.5
    # Of those in and beside events, some twice, all but the few of less than 3 µm.
    assert fit.events.left_out.sum() == pytest.approx(wild.sum(), rel=0.3)
    assert sound.events.left_out.sum() == 0


def test_the_events_are_the_same_whatever_the_slave_does() -> None:
    readings = over(log(1, alike, moves=12, noise=1e-7), "A", "B")
    counts = []
    for seed in range(4):
        rng, error = np.random.default_rng(seed), readings.error["Z"].copy()
        # Wild readings in half of all rows: what is left of some events tells nothing.
        wild = rng.random(len(error)) < 0.5
        error[wild] += rng.uniform(-0.5, 0.5, int(wild.sum()))
        spoiled = dataclasses.replace(readings, error={"Z": error})
        counts.append(len(cut_events(spoiled, FORM, ("A", "B"))))
    assert set(counts) == {len(cut_events(readings, FORM, ("A", "B")))}


def test_missed_readings_of_the_slave_are_left_out() -> None:
    readings = over(log(9, mode_1))
    error = readings.error["Z"].copy()
    error[np.random.default_rng(0).random(len(error)) < 0.2] = np.nan
    fit = fitted(dataclasses.replace(readings, error={"Z": error}))
    np.testing.assert_allclose(fit.values[:, 0], BY_QUADRANT, atol=3e-4)


def test_accelerations_are_taken_as_measured_where_none_are_given() -> None:
    readings = over(log(10, mode_1))
    fit = fitted(readings, None, None)
    # Moves at 60 to 100 % of 2000 mm/s².
    assert 1200.0 < fit.effect.acceleration < 2000.0
    assert -2000.0 < fit.effect.deceleration < -1200.0
    assert fit.effect.acceleration == round(fit.effect.acceleration)


def test_columns_of_the_search_are_those_of_the_controller() -> None:
    rng = np.random.default_rng(0)
    nodes = (np.array([0.0, 150.0, 400.0]), np.array([-50.0, 80.0]))
    places = rng.uniform(-100.0, 500.0, (40, 2))
    points = np.array(list(itertools.product(*nodes)))
    stencil = surface_through(points).stencil(jnp.asarray(places))
    # Two ways of writing the same few products.
    np.testing.assert_allclose(
        columns_of(places, (0, 1), nodes), stencil.matrix(), atol=1e-12
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": 3}, "mode 3 cannot be fitted: the events do not spread"),
        ({"positions": np.zeros((2, 1))}, "stand at the same place"),
        ({"acceleration": 1e5, "deceleration": -1e5}, "no acceleration of the master"),
    ],
)
def test_what_cannot_be_meant_is_refused(options: dict[str, Any], message: str) -> None:
    readings = log(11, mode_1, moves=4)
    one = over(readings, "A")
    with pytest.raises(FitError, match=message):
        fitted(one, **options)


def test_a_master_that_never_brakes_is_refused() -> None:
    count = 50
    readings = recorded(
        np.arange(50.0), np.full(count, 100.0), np.ones(count), np.zeros(count), {}
    )
    with pytest.raises(FitError, match="never slows down in these readings"):
        fitted(readings, None, None)


def test_positions_that_are_not_numbers_are_refused() -> None:
    readings = log(12, mode_1, moves=2)
    readings.position["B"][7] = np.nan
    with pytest.raises(FitError, match="reading 8: positions is not finite"):
        cut_events(readings, FORM, ("A", "B"))
