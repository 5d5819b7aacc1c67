"""Look-ahead, distance and delay of a friction list, found together with the law."""

import dataclasses

import numpy as np
import pytest

from axcomp.ident.core import FitError
from axcomp.ident.friction import DriveSamples, ReversalFit, fit_reversal
from axcomp.models import (
    AbstractFriction,
    FrictionCompensation,
    FrictionTable,
    Setpoints,
    StribeckFriction,
)

LAW = StribeckFriction(2.0, 3.0, 5.0, 1.5, 0.004)
TABLE = FrictionTable(
    Setpoints(np.array([1.0, 5.0, 20.0, 60.0, 150.0])),
    np.array([4.0, 3.8, 3.7, 3.9, 4.3]),
)
CYCLE, INERTIA, OFFSET = 0.001, 0.002, 0.3


def motion(rest: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Two speeds of a circular test: slow about its reversals, in mm and mm/s."""
    time = np.arange(6000) * CYCLE
    # No cycle falls on the turning point: standing there would hide the last cycle.
    angle = 2 * np.pi * np.where(time < 3.0, time / 1.2, 2.5 + (time - 3.0) / 0.9)
    position = 20.0 * np.sin(angle + 0.3)
    velocity = np.gradient(position, CYCLE)
    if rest:
        turn = int(np.argmax(np.diff(np.sign(velocity)) != 0)) + 1
        still = np.full(200, position[turn - 1])
        position = np.concatenate([position[:turn], still, position[turn:]])
        velocity = np.concatenate([velocity[:turn], np.zeros(200), velocity[turn:]])
    return position, velocity


def recorded(
    law: AbstractFriction,
    setting: tuple[int, float, int],
    *,
    rest: bool = False,
    position: np.ndarray | None = None,
) -> tuple[DriveSamples, np.ndarray, np.ndarray]:
    """A drive whose friction changes over as a controller gives it."""
    if position is None:
        position, velocity = motion(rest)
    else:
        velocity = np.gradient(position, CYCLE)
    model = FrictionCompensation(law, *setting)
    friction = np.array(model.run(model.start(), position, velocity)[0])
    hard = np.gradient(velocity, CYCLE)
    current = friction + INERTIA * hard + OFFSET
    time = CYCLE * np.arange(len(position))
    return DriveSamples(time, velocity, current, hard), position, velocity


def steady(
    law: AbstractFriction, samples: DriveSamples, found: ReversalFit
) -> np.ndarray:
    """What is left of the current when steady friction, inertia and load are taken off."""
    assert samples.acceleration is not None
    given_back = (
        samples.current + found.missing - INERTIA * samples.acceleration - OFFSET
    )
    return np.asarray(given_back - law.evaluate(samples.velocity))


@pytest.mark.parametrize(
    "setting",
    [
        (0, 0.0, 0),
        (4, 0.0007, 3),
        pytest.param((1, 0.008, 12), marks=pytest.mark.heavy),
    ],
)
def test_unknown_stribeck_law_and_reversal_are_found_to_the_last_digits(
    setting: tuple[int, float, int],
) -> None:
    samples, position, velocity = recorded(LAW, setting)
    found = fit_reversal(samples, position, velocity)
    assert (found.lookahead, found.delay_cycles) == (setting[0], setting[2])
    # The law is of the kind that is fitted and nothing is noisy: the solver's tolerance.
    assert found.position_delay == pytest.approx(setting[1], abs=1e-6)
    # Before the first motion nothing acts at all, whatever the law.
    late = slice(setting[2] + 1, None)
    assert np.abs(steady(LAW, samples, found)[late]).max() < 1e-3


def test_unknown_law_that_no_formula_gives_is_found_by_a_table() -> None:
    samples, position, velocity = recorded(TABLE, (2, 0.008, 3))
    found = fit_reversal(samples, position, velocity)
    assert (found.lookahead, found.delay_cycles) == (2, 3)
    # Knots of the fit are not those of the truth: 1 % of the distance, of the current.
    assert found.position_delay == pytest.approx(0.008, rel=0.01)
    assert np.abs(steady(TABLE, samples, found)[4:]).max() < 0.04


@pytest.mark.parametrize(
    ("setting", "period"),
    [((3, 0.005, 5), 1.5), pytest.param((2, 0.012, 1), 2.3, marks=pytest.mark.heavy)],
)
def test_a_wrong_delay_does_not_make_up_for_a_distance(
    setting: tuple[int, float, int], period: float
) -> None:
    law = FrictionTable(
        Setpoints(np.array([1.0, 10.0, 40.0, 120.0])), np.array([6.0, 4.5, 4.2, 4.9])
    )
    angle = 2 * np.pi * np.arange(6000) * CYCLE / period
    position = 20.0 * np.sin(angle + 0.3)
    samples, _, velocity = recorded(law, setting, position=position)
    found = fit_reversal(samples, position, velocity)
    assert (found.lookahead, found.delay_cycles) == (setting[0], setting[2])
    # Knots of the fit are not those of the truth.
    assert found.position_delay == pytest.approx(setting[1], rel=0.01)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.heavy)])
def test_noisy_recording_gives_them_within_the_stated_deviation(seed: int) -> None:
    samples, position, velocity = recorded(LAW, (3, 0.004, 5))
    rng = np.random.default_rng(seed)
    # 10 % noise and 1 % wild samples, as a drive's torque feedback may have.
    noisy = samples.current + 0.3 * rng.normal(size=samples.current.size)
    wild = rng.random(noisy.size) < 0.01
    noisy[wild] += rng.choice([-10.0, 10.0], size=int(wild.sum()))
    noisy_samples = dataclasses.replace(samples, current=noisy)
    found = fit_reversal(noisy_samples, position, velocity)
    assert found.delay_cycles == 5
    # 4 standard deviations: 2 draws.
    assert abs(found.position_delay - 0.004) <= 4 * found.position_delay_sd
    assert 1e-6 < found.position_delay_sd < 1e-3
    if found.lookahead_probability > 0.95:
        assert found.lookahead == 3


def test_what_the_noise_hides_is_called_undetermined() -> None:
    samples, position, velocity = recorded(LAW, (3, 0.0002, 5))
    rng = np.random.default_rng(1)
    current = samples.current + 6.0 * rng.normal(size=samples.current.size)
    found = fit_reversal(
        dataclasses.replace(samples, current=current), position, velocity
    )
    assert "reversal_lookahead" in found.undetermined


def test_standing_between_both_directions_hides_nothing() -> None:
    samples, position, velocity = recorded(LAW, (2, 0.0008, 4), rest=True)
    found = fit_reversal(samples, position, velocity, inertia=INERTIA)
    assert (found.lookahead, found.delay_cycles) == (2, 4)
    assert found.position_delay == pytest.approx(0.0008, abs=1e-6)


def test_jitter_of_a_standing_axis_is_no_reversal() -> None:
    stroke = 20.0 * np.cos(np.linspace(0.0, np.pi, 600))
    rest = np.ones(200)
    strokes = [np.append(sign * stroke, -20.0 * sign * rest) for sign in [1, -1] * 4]
    position = np.concatenate(strokes)
    velocity = np.gradient(position, CYCLE)
    # A drive holds at rest what it gave last, as its integral part does.
    model = FrictionCompensation(LAW, 0, 0.008, 0, held_at_rest=True)
    friction = np.array(model.run(model.start(), position, velocity)[0])
    hard = np.gradient(velocity, CYCLE)
    current = friction + INERTIA * hard + OFFSET
    # An encoder flickers by 10 nm where nothing moves.
    flicker = 1e-5 * np.sin(np.arange(len(position)))
    recorded_velocity = np.where(velocity == 0, np.gradient(flicker, CYCLE), velocity)
    time = CYCLE * np.arange(len(position))
    samples = DriveSamples(time, velocity, current, hard)
    found = fit_reversal(samples, position, recorded_velocity, inertia=INERTIA)
    assert (found.reversals, found.delay_cycles) == (7, 0)
    # At rest no look-ahead shows.
    assert (found.lookahead, found.lookahead_seen) == (0, False)
    # Nothing is noisy, and the law is of the kind that is fitted: the solver's tolerance.
    assert found.position_delay == pytest.approx(0.008, abs=1e-6)


def test_motion_in_one_direction_is_refused() -> None:
    position, velocity = np.linspace(0, 10, 100), np.linspace(50.0, 150.0, 100)
    samples = DriveSamples(
        CYCLE * np.arange(100), velocity, np.full(100, 2.0), np.zeros(100)
    )
    with pytest.raises(FitError, match="found no reversal"):
        fit_reversal(samples, position, velocity)


def test_gaps_and_other_lengths_are_refused() -> None:
    samples, position, velocity = recorded(LAW, (0, 0.0, 0))
    with pytest.raises(FitError, match="expected as many of each"):
        fit_reversal(samples, position[:-1], velocity[:-1])
    position[7] = np.nan
    with pytest.raises(FitError, match="found gaps"):
        fit_reversal(samples, position, velocity)
