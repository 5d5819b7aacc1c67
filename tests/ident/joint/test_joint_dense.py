"""The joint fit against dense algebra that knows nothing of bands, pins or rules."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from axcomp.ident.fit import Samples, TableEffect, fit_table
from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    JointData,
    Leadscrew,
    Plane,
    fit_joint,
    held_out_errors,
)

from .gauge import in_gauge

NOISE = 5e-4  # mm
SMOOTHNESS = 3.0  # of second differences, relative to 1/noise²


def _rows(effect: Any, weights: Any) -> np.ndarray:
    """Return the rows √weight · differences of one effect's prior over its values."""
    prior: Any = effect.prior
    if prior is None:
        return np.zeros((0, effect.size))
    parts = [
        np.sqrt(weights.get(name, 0.0)) * rows.toarray()
        for name, rows in zip(prior.names, prior.rows, strict=True)
    ]
    return np.vstack(parts)


def _dense(data: JointData, effects: Any, smoothness: Any) -> np.ndarray:
    """Return the fitted sum per reading by one dense least squares problem."""
    blocks = [effect.block(data)[0].toarray() for effect in effects]
    columns = np.asarray(np.hstack([*blocks, np.ones((len(data), 1))]))
    priors = [_rows(effect, smoothness[effect.name]) for effect in effects]
    prior = np.asarray(scipy.linalg.block_diag(*priors, np.zeros((0, 1))))
    target = np.concatenate([data.error["X"], np.zeros(len(prior))])
    found: Any = scipy.linalg.lstsq(np.vstack([columns, prior]), target, cond=1e-13)
    return np.asarray(columns @ found[0])


@pytest.mark.parametrize(
    ("nodes", "many"),
    [(9, 10**5), pytest.param(21, 10**5, marks=pytest.mark.heavy), (21, 1)],
)
def test_the_sum_is_that_of_one_dense_least_squares_problem(
    mixed: Any,
    effects: Any,
    nodes: int,
    many: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # From so many rows on the products are taken by the compiled loop.
    monkeypatch.setattr("axcomp.ident.core._sums.MANY", many)
    case = mixed(2, count=1000, outliers=0.0)
    # 9 × 9 nodes are solved densely, 21 × 21 as a band beside the rest.
    plane = Plane(
        "X", ("X", "Y"), (np.linspace(0, 1000, nodes), np.linspace(0, 500, nodes))
    )
    stack = [each for each in effects() if each.compensation != "plane"] + [plane]
    fit = fit_joint(case.data, stack, loss="gauss")
    smoothness = {part.name: part.smoothness for part in fit.parts}
    reference = _dense(case.data, [part.effect for part in fit.parts], smoothness)
    found = fit.predict(case.data)["X"]
    # Relative to errors of some 0.02 mm; the normal equations square a condition of about 1e3.
    assert np.abs(found - reference).max() < 1e-9 * np.abs(reference).max()


def test_one_leadscrew_alone_is_what_the_table_fit_gives() -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 1000.0, 600)
    error = 0.01 * np.sin(x / 150.0) + rng.normal(0.0, NOISE, 600)
    nodes = np.linspace(0.0, 1000.0, 41)
    data = JointData(position={"X": x}, error={"X": error})
    joint = fit_joint(data, [Leadscrew("X", nodes)])
    alone = fit_table(TableEffect((nodes,)), Samples(x[:, None], error))
    total = joint.parts[0].values + joint.datum["X"][0]
    # Both choose the smoothness by the same evidence, each to within its own tolerance.
    assert np.abs(total - alone.values).max() < 0.3 * alone.standard_deviation.max()
    # The joint fit's deviations leave out that of the constant.
    assert joint.parts[0].standard_deviation == pytest.approx(
        alone.standard_deviation, rel=0.15
    )


def test_deviations_are_those_of_dense_algebra(mixed: Any) -> None:
    case = mixed(3, count=800, outliers=0.0)
    stack: list[AbstractEffect] = [
        Leadscrew("X", np.linspace(0, 1000, 9), bilateral=True),
        Cross("X", master="Y", setpoints=np.linspace(0, 500, 7)),
        Plane("X", ("X", "Y"), (np.linspace(0, 1000, 5), np.linspace(0, 500, 4))),
        Backlash("X"),
    ]
    whole = fit_joint(case.data, stack, loss="gauss")
    # What these effects do not explain has a memory in time; white noise has none.
    noise = np.random.default_rng(1).normal(0.0, whole.noise["X"], 800)
    white = {"X": whole.predict(case.data)["X"] + noise}
    data = dataclasses.replace(case.data, error=white)
    fit = fit_joint(data, stack, loss="gauss", smoothness=SMOOTHNESS)
    effects = [part.effect for part in fit.parts]
    blocks = [effect.block(case.data)[0].toarray() for effect in effects]
    columns = np.hstack([*blocks, np.ones((800, 1))])
    rows = [_rows(part.effect, part.smoothness) for part in fit.parts]
    prior = np.asarray(scipy.linalg.block_diag(*rows, np.zeros((0, 1))))
    whole_matrix = np.vstack([columns, prior])
    # Random errors of the readings and of the prior, moved to the rule one by one.
    rng = np.random.default_rng(0)
    inverse = np.linalg.pinv(whole_matrix, rcond=1e-12)
    sizes = np.cumsum([effect.size for effect in effects])
    moved = []
    for _ in range(400):
        draw = inverse @ rng.normal(size=len(whole_matrix))
        values, datum = in_gauge(
            fit, np.split(draw[:-1], sizes[:-1]), {"X": float(draw[-1])}
        )
        moved.append(np.concatenate([*values, [datum["X"]]]))
    scatter = np.std(moved, axis=0)
    expected = np.concatenate([p.standard_deviation for p in fit.parts])
    unit = fit.noise["X"]
    # 400 draws: 3.5 % each, four of these over 50 values.
    assert scatter[:-1] == pytest.approx(expected / unit, rel=0.17)


def test_a_group_is_left_out_as_if_it_had_never_been_measured(
    mixed: Any, effects: Any
) -> None:
    case = mixed(4, count=1500, outliers=0.0)
    groups = np.arange(1500) // 500
    options: Any = {"loss": "gauss", "smoothness": SMOOTHNESS}
    fit = fit_joint(case.data, effects(), **options)
    left = held_out_errors(fit, groups)["X"]
    found = [part.effect for part in fit.parts]  # with their lags
    for group in range(3):
        use = groups != group
        fold = fit_joint(case.data, found, **options, use=use)
        own = (case.data.error["X"] - fold.predict(case.data)["X"])[~use]
        # Least squares by the same weights: nothing but rounding.
        assert left[~use] == pytest.approx(own, abs=1e-8)
