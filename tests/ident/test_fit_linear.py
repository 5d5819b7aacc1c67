"""The fit of a linear stack as a function, and its derivatives."""

from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import axcomp
from axcomp.ident.core import FitError, one_blas_thread
from axcomp.models import Backlash, EquidistantNodes, Leadscrew, Plane, Setpoints

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
    "name", ["plane", pytest.param("ring", marks=pytest.mark.heavy)]
)
def test_derivatives_are_those_of_differences(name: str) -> None:
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


def test_what_readings_do_not_determine_is_refused() -> None:
    few = np.where(PLACE[:, :1] < 10.0, PLACE, 1.0)
    table = TABLES["one direction"]
    with pytest.raises(FitError, match="do not determine the model"):
        fitted(table, few, ERROR, WEIGHT, 0.0)
    assert np.isfinite(fitted(table, few, ERROR, WEIGHT, 1e-3).pos).all()
