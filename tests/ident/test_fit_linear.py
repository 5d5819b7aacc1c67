"""The fit of a linear stack as a function, and its derivatives."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest
from jaxtyping import Array, Float

import axcomp
from axcomp.ident._linear_solver import Arrow, ArrowCholesky
from axcomp.ident.core import FitError, one_blas_thread
from axcomp.models import (
    Backlash,
    EquidistantNodes,
    FrictionTable,
    Leadscrew,
    Plane,
    Setpoints,
)

COUNT = 160
RNG = np.random.default_rng(2)
PLACE = RNG.uniform(-3.0, 23.0, (COUNT, 2))
WAY = RNG.choice([-1.0, 1.0], COUNT)
ERROR = RNG.normal(size=COUNT)
WEIGHT = RNG.uniform(0.5, 2.0, COUNT)
EVEN = EquidistantNodes(0.0, 2.0, 11)
TABLES = {
    "plane": Plane.rectangular((0.0, 0.0), (4.0, 2.0), np.zeros((11, 6))),
    "one direction": Leadscrew(EVEN, np.zeros(11)),
    "two directions": Leadscrew(EVEN, np.zeros(11), np.zeros(11)),
    "ring": Leadscrew(EVEN, np.zeros(11), modulo=True),
}
tables = pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)


@pytest.fixture(autouse=True)
def _without_threads() -> Iterator[None]:
    # What is compiled here runs on tiny matrices, which threads of BLAS only slow down.
    with one_blas_thread():
        yield


def predict(table: Any, place: Float[Array, "t 2"]) -> Float[Array, " t"]:
    if isinstance(table, Plane):
        return table.entry(place)
    return table.entry(place[:, 0], jnp.asarray(WAY))


def fitted(table: Any, place: Any, error: Any, weight: Any, smoothness: Any) -> Any:
    return axcomp.fit_linear(
        table, predict, place, error, weights=weight, smoothness=smoothness
    )


def bends(count: int, ring: bool) -> np.ndarray:
    """Return second differences of equidistant nodes."""
    if ring:
        unit = np.eye(count)
        return np.roll(unit, 1, axis=1) - 2.0 * unit + np.roll(unit, -1, axis=1)
    return np.diff(np.eye(count), 2, axis=0)


@tables
def test_the_fit_is_that_of_penalised_least_squares(table: Any) -> None:
    found = fitted(table, PLACE, ERROR, WEIGHT, 0.5)
    ring = isinstance(table, Leadscrew) and table.modulo is not None
    if isinstance(table, Plane):
        stencil, shape = table.stencil(PLACE), (11, 6)
        own = [
            np.kron(bends(11, False), np.eye(6)),
            np.kron(np.eye(11), bends(6, False)),
        ]
    else:
        stencil = table.stencil(PLACE[:, 0], WAY)
        own = [np.kron(np.eye(2 if table.bilateral else 1), bends(11 - ring, ring))]
        shape = (stencil.size,)
    design = np.zeros((COUNT, stencil.size))
    np.add.at(design, (np.arange(COUNT)[:, None], stencil.nodes), stencil.weights)
    if ring:
        design[:, 0] += design[:, -1]
        design = design[:, :-1]
    root = np.sqrt(WEIGHT)
    rows = np.concatenate([root[:, None] * design, *(0.5**0.5 * each for each in own)])
    right = np.concatenate([root * ERROR, np.zeros(len(rows) - COUNT)])
    values = np.linalg.lstsq(rows, right)[0]
    if ring:
        values = np.append(values, values[0])
    # Normal equations against an orthogonal factor: rounding times the condition.
    np.testing.assert_allclose(found.values, values.reshape(shape), atol=1e-10)


@pytest.mark.parametrize(
    ("name", "twice"),
    [
        ("plane", False),
        pytest.param("plane", True, marks=pytest.mark.heavy),
        pytest.param("ring", True, marks=pytest.mark.heavy),
    ],
)
def test_derivatives_are_those_of_differences(name: str, twice: bool) -> None:
    table: Any = TABLES[name]
    pull = jnp.asarray(RNG.normal(size=table.values.shape))

    def number(place: Any, error: Any, weight: Any, smoothness: Any) -> Array:
        return jnp.sum(pull * fitted(table, place, error, weight, smoothness).values)

    at = [jnp.asarray(each) for each in (PLACE, ERROR, WEIGHT, 0.5)]
    push = [jnp.asarray(RNG.normal(size=each.shape)) for each in at]
    slope = jax.jit(lambda at: jax.jvp(number, at, push)[1])
    reverse = jax.jit(jax.grad(number, (0, 1, 2, 3)))(*at)
    along = sum(float(jnp.sum(a * b)) for a, b in zip(reverse, push, strict=True))
    forward = float(slope(at))
    assert forward == pytest.approx(along, rel=1e-9)
    # Small against the distance of any reading from the next node, where slopes jump.
    step = 1e-6
    ends = [[a + s * p for a, p in zip(at, push, strict=True)] for s in (step, -step)]
    value = jax.jit(number)
    change = float(value(*ends[0]) - value(*ends[1])) / (2 * step)
    assert forward == pytest.approx(change, rel=1e-6)
    if not twice:  # the recipes have a second derivative
        return
    bend = jax.jit(lambda at: jax.jvp(lambda *at: slope(list(at)), at, push)[1])
    change = float(slope(ends[0]) - slope(ends[1])) / (2 * step)
    assert float(bend(at)) == pytest.approx(change, rel=1e-6)


def test_a_stack_is_fitted_by_name() -> None:
    stack = {"screw": Leadscrew(Setpoints(np.array([0.0, 7.0, 20.0])), np.zeros(3)),
             "play": Backlash(0.0)}  # fmt: skip
    truth = {"screw": Leadscrew(stack["screw"].nodes, np.array([1.0, -2.0, 3.0])),
             "play": Backlash(0.7)}  # fmt: skip

    def both(stack: Any, place: Any) -> Float[Array, " t"]:
        return stack["screw"].offset(place) + stack["play"].offset(jnp.asarray(WAY))

    place = PLACE[:, 0]
    holes = np.where(np.arange(COUNT) < 5, np.nan, both(truth, place))
    found = axcomp.fit_linear(
        stack, both, place, holes,
        weights=np.isfinite(holes) * 1.0, smoothness={"screw": 0.0},
    )  # fmt: skip
    # Exact data: rounding.
    np.testing.assert_allclose(found["screw"].pos, truth["screw"].pos, atol=1e-10)
    assert float(found["play"].width) == pytest.approx(0.7)
    with pytest.raises(ValueError, match=r"found screws, expected tables \['screw'\]"):
        axcomp.fit_linear(
            stack, both, place, holes, smoothness={"screws": 1.0}, weights=0.0
        )


def test_the_scaling_of_a_friction_table_is_not_fitted_beside_its_entries() -> None:
    speed = np.random.default_rng(1).uniform(2.0, 199.0, 200)
    table = FrictionTable(Setpoints(np.array([1.0, 50.0, 200.0])), np.ones(3), 0.5)
    found = axcomp.fit_linear(table, FrictionTable.__call__, speed, 1.0 + 0.01 * speed)
    # Exact data: rounding.
    np.testing.assert_allclose(found.values, [2.02, 3.0, 6.0], atol=1e-8)
    assert float(found.scaling) == 0.5


def test_what_readings_do_not_determine_is_refused() -> None:
    few = np.where(PLACE[:, :1] < 10.0, PLACE, 1.0)
    table = TABLES["one direction"]
    with pytest.raises(FitError, match="do not determine the model"):
        fitted(table, few, ERROR, WEIGHT, 0.0)
    assert np.isfinite(fitted(table, few, ERROR, WEIGHT, 1e-3).pos).all()


@pytest.mark.other_types
def test_what_is_no_linear_fit_is_refused() -> None:
    table, place = TABLES["one direction"], PLACE[:, 0]

    def along(model: Any, place: Any) -> Any:
        return model.offset(place)

    cases: tuple[tuple[dict[str, Any], str], ...] = (
        ({"smoothness": -1.0}, "smoothness: found -1.0, expected a number of 0 or"),
        ({"smoothness": (1.0, np.nan)}, "smoothness: found nan"),
        ({"solver": "ipopt"}, "solver: found 'ipopt', expected one of lineax"),
        ({"weights": np.ones(3)}, r"weights: found shape \(3,\)"),
    )
    for options, message in cases:
        with pytest.raises(ValueError, match=message):
            axcomp.fit_linear(table, along, place, ERROR, **options)
    with pytest.raises(ValueError, match=r"readings, \(\d+, 1\)"):
        axcomp.fit_linear(table, along, place, ERROR[:, None], smoothness=1.0)
    holes = np.where(place > np.median(place), np.nan, place)
    with pytest.raises(FitError, match="no numbers, expected finite inputs"):
        axcomp.fit_linear(table, along, holes, ERROR, smoothness=1.0)
    with pytest.raises(FitError, match="not linear in the arrays"):
        axcomp.fit_linear(
            jnp.ones(2), lambda m, x: jnp.exp(m[0] * x) + m[1], place / 40.0, ERROR
        )
    with pytest.raises(ValueError, match="make the model outside"):
        jax.jit(
            lambda weight: (
                axcomp.fit_linear(
                    Leadscrew(EquidistantNodes(0.0, 10.0, 5), np.zeros(5)),
                    along,
                    place,
                    ERROR,
                    smoothness=weight,
                ).pos
            )
        )(1.0)


@pytest.mark.other_types
def test_lists_are_arrays_and_pairs() -> None:
    table = TABLES["one direction"]
    lists: Any = (PLACE[:, 0].tolist(), ERROR.tolist(), [0.5, 0.1])
    arrays: Any = (PLACE[:, 0], ERROR, (0.5, 0.1))
    found = [
        axcomp.fit_linear(
            table, lambda m, x: m.offset(x), place, error, smoothness=pair
        )
        for place, error, pair in (lists, arrays)
    ]
    np.testing.assert_array_equal(*(each.pos for each in found))


def large() -> tuple[Any, Any, Any]:
    """Return a stack with a plane so large that it is a band, and readings of it."""
    place = np.random.default_rng(7).uniform(0.0, 40.0, (4000, 2))
    error = np.sin(place[:, 0] / 7.0) * np.cos(place[:, 1] / 11.0)
    plane = Plane.rectangular((0.0, 0.0), (2.0, 1.9), np.zeros((22, 21)))
    return {"plane": plane, "play": jnp.zeros(2)}, place, error


def of_both(stack: Any, place: Any) -> Float[Array, " t"]:
    # What stands beside the plane couples to all of it.
    beside = stack["play"][0] * place[:, 0] ** 2 + stack["play"][1] * place[:, 1] ** 3
    return stack["plane"].entry(place) + beside / 1e4


def test_a_large_table_is_a_band_beside_a_border() -> None:
    stack, place, error = large()
    pull = jnp.asarray(RNG.normal(size=(22, 21)))

    def number(error: Any, weight: Any, place: Any, solver: Any = None) -> Array:
        found = axcomp.fit_linear(
            stack, of_both, place, error, solver=solver,
            smoothness={"plane": (weight, 0.2)}, throw=False,
        )  # fmt: skip
        return jnp.sum(pull * found["plane"].values) + found["play"][0]

    at = jnp.asarray(error), jnp.asarray(0.3), jnp.asarray(place)
    dense = number(*at, lx.Cholesky())
    # Normal equations of a condition of some 1e6, in double precision.
    assert float(number(*at)) == pytest.approx(float(dense), rel=1e-8)
    push = [jnp.asarray(RNG.normal(size=each.shape)) for each in at]
    value, slopes = jax.jit(jax.value_and_grad(number, (0, 1, 2)))(*at)
    along = sum(float(jnp.sum(a * b)) for a, b in zip(slopes, push, strict=True))
    step = 1e-5  # smaller ones see the rounding of the normal equations
    ends = [
        float(number(*(a + s * p for a, p in zip(at, push, strict=True))))
        for s in (step, -step)
    ]
    assert along == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)
    assert float(value) == pytest.approx(float(dense), rel=1e-8)


def test_a_large_table_is_read_one_cell_at_a_time() -> None:
    stack, place, error = large()

    def against_the_corner(stack: Any, place: Any) -> Float[Array, " t"]:
        return stack["plane"].entry(place) - stack["plane"].entry(jnp.ones((1, 2)))[0]

    with pytest.raises(FitError, match="touch several cells of a large table"):
        axcomp.fit_linear(
            stack["plane"], lambda m, x: against_the_corner({"plane": m}, x), place,
            error, smoothness=1.0,
        )  # fmt: skip


def test_the_factor_is_a_solver_of_lineax() -> None:
    n, m, width = 30, 4, 3
    band, cross = RNG.normal(size=(n, width)), RNG.normal(size=(m, n))
    band[:, 0], border = 20.0, 40.0 * np.eye(m)
    for k in range(1, width):
        band[n - k :, k] = 0.0
    arrow = Arrow(jnp.asarray(band), jnp.asarray(cross), jnp.asarray(border))
    dense = np.stack([np.asarray(arrow @ jnp.asarray(unit)) for unit in np.eye(n + m)])
    np.testing.assert_allclose(dense, dense.T, atol=1e-12)
    right = jnp.asarray(RNG.normal(size=n + m))
    operator = lx.MatrixLinearOperator(jnp.asarray(dense), lx.positive_semidefinite_tag)
    for options in ({}, {"matrix": arrow}):
        found = lx.linear_solve(operator, right, ArrowCholesky(), options=options)
        np.testing.assert_allclose(dense @ found.value, right, atol=1e-10)
    many = jax.vmap(lambda b: lx.linear_solve(operator, b, ArrowCholesky()).value)
    both = many(jnp.stack([right, 2.0 * right]))
    np.testing.assert_allclose(both[1], 2.0 * found.value, atol=1e-10)
    bad = lx.MatrixLinearOperator(-jnp.eye(3), lx.positive_semidefinite_tag)
    lost = lx.linear_solve(bad, jnp.ones(3), ArrowCholesky(), throw=False)
    assert lost.result == lx.RESULTS.singular


def test_readings_may_be_constants_of_a_compiled_fit() -> None:
    error, weight = jnp.asarray(ERROR), jnp.asarray(WEIGHT)

    def middle(smoothness: Any) -> Any:
        return fitted(TABLES["plane"], PLACE, error, weight, smoothness).values[5, 3]

    # One rounding of compiled code against another, times the condition of the matrix.
    np.testing.assert_allclose(jax.jit(middle)(0.5), middle(0.5), rtol=1e-10)
