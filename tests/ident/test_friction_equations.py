"""The equation of a friction law: summed up row by row, and by matrices; near a shape, in sums."""

import dataclasses
import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.fit.friction import (
    CoulombViscous,
    DriveSamples,
    KnotTable,
    Stribeck,
    default_knots,
)
from axcomp.ident.fit.friction._equations import equation_of
from axcomp.ident.fit.friction._interpolated import Interpolated
from axcomp.ident.fit.friction._lanes import Lanes, Shares, lanes_of
from axcomp.ident.fit.friction._loss import far_off
from axcomp.ident.fit.friction._matrices import MatrixEquation
from axcomp.ident.fit.friction._pairs import PairEquation
from axcomp.ident.fit.friction._problem import Known, make_problem
from axcomp.ident.fit.friction._separable import separable
from axcomp.ident.fit.friction._stack import Stack, alone
from axcomp.ident.fit.friction._structure import AbstractStructure

CYCLE = 0.01  # s
COUNT = 900


def recording(noise: float = 0.05) -> DriveSamples:
    """Ramps between random speeds in mm/s, currents in A, rest and a load of its own."""
    rng = np.random.default_rng(11)
    aims = rng.choice([-1.0, 0.0, 1.0], 30) * np.exp(rng.uniform(0.0, 5.0, 30))
    velocity = np.interp(np.arange(COUNT), np.linspace(0, COUNT, 30), aims)
    acceleration = np.gradient(velocity, CYCLE)
    level = 1.2 + 0.9 * np.exp(-((velocity / 12.0) ** 2))
    tilt = np.sin(0.01 * np.arange(COUNT))
    current = np.sign(velocity) * level + 0.004 * velocity + 0.0008 * acceleration
    current += 0.3 + 0.2 * tilt + noise * rng.normal(size=COUNT)
    time = CYCLE * np.arange(COUNT)
    return DriveSamples(
        time, velocity, current, acceleration, loads={"tilt": tilt, "two": tilt**2}
    )


def laws() -> list[AbstractStructure]:
    knots = default_knots(np.abs(recording().velocity), 6)
    return [
        *(CoulombViscous(way) for way in (False, True)),
        *(Stribeck(way, shape) for way in (False, True) for shape in (2.0, None)),
        *(KnotTable(way, knots) for way in (False, True)),
    ]


def windows(stack: Stack) -> tuple[Lanes, np.ndarray]:
    """Return fits without each fifth of the rows and of all, and where these lie."""
    edges = np.linspace(0, COUNT, 6).astype(int)
    keep = np.ones((6, COUNT), bool)
    spans = [*itertools.pairwise(edges), (0, COUNT)]
    for own, (start, end) in zip(keep[:-1], spans, strict=False):
        own[start:end] = False
    return lanes_of(stack.one.usable, keep), np.array(spans)


def some_weights(lanes: Lanes) -> Shares:
    """Return weights of which some are below 1, the same in all fits."""
    rng = np.random.default_rng(5)
    share = np.where(rng.random(COUNT) < 0.1, rng.random(COUNT), 1.0)
    return Shares(lanes, lanes.use * share)


def scaled(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(found - wanted).max() / max(np.abs(wanted).max(), 1e-300))


KNOWN = [Known(), Known(inertia=0.0008), Known(inertia=0.0008, offset=0.3)]


@pytest.mark.parametrize("law", laws(), ids=lambda law: f"{law.words} {law.shapes}")
@pytest.mark.parametrize("known", KNOWN, ids=["2", "1", "0"])
def test_rows_one_by_one_give_what_matrices_give(
    law: AbstractStructure, known: Known
) -> None:
    samples = recording()
    if known.offset is not None:
        samples = dataclasses.replace(samples, loads={})
    stack = alone(make_problem(samples, law, known, 1))
    lanes, spans = windows(stack)
    shares = some_weights(lanes)
    one, two = PairEquation(stack, lanes), MatrixEquation(stack, lanes)
    weights = np.full(len(lanes), 50.0)
    one, two = one.smoothed(weights), two.smoothed(weights)
    shape = np.tile(np.log([10.0, 1.7][: one.height]), (len(lanes), 1))
    shape += 0.1 * np.arange(len(lanes))[:, None]
    here, there = one.solve(shares, shape), two.solve(shares, shape)
    # Sums of 900 products in another order, with a condition of 1e4 and less.
    close = 1e-9
    used = lanes.use > 0
    assert scaled(here.factors, there.factors) < close
    assert scaled(here.residual[used], there.residual[used]) < close
    # Samples at rest stand in the columns beside friction of the one and not the other.
    law_alone = slice(len(stack.one.fixed_names), None)
    assert (
        scaled(here.linear.size[:, law_alone], there.linear.size[:, law_alone]) < close
    )
    if one.height:
        assert scaled(one.step(here), two.step(there)) < 1e-6  # differences of sums
    columns, others = one.columns(here, 2), two.columns(there, 2)
    assert scaled(columns[used[2]], others[used[2]]) < close
    found = one.held_out(shares, shape[:1], here.factors[:1], spans)
    wanted = two.held_out(shares, shape[:1], there.factors[:1], spans)
    usable = stack.usable
    for own, other in zip(found[:2], wanted[:2], strict=True):
        assert scaled(own[usable], other[usable]) < 1e-7  # one more set of factors


def test_samples_that_are_mixed_or_have_instruments_go_by_matrices() -> None:
    samples, law = recording(), Stribeck()
    mixed = alone(make_problem(samples, law, Known(), 4))
    assert isinstance(equation_of(mixed, mixed.all_rows), MatrixEquation)
    twin = dataclasses.replace(
        samples,
        instrument_velocity=samples.velocity,
        instrument_acceleration=samples.acceleration,
    )
    stack = alone(make_problem(twin, law, Known(), 1))
    assert isinstance(equation_of(stack, stack.all_rows), MatrixEquation)
    assert isinstance(equation_of(stack, stack.all_rows, plain=True), PairEquation)


@pytest.mark.parametrize("way", [False, True])
def test_a_shape_sought_in_sums_is_where_all_rows_would_leave_it(way: bool) -> None:
    stack = alone(make_problem(recording(), Stribeck(way), Known(), 1))
    lanes, _ = windows(stack)
    shares = some_weights(lanes)
    equation = PairEquation(stack, lanes)
    about = np.log([[12.3]])  # 2 % beside the truth
    shape, there = Interpolated(equation, about).shapes(shares)
    assert there.all()
    step = equation.step(equation.solve(shares, shape))
    # Interpolated between eight shapes over ± 0.1: to 1e-10 of a column.
    np.testing.assert_allclose(step, 0.0, atol=1e-8)


@pytest.mark.parametrize("way", [False, True])
def test_a_shape_sought_in_sums_is_the_same_to_the_bit_in_any_company(
    way: bool,
) -> None:
    stack = alone(make_problem(recording(), Stribeck(way), Known(), 1))
    lanes, _ = windows(stack)
    shares = lanes.all_rows()
    sums = Interpolated(PairEquation(stack, lanes), np.log([[12.3]]))
    shape, _ = sums.shapes(shares)
    for lane in range(len(lanes)):
        which = np.array([lane])
        own, _ = sums.take(which).shapes(shares.take(which))
        assert own.tobytes() == shape[which].tobytes()


def test_a_shape_out_of_reach_is_not_claimed_to_be_found() -> None:
    stack = alone(make_problem(recording(), Stribeck(), Known(), 1))
    lanes, _ = windows(stack)
    equation = PairEquation(stack, lanes)
    _, there = Interpolated(equation, np.log([[40.0]])).shapes(lanes.all_rows())
    assert not there.any()


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_what_is_fitted_near_a_shape_does_not_depend_on_it(noise: float) -> None:
    stack = alone(make_problem(recording(noise), Stribeck(), Known(), 1))
    lanes, _ = windows(stack)
    some = lanes.take(np.arange(5))
    (whole,) = separable(PairEquation(stack, stack.all_rows), "trim", certain=False)
    fits = [
        separable(PairEquation(stack, some), "trim", certain=False, about=about[None])
        for about in (whole.shape, whole.shape + 0.02, whole.shape + 3.0)
    ]
    for near, beside, nowhere in zip(*fits, strict=True):
        # Interpolated columns are exact to 1e-10.
        assert scaled(beside.factors, near.factors) < 1e-8
        np.testing.assert_allclose(beside.shape, near.shape, atol=1e-8)
        # Found the long way, which ends where no sample moves by 1e-3 of the noise.
        off = np.abs(nowhere.residual - near.residual).max()
        assert off < 2e-3 * near.loss.scale


@pytest.mark.parametrize("kind", ["noise", "rounded", "zeros", "sorted"])
@pytest.mark.parametrize("count", [1, 2, 3, 8, 501, 1000])
def test_scales_are_medians_and_far_residuals_are_all_found(
    kind: str, count: int
) -> None:
    rng = np.random.default_rng(count)
    residual = rng.normal(size=(20, count))
    if kind == "rounded":
        residual = residual.round(1)
    if kind == "zeros":
        residual[:] = 0.0
    if kind == "sorted":
        residual.sort(axis=1)
    keep = rng.random((20, count)) > 0.2
    keep[:, 0] = True
    lanes = lanes_of(np.ones(count, bool), keep)
    scale = np.empty(20)
    one = np.ones(20)
    lane, row = far_off(residual, lanes, 0.0 * one, one, 2.0, scale)
    wanted = [np.median(np.abs(r[k])) for r, k in zip(residual, keep, strict=True)]
    np.testing.assert_array_equal(scale, wanted)
    far = (np.abs(residual) > 2.0 * scale[:, None]) & keep
    assert list(zip(lane, row, strict=True)) == list(zip(*far.nonzero(), strict=True))


@pytest.mark.slow  # compiles anew, with a look at every index
def test_machine_code_stays_within_its_arrays(tmp_path: Path) -> None:
    script = tmp_path / "laws.py"
    script.write_text(
        "import numpy as np\n"
        "from axcomp.ident.fit.friction import DriveSamples, choose_law, place_knots\n"
        "rng = np.random.default_rng(1)\n"
        "v = np.interp(np.arange(900), np.arange(0, 900, 30),"
        " rng.choice([-1, 0, 1], 30) * np.exp(rng.uniform(0, 5, 30)))\n"
        "i = np.sign(v) * (1.2 + 0.9 * np.exp(-((v / 12) ** 2))) + 0.004 * v\n"
        "i += 0.1 * rng.normal(size=900)\n"
        "i[::90] += 3\n"
        "samples = DriveSamples(0.01 * np.arange(900), v, i, np.gradient(v, 0.01))\n"
        "choice = choose_law(samples, decimate=1)\n"
        "choice.left_out.predicted(choice.fit)\n"
        "speed = np.geomspace(0.1, 100, 150)\n"
        "curve = 1.2 + 0.9 * np.exp(-((speed / 12) ** 2))\n"
        "for entries in (3, 4, 5, 20):\n"
        "    place_knots(speed, curve, 1 + 0 * speed, entries=entries, unit=1e-3)\n"
        "near = speed[:9]\n"
        "place_knots(near, near, 1 + 0 * near, unit=1e-3)\n"
        "print(choice.fit.structure.words)\n"
    )
    tell = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_OPT": "0"}
    tell["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    done = subprocess.run(
        [sys.executable, script],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **tell},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Stribeck")


@pytest.mark.parametrize("law", laws(), ids=lambda law: f"{law.words} {law.shapes}")
def test_friction_of_samples_is_that_of_the_law_of_each(law: AbstractStructure) -> None:
    problem = make_problem(recording(), law, Known(), 1)
    rng = np.random.default_rng(2)
    which = rng.integers(0, 3, COUNT)
    factors = rng.normal(size=(3, len(law.names)))
    shapes = np.log([[8.0, 1.5], [10.0, 2.0], [15.0, 2.5]])[:, : len(law.shapes)]
    found = problem.friction(which, factors, shapes)
    velocity = problem.samples.velocity
    for k in range(3):
        own = which == k
        wanted = law.columns(velocity[own], shapes[k]) @ factors[k]
        # Sums of three products and fewer, in another order.
        np.testing.assert_allclose(found[own], wanted, rtol=1e-12, atol=1e-12)
