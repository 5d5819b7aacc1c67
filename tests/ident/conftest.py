"""Results of jobs that never ran: what a report needs, made from a seed."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from axcomp.data.measurements import iso230
from axcomp.ident.fit import RunEffect, TableEffect, TableFit
from axcomp.ident.job import (
    ConventionState,
    ErrorFigures,
    GateCheck,
    JobResult,
    LoadStep,
    Remark,
    SampleView,
    TableResult,
)

NOISE = 0.002  # mm


def figures(error: np.ndarray, view: SampleView, iso: bool) -> ErrorFigures:
    named = None
    if iso:
        assert view.run is not None
        assert view.direction is not None
        found = iso230(view.positions[:, 0], error, view.run, view.direction)
        named = {key: getattr(found, key) for key in "ARBEM"}
    error = error[~view.wild]
    return ErrorFigures(
        float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()), named
    )


def _named(
    names: tuple[str, ...], values: np.ndarray, shape: tuple[int, ...]
) -> dict[str, np.ndarray]:
    return dict(zip(names, values.reshape(shape), strict=True))


def _fit(
    compensation: str,
    axis: str,
    masters: tuple[str, ...],
    layout: TableEffect,
    truth: np.ndarray,
    view: SampleView,
    support: np.ndarray,
    runs: tuple[RunEffect, ...],
    sign: float,
) -> TableResult:
    rng = np.random.default_rng(5)
    sd = np.where(support > 0, 0.0005 / np.sqrt(np.maximum(support, 1)), 0.004)
    values = truth + sd * rng.normal(size=truth.shape)
    table = TableFit(
        layout=layout,
        values=values,
        standard_deviation=sd,
        support=support,
        noise=NOISE,
        smoothness={"order 2, axis 1": 3.0, "order 4, axis 1": 1.0},
        loss="student",
        residual=view.predicted,
        wild=view.wild,
        runs=runs,
        suspect_nodes=(),
        suspect_runs=(),
        covariance=sp.csr_array((0, 0)),
        converged=True,
        message="Settled after 7 steps.",
    )
    names = ("pos", "neg") if layout.branches == 2 else ("",)
    shaped = values.reshape((len(names), -1)) if layout.branches == 2 else [values]
    entries = {name: sign * part for name, part in zip(names, shaped, strict=True)}
    iso = compensation == "leadscrew"
    return TableResult(
        compensation=compensation,
        axis=axis,
        axis_number=3,
        masters=masters,
        units=("mm",) * len(masters),
        unit="mm",
        limits={},
        nodes=layout.nodes,
        table=entries,
        standard_deviation=dict(
            zip(names, np.reshape(sd, np.shape(shaped)), strict=True)
        ),
        support=dict(zip(names, np.reshape(support, np.shape(shaped)), strict=True)),
        fit=table,
        readings=len(view.before),
        wild=int(view.wild.sum()),
        samples=view,
        error={
            "before": figures(view.before, view, iso),
            "predicted": figures(view.predicted, view, iso),
            "from_file": figures(view.from_file, view, iso),
        },
        rounding=5e-5,
        gate=(
            GateCheck("max_correction", 0.03, 1.0, "mm", True, "at X = 500 mm"),
            GateCheck("max_slope", 4.0, 20.0, "µm/mm", True, "between X = 20 and 30"),
        ),
        remarks=(Remark("info", "An info."), Remark("warning", "A warning.")),
        conventions=(ConventionState("leadscrew_sign", "-1", "assumed", "", "sign"),),
        files=(Path("achskw3.lis"),),
    )


def _view(
    positions: np.ndarray,
    truth: np.ndarray,
    direction: np.ndarray | None,
    run: np.ndarray | None,
) -> SampleView:
    rng = np.random.default_rng(7)
    size = len(positions)
    noise = NOISE * rng.normal(size=size)
    wild = rng.random(size) < 0.01
    before = truth + noise + wild * rng.choice([-0.3, 0.3], size=size)
    left = before - truth
    return SampleView(
        positions=positions,
        direction=direction,
        run=run,
        order=np.arange(size, dtype=float),
        timed=False,
        slices={},
        error=before,
        predicted=left,
        from_file=0.97 * left,
        predicted_sd=np.full(size, NOISE) * (1 + 0.2 * rng.random(size)),
        wild=wild,
    )


def make_leadscrew(count: int = 41, runs: int = 5) -> TableResult:
    nodes = np.linspace(0.0, 800.0, count)
    up = 0.02 * np.sin(nodes / 130) + 5e-5 * nodes
    layout = TableEffect((nodes,), branches=2)
    truth = np.stack([up, up - 0.006])
    run = np.repeat(np.arange(runs), 2 * count)
    direction = np.tile(np.repeat([1, -1], count), runs)
    positions = np.tile(np.concatenate([nodes, nodes[::-1]]), runs)
    error = np.where(
        direction > 0,
        np.interp(positions, nodes, up),
        np.interp(positions, nodes, up) - 0.006,
    )
    support = np.full((2, count), runs)
    support[:, -3:] = 0
    effects = tuple(
        RunEffect(r, 1e-3 * (r - 2), 3e-4, 5e-4 * r, 4e-4) for r in range(runs)
    )
    view = _view(positions[:, None], error, direction, run)
    return _fit("leadscrew", "X", ("X",), layout, truth, view, support, effects, 1.0)


def make_cross(count: int = 33) -> TableResult:
    nodes = np.linspace(0.0, 800.0, count)
    truth = 0.03 * (nodes / 800) * (1 - nodes / 800)
    positions = np.tile(nodes, 4)
    error = np.interp(positions, nodes, truth)
    support = np.full(count, 4)
    view = _view(positions[:, None], error, None, np.repeat(np.arange(4), count))
    return _fit(
        "cross", "Y", ("X",), TableEffect((nodes,)), truth, view, support, (), -1.0
    )


def make_plane(
    columns: int = 33,
    rows: int = 17,
    readings: int = 4000,
    width: float = 800.0,
) -> TableResult:
    rng = np.random.default_rng(3)
    x, y = np.linspace(0, width, columns), np.linspace(0, 400, rows)

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 0.02 * np.sin(u / 150) * np.cos(v / 120) + 2e-5 * u

    positions = rng.uniform([0, 0], [width, 400], (readings, 2))
    hidden = (positions[:, 0] > 620) & (positions[:, 1] > 260)
    positions = positions[~hidden]
    error = surface(positions[:, 0], positions[:, 1])
    i = np.clip(np.searchsorted(x, positions[:, 0]) - 1, 0, columns - 2)
    j = np.clip(np.searchsorted(y, positions[:, 1]) - 1, 0, rows - 2)
    support = np.zeros((rows, columns), dtype=int)
    for dj in (0, 1):
        for di in (0, 1):
            np.add.at(support, (j + dj, i + di), 1)
    truth = surface(*np.meshgrid(x, y))
    layout = TableEffect((x, y))
    view = _view(positions, error, None, None)
    return _fit("plane", "Z", ("X", "Y"), layout, truth, view, support, (), -1.0)


def make_job(*fits: TableResult, **changes: object) -> JobResult:
    job = JobResult(
        title="Portal mill 7",
        machine={"id": "mill-7", "measured_at": "2026-11-20"},
        fits=fits,
        inputs={"probe.csv": "ab" * 32},
        versions={"axcomp": "0.1.0", "python": "3.12"},
        load_sheet=(LoadStep("Copy achskw3.lis", "to the folder of the axis lists."),),
        remarks=(),
        wall_time=1.25,
        job={"title": "Portal mill 7", "fits": [{"axis": "Z"}]},
        digests={"achskw3.lis": "cd" * 32},
    )
    return dataclasses.replace(job, **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def leadscrew() -> Callable[..., TableResult]:
    return make_leadscrew


@pytest.fixture(scope="session")
def cross() -> Callable[..., TableResult]:
    return make_cross


@pytest.fixture(scope="session")
def plane() -> Callable[..., TableResult]:
    return make_plane


@pytest.fixture(scope="session")
def job() -> Callable[..., JobResult]:
    return make_job
