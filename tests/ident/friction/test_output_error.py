"""The axis simulated: derivatives, recovery, both solvers, inequalities, and the EMPS drive."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import butter, sosfiltfilt

from axcomp.ident.core import FitError
from axcomp.ident.friction import (
    CoulombViscous,
    DriveSamples,
    FrictionFit,
    KnotTable,
    Stribeck,
    fit_output_error,
    laws_held_out,
)
from axcomp.ident.friction._simulate import Drive, Excitation, padded, travel
from axcomp.models import StribeckFriction

from ..friction_job import fit_inverse

# Simulations take longer than a compilation with few optimisations saves.
pytestmark = pytest.mark.usefixtures("optimised")

EMPS = Path(__file__).parents[3] / "../shared/data/emps/DATA_EMPS.mat"
CYCLE = 1e-3  # s
TRUTH = np.array([0.095, -3.0, 20.0, 0.2])  # inertia, offset, coulomb, viscous
COUNT = 3000


def plainly(parameters: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Positions by the recursion written out, in mm."""
    inertia, offset, coulomb, viscous = parameters
    small = CYCLE / 2
    gain = small / inertia
    way = velocity = 0.0
    found = [0.0]
    for push in force:
        for _ in range(2):
            drive = push - offset
            way_on = np.sign(velocity) if velocity else np.sign(drive)
            rate = way_on * drive - coulomb
            speed = abs(velocity) + gain * rate
            if speed > 0:
                velocity = way_on * speed / (1.0 + gain * viscous)
            else:  # stopped: what is left of the step goes the other way, or nowhere
                left, back = speed / rate, max(-way_on * drive - coulomb, 0.0)
                velocity = -way_on * left * back / (1.0 + left * viscous)
            way += small * velocity
        found.append(way)
    return np.array(found)


def pushed(seed: int = 0, rest: bool = True) -> np.ndarray:
    """A force that drives an axis to and fro, with or without a standstill in between."""
    rng = np.random.default_rng(seed)
    time = CYCLE * np.arange(COUNT)
    force = 60.0 * np.sign(np.sin(2 * np.pi * time / 0.7))
    force = force + 3.0 * rng.normal(size=COUNT)
    return np.where(np.abs(time - 1.3) < 0.1, 5.0, force) if rest else force


def recorded(force: np.ndarray, position: np.ndarray) -> DriveSamples:
    velocity = np.gradient(position, CYCLE)
    time = CYCLE * np.arange(len(force))
    return DriveSamples(
        time, velocity, force, np.gradient(velocity, CYCLE), position=position
    )


def simulated(rest: bool = True) -> DriveSamples:
    force = pushed(rest=rest)
    return recorded(force, plainly(TRUTH, force[:-1]))


def noisy(samples: DriveSamples, seed: int = 1) -> DriveSamples:
    """The same with 0.02 mm of noise in the position, where the axis set off apart."""
    assert samples.position is not None
    error = 0.02 * np.random.default_rng(seed).normal(size=len(samples.time))
    error[0] = 0.0
    return dataclasses.replace(samples, position=samples.position + error)


def started(samples: DriveSamples, state: np.ndarray) -> FrictionFit:
    guess = fit_inverse(samples, CoulombViscous(), decimate=5)
    return dataclasses.replace(guess, state=state, given=guess.state_covariance)


def excitation(force: np.ndarray, velocity: float = 0.0) -> Excitation:
    begins = np.arange(len(force)) == 0
    return Excitation(
        jnp.asarray(force),
        jnp.asarray(begins),
        jnp.full(len(force), velocity),
        jnp.asarray(CYCLE),
    )


def drive(parameters: jax.Array) -> Drive:
    """A drive of ten numbers, two for each direction-dependent one."""
    law = StribeckFriction(
        parameters[2:4], parameters[4:6], parameters[8], parameters[9], parameters[6:8]
    )
    return Drive(parameters[0], parameters[1], law)


def test_simulation_is_the_recursion_with_sticking() -> None:
    samples = simulated()
    assert samples.position is not None
    m, o, c, b = TRUTH
    given = jnp.array([m, o, c, c, c, c, b, b, 1.0, 2.0])
    way = np.asarray(jax.jit(travel)(drive(given), excitation(samples.current[:-1])))
    # Rounding of 6 000 sums.
    np.testing.assert_allclose(way, samples.position[1:], atol=1e-10)
    assert (np.diff(way) == 0).sum() > 25


def test_sensitivities_are_those_of_differences() -> None:
    force = excitation(pushed())
    given = jnp.array([0.095, -3.0, 20.0, 21.0, 24.0, 24.0, 0.2, 0.22, 12.0, 1.5, 5.0])

    @jax.jit
    def way(parameters: jax.Array) -> jax.Array:
        begun = dataclasses.replace(force, velocity=jnp.full(COUNT, parameters[10]))
        return travel(drive(parameters), begun)

    found = np.asarray(jax.jit(jax.jacfwd(way))(given))
    for place, value in enumerate(given):
        step = 1e-6 * float(abs(value))
        ahead, back = (way(given.at[place].add(sign * step)) for sign in (1.0, -1.0))
        slope = np.asarray(ahead - back) / (2 * step)
        # Central differences over a kinked path: good to 1e-4 of the largest slope.
        atol = 1e-4 * np.abs(slope).max() + 1e-6
        np.testing.assert_allclose(found[:, place], slope, atol=atol)


@pytest.mark.parametrize("factor", [pytest.param(1 / 3, marks=pytest.mark.heavy), 3.0])
def test_truth_is_found_from_a_start_three_times_off(factor: float) -> None:
    samples = simulated(rest=False)
    fit = fit_output_error(started(samples, factor * TRUTH), samples, trust=0.0)
    # Exact data: the search ends where a step changes no more than 3e-3 of the residuals.
    np.testing.assert_allclose(fit.friction.state, TRUTH, rtol=2e-3)


def test_standstill_leaves_a_run_close_to_the_truth_from_far_away() -> None:
    samples = simulated()
    fit = fit_output_error(started(samples, 3.0 * TRUTH), samples, trust=0.0)
    # When the axis sticks depends on everything: the valley has several bottoms, all of a
    # hundredth of a mm here, on a way of 50 mm.
    assert fit.free_run < 0.02
    np.testing.assert_allclose(fit.friction.state, TRUTH, rtol=0.05)


def test_optimistix_and_ipopt_reach_the_same_cost() -> None:
    samples = noisy(simulated())
    guess = started(samples, 1.2 * TRUTH)
    costs = [
        fit_output_error(guess, samples, trust=0.0, solver=solver).cost
        for solver in ("optimistix", "ipopt")
    ]
    # A flat valley with kinks: both end early, within 1e-3 of the cost.
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)


def test_free_exponent_of_a_stribeck_curve_is_found() -> None:
    force = pushed(rest=False)
    truth = StribeckFriction(15.0, 25.0, 30.0, 1.0, 0.2)
    way = travel(Drive(jnp.asarray(0.095), jnp.asarray(-3.0), truth), excitation(force))
    samples = recorded(force, np.append(0.0, np.asarray(way)[:-1]))
    fit = fit_output_error(fit_inverse(samples, Stribeck(), decimate=5), samples)
    assert fit.friction.law is not None
    speed = np.array([2.0, 10.0, 30.0, 100.0])
    # Exact data; the inverse fit that it holds on to differentiates the position.
    np.testing.assert_allclose(
        fit.friction.law.evaluate(speed), truth.evaluate(speed), rtol=0.02
    )


def test_noise_leaves_the_truth_within_the_reported_errors() -> None:
    samples = simulated(rest=False)
    guess = fit_inverse(samples, CoulombViscous(), decimate=5)
    ratios = []
    for seed in range(4):
        found = fit_output_error(guess, noisy(samples, seed), trust=0.0)
        sd = np.sqrt(np.diag(found.friction.state_covariance))
        ratios.append((found.friction.state - TRUTH) / sd)
    # 16 numbers: one in twenty sets has one beyond 3 σ.
    assert np.abs(ratios).max() < 3.5


def test_a_law_far_from_that_of_the_forces_is_doubtful_by_as_much() -> None:
    samples = noisy(simulated())
    guess = started(samples, 1.5 * TRUTH)
    fit = fit_output_error(guess, samples, trust=0.0).friction
    sd, apart = np.sqrt(np.diag(fit.state_covariance)), fit.state - guess.state
    # By tangents at the bottom of a kinked valley a deviation was up to 33 times too small.
    assert (sd >= np.abs(apart)).all()
    assert (sd <= 1.5 * np.abs(apart)).all()


def test_friction_kept_above_zero_may_fall_with_speed() -> None:
    # Friction that turns to a push at 60 mm/s; the drive reaches more.
    falling = np.array([0.095, 0.0, 6.0, -0.1])
    force = 0.5 * pushed(rest=False)
    samples = recorded(force, plainly(falling, force[:-1]))
    guess = fit_inverse(samples, CoulombViscous(), decimate=5)
    fit = fit_output_error(
        guess, samples, solver="ipopt", constraints=("non-negative",)
    )
    assert fit.friction.law is not None
    fastest = np.abs(samples.velocity).max()
    level = fit.friction.law.evaluate(np.linspace(1.0, fastest, 100))
    # To IPOPT's tolerance for inequalities, relative to a level of some newtons.
    assert level.min() > -1e-3
    assert fit.friction.parameters["viscous"] < 0
    assert 6.0 - 0.1 * fastest < -1.0


def test_laws_held_out_are_those_of_the_rest_of_the_recording() -> None:
    samples = noisy(simulated(rest=False))
    guess = fit_inverse(samples, CoulombViscous(), decimate=5)
    fit = fit_output_error(guess, samples)
    window = np.arange(COUNT) * 3 // COUNT
    # The last third lies: what is found without it does not see that.
    assert samples.position is not None
    wrong = samples.current + 8.0 * (window == 2) * np.sign(samples.velocity)
    lying = dataclasses.replace(samples, current=wrong)
    fit = dataclasses.replace(fit, task=dataclasses.replace(fit.task, samples=lying))
    laws = laws_held_out(fit, window)
    found = [law.friction(np.array([50.0]))[0] for law in laws]
    # 30 N at 50 mm/s; noise of position leaves some tenths, the lie more than 1 N.
    assert found[2] == pytest.approx(30.0, abs=0.5)
    assert min(abs(found[0] - 30.0), abs(found[1] - 30.0)) > 1.0


def test_another_length_compiles_nothing() -> None:
    samples = simulated()
    shorter = samples.take(np.arange(COUNT) < COUNT - 777)
    compiled: list[float] = []
    watching = False

    def heard(event: str, duration_secs: float, **kwargs: str | int) -> None:
        if watching and event.endswith("backend_compile_duration"):
            compiled.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(heard)
    fit_output_error(started(samples, TRUTH), samples)
    watching = True
    fit_output_error(started(shorter, TRUTH), shorter)
    watching = False
    # Asked for is less than a second; only steps of a microsecond may be left.
    assert sum(compiled) < 0.1
    assert len(padded(shorter.current)) == len(padded(samples.current))


def test_what_cannot_be_fitted_is_named() -> None:
    samples = simulated()
    table = fit_inverse(samples, KnotTable(False, (10.0, 50.0, 100.0)), decimate=5)
    with pytest.raises(FitError, match="expected Coulomb \\+ viscous or Stribeck"):
        fit_output_error(table, samples)
    plain = fit_inverse(samples, CoulombViscous(), decimate=5)
    with pytest.raises(FitError, match="holds no positions"):
        fit_output_error(plain, dataclasses.replace(samples, position=None))
    with pytest.raises(FitError, match="constraints: found non-negative"):
        fit_output_error(plain, samples, constraints=("non-negative",))


def test_constant_load_is_named_as_a_gauge_of_levels_per_direction() -> None:
    samples = simulated()
    guess = fit_inverse(samples, CoulombViscous(True), decimate=5)
    fit = fit_output_error(guess, samples).friction
    assert "level⁺ + offset" in fit.gauges[0]


def emps() -> DriveSamples:
    if not EMPS.exists():
        pytest.skip("needs ../shared/data/emps/DATA_EMPS.mat")
    data = loadmat(EMPS)
    position = 1e3 * data["qm"].ravel()
    low = np.asarray(butter(4, 0.2, output="sos"))  # 100 Hz at 1 kHz
    velocity = np.gradient(sosfiltfilt(low, position), CYCLE)
    return DriveSamples(
        data["t"].ravel(),
        velocity,
        (data["gtau"] * data["vir"]).ravel(),
        np.gradient(velocity, CYCLE),
        position=position,
    )


@pytest.mark.slow
def test_emps_free_run_is_no_worse_than_the_published_fit() -> None:
    samples = emps()
    fit = fit_output_error(fit_inverse(samples, CoulombViscous()), samples)
    # Published parameters, simulated likewise: 2.71 mm.
    assert fit.free_run <= 2.71
    both = fit_output_error(fit_inverse(samples, CoulombViscous(True)), samples)
    assert both.free_run < fit.free_run


@pytest.mark.slow
@pytest.mark.parametrize("trust", [0.01, pytest.param(1.0, marks=pytest.mark.heavy)])
def test_emps_solvers_agree_where_the_guess_counts(trust: float) -> None:
    samples = emps()
    guess = fit_inverse(samples, CoulombViscous())
    first = fit_output_error(guess, samples, trust=trust)
    second = fit_output_error(guess, samples, trust=trust, solver="ipopt")
    # Without what the guess knew the valley is flat and kinked: solvers end apart in it.
    assert first.cost == pytest.approx(second.cost, rel=1e-3)
    np.testing.assert_allclose(first.friction.state, second.friction.state, rtol=1e-3)
