"""Look-ahead, distance and delay of a friction list, from recorded reversals."""

import numpy as np
import pytest

from axcomp.ident.fit import FitError
from axcomp.ident.fit.friction import fit_reversal
from axcomp.models import FrictionCompensation, StribeckFriction

LAW = StribeckFriction(2.0, 3.0, 5.0, 1.5, 0.004)
CYCLE = 0.001


def motion(periods: int = 6, amplitude: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """A sine of a circular test: slow about its reversals, in mm and mm/s."""
    time = np.arange(int(periods * 1.2 / CYCLE)) * CYCLE
    # No cycle falls on the turning point: standing there would hide the last cycle.
    position = amplitude * np.sin(2 * np.pi * time / 1.2 + 0.3)
    return position, np.gradient(position, CYCLE)


def recorded(lookahead: int, distance: float, delay: int) -> tuple[np.ndarray, ...]:
    position, velocity = motion()
    model = FrictionCompensation(LAW, lookahead, distance, delay)
    current = np.array(model.run(model.start(), position, velocity)[0])
    return position, velocity, current


@pytest.mark.parametrize(
    ("lookahead", "distance", "delay"),
    [(0, 0.0, 0), (2, 0.0007, 3), (4, 0.001, 0), (1, 0.006, 12), (0, 0.0003, 7)],
)
def test_perfect_recording_gives_the_cycle_and_a_tenth_of_a_micrometre(
    lookahead: int, distance: float, delay: int
) -> None:
    found = fit_reversal(LAW, *recorded(lookahead, distance, delay))
    assert (found.lookahead, found.delay_cycles) == (lookahead, delay)
    assert found.position_delay == pytest.approx(distance, abs=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_noisy_recording_gives_them_within_the_stated_deviation(seed: int) -> None:
    position, velocity, current = recorded(3, 0.004, 5)
    rng = np.random.default_rng(seed)
    # 10 % noise and 1 % wild samples, as a drive's torque feedback may have.
    noisy = current + 0.3 * rng.normal(size=current.size)
    wild = rng.random(current.size) < 0.01
    noisy[wild] += rng.choice([-10.0, 10.0], size=int(wild.sum()))
    found = fit_reversal(LAW, position, velocity, noisy)
    assert found.delay_cycles == 5
    # 4 standard deviations: 4 draws.
    assert abs(found.position_delay - 0.004) <= 4 * found.position_delay_sd
    assert 1e-6 < found.position_delay_sd < 1e-3
    if found.lookahead_probability > 0.95:
        assert found.lookahead == 3


def test_what_the_noise_hides_is_called_undetermined() -> None:
    position, velocity, current = recorded(3, 0.0002, 5)
    rng = np.random.default_rng(1)
    found = fit_reversal(
        LAW, position, velocity, current + 6.0 * rng.normal(size=current.size)
    )
    assert "reversal_lookahead" in found.undetermined


def test_standing_between_both_directions_hides_nothing() -> None:
    position, velocity = motion()
    turn = int(np.argmax(np.diff(np.sign(velocity)) != 0)) + 1
    rest = np.full(200, position[turn - 1])
    position = np.concatenate([position[:turn], rest, position[turn:]])
    velocity = np.concatenate([velocity[:turn], np.zeros(200), velocity[turn:]])
    model = FrictionCompensation(LAW, 2, 0.0008, 4)
    current = np.asarray(model.run(model.start(), position, velocity)[0])
    found = fit_reversal(LAW, position, velocity, current)
    assert (found.lookahead, found.delay_cycles) == (2, 4)
    assert found.position_delay == pytest.approx(0.0008, abs=1e-4)


def test_motion_in_one_direction_is_refused() -> None:
    position = np.linspace(0, 10, 100)
    with pytest.raises(FitError, match="found no reversal"):
        fit_reversal(LAW, position, np.full(100, 100.0), np.full(100, 2.0))


def test_gaps_are_refused() -> None:
    position, velocity, current = recorded(0, 0.0, 0)
    current[7] = np.nan
    with pytest.raises(FitError, match="found gaps"):
        fit_reversal(LAW, position, velocity, current)
