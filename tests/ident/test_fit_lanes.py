"""Small tables side by side: the same numbers as alone, and as the thorough way finds."""

import numpy as np
import pytest

from axcomp.ident.fit import Samples, TableFit, TableLayout, fit_table
from axcomp.ident.fit._table import _closely
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
