"""Small tables side by side: the same numbers as alone, and as the thorough way finds."""

import dataclasses

import numpy as np
import pytest

from axcomp.ident.fit import FitError, Samples, TableFit, TableLayout, fit_table
from axcomp.ident.fit._runs import run_design, run_medians
from axcomp.ident.fit._table import _closely, fit_tables
from axcomp.ident.fit.lanes import TableRequest, fit_small

NODES = np.linspace(-20.0, 20.0, 9)
BILATERAL = TableLayout((NODES,), branches=2)
RING = TableLayout((np.linspace(0.0, 360.0, 13),), periodic=True)


def cycles(seed: int, layout: TableLayout = BILATERAL) -> Samples:
    rng = np.random.default_rng(seed)
    nodes = layout.nodes[0]
    there = np.concatenate([nodes, nodes[::-1]])
    branch = np.repeat([0, 1], len(nodes))
    turn = 2.0 * np.pi / np.ptp(nodes)
    error, runs = [], 5
    for _ in range(runs):
        truth = 0.02 * np.sin(turn * there + seed) - 0.004 * branch
        error.append(truth + rng.normal(0, 1e-3) + rng.normal(0, 1.2e-3, len(there)))
    return Samples(
        positions=np.tile(there, runs)[:, None],
        error=np.concatenate(error),
        branch=np.tile(branch, runs) if layout.branches == 2 else None,
        run=np.repeat(np.arange(1, runs + 1), len(there)),
        order=np.tile(np.linspace(0, 1, len(there)), runs),
    )


def assert_equal(one: TableFit, other: TableFit) -> None:
    for name in (
        "values",
        "standard_deviation",
        "support",
        "residual",
        "share",
        "wild",
    ):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for name in ("noise", "smoothness", "runs", "suspect_runs", "message"):
        assert getattr(one, name) == getattr(other, name), name


def test_a_fit_does_not_depend_on_its_company() -> None:
    requests = [
        TableRequest(BILATERAL, cycles(seed), run_effects="drift") for seed in range(20)
    ]
    odd = cycles(3).take(np.arange(90) != 7)
    requests += [
        TableRequest(BILATERAL, odd, run_effects="offset"),
        TableRequest(RING, cycles(1, RING), loss="huber"),
        TableRequest(BILATERAL, cycles(2), smoothness=0.3, loss="gauss"),
    ]
    together = fit_small(requests)
    for request, fit in zip(requests, together, strict=True):
        (alone,) = fit_small([request])
        assert (alone is None) == (fit is None)
        if alone is not None and fit is not None:
            assert_equal(alone, fit)
    assert sum(fit is not None for fit in together) >= 20


@pytest.mark.parametrize("loss", ["student", "huber", "gauss"])
@pytest.mark.parametrize("layout", [BILATERAL, RING], ids=["bilateral", "ring"])
def test_lanes_find_what_the_thorough_way_finds(layout: TableLayout, loss: str) -> None:
    for seed in range(4):
        request = TableRequest(layout, cycles(seed, layout), "auto", loss, "offset")
        (quick,) = fit_small([request])
        assert quick is not None
        slow = _closely(request)
        # Two searches end within a few per cent of the same weights: a table between them
        # moves by a small share of its own uncertainty.
        spread = float(slow.standard_deviation.mean())
        np.testing.assert_allclose(quick.values, slow.values, rtol=0, atol=0.2 * spread)
        assert quick.noise == pytest.approx(slow.noise, rel=0.01)
        assert np.array_equal(quick.support, slow.support)
        assert quick.suspect_runs == slow.suspect_runs


def test_weights_that_are_given_need_no_search_and_agree_closely() -> None:
    request = TableRequest(BILATERAL, cycles(5), 0.5, "gauss", "drift")
    (quick,) = fit_small([request])
    assert quick is not None
    slow = _closely(request)
    # The same equations, solved by another route.
    np.testing.assert_allclose(quick.values, slow.values, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        quick.standard_deviation, slow.standard_deviation, rtol=1e-9
    )


def test_readings_that_need_second_thoughts_take_the_thorough_way() -> None:
    samples = cycles(4)
    error = samples.error.copy()
    error[(samples.positions[:, 0] == 5.0) & (samples.branch == 0)] += 0.5
    spoilt = Samples(samples.positions, error, samples.branch, None, samples.run)
    request = TableRequest(BILATERAL, spoilt)
    assert fit_small([request]) == [None]
    assert_equal(fit_table(BILATERAL, spoilt), _closely(request))


def test_rows_of_shared_readings_are_fitted_as_if_they_had_come_alone() -> None:
    samples = cycles(6)
    assert samples.run is not None
    spatial = samples.positions[:, 0] < 15.0
    chosen = [np.flatnonzero(samples.run != run) for run in (1, 3, 5)]
    chosen += [np.flatnonzero(spatial), np.flatnonzero(samples.run == 2)]
    for effects in ("none", "offset", "drift"):
        shared = [
            TableRequest(BILATERAL, samples, 0.5, "student", effects, True, rows)
            for rows in chosen
        ]
        alone = [
            TableRequest(BILATERAL, samples.take(rows), 0.5, "student", effects, True)
            for rows in chosen
        ]
        for one, other in zip(fit_small(shared), fit_small(alone), strict=True):
            assert one is not None
            assert other is not None
            assert_equal(one, other)


def test_rows_that_cannot_be_fitted_are_refused_in_the_words_of_their_own() -> None:
    samples = cycles(7)
    error = samples.error.copy()
    error[40] = np.nan
    spoilt = dataclasses.replace(samples, error=error)
    good, bad = np.arange(40), np.arange(10, 90)
    fits = [
        TableRequest(BILATERAL, spoilt, 0.5, allow_gaps=True, rows=rows)
        for rows in (good, bad)
    ]
    assert fit_small(fits) == [None, None]
    assert_equal(
        fit_tables(fits[:1])[0],
        _closely(TableRequest(BILATERAL, samples.take(good), 0.5, allow_gaps=True)),
    )
    with pytest.raises(FitError, match="reading 31: error is not finite"):
        fit_tables(fits)


def test_rows_at_one_place_are_refused() -> None:
    samples = cycles(8)
    rows = np.flatnonzero(samples.positions[:, 0] == 5.0)
    request = TableRequest(BILATERAL, samples, 0.5, allow_gaps=True, rows=rows)
    assert fit_small([request]) == [None]
    with pytest.raises(FitError, match="all readings stand at 5 along axis 1"):
        fit_tables([request])


@pytest.mark.parametrize("lost", [0, 7], ids=["of equal length", "of other lengths"])
def test_medians_of_runs_are_those_of_their_values(lost: int) -> None:
    rng = np.random.default_rng(9)
    several = []
    for _ in range(3):
        samples = cycles(1)
        left = samples.take(rng.permutation(90)[: 90 - lost])
        design = run_design(left, "offset")
        assert design is not None
        several.append(design)
    values = rng.normal(size=(3, 90 - lost))
    found = run_medians(several, values)
    for design, own, row in zip(several, values, found, strict=True):
        # Both take the mean of the same two values.
        assert row.tolist() == [
            np.median(own[design.index == run]) for run in range(len(design.labels))
        ]
