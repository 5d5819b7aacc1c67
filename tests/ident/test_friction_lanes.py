"""Fits of one recording with and without some of its rows, side by side."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from scipy.signal import oaconvolve

from axcomp.ident.fit._gather import Gathering
from axcomp.ident.fit.friction import (
    Choice,
    CoulombViscous,
    DriveSamples,
    KnotTable,
    Stribeck,
    choose_law,
    default_knots,
    fit_inverse,
)
from axcomp.ident.fit.friction._covariance import score_covariance
from axcomp.ident.fit.friction._lanes import lanes_of
from axcomp.ident.fit.friction._lowpass import decimation
from axcomp.ident.fit.friction._problem import Known, make_problem
from axcomp.ident.fit.friction._solve import solve_stack
from axcomp.ident.fit.friction._stack import alone
from axcomp.ident.fit.friction._structure import AbstractStructure

CYCLE = 0.01  # s


def recording(wild: float, count: int = 1200) -> DriveSamples:
    """Ramps between random speeds in mm/s, currents in A; some samples far off."""
    rng = np.random.default_rng(3)
    aims = rng.choice([-1.0, 1.0], 40) * np.exp(rng.uniform(0.0, np.log(200.0), 40))
    velocity = np.interp(np.arange(count), np.linspace(0, count, 40), aims)
    acceleration = np.gradient(velocity, CYCLE)
    level = 1.2 + 0.9 * np.exp(-((velocity / 12.0) ** 2))
    current = np.sign(velocity) * level + 0.004 * velocity + 0.0008 * acceleration
    current += 0.3 + 0.1 * rng.normal(size=count)
    hit = rng.random(count) < wild
    current[hit] += rng.uniform(2.0, 8.0, hit.sum())
    return DriveSamples(CYCLE * np.arange(count), velocity, current, acceleration)


def kinds(samples: DriveSamples) -> list[AbstractStructure]:
    knots = default_knots(np.abs(samples.velocity), 8)
    return [
        CoulombViscous(),
        Stribeck(True),
        Stribeck(False, None),
        KnotTable(True, knots),
    ]


@pytest.mark.parametrize("wild", [0.0, 0.03])
def test_fits_side_by_side_are_those_of_each_choice_of_rows(wild: float) -> None:
    samples = recording(wild)
    window = np.arange(len(samples.time)) * 5 // len(samples.time)
    for kind in kinds(samples):
        problem = make_problem(samples, kind, Known(), 1)
        keep = window != np.arange(5)[:, None]
        beside = solve_stack(alone(problem), "trim", lanes_of(problem.usable, keep))
        for rows, found in zip(keep, beside, strict=True):
            fresh = make_problem(samples, kind, Known(), 1)
            lanes = lanes_of(fresh.usable, rows[None])
            (found_alone,) = solve_stack(alone(fresh), "trim", lanes)
            one, other = found_alone.solution, found.solution
            assert type(found.problem.structure) is type(found_alone.problem.structure)
            assert other.passes == one.passes
            # Sums in another order; a step of a search may end one rounding earlier.
            np.testing.assert_allclose(other.residual, one.residual, atol=1e-8)
            np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-6)


def test_a_window_left_out_has_no_say_in_what_is_predicted_there() -> None:
    samples = recording(0.0)
    choice = choose_law(samples, [Stribeck(), CoulombViscous()], decimate=1)
    window = choice.left_out.window_of_samples
    own = window == 4
    other = dataclasses.replace(
        samples, current=np.where(own, 3.0 * samples.current, samples.current)
    )
    again = choose_law(other, [Stribeck(), CoulombViscous()], decimate=1)
    before = choice.left_out.predicted(choice.laws[0])[own]
    after = again.left_out.predicted(again.laws[0])[own]
    # The shares from which the search starts are those of the rest alone: rounding.
    np.testing.assert_allclose(after, before, rtol=1e-9)


def test_laws_of_a_choice_are_those_of_single_fits() -> None:
    samples = recording(0.03)
    for law in choose_law(samples).laws:
        alone = fit_inverse(samples, law.structure)
        # Sums over the windows' stretches instead of one: rounding.
        np.testing.assert_allclose(law.values, alone.values, rtol=1e-8)
        np.testing.assert_allclose(law.covariance, alone.covariance, rtol=1e-6)


def test_recordings_side_by_side_are_chosen_for_as_alone() -> None:
    # Wild samples, no drop, other lengths: what one of them needs is none of the others'.
    recordings = [
        recording(0.0),
        recording(0.03, 1117),
        dataclasses.replace(recording(0.0), current=recording(0.0).velocity * 0.01),
        recording(0.02),
    ]
    beside = Gathering().run([partial(choose_law, each) for each in recordings])
    for samples, found in zip(recordings, beside, strict=True):
        assert isinstance(found, Choice)
        alone = choose_law(samples)
        assert found.sentence == alone.sentence
        for one, other in zip(found.candidates, alone.candidates, strict=True):
            # Rows filled up with zeros are summed in another order: rounding, after a
            # search that ends within 1e-10.
            np.testing.assert_allclose(
                one.window_error, other.window_error, rtol=1e-9, atol=1e-15
            )
        np.testing.assert_allclose(found.fit.values, alone.fit.values, rtol=1e-9)
        held = found.left_out.predicted(found.fit)
        wanted = alone.left_out.predicted(alone.fit)
        np.testing.assert_allclose(held, wanted, rtol=1e-9)


def test_recordings_side_by_side_keep_their_own_loss() -> None:
    samples = recording(0.03)
    calls = [partial(choose_law, samples, loss=loss) for loss in ("trim", "student")]
    for call, found in zip(calls, Gathering().run(calls), strict=True):
        assert isinstance(found, Choice)
        alone = call()
        # The same numbers: what is asked for with another loss is solved apart.
        np.testing.assert_array_equal(found.fit.values, alone.fit.values)
        held = found.left_out.predicted(found.fit)
        np.testing.assert_array_equal(held, alone.left_out.predicted(alone.fit))


def test_sliding_sums_are_sums_over_lags_with_bartletts_weights() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(503, 3))
    scores = np.cumsum(noise, axis=0) * 0.1 + noise
    piece = np.repeat([0, 1, 2], [200, 300, 3])
    found, lag = score_covariance(scores, piece)
    assert lag > 3
    wanted = scores.T @ scores
    for step in range(1, lag + 1):
        same = piece[step:] == piece[:-step]
        cross = scores[step:][same].T @ scores[:-step][same]
        wanted += (1.0 - step / (lag + 1)) * (cross + cross.T)
    np.testing.assert_allclose(found, wanted, rtol=1e-10)


@pytest.mark.parametrize("factor", [2, 7])
def test_thinned_rows_are_those_of_a_convolution(factor: int) -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(2000, 3))
    lowpass = decimation(np.repeat([0, 1], [1400, 600]), factor)
    full = oaconvolve(columns, lowpass.kernel[:, None], mode="same", axes=0)
    # The same sums in another order.
    np.testing.assert_allclose(lowpass(columns), full[lowpass.centres], atol=1e-12)
