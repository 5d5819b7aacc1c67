"""Surfaces between tests: grids, triangles, the thin plate, and where they differ."""

import pickle
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator

from axcomp.models import (
    AbstractSurface,
    BilinearGrid,
    DelaunaySurface,
    Setpoints,
    ThinPlateSurface,
    grid_through,
    surface_through,
)

RNG = np.random.default_rng(7)
X, Y = np.meshgrid([0.0, 100.0, 300.0], [-50.0, 0.0, 80.0])
GRID = np.stack([X.reshape(-1), Y.reshape(-1)], axis=1)[RNG.permutation(9)]
LOOSE = GRID + RNG.uniform(-15, 15, GRID.shape)
VALUES = RNG.normal(size=(4, 9))
PLACES = np.stack([RNG.uniform(-60, 360, 300), RNG.uniform(-90, 120, 300)], axis=1)
CORNER = DelaunaySurface.through(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
SURFACES = [
    surface_through(GRID),
    DelaunaySurface.through(LOOSE),
    ThinPlateSurface.through(LOOSE),
]


def filled(places: Any) -> jax.Array:
    """As many places as `PLACES` has, the last one repeated: one compilation for all."""
    missing = PLACES.shape[0] - len(places)
    return jnp.asarray(np.pad(places, ((0, missing), (0, 0)), mode="edge"))


def _values(surface: AbstractSurface, values: Any, at: jax.Array) -> jax.Array:
    rows = jnp.broadcast_to(jnp.asarray(values), (VALUES.shape[0], len(values)))
    branch = jnp.asarray(np.zeros(len(at), dtype=np.int32))
    return surface.evaluate(rows, branch, at)


@jax.jit
def _slopes(surface: AbstractSurface, values: Any, at: jax.Array) -> jax.Array:
    # One sum over all places: places do not act on each other.
    return jax.grad(lambda at: jnp.sum(_values(surface, values, at)))(at)


def values_at(surface: AbstractSurface, values: Any, places: Any) -> jax.Array:
    return _values(surface, values, filled(places))[: len(places)]


def slopes_at(surface: AbstractSurface, values: Any, places: Any) -> jax.Array:
    """Derivative of each value by its own place."""
    return _slopes(surface, np.asarray(values), filled(places))[: len(places)]


def test_tests_in_any_order_are_found_to_be_a_grid() -> None:
    grid = grid_through(GRID)
    assert isinstance(grid, BilinearGrid)
    assert [axis.count for axis in grid.nodes] == [3, 3]
    np.testing.assert_array_equal(grid.points, GRID)
    np.testing.assert_array_equal(values_at(grid, VALUES[0], GRID), VALUES[0])


def test_a_grid_is_bilinear_between_its_tests() -> None:
    square = surface_through(np.array([[1.0, 1], [0, 0], [0, 1], [1, 0]]))
    values = np.array([8.0, 1.0, 2.0, 4.0])
    # At (x, y): 1 + 3x + y + 3xy.
    found = values_at(square, values, [[0.5, 0.5], [0.25, 1.0], [0.5, 0.0]])
    np.testing.assert_allclose(found, [3.75, 3.5, 2.5], rtol=1e-15)


def test_a_grid_holds_its_border() -> None:
    square = surface_through(np.array([[0.0, 0], [0, 1], [1, 0], [1, 1]]))
    found = values_at(square, np.array([1.0, 2, 4, 8]), [[-1.0, 0.5], [5.0, 9.0]])
    np.testing.assert_array_equal(found, [1.5, 8.0])
    covered = square.covers(jnp.array([[0.0, 1.0], [0.5, 1.0 + 1e-9]]))
    np.testing.assert_array_equal(covered, [True, False])


def test_tests_that_form_no_grid_get_triangles() -> None:
    assert grid_through(LOOSE) is None
    assert isinstance(surface_through(LOOSE), DelaunaySurface)


def test_along_one_axis_or_none_tests_always_form_a_grid() -> None:
    line = surface_through(np.array([[2.0], [0.0], [1.0]]))
    found = values_at(line, [9.0, 1.0, 3.0], [[-1.0], [0.5], [1.5], [7.0]])
    np.testing.assert_array_equal(found, [1.0, 2.0, 6.0, 9.0])
    point = surface_through(np.zeros((1, 0)))
    np.testing.assert_array_equal(values_at(point, [5.0], np.zeros((2, 0))), [5.0, 5.0])
    assert bool(point.covers(jnp.zeros((2, 0))).all())
    assert point.points.shape == (1, 0)


def test_triangles_agree_with_scipy_inside() -> None:
    surface = DelaunaySurface.through(LOOSE)
    expected = LinearNDInterpolator(LOOSE, VALUES[0])(PLACES)
    inside = np.isfinite(expected)
    assert 50 < inside.sum() < 250
    np.testing.assert_array_equal(surface.covers(jnp.asarray(PLACES)), inside)
    # Areas of triangles, from products of numbers up to 300.
    np.testing.assert_allclose(
        values_at(surface, VALUES[0], PLACES)[inside],
        expected[inside],
        rtol=0,
        atol=1e-12,
    )


def test_outside_the_triangles_the_nearest_point_is_held() -> None:
    values = np.array([1.0, 2.0, 5.0])
    places = np.array([[-3.0, 0.25], [-1.0, -1.0], [1.0, 1.0], [9.0, -9.0], [1.0, 1.5]])
    nearest = [[0.0, 0.25], [0.0, 0.0], [0.5, 0.5], [1.0, 0.0], [0.25, 0.75]]
    np.testing.assert_allclose(
        CORNER.nearest(filled(places))[:5], nearest, rtol=0, atol=1e-15
    )
    # On the plane 1 + x + 4y.
    expected = [2.0, 1.0, 3.5, 2.0, 4.25]
    found = values_at(CORNER, values, places)
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    assert not CORNER.covers(filled(places)).any()


def test_the_border_has_each_edge_of_the_hull_once() -> None:
    assert set(CORNER.border) == {(0, 1), (0, 2), (1, 2)}
    square = DelaunaySurface.through(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]))
    assert set(square.border) == {(0, 1), (1, 2), (2, 3), (0, 3)}


def test_a_test_on_the_border_makes_no_flat_triangle() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1e-13], [3.0, 0.0], [1.0, 2.0]])
    surface = DelaunaySurface.through(points)
    found = values_at(surface, np.arange(5.0), [[2.0, 0.0], [2.0, -1.0], [1.5, 0.0]])
    np.testing.assert_allclose(found, [2.0, 2.0, 1.5], rtol=0, atol=1e-9)


def test_the_thin_plate_agrees_with_scipy_inside_and_is_held_outside() -> None:
    plate = ThinPlateSurface.through(LOOSE)
    held = np.asarray(plate.region.nearest(jnp.asarray(PLACES)))
    expected = RBFInterpolator(LOOSE, VALUES[0], kernel="thin_plate_spline")(held)
    # Two solutions of a system of 12 equations with a condition of about 1e4.
    found = values_at(plate, VALUES[0], PLACES)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(
        plate.covers(jnp.asarray(PLACES)), plate.region.covers(jnp.asarray(PLACES))
    )


@pytest.mark.parametrize("surface", SURFACES)
def test_every_surface_goes_through_its_tests(surface: AbstractSurface) -> None:
    found = values_at(surface, VALUES[0], surface.points)
    np.testing.assert_allclose(found, VALUES[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("surface", SURFACES)
def test_stencils_give_what_evaluation_gives_and_sum_up_to_one(
    surface: AbstractSurface,
) -> None:
    branch = jnp.asarray(RNG.integers(0, 4, 300), dtype=jnp.int32)
    stencil = surface.stencil(jnp.asarray(PLACES))
    rows = jnp.stack([stencil(jnp.asarray(row)) for row in VALUES])
    found = surface.evaluate(jnp.asarray(VALUES), branch, jnp.asarray(PLACES))
    # The same sums in another order; the thin plate solves its system twice.
    np.testing.assert_allclose(
        found, rows[np.asarray(branch), np.arange(300)], rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(
        jnp.sum(stencil.weights, axis=1), 1.0, rtol=0, atol=1e-11
    )


@pytest.mark.parametrize("surface", SURFACES)
def test_derivatives_by_position_agree_with_finite_differences(
    surface: AbstractSurface,
) -> None:
    slope = slopes_at(surface, VALUES[0], PLACES)
    step = 1e-5
    for axis in (0, 1):
        by = step * np.eye(2)[axis]
        there, here = (
            values_at(surface, VALUES[0], place) for place in (PLACES + by, PLACES - by)
        )
        quotient = (there - here) / (2 * step)
        # Values of 1 and their rounding over the step: 1e-13 / 1e-5; no place lies
        # within a step of a kink.
        np.testing.assert_allclose(slope[:, axis], quotient, rtol=1e-6, atol=3e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    "own",
    # The plate stands on triangles, which hold it outside.
    [pytest.param(SURFACES[1], marks=pytest.mark.heavy), SURFACES[2]],
)
def test_derivatives_by_test_position_agree_with_finite_differences(
    own: AbstractSurface,
) -> None:
    @jax.jit
    def total(points: Any, own: Any) -> jax.Array:
        own = jax.tree.map(lambda _: points, own)
        return jnp.sum(values_at(own, VALUES[0], PLACES) ** 2)

    step = 1e-5
    found = jax.grad(total)(jnp.asarray(LOOSE), own)
    for number in (0, 5):
        by = step * np.eye(9)[number][:, None] * np.array([[1.0, 0.0]])
        there, here = total(LOOSE + by, own), total(LOOSE - by, own)
        # A sum of 300 numbers: 1e-12 / 1e-5.
        np.testing.assert_allclose(
            found[number, 0], (there - here) / (2 * step), rtol=1e-6, atol=1e-6
        )


def test_on_a_common_edge_the_derivative_is_that_of_the_first_triangle() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    values = np.array([0.0, 1.0, 0.0, 5.0])
    for triangles, slope in (
        (((0, 1, 2), (0, 2, 3)), [1.0, -1.0]),
        (((0, 2, 3), (0, 1, 2)), [-5.0, 5.0]),
    ):
        surface = DelaunaySurface(points, triangles)
        found = slopes_at(surface, values, [[0.5, 0.5]])
        np.testing.assert_array_equal(found, [slope])


def test_at_a_corner_outside_nothing_changes() -> None:
    found = slopes_at(CORNER, [1.0, 2.0, 5.0], [[-1.0, -1.0], [-1.0, 0.5]])
    # Beside an edge, only the way along it counts: 4 per mm of y.
    np.testing.assert_allclose(found, [[0.0, 0.0], [0.0, 4.0]], rtol=0, atol=1e-15)


def test_the_thin_plate_has_a_derivative_at_its_tests() -> None:
    plate = SURFACES[2]
    inner = int(np.argmin(np.hypot(*(LOOSE - LOOSE.mean(axis=0)).T)))
    at = LOOSE[[inner]]
    found = slopes_at(plate, VALUES[0], at)
    by = np.array([[1e-4, 0.0]])
    there, here = (
        values_at(plate, VALUES[0], place)[0] for place in (at + by, at - by)
    )
    # Its second derivative has a logarithm there: the quotient is off by h ln h.
    np.testing.assert_allclose(found[0, 0], (there - here) / 2e-4, rtol=1e-5)


@pytest.mark.parametrize("surface", SURFACES)
def test_vmap_over_values_gives_what_a_loop_gives(surface: AbstractSurface) -> None:
    one = lambda row: values_at(surface, row, PLACES)  # noqa: E731
    looped = jnp.stack([one(row) for row in jnp.asarray(VALUES)])
    # The thin plate sums 12 products of up to 100 in another order.
    np.testing.assert_allclose(
        jax.vmap(one)(jnp.asarray(VALUES)), looped, rtol=0, atol=1e-11
    )


@settings(max_examples=60, deadline=None)
@given(
    place=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    step=st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)),
)
def test_linear_surfaces_are_continuous_and_within_the_values_of_their_tests(
    place: tuple[float, float], step: tuple[float, float]
) -> None:
    both = np.array([place, np.add(place, step)])
    for surface in SURFACES[:2]:
        here, there = values_at(surface, VALUES[0], both)
        assert VALUES[0].min() - 1e-11 <= here <= VALUES[0].max() + 1e-11
        # Steepest: a difference of values of 4 over a height of about 5 mm.
        assert abs(here - there) <= 2.0 * np.hypot(*step) + 1e-11


@pytest.mark.parametrize("surface", SURFACES)
def test_surfaces_survive_pickling(surface: AbstractSurface) -> None:
    copy = pickle.loads(pickle.dumps(surface))
    np.testing.assert_array_equal(
        values_at(copy, VALUES[0], PLACES), values_at(surface, VALUES[0], PLACES)
    )


def test_tests_without_a_surface_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one test, got none"):
        surface_through(np.zeros((0, 2)))
    with pytest.raises(
        ValueError, match=r"tests 0 and 2 stand at the same place \(1, 2\) mm"
    ):
        surface_through(np.array([[1.0, 2.0], [3.0, 4.0], [1.0, 2.0]]))
    for count in (2, 5):
        line = np.stack([np.arange(count), 0.1 * np.arange(count)], axis=1)
        with pytest.raises(ValueError, match=f"{count} tests on one line have no"):
            surface_through(line)
    with pytest.raises(ValueError, match=r"each of the 2 tests once, got \(0, 0\)"):
        BilinearGrid((Setpoints(np.array([0.0, 1.0])),), (0, 0))
