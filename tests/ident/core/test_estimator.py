"""The estimator against dense algebra and against the controller's models."""

import subprocess
import sys
from typing import Any
from unittest import mock

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from axcomp.ident.core import (
    ArrowFactor,
    GroupEffect,
    Loss,
    Posterior,
    Problem,
    Readings,
    Stack,
    TableEffect,
    chain,
    choose_loss,
    choose_weights,
    sums_of,
)
from axcomp.ident.core._evidence import _best_of
from axcomp.models import Leadscrew, Plane

EVEN, UNEVEN = np.linspace(-7.0, 60.0, 12), np.cumsum([0.0, *[1.0, 2.5, 4.0] * 3])
TABLES = {
    "line": TableEffect((UNEVEN,), inputs=("x",)),
    "bilateral": TableEffect((EVEN,), 2, inputs=("x",)),
    "ring": TableEffect((np.linspace(0.0, 60.0, 9),), 2, True, inputs=("x",)),
    "plane": TableEffect((np.linspace(0, 60, 5), UNEVEN), inputs=("x", "y")),
    "wide plane": TableEffect((EVEN, UNEVEN[:4]), inputs=("x", "y")),
    "one cell": TableEffect(
        (np.array([0.0, 60.0]), np.array([0.0, 20.0])), inputs=("x", "y")
    ),
}
tables = pytest.mark.parametrize("name", TABLES)
STUDENT = Loss(1.0, 4.0, limit=3.0, wild_from=3.0)
HUBER = Loss(1.0, corner=1.0, wild_from=3.0)


def readings(count: int = 400, seed: int = 0) -> Readings:
    rng = np.random.default_rng(seed)
    inputs = {
        "x": rng.uniform(-10.0, 65.0, count),
        "y": rng.uniform(-2.0, 26.0, count),
        "direction": rng.choice([-1.0, 1.0], count),
        "run": rng.integers(0, 4, count),
        "late": rng.uniform(-0.5, 0.5, count),
    }
    # Some of them on nodes and on the ends of tables.
    inputs["x"][:40] = rng.choice([0.0, 60.0, *EVEN, *UNEVEN], 40)
    return Readings(rng.normal(size=count), inputs)


def stack_of(name: str) -> Stack:
    alike = np.kron(np.eye(2), np.full((4, 1), 0.5))
    return Stack((TABLES[name], GroupEffect(np.ones(4, bool), "late", alike)))


def dense(stack: Stack, given: Readings) -> np.ndarray:
    return np.asarray(stack.matrix(given).toarray())


def precision(stack: Stack, weights: np.ndarray) -> np.ndarray:
    result = np.zeros((stack.size, stack.size))
    for weight, term in zip(weights, stack.terms, strict=True):
        rows = term.rows.toarray()
        result += weight * rows.T @ rows
    return result


@tables
def test_the_design_of_a_table_is_the_look_up_of_the_controller(name: str) -> None:
    table, given = TABLES[name], readings()
    values = np.random.default_rng(1).normal(size=table.size)
    nodes, shares = table.design(given)
    found = (shares * values[nodes]).sum(axis=1)
    array = jnp.asarray(table.to_table(values))
    model: Any = table.model
    if isinstance(model, Plane):
        places = np.column_stack([given.inputs["x"], given.inputs["y"]])
        expected = Plane(model.nodes1, model.nodes2, array).entry(places)
    else:
        pos, neg = (array, None) if table.branches == 1 else (array[0], array[1])
        own = Leadscrew(model.nodes, pos, neg, model.modulo)
        expected = own.entry(given.inputs["x"], given.inputs["direction"])
    # Sums of up to four products of size 1.
    np.testing.assert_allclose(found, expected, atol=1e-14)
    np.testing.assert_array_equal(table.to_values(table.to_table(values)), values)


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_a_reading_on_a_node_supports_that_node_alone(kind: type) -> None:
    # Written "0.3" where the node is 0.1 · 3: next to each other by a rounding.
    table = TableEffect((0.1 * np.arange(21),), inputs=("x",))
    place = np.array([float(f"{0.1 * k:.1f}") for k in range(0, 21, 2)])
    given = Readings(np.zeros(11), {"x": place.astype(kind).astype(float)})
    sums, _ = sums_of(Stack((table,)), given, np.zeros(21), Loss())
    np.testing.assert_array_equal(sums.support, np.arange(21) % 2 == 0)


@tables
@pytest.mark.parametrize("loss", [Loss(), STUDENT, HUBER], ids="gauss t huber".split())
def test_sums_are_those_of_dense_algebra(name: str, loss: Loss) -> None:
    stack, given = stack_of(name), readings()
    theta = np.random.default_rng(2).normal(size=stack.size)
    sums, residual = sums_of(stack, given, theta, loss)
    design = dense(stack, given)
    rest = given.value - design @ theta
    ratio = rest / loss.scale
    active = np.abs(ratio) <= loss.limit
    psi = loss.share(ratio) * rest
    matrix = design.T @ (active[:, None] * design)
    vector = np.random.default_rng(3).normal(size=stack.size)
    # Sums of 400 products of size 1 in another order.
    np.testing.assert_allclose(residual, ratio * loss.scale, atol=1e-13)
    np.testing.assert_allclose(sums.right, design.T @ psi, atol=1e-11)
    np.testing.assert_allclose(sums.apply(vector), matrix @ vector, atol=1e-10)
    np.testing.assert_allclose(sums.diagonal, np.diag(matrix), atol=1e-11)
    good = np.abs(ratio) <= loss.wild_from
    expected = [
        active.sum(), loss.influence(ratio)[1][active].sum(), psi @ psi,
        (rest**2)[good].sum(), good.sum(),
    ]  # fmt: skip
    np.testing.assert_allclose(sums.tally, expected, rtol=1e-12)
    # A thousandth of a node is rounding; other unknowns have any unit.
    least = np.where(np.arange(stack.size) < TABLES[name].size, 1e-3, 0.0)
    read = (np.abs(design) > least) & active[:, None]
    np.testing.assert_array_equal(sums.support, read.sum(0))
    assert sums.histogram.sum() == len(given)


def test_sums_of_pieces_add_up_and_may_be_taken_about_elsewhere() -> None:
    stack, given = stack_of("plane"), readings()
    rng = np.random.default_rng(4)
    theta, other = rng.normal(size=(2, stack.size))
    whole, _ = sums_of(stack, given, theta, Loss())
    first, second = given.take(slice(0, 130)), given.take(slice(130, None))
    parts = [sums_of(stack, part, theta, Loss())[0] for part in (first, second)]
    moved, _ = sums_of(stack, given, other, Loss())
    for found, expected in (
        (parts[0] + parts[1], whole),
        (whole.moved(other - theta), moved),
    ):
        np.testing.assert_allclose(found.right, expected.right, atol=1e-11)
        np.testing.assert_allclose(found.tally[:3], expected.tally[:3], rtol=1e-11)


@pytest.mark.parametrize("points", [(12, 4), (3, 7), (2, 2)])
@pytest.mark.parametrize("loss", [Loss(), STUDENT], ids=["gauss", "t"])
def test_the_loop_over_a_plane_gives_the_sums_of_its_design(
    points: tuple[int, int],
    loss: Loss,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes = tuple(np.linspace(0.0, 60.0, count) for count in points)
    stack, given = Stack((TableEffect(nodes, inputs=("x", "y")),)), readings()
    theta = np.random.default_rng(5).normal(size=stack.size)
    expected, left = sums_of(stack, given, theta, loss)
    monkeypatch.setattr("axcomp.ident.core._sums.MANY", 1)
    found, residual = sums_of(stack, given, theta, loss)
    np.testing.assert_allclose(residual, left, atol=1e-14)
    for part in ("diagonals", "cross", "border", "right", "tally"):
        # The same products, added up in another order.
        one, other = getattr(found, part), getattr(expected, part)
        np.testing.assert_allclose(one, other, atol=1e-11)
    np.testing.assert_array_equal(found.support, expected.support)
    np.testing.assert_array_equal(found.histogram, expected.histogram)


@tables
def test_the_loop_over_sparse_rows_gives_the_products_of_scipy(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack, given = stack_of(name), readings()
    theta = np.random.default_rng(5).normal(size=stack.size)
    expected, _ = sums_of(stack, given, theta, STUDENT)
    design = stack.matrix(given)
    monkeypatch.setattr("axcomp.ident.core._sums.MANY", 1)
    found, _ = sums_of(stack, given, theta, STUDENT, design=design)
    for part in ("diagonals", "cross", "border", "right"):
        # The same products, added up in another order.
        one, other = getattr(found, part), getattr(expected, part)
        np.testing.assert_allclose(one, other, atol=1e-11)
    np.testing.assert_array_equal(found.support, expected.support)


def test_the_loop_over_a_plane_locates_cells_as_the_model_does_bit_for_bit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    table = TableEffect(
        (np.linspace(-40.0, 30.0, 15), -3.0 + 0.7 * np.arange(9)), inputs=("x", "y")
    )
    stack, rng = Stack((table,)), np.random.default_rng(6)
    near = [nodes[rng.integers(0, len(nodes), 500)] for nodes in table.nodes]
    steps = rng.choice([-1e-9, -1e-15, 0.0, 1e-15, 1e-9, 0.3], (2, 500))
    x, y = (n * (1.0 + s) for n, s in zip(near, steps, strict=True))
    given = Readings(np.zeros(500), {"x": x, "y": y})
    # The residual about a unit table is minus the share of that node, to the last bit.
    monkeypatch.setattr("axcomp.ident.core._sums.MANY", 1)
    nodes, shares = table.design(given)
    for node in rng.integers(0, table.size, 40):
        _, residual = sums_of(stack, given, np.eye(table.size)[node], Loss())
        own = np.where(nodes == node, shares, 0.0).sum(axis=1)
        np.testing.assert_array_equal(-residual, own)


@tables
def test_posterior_and_evidence_are_those_of_dense_algebra(name: str) -> None:
    stack, given = stack_of(name), readings()
    rng = np.random.default_rng(7)
    theta = rng.normal(size=stack.size)
    sums, _ = sums_of(stack, given, theta, Loss())
    problem = Problem.of(sums, theta)
    weights = np.exp(rng.normal(0.0, 1.0, len(problem.density)))
    found = problem.at(weights)
    assert found is not None
    design = dense(stack, given)
    prior = precision(stack, weights) + np.diag(problem.held)
    matrix = design.T @ design + prior
    inverse = np.linalg.inv(matrix)
    values = inverse @ (design.T @ given.value)
    left = given.value - design @ values
    # Condition 1e4 at most, and the ridge of 1e-9 on the runs.
    np.testing.assert_allclose(found.values, values, atol=1e-9)
    np.testing.assert_allclose(found.inverse_diagonal, np.diag(inverse), rtol=1e-8)
    assert found.residual_square == pytest.approx(float(left @ left), rel=1e-9)
    total = left @ left + values @ precision(stack, weights) @ values
    rank = np.linalg.eigvalsh(precision(stack, weights))
    stiff = rank[rank > 1e-9 * rank.max()]
    free = len(given) - (stack.size - len(stiff))
    evidence = free * np.log(total) + np.linalg.slogdet(matrix)[1] - np.log(stiff).sum()
    # Log-determinants of 30 unknowns, each to a few roundings times the condition.
    assert found.evidence == pytest.approx(float(evidence), abs=1e-6)
    used = np.trace(inverse @ (matrix - prior))
    assert found.used == pytest.approx(float(used), abs=1e-5)
    rows = Stack(stack.effects[:1]).matrix(given)
    moved: Any = rows @ found.covariance(stack.offsets)
    own = moved.multiply(rows).sum(axis=1)
    table = dense(Stack(stack.effects[:1]), given)
    band = inverse[: stack.band, : stack.band]
    np.testing.assert_allclose(
        own, np.einsum("ti,ij,tj->t", table, band, table), rtol=1e-7
    )
    slopes = found.slopes
    for k, slope in enumerate(slopes):
        ends = []
        for step in (1e-4, -1e-4):
            moved = weights.copy()
            moved[k] *= np.exp(step)
            there: Any = problem.at(moved)
            ends.append(there.evidence)
        # Central differences over 2e-4 of something of size 1e3.
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-4, abs=1e-5)


@pytest.mark.parametrize("ring", [False, True])
@pytest.mark.parametrize("count", [3, 5, 40, 405])
def test_determinant_of_a_chain_is_that_of_its_eigenvalues(
    count: int, ring: bool
) -> None:
    rng = np.random.default_rng(8)
    axis = chain(np.cumsum(rng.uniform(0.5, 1.5, count + ring)), ring)
    for weights in (np.array([1.0, 0.0]), np.array([2.0, 3.0])):
        pairs = zip(weights, axis.rows, strict=True)
        second, fourth = (weight * (rows.T @ rows) for weight, rows in pairs)
        values = np.linalg.eigvalsh((second + fourth).toarray())[axis.free :]
        value = axis.logdet(weights)
        # Dense eigenvalues lose the digits that the condition of the chain takes, here 1e10.
        assert value == pytest.approx(float(np.log(values).sum()), abs=1e-4)


@pytest.mark.parametrize(
    ("band", "width", "beside"), [(700, 70, 12), (900, 5, 0), (0, 1, 40)]
)
def test_a_factor_solves_and_inverts_what_dense_algebra_does(
    band: int, width: int, beside: int
) -> None:
    rng = np.random.default_rng(9)
    size = band + beside
    matrix = np.zeros((size, size))
    for step in range(min(width, band)):
        own = rng.normal(size=band - step) if step else np.full(band, 3.0 * width)
        matrix[np.arange(step, band), np.arange(band - step)] = own
    matrix[band:, :band] = rng.normal(size=(beside, band))
    matrix[band:, band:] = 10.0 * size * np.eye(beside)
    matrix = np.tril(matrix) + np.tril(matrix, -1).T
    columns = np.zeros((band, width))
    for step in range(min(width, band)):
        columns[: band - step, step] = np.diagonal(matrix[:band, :band], -step)
    factor = ArrowFactor.of(columns, matrix[band:, :band].copy(), matrix[band:, band:])
    assert factor is not None
    inverse, right = np.linalg.inv(matrix), rng.normal(size=(size, 20))
    # Condition below 10.
    np.testing.assert_allclose(factor.solve(right), inverse @ right, atol=1e-13)
    np.testing.assert_allclose(
        factor.solve(right[:, 0]), inverse @ right[:, 0], atol=1e-13
    )
    corner = inverse[band:, band:]
    np.testing.assert_allclose(factor.border_inverse, corner, rtol=1e-12, atol=1e-14)
    assert factor.logdet == pytest.approx(
        float(np.linalg.slogdet(matrix)[1]), rel=1e-13
    )
    if band:
        found = factor.selected([0, width - 1])[: band - width + 1, 1]
        expected = np.diagonal(inverse[:band, :band], 1 - width)
        np.testing.assert_allclose(found, expected, atol=1e-14)
        own, diagonal = factor.selected([0])[:, 0], np.diag(inverse)[:band]
        np.testing.assert_allclose(own, diagonal, rtol=1e-12)


def test_parts_that_nothing_couples_are_factorised_as_one_matrix_would_be() -> None:
    rng = np.random.default_rng(11)
    sizes = 250, 1, 300  # together beyond what is looked at as a whole
    mixed = [rng.normal(size=(size, size)) for size in sizes]
    parts = [each @ each.T + 2 * len(each) * np.eye(len(each)) for each in mixed]
    matrix = np.asarray(scipy.linalg.block_diag(*parts))
    right = rng.normal(size=sum(sizes))
    factor = ArrowFactor.of(np.zeros((0, 1)), np.zeros((sum(sizes), 0)), matrix)
    assert factor is not None
    inverse = np.linalg.inv(matrix)
    # Condition below 10.
    np.testing.assert_allclose(factor.border_inverse, inverse, atol=1e-15)
    np.testing.assert_allclose(factor.solve(right), inverse @ right, atol=1e-13)
    assert factor.logdet == pytest.approx(
        float(np.linalg.slogdet(matrix)[1]), rel=1e-13
    )


def test_a_matrix_that_is_not_definite_gives_no_factor() -> None:
    empty = np.zeros((0, 3)), np.zeros((0, 0))
    assert (
        ArrowFactor.of(np.array([[1.0, 2.0], [1.0, 0.0], [1.0, 0.0]]), *empty) is None
    )
    assert ArrowFactor.of(np.zeros((0, 1)), np.zeros((1, 0)), -np.eye(1)) is None


def test_the_weights_found_have_the_best_evidence_of_a_fine_grid() -> None:
    rng = np.random.default_rng(10)
    table = TableEffect((np.linspace(0.0, 60.0, 25),), inputs=("x",))
    x = rng.uniform(0.0, 60.0, 300)
    given = Readings(np.sin(x / 8.0) + 0.1 * rng.normal(size=300), {"x": x})
    sums, _ = sums_of(Stack((table,)), given, np.zeros(25), Loss())
    problem = Problem.of(sums, np.zeros(25))
    best = choose_weights(problem)
    assert best is not None
    grid = [
        found.evidence
        for second in np.geomspace(1e-4, 1e6, 30)
        for fourth in (0.0, *np.geomspace(1e-2, 1e8, 30))
        if (found := problem.at(np.array([second, fourth]) * problem.density))
        is not None
    ]
    # Fourth differences must be worth 2 in twice the log-likelihood.
    assert best.evidence < min(grid) + 2.0


@pytest.mark.parametrize("name", ["student", "huber", "gauss"])
def test_scale_from_counted_residuals_is_that_of_the_residuals(name: str) -> None:
    residual = np.sort(np.abs(np.random.default_rng(11).standard_t(5, 4000)))
    whole = choose_loss(name, residual, 1.1, 1e-9, np.ones(4000, np.int64))
    values, count = np.unique(np.round(residual, 4), return_counts=True)
    binned = choose_loss(name, values, 1.1, 1e-9, count)
    # Rounding to 1e-4 of a scale of 1.
    assert binned.scale == pytest.approx(whole.scale, rel=1e-3)
    assert binned.freedom == whole.freedom


def test_a_small_fit_loads_no_compiler() -> None:
    code = (
        "import sys, numpy as np; from axcomp.ident.fit import *; x = np.linspace(0, 9, 60);"
        "fit_table(TableEffect((np.arange(10.0),)), Samples(x[:, None], np.sin(x)));"
        "assert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_band_without_right_hand_sides_leaves_memory_alone() -> None:
    # LAPACK's triangular solver for bands wrote beyond the end of none at all: a large plane
    # beside a temperature without a lag killed the process. The shapes say that it is not asked.
    band = np.zeros((600, 30))
    band[:, 0] = 2.0
    factor = ArrowFactor.of(band.copy(), np.zeros((2, 600)), np.eye(2))
    assert factor is not None
    with mock.patch("axcomp.ident.core._factor.dtbtrs", side_effect=AssertionError):
        assert factor.solve(np.zeros((602, 0))).shape == (602, 0)


def test_weights_so_stiff_that_nothing_can_go_on_from_them_are_no_start() -> None:
    # Seen on a plane of 1001 × 21 nodes and 10⁶ readings: the inverse overflows.
    posts = {
        weight: mock.NonCallableMock(
            spec=Posterior, evidence=evidence, carried=np.array([carried])
        )
        for weight, evidence, carried in (
            (1.0, 5.0, 3.0),
            (2.0, 1.0, np.nan),
            (4.0, 3.0, 2.0),
        )
    }
    problem = mock.NonCallableMock(spec=Problem, bounds=np.log([[1e-3, 1e3]]))
    problem.at = lambda weights: posts[float(weights[0])]
    found = _best_of(problem, [np.array([weight]) for weight in posts])
    assert found is posts[4.0]
