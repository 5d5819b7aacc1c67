"""Friction from any motion: parameters, their errors, and what cannot be told."""

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from axcomp.ident.fit import FitError
from axcomp.ident.friction import (
    CoulombViscous,
    DriveSamples,
    KnotTable,
    Stribeck,
    default_knots,
)
from axcomp.ident.friction._equation import Equation, record
from axcomp.ident.friction._inverse import fit_carried
from axcomp.ident.friction._weights import weigh
from axcomp.models import StribeckFriction

from ..friction_job import fit_inverse

DATA = Path(__file__).parents[3] / "../shared/data"
CYCLE = 0.01  # s
TRUTH = {
    "coulomb": 1.2,
    "breakaway": 2.1,
    "stribeck_velocity": 12.0,
    "viscous": 0.004,
    "inertia": 0.0008,
    "offset": 0.35,
}


def motion(
    rng: np.random.Generator, count: int = 2000, slowest: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Ramps between plateaus of random speed and direction, in mm/s and mm/s²."""
    velocity, last = [], 0.0
    while sum(map(len, velocity)) < count:
        aim = rng.choice([-1.0, 1.0]) * np.exp(
            rng.uniform(np.log(slowest), np.log(300.0))
        )
        velocity += [
            np.linspace(last, aim, rng.integers(10, 40)),
            np.full(rng.integers(10, 40), aim),
        ]
        last = float(aim)
    found = np.concatenate(velocity)[:count]
    return found, np.gradient(found, CYCLE)


def recording(seed: int, noise: float = 0.0, wild: float = 0.0) -> DriveSamples:
    rng = np.random.default_rng(seed)
    velocity, acceleration = motion(rng)
    law = StribeckFriction(
        jnp.asarray(TRUTH["coulomb"]),
        jnp.asarray(TRUTH["breakaway"]),
        jnp.asarray(TRUTH["stribeck_velocity"]),
        jnp.asarray(2.0),
        jnp.asarray(TRUTH["viscous"]),
    )
    current = np.asarray(law(velocity))
    current = current + TRUTH["inertia"] * acceleration + TRUTH["offset"]
    size = np.sqrt(np.mean(current**2))
    current = current + noise * size * rng.normal(size=len(current))
    hit = rng.random(len(current)) < wild
    current[hit] += rng.choice([-1, 1], hit.sum()) * rng.uniform(1, 5, hit.sum()) * size
    time = CYCLE * np.arange(len(current))
    return DriveSamples(time, velocity, current, acceleration)


def test_exact_recording_gives_back_every_parameter() -> None:
    fit = fit_inverse(recording(1))
    assert fit.converged
    for name, value in TRUTH.items():
        # Nothing but the end of the iteration stands between fit and truth.
        assert fit.parameters[name] == pytest.approx(value, rel=1e-5)


def test_law_of_the_fit_is_the_model_of_the_controller() -> None:
    fit = fit_inverse(recording(1, 0.1))
    speeds = np.linspace(-300.0, 300.0, 41)
    assert fit.law is not None
    # Same formula written twice: rounding only.
    np.testing.assert_allclose(fit.friction(speeds), fit.law(speeds), atol=1e-12)


@pytest.mark.parametrize("shape", [2.0, None])
def test_truth_lies_within_the_reported_errors(shape: float | None) -> None:
    ratios = []
    for seed in range(25):
        fit = fit_inverse(
            recording(seed, 0.1, 0.01),
            Stribeck(False, shape),
            decimate=1,
            carried=False,
        )
        names = [name for name in TRUTH if name not in fit.undetermined]
        assert len(names) == len(TRUTH)
        ratios.append(
            [
                (fit.parameters[name] - TRUTH[name]) / fit.standard_deviations[name]
                for name in names
            ]
        )
    found = np.abs(np.array(ratios))
    # 150 numbers; the full thousand draws are in benchmarks/test_friction_accuracy.py.
    assert (found < 3).mean() > 0.98
    # Errors neither too small nor too large: χ² of 25 draws scatters by 14 % (one σ of 1).
    assert np.all(np.sqrt((found**2).mean(axis=0)) < 1.5)
    assert np.sqrt((found**2).mean()) > 0.75


def test_deviations_count_an_exponent_that_is_assumed() -> None:
    law = StribeckFriction(*map(jnp.asarray, (1.2, 2.1, 12.0, 1.5, 0.004)))
    plain = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        velocity, acceleration = motion(rng, 3000, slowest=6.0)
        current = np.asarray(law(velocity)) + TRUTH["inertia"] * acceleration
        current += TRUTH["offset"]
        current += 0.2 * np.sqrt(np.mean(current**2)) * rng.normal(size=len(current))
        time = CYCLE * np.arange(len(current))
        velocity = np.where(np.abs(velocity) < 5.4, 0.0, velocity)
        seen = DriveSamples(time, velocity, current, acceleration)
        # A contest of laws takes an exponent of 2 unless the rows ask for another one.
        contest = record(seen, None, None)
        equation, weights = Equation(contest, Stribeck()), weigh(contest, "trim")
        fit = fit_carried(equation, weights)
        assert fit.structure == Stribeck(exponent=2.0)
        known = fit_inverse(seen, fit.structure)
        gap = abs(fit.parameters["breakaway"] - TRUTH["breakaway"])
        plain.append(gap / known.standard_deviations["breakaway"])
        assert gap < 3.0 * fit.standard_deviations["breakaway"]
    # What the rows say of the break-away under an exponent of 2 is far from the truth.
    assert min(plain) > 2.0


def test_standard_deviations_grow_where_neighbours_resemble_each_other() -> None:
    samples = recording(3)
    rng = np.random.default_rng(0)
    ratios = []
    for _ in range(20):
        noise = np.zeros(len(samples.time))
        for place in range(1, len(noise)):
            noise[place] = 0.9 * noise[place - 1] + 0.05 * rng.normal()
        fit = fit_inverse(
            dataclasses.replace(samples, current=samples.current + noise), decimate=1
        )
        error = fit.parameters["offset"] - TRUTH["offset"]
        ratios.append(error / fit.standard_deviations["offset"])
    # Errors for independent noise would be four times too small; Bartlett's are 20 % short.
    assert np.std(ratios) < 1.6


def test_instruments_take_away_the_bias_of_a_noisy_velocity() -> None:
    samples = recording(4, 0.02)
    rng = np.random.default_rng(0)
    noisy = dataclasses.replace(
        samples,
        velocity=samples.velocity + rng.normal(0.0, 0.2, len(samples.time)),
        acceleration=np.asarray(samples.acceleration)
        + rng.normal(0.0, 400.0, len(samples.time)),
        instrument_velocity=samples.velocity,
        instrument_acceleration=samples.acceleration,
    )
    plain = dataclasses.replace(
        noisy, instrument_velocity=None, instrument_acceleration=None
    )
    biased = fit_inverse(plain, decimate=1)
    fit = fit_inverse(noisy, decimate=1)
    sd = fit.standard_deviations["inertia"]
    assert biased.parameters["inertia"] < TRUTH["inertia"] - 5 * sd
    assert abs(fit.parameters["inertia"] - TRUTH["inertia"]) < 3 * sd


def test_known_inertia_is_not_fitted() -> None:
    fit = fit_inverse(recording(1), inertia=TRUTH["inertia"])
    assert fit.parameters["inertia"] == TRUTH["inertia"]
    assert "inertia" not in fit.standard_deviations
    # Exact data, as above.
    assert fit.parameters["coulomb"] == pytest.approx(TRUTH["coulomb"], rel=1e-5)


def test_table_follows_the_law_within_its_errors() -> None:
    samples = recording(5, 0.1, 0.01)
    knots = default_knots(np.abs(samples.velocity), 15)
    fit = fit_inverse(samples, KnotTable(False, knots), decimate=1)
    truth = fit_inverse(recording(5))
    assert truth.law is not None
    speeds = np.geomspace(3.0, 250.0, 20)
    value, slopes = fit.friction(speeds), fit.slopes(speeds)
    sd = np.sqrt((slopes @ fit.law_covariance * slopes).sum(axis=1))
    # The line between knots leaves the curve by some per cent beside its own σ.
    off = np.abs(value - np.asarray(truth.law(speeds)))
    assert (off < 4 * sd + 0.06).all()


def test_an_offset_beside_both_directions_is_a_choice() -> None:
    fit = fit_inverse(recording(1, 0.05), CoulombViscous(True))
    assert "cannot be told apart" in fit.gauges[0]
    # The stated gauge: equal levels.
    assert fit.parameters["coulomb_positive"] == pytest.approx(
        fit.parameters["coulomb_negative"], rel=1e-9
    )


def test_one_direction_alone_does_not_tell_friction_from_load() -> None:
    samples = recording(1, 0.05)
    fit = fit_inverse(samples.take(samples.velocity > 0), decimate=1)
    assert {"coulomb", "breakaway", "offset"} <= set(fit.undetermined)
    assert fit.law is None
    assert "viscous" in fit.parameters
    assert "level⁺ + offset" in fit.gauges[0]
    assert "level⁻" not in fit.gauges[0]


def test_no_motion_in_the_stribeck_range_is_said() -> None:
    samples = recording(1, 0.05)
    fast = samples.take(np.abs(samples.velocity) > 60.0)
    fit = fit_inverse(fast, decimate=1)
    assert {"breakaway", "stribeck_velocity"} <= set(fit.undetermined)
    assert "breakaway" not in fit.parameters
    # 5 % noise on 1 700 samples: the rest comes out as without the drop.
    assert fit.parameters["coulomb"] == pytest.approx(TRUTH["coulomb"], rel=0.05)


def test_rising_friction_is_no_stribeck_effect() -> None:
    samples = recording(1)
    bent = 0.002 * samples.velocity - 2e-6 * samples.velocity * np.abs(samples.velocity)
    current = np.sign(samples.velocity) + 4 * bent
    fit = fit_inverse(dataclasses.replace(samples, current=current), decimate=1)
    assert "stribeck_velocity" in fit.undetermined
    assert fit.parameters["coulomb"] > 0


def test_saturated_current_is_left_out() -> None:
    samples = recording(1, 0.02)
    limit = 2.2
    clipped = np.clip(samples.current, -limit, limit)
    hit = np.abs(clipped) == limit
    assert hit.mean() > 0.02
    fit = fit_inverse(dataclasses.replace(samples, current=clipped), decimate=1)
    sd = fit.standard_deviations["inertia"]
    # Single clipped samples cannot be told from others; runs of five are.
    assert fit.parameters["inertia"] == pytest.approx(TRUTH["inertia"], abs=5 * sd)


def test_clock_with_jumps_is_fitted_in_pieces() -> None:
    samples = recording(1, 0.02)
    time = samples.time + np.where(np.arange(2000) >= 900, 3.0, 0.0)
    fit = fit_inverse(dataclasses.replace(samples, time=time), decimate=2)
    sd = fit.standard_deviations["coulomb"]
    assert abs(fit.parameters["coulomb"] - TRUTH["coulomb"]) < 4 * sd


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time": np.zeros(2000)}, "expected ascending times"),
        ({"velocity": np.zeros(2000)}, "does not move"),
        ({"current": np.zeros(2000)}, "current is 0 throughout"),
        ({"current": np.full(2000, np.nan)}, "sample 1: current is not finite"),
    ],
)
def test_useless_recordings_are_refused(
    change: dict[str, np.ndarray], words: str
) -> None:
    with pytest.raises(FitError, match=words):
        fit_inverse(dataclasses.replace(recording(1), **change))


def test_no_rows_behind_the_filter_are_told() -> None:
    with pytest.raises(FitError, match="0 samples in motion are left after filtering"):
        fit_inverse(recording(1), decimate=500)


def test_unknown_loss_is_refused() -> None:
    with pytest.raises(FitError, match="expected 'student', 'huber', 'trim' or"):
        fit_inverse(recording(1), loss="l1")


def test_ur10e_joint_comes_out_beside_the_published_values() -> None:
    path = DATA / "friction/ur10e_jointwise_joint_1.csv.gz"
    if not path.exists():
        pytest.skip("needs ../shared/data/friction/ur10e_jointwise_joint_1.csv.gz")
    table = np.loadtxt(path, delimiter=",")
    low = np.asarray(butter(4, 0.2, output="sos"))  # 10 Hz at 100 Hz
    velocity = sosfiltfilt(low, table[:, 7])  # rad/s
    samples = DriveSamples(
        CYCLE * np.arange(len(table)),
        velocity,
        10.0 * table[:, 13],
        np.gradient(velocity, CYCLE),
    )
    fit = fit_inverse(samples)
    # Published for the whole robot at once, without its errors; the joint alone shows 7 %
    # more viscous friction because its curve bends, which the published law cannot say.
    assert fit.parameters["viscous"] == pytest.approx(21.256, rel=0.08)
    assert fit.parameters["coulomb"] == pytest.approx(12.548, rel=0.06)
    assert abs(fit.parameters["offset"] - 0.196) < 2 * fit.standard_deviations["offset"]
    assert "stribeck_velocity" in fit.undetermined


def test_ur10e_joint_under_gravity_agrees_with_the_published_values() -> None:
    path = DATA / "friction/ur10e_jointwise_joint_2.csv.gz"
    if not path.exists():
        pytest.skip("needs ../shared/data/friction/ur10e_jointwise_joint_2.csv.gz")
    table = np.loadtxt(path, delimiter=",")
    low = np.asarray(butter(4, 0.2, output="sos"))  # 10 Hz at 100 Hz
    velocity, angle = sosfiltfilt(low, table[:, 8]), table[:, 2]
    samples = DriveSamples(
        CYCLE * np.arange(len(table)),
        velocity,
        10.696 * table[:, 14],
        np.gradient(velocity, CYCLE),
        loads={"gravity_cos": np.cos(angle), "gravity_sin": np.sin(angle)},
    )
    fit = fit_inverse(samples)
    published = {"viscous": 20.221, "coulomb": 13.266, "offset": -0.754}
    for name, value in published.items():
        # Within two of the reported deviations: the arm's weight moves through the motion
        # and leaves each of the three less certain than at joint 1.
        away = abs(fit.parameters[name] - value) / fit.standard_deviations[name]
        assert away < 2.0, name
