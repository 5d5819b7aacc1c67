"""Where the nodes of a table lie that nobody has chosen."""

import numpy as np
import pytest

from axcomp.ident.job.table._layout import grid_over, grids_for


def test_targets_become_nodes() -> None:
    places = np.tile(np.arange(20.0, 301.0, 35.0), 6)
    assert grid_over(places) == (20.0, 35.0, 9)


def test_readings_a_little_beside_their_targets_get_these_as_nodes() -> None:
    places = np.tile(np.arange(20.0, 301.0, 35.0), 6)
    beside = np.random.default_rng(0).uniform(-2.0, 2.0, places.size)
    start, interval, points = grid_over(places + beside)
    assert abs(start - 20.0) <= 2.0  # as the readings lie beside the first target
    assert (interval, points) == (35.0, 9)


def test_targets_become_nodes_and_reach_the_limits() -> None:
    places = np.tile(np.arange(20.0, 301.0, 35.0), 6)
    start, interval, points = grid_over(places, (0.0, 310.0), surface=False)
    assert (start, interval) == (-15.0, 35.0)
    assert start + interval * (points - 1) >= 310.0


@pytest.mark.parametrize("surface", [False, True])
def test_a_trace_gets_round_numbers_that_cover_it(surface: bool) -> None:
    places = np.random.default_rng(0).uniform(3.3, 411.7, 4000)
    start, interval, points = grid_over(places, None, surface=surface)
    assert start <= 3.3 < start + interval
    assert start + interval * (points - 2) < 411.7 <= start + interval * (points - 1)
    assert interval == (25.0 if surface else 10.0)


def test_few_readings_get_few_nodes() -> None:
    places = np.random.default_rng(0).uniform(0.0, 100.0, 60)
    start, interval, points = grid_over(places)
    assert points <= 60 // 2 + 2
    assert start <= places.min()
    assert start + interval * (points - 1) >= places.max()


def test_a_plane_has_hardly_more_nodes_than_places_that_were_measured() -> None:
    x, y = np.meshgrid(np.arange(0.0, 161.0, 10.0), np.arange(0.0, 101.0, 10.0))
    kept = np.random.default_rng(0).permutation(x.size)[:120]
    first, second = grids_for(x.ravel()[kept], y.ravel()[kept])
    assert first == (0.0, 20.0, 9)
    assert second == (0.0, 10.0, 11)


def test_a_mesh_with_a_hole_keeps_its_targets_as_nodes() -> None:
    x, y = np.meshgrid(np.arange(0.0, 161.0, 10.0), np.arange(0.0, 101.0, 10.0))
    first, second = grids_for(x.ravel()[1:], y.ravel()[1:])
    assert (first, second) == ((0.0, 10.0, 17), (0.0, 10.0, 11))
