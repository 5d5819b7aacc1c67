"""The Gaussian posterior against dense linear algebra that knows no bands."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg

from axcomp.ident.fit import (
    FitError,
    Samples,
    TableFit,
    TableLayout,
    fit_table,
    predict,
)
from axcomp.ident.fit._band import factorise
from axcomp.ident.fit._chain import ChainPrior
from axcomp.ident.fit._estimate import table_prior
from axcomp.ident.fit._grid import Grid, Located
from axcomp.ident.fit._information import (
    Normal,
    evaluate,
    moment_sums,
    normal_from_moments,
    touched,
    vector_from_moments,
)
from axcomp.ident.fit._posterior import Posterior, solve
from axcomp.ident.fit._prior import Smoothness
from axcomp.ident.fit._problem import Border, Problem

COUNT = 300
UNEVEN = np.cumsum([0.0, 1.5, 2.0, 2.5, 1.0, 2.2, 1.8, 2.0, 1.6, 2.4, 2.0])
LAYOUTS = {
    "plane, master 1 longer": TableLayout((np.arange(9.0) * 2, np.arange(6.0) * 3)),
    "plane, master 2 longer": TableLayout((np.arange(5.0) * 2, UNEVEN[:7])),
    "one direction, uneven": TableLayout((UNEVEN,)),
    "two directions": TableLayout((np.arange(11.0) * 2,), branches=2),
    "ring": TableLayout((UNEVEN,), periodic=True),
    "ring, two directions": TableLayout(
        (np.arange(12.0) * 2,), branches=2, periodic=True
    ),
    "ring of two nodes": TableLayout((np.arange(3.0) * 2,), periodic=True),
    "ring of one node": TableLayout((np.arange(2.0) * 2,), periodic=True),
}
# Sums of 300 readings, solved with condition numbers below 1e4: rounding leaves about 1e-12.
ROUNDING = 1e-10

layouts = pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS.keys())


class Case(NamedTuple):
    """Readings of a layout with run effects, and the same as dense matrices."""

    grid: Grid
    samples: Samples
    located: Located
    runs: np.ndarray
    design: np.ndarray
    smoothness: Smoothness
    precision: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        assert self.samples.weight is not None
        return self.samples.weight


def hats(x: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Weights of linear interpolation with held edges, from NumPy's own interpolation."""
    return np.stack([np.interp(x, nodes, unit) for unit in np.eye(len(nodes))], axis=1)


def differences(nodes: np.ndarray, ring: bool) -> tuple[np.ndarray, np.ndarray]:
    """Second and fourth difference matrices, written down row by row."""
    gaps = np.diff(nodes)
    count = len(gaps) if ring else len(nodes)
    if count < 3:
        return np.zeros((0, count)), np.zeros((0, count))
    mean = gaps.mean()
    middles = range(1, count + 1) if ring else range(1, count - 1)
    bend, share = np.zeros((len(middles), count)), np.zeros(len(middles))
    for row, i in enumerate(middles):
        before, after = gaps[i - 1], gaps[i % len(gaps)]
        width = (before + after) / 2
        bend[row, (i - 1) % count] += mean**2 / before / width
        bend[row, i % count] -= mean**2 * (1 / before + 1 / after) / width
        bend[row, (i + 1) % count] += mean**2 / after / width
        share[row] = width / mean
    second = np.sqrt(share)[:, None] * bend
    inner = np.append(nodes[1:], nodes[-1] + gaps[0]) if ring else nodes[1:-1]
    if len(share) < 3:
        return second, np.zeros((0, count))
    gaps2 = np.diff(inner)
    rows = range(1, count + 1) if ring else range(1, len(share) - 1)
    fourth = np.zeros((len(rows), count))
    for row, i in enumerate(rows):
        before, after = gaps2[i - 1], gaps2[i % len(gaps2)]
        width = (before + after) / 2
        part = mean**2 / before / width * bend[(i - 1) % len(share)]
        part = part - mean**2 * (1 / before + 1 / after) / width * bend[i % len(share)]
        part = part + mean**2 / after / width * bend[(i + 1) % len(share)]
        fourth[row] = np.sqrt(width / mean) * part
    return second, fourth


def make(layout: TableLayout) -> Case:
    rng = np.random.default_rng(5)
    grid = Grid(layout)
    span = [(nodes[0], nodes[-1]) for nodes in layout.nodes]
    # Some outside the table, where its edge is held.
    low, high = np.array(span).T
    positions = rng.uniform(low - 1.0, high + 1.0, (COUNT, len(layout.nodes)))
    branch = rng.integers(0, 2, COUNT) if layout.branches == 2 else None
    weight = rng.uniform(0.5, 2.0, COUNT)
    samples = Samples(positions, rng.normal(size=COUNT), branch, weight)
    # Three runs, effects that sum to zero.
    runs = np.eye(3)[rng.integers(0, 3, COUNT)] @ np.array([[1, 0], [0, 1], [-1, -1.0]])
    weights = ((0.7, 0.3), (1.5, 0.4))
    slow, fast = grid.slow_column, 1 - grid.slow_column
    d2, d4 = differences(layout.nodes[slow], layout.periodic)
    own = weights[0][0] * d2.T @ d2 + weights[0][1] * d4.T @ d4
    if grid.planar:
        along = hats(positions[:, slow], layout.nodes[slow])
        across = hats(positions[:, fast], layout.nodes[fast])
        d2, d4 = differences(layout.nodes[fast], False)
        other = weights[1][0] * d2.T @ d2 + weights[1][1] * d4.T @ d4
        precision = np.kron(own, np.eye(grid.fast)) + np.kron(np.eye(grid.slow), other)
    else:
        x = positions[:, 0]
        if layout.periodic:
            first, last = layout.nodes[0][[0, -1]]
            x = first + np.mod(x - first, last - first)
        along = hats(x, layout.nodes[0])
        if layout.periodic:
            along[:, 0] += along[:, -1]
            along = along[:, :-1]
        across = (
            np.ones((COUNT, 1)) if branch is None else np.eye(2)[branch].astype(float)
        )
        precision = np.kron(own, np.eye(grid.fast))
        weights = (weights[0], (0.0, 0.0))
    design = (along[:, :, None] * across[:, None, :]).reshape(COUNT, -1)
    smoothness = Smoothness(*weights)
    located = grid.locate(samples)
    return Case(grid, samples, located, runs, design, smoothness, precision)


def normal_of(case: Case) -> Normal:
    return normal_from_moments(
        case.grid, moment_sums(case.grid, case.located, case.weight, 2)
    )


def vector_of(case: Case, target: np.ndarray) -> np.ndarray:
    sums = moment_sums(case.grid, case.located, case.weight * target, 1)
    return vector_from_moments(case.grid, sums)


def posterior_of(case: Case) -> Posterior:
    """Solve about a current estimate that is far off, as the iterations do."""
    rng = np.random.default_rng(8)
    shape = (case.grid.slow, case.grid.fast)
    values, effects = rng.normal(size=shape), rng.normal(size=2)
    left = case.samples.error - evaluate(case.grid, case.located, values)
    left = left - case.runs @ effects
    coupling = case.design.T @ (case.weight[:, None] * case.runs)
    border = Border(
        coupling.reshape(*shape, 2),
        case.runs.T @ (case.weight[:, None] * case.runs),
        case.runs.T @ (case.weight * left),
    )
    problem = Problem(
        normal=normal_of(case),
        prior=table_prior(case.grid),
        vector=vector_of(case, left),
        square=float(case.weight @ left**2),
        count=COUNT,
        values=values,
        effects=effects,
        border=border,
    )
    posterior = solve(problem, case.smoothness)
    assert posterior is not None
    return posterior


def dense(case: Case) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Design, matrix and solution of everything at once."""
    both = np.hstack([case.design, case.runs])
    matrix = both.T @ (case.weight[:, None] * both)
    size = case.grid.size
    matrix[:size, :size] += case.precision
    right = both.T @ (case.weight * case.samples.error)
    return both, matrix, np.linalg.solve(matrix, right)


@layouts
def test_stencil_and_sums_are_those_of_linear_interpolation(
    layout: TableLayout,
) -> None:
    case = make(layout)
    values = np.random.default_rng(1).normal(size=(case.grid.slow, case.grid.fast))
    seen = evaluate(case.grid, case.located, values)
    np.testing.assert_allclose(seen, case.design @ values.ravel(), atol=1e-14)
    gram = case.design.T @ (case.weight[:, None] * case.design)
    product = normal_of(case).apply(values)
    np.testing.assert_allclose(product.ravel(), gram @ values.ravel(), atol=ROUNDING)
    vector = vector_of(case, case.samples.error).ravel()
    expected = case.design.T @ (case.weight * case.samples.error)
    np.testing.assert_allclose(vector, expected, atol=ROUNDING)


@layouts
def test_support_counts_the_readings_that_touch_a_node(layout: TableLayout) -> None:
    case = make(layout)
    expected = (case.design > 0).sum(axis=0)
    if case.grid.slow == 1:
        # A ring of one node: each reading comes to it from both ends of the cell.
        expected = touched(case.grid, case.located).ravel()
        assert (expected >= COUNT).all()
    np.testing.assert_array_equal(touched(case.grid, case.located).ravel(), expected)


@layouts
def test_prior_is_the_sum_of_squared_differences(layout: TableLayout) -> None:
    case = make(layout)
    prior = table_prior(case.grid)
    values = np.random.default_rng(2).normal(size=(case.grid.slow, case.grid.fast))
    product = case.precision @ values.ravel()
    applied = prior.apply(case.smoothness, values).ravel()
    # Fourth differences of uneven nodes reach a few hundred.
    np.testing.assert_allclose(applied, product, atol=1e-11)
    penalty = prior.penalty(case.smoothness, values)
    assert penalty == pytest.approx(values.ravel() @ product, rel=1e-12)
    null = case.grid.size - np.linalg.matrix_rank(case.precision)
    assert prior.null == null


@layouts
def test_determinant_of_the_prior_is_that_of_its_eigenvalues(
    layout: TableLayout,
) -> None:
    case = make(layout)
    prior = table_prior(case.grid)
    values = np.linalg.eigvalsh(case.precision)[prior.null :]
    # The smallest eigenvalues of the dense matrix keep ten digits.
    expected = np.log(values).sum()
    assert prior.logdet(case.smoothness) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("ring", [False, True])
def test_shifted_determinant_of_a_chain_is_dense(ring: bool) -> None:
    chain, weights = ChainPrior(UNEVEN, ring), (2.0, 5.0)
    matrix = chain.matrix(weights).toarray() + 3.0 * np.eye(chain.size)
    expected = np.linalg.slogdet(matrix)[1]
    assert chain.logdet_shifted(weights, 3.0) == pytest.approx(expected, rel=1e-12)


@layouts
def test_solution_with_run_effects_is_dense(layout: TableLayout) -> None:
    case = make(layout)
    posterior = posterior_of(case)
    both, matrix, solution = dense(case)
    size = case.grid.size
    np.testing.assert_allclose(posterior.values.ravel(), solution[:size], atol=ROUNDING)
    np.testing.assert_allclose(posterior.effects, solution[size:], atol=ROUNDING)
    residual = case.samples.error - both @ solution
    square = float(case.weight @ residual**2)
    assert posterior.residual_square == pytest.approx(square, rel=1e-10)
    penalty = float(solution[:size] @ case.precision @ solution[:size])
    assert posterior.penalty == pytest.approx(penalty, rel=1e-9, abs=1e-12)
    assert posterior.logdet == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-12)


@layouts
def test_variances_and_effective_parameters_are_dense(layout: TableLayout) -> None:
    case = make(layout)
    posterior = posterior_of(case)
    both, matrix, _ = dense(case)
    inverse = np.linalg.inv(matrix)
    size, fast = case.grid.size, case.grid.fast
    np.testing.assert_allclose(
        posterior.inverse[0, 0].ravel(), np.diag(inverse)[:size], atol=ROUNDING
    )
    for (dl, ds), found in posterior.inverse.items():
        for row in range(case.grid.slow if layout.periodic else case.grid.slow - dl):
            for s in range(max(0, -ds), fast - max(0, ds)):
                other = case.grid.neighbour(np.array([row]), dl)[0] * fast + s + ds
                expected = inverse[row * fast + s, other]
                assert found[row, s] == pytest.approx(expected, abs=ROUNDING)
    used = np.trace(inverse @ (both.T @ (case.weight[:, None] * both)))
    assert posterior.used == pytest.approx(used, rel=1e-10)
    np.testing.assert_allclose(
        posterior.schur_inverse, inverse[size:, size:], atol=ROUNDING
    )


@layouts
def test_evidence_is_the_restricted_likelihood(layout: TableLayout) -> None:
    case = make(layout)
    posterior = posterior_of(case)
    rougher = solve(posterior.problem, Smoothness((0.1, 0.02), (0.3, 0.0)))
    assert rougher is not None
    prior = posterior.problem.prior

    def cost(one: Posterior) -> float:
        free = COUNT - prior.null - 2
        rest = one.residual_square + one.penalty
        return free * float(np.log(rest)) + one.logdet - prior.logdet(one.smoothness)

    # Only differences matter; both are a few hundred.
    difference = posterior.evidence - rougher.evidence
    assert difference == pytest.approx(cost(posterior) - cost(rougher), abs=1e-9)


@layouts
def test_sums_of_parts_add_up_to_the_sum_of_the_whole(layout: TableLayout) -> None:
    case = make(layout)
    early = np.arange(COUNT) < 111
    parts = [
        normal_from_moments(
            case.grid,
            moment_sums(case.grid, case.located.take(keep), case.weight[keep], 2),
        )
        for keep in (early, ~early)
    ]
    whole, added = normal_of(case), parts[0] + parts[1]
    for key, diagonal in whole.diagonals.items():
        np.testing.assert_allclose(added.diagonals[key], diagonal, atol=1e-12)


@pytest.mark.parametrize(
    "layout",
    [
        TableLayout((np.arange(31.0) * 2, np.cumsum([0.0, *[1.0, 2.0] * 8]))),
        TableLayout((np.cumsum([0.0, *[1.0, 2.0] * 12]),)),
        TableLayout((np.arange(25.0) * 3,), branches=2, periodic=True),
    ],
    ids=["plane", "line", "ring"],
)
def test_compiled_sums_are_those_of_numpy(
    layout: TableLayout, monkeypatch: pytest.MonkeyPatch
) -> None:
    from axcomp.ident.fit import _grid, _information

    rng = np.random.default_rng(3)
    count = (
        150_001  # above the limit for compiled code, with a rest that fills no block
    )
    width = float(layout.nodes[0][-1])
    positions = rng.uniform(-5.0, width + 5.0, (count, len(layout.nodes)))
    # On nodes, at both ends and beyond: the search must decide as NumPy's does.
    positions[:1000] = np.round(positions[:1000])
    branch = rng.integers(0, 2, count) if layout.branches == 2 else None
    samples = Samples(positions, rng.normal(size=count), branch)
    grid = Grid(layout)
    values = rng.normal(size=(grid.slow, grid.fast))

    def work() -> tuple[Located, np.ndarray, np.ndarray]:
        located = grid.locate(samples)
        sums = moment_sums(grid, located, samples.error, 2)
        return located, sums, evaluate(grid, located, values)

    located, sums, seen = work()
    for module in (_grid, _information):
        monkeypatch.setattr(module, "MANY", 10**9)
    plain_located, plain_sums, plain_seen = work()
    # A reading at a node may count as the end of one cell or the beginning of the next.
    for found, plain in (
        (located.l + located.u, plain_located.l + plain_located.u),
        (located.s + located.v, plain_located.s + plain_located.v),
    ):
        # Rounding of positions up to 100 by nodes 1 mm apart.
        np.testing.assert_allclose(found, plain, atol=1e-13)
    # Up to 1e4 numbers of size 1 in another order.
    np.testing.assert_allclose(sums, plain_sums, atol=1e-10)
    np.testing.assert_allclose(seen, plain_seen, atol=1e-13)


@pytest.mark.parametrize(("size", "band"), [(1, 0), (7, 2), (60, 5), (150, 13)])
def test_selected_inverse_is_the_inverse(size: int, band: int) -> None:
    rng = np.random.default_rng(size)
    columns = rng.normal(size=(size, band + 1))
    columns[:, 0] = 3.0 * (band + 1)
    for offset in range(1, band + 1):
        columns[size - offset :, offset] = 0.0
    full = scipy.linalg.toeplitz(np.zeros(size))
    for offset in range(band + 1):
        part = np.diag(columns[: size - offset, offset], -offset)
        full += part + (part.T if offset else 0.0)
    factor = factorise(columns.copy())
    assert factor is not None
    inverse = np.linalg.inv(full)
    right = rng.normal(size=(size, 3))
    # Diagonally dominant: condition number below 10.
    np.testing.assert_allclose(factor.solve(right), inverse @ right, atol=1e-13)
    assert factor.logdet == pytest.approx(np.linalg.slogdet(full)[1], rel=1e-13)
    for offset, found in factor.inverse_diagonals(range(band + 1)).items():
        np.testing.assert_allclose(
            found[: size - offset], np.diag(inverse, -offset), atol=1e-14
        )
        assert not found[size - offset :].any()


def test_matrix_that_is_not_definite_gives_no_factor() -> None:
    assert factorise(np.array([[1.0, 2.0], [1.0, 0.0]])) is None


@layouts
def test_predicted_deviation_is_that_of_the_dense_covariance(
    layout: TableLayout,
) -> None:
    case = make(layout)
    samples = dataclasses.replace(case.samples, weight=None)
    fit = fit_table(layout, samples, smoothness=0.8, loss="gauss")
    covariance = _dense_covariance(case, fit)
    mean, deviation = predict(fit, samples.positions, samples.branch)
    values = case.grid.from_table(fit.values).ravel()
    np.testing.assert_allclose(mean, case.design @ values, atol=1e-13)
    expected = np.einsum("ti,ij,tj->t", case.design, covariance, case.design)
    # Deviations are about 0.3.
    np.testing.assert_allclose(deviation, np.sqrt(expected), rtol=1e-8)


def _dense_covariance(case: Case, fit: TableFit) -> np.ndarray:
    d2, _ = differences(case.grid.slow_nodes, case.grid.layout.periodic)
    precision = np.kron(d2.T @ d2, np.eye(case.grid.fast))
    if case.grid.planar:
        d2, _ = differences(case.grid.fast_nodes, False)
        precision += np.kron(np.eye(case.grid.slow), d2.T @ d2)
    matrix = case.design.T @ case.design + 0.8 * precision
    return np.asarray(fit.noise**2 * np.linalg.inv(matrix))


@pytest.mark.parametrize("smoothness", ["auto", 1.0])
def test_readings_on_a_diagonal_do_not_determine_a_plane(
    smoothness: float | str,
) -> None:
    layout = TableLayout((np.arange(5.0), np.arange(4.0)))
    positions = np.stack([np.linspace(0, 4, 50), np.linspace(0, 3, 50)], axis=1)
    # A tilt about the diagonal is seen by nobody and costs no bend.
    samples = Samples(positions, np.sin(positions[:, 0]))
    with pytest.raises(FitError, match="do not determine the table"):
        fit_table(layout, samples, smoothness=smoothness, loss="gauss")
