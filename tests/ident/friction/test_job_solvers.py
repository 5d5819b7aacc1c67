"""Friction jobs that simulate the drive or look at its reversals."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import FrictionResult, JobError, load_job, run_job
from axcomp.models import (
    FrictionCompensation,
    FrictionTable,
    Setpoints,
    StribeckFriction,
)

from ..friction_job import friction_job

# Simulations take longer than a compilation with few optimisations saves.
pytestmark = pytest.mark.usefixtures("optimised")

WRITTEN = "rated_current = 12\ntorque_unit = 0.001\nlevel = 1.0"
"""Keys with which all of the friction becomes a list."""


def write_job(folder: Path, cycle: float, keys: str) -> Path:
    path = folder / "job.toml"
    head = f"[controller]\ncycle_time = {cycle}"
    path.write_text(friction_job(keys, head=head))
    return path


def record(
    folder: Path, cycle: float, position: np.ndarray, current: np.ndarray
) -> None:
    time = cycle * np.arange(len(position))
    table = np.column_stack([time, position, current])
    np.savetxt(folder / "trace.csv", table, "%.9f", ",", header="t,x,i", comments="")


def run(folder: Path, cycle: float, keys: str) -> FrictionResult:
    found = run_job(write_job(folder, cycle, keys), folder / "out").fits[0]
    assert isinstance(found, FrictionResult)
    return found


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        ('solver = "ipopt"', "solver.*expected 'output_error'"),
        ('constraints = ["non-negative"]', "constraints.*expected 'output_error'"),
        (
            'method = "output_error"\nconstraints = ["non-negative"]',
            "constraints.*expected 'ipopt'",
        ),
        ('method = "output_error"\nsolver = "newton"', "solver"),
        (
            'method = "output_error"\nsolver = "ipopt"\nconstraints = ["rising"]',
            "constraints",
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused_before_work(
    tmp_path: Path, keys: str, match: str
) -> None:
    # There is no file to read: nothing but the job has been looked at.
    with pytest.raises(JobError, match=match):
        load_job(write_job(tmp_path, 0.002, keys))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose current comes 12 ms late: forces and positions disagree on a law."""
    folder = tmp_path_factory.mktemp("driven")
    law, step = StribeckFriction(2.0, 3.0, 5.0, 2.0, 0.004), 0.004
    rng = np.random.default_rng(8)
    count = np.arange(100)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1, count / 30))
    speeds = (2.0, 8.0, 16.0, 40.0, 100.0)
    velocity = np.concatenate(
        [way * v * ramp * ramp[::-1] for v in speeds for way in (1, -1)]
    )
    friction = np.asarray(law(velocity))
    current = 0.002 * np.gradient(velocity, step) + friction + 0.3
    late = np.roll(current, 3) + 0.05 * rng.normal(size=velocity.size)
    record(folder, step, np.cumsum(velocity) * step, late)
    return folder


@pytest.fixture(scope="module")
def output(driven: Path) -> FrictionResult:
    """The recording fitted by simulation."""
    return run(driven, 0.004, f'method = "output_error"\n{WRITTEN}')


@pytest.mark.slow
def test_what_is_predicted_follows_the_law_that_output_error_found(
    driven: Path, output: FrictionResult
) -> None:
    inverse = run(driven, 0.004, WRITTEN)
    velocity, moving = output.view.samples.velocity, output.view.samples.in_motion
    laws = [each.view.found.fit.law for each in (inverse, output)]
    assert laws[0] is not None
    assert laws[1] is not None

    def friction(place: int) -> np.ndarray:
        law = laws[place]
        assert law is not None
        return np.asarray(law.evaluate(velocity))[moving]

    # What lists of both leave differs as what they give: the rest is the same current.
    given = [friction(0), friction(1)]
    left = [(r.view.before - r.view.predicted)[moving] for r in (inverse, output)]
    apart, told = left[1] - left[0], given[1] - given[0]
    # Nine tenths of the recording give nearly the law of all of it, not that law itself.
    assert np.std(told) > 0.01
    assert np.corrcoef(apart, told)[0, 1] > 0.8


@pytest.mark.slow
@pytest.mark.heavy  # `test_output_error` compares the solvers, each in less time
def test_ipopt_in_a_job_ends_no_higher_than_optimistix(
    driven: Path, output: FrictionResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Without inequalities both jobs hold windows out by optimistix: once is enough.
    held_out = "axcomp.ident.kinds.friction._law.laws_held_out"
    monkeypatch.setattr(held_out, lambda *_: output.view.found.without)
    second = run(driven, 0.004, 'method = "output_error"\nsolver = "ipopt"')
    assert output.view.found.output is not None
    assert second.view.found.output is not None
    assert second.view.found.law.method == "output error (ipopt)"
    # A current that comes late makes many bottoms: the solvers end in some of them.
    assert second.view.found.output.cost <= 1.05 * output.view.found.output.cost


@pytest.mark.parametrize(
    ("inertia", "line"),
    [(0.5, ""), (0.001, "inertia = 0.001")],
    ids=["fitted inertia", "known small inertia"],
)
def test_reversal_and_list_are_found_with_an_unknown_law(
    tmp_path: Path, inertia: float, line: str
) -> None:
    cycle = 0.001
    knots, out = np.array([1.0, 50.0, 150.0]), np.array([4000.0, 3800.0, 3900.0])
    position = 20.0 * np.sin(2 * np.pi * np.arange(6000) * cycle / 1.2 + 0.3)
    velocity = np.gradient(position, cycle)
    model = FrictionCompensation(FrictionTable(Setpoints(knots), out), 2, 0.008, 3)
    current = np.array(model.run(model.start(), position, velocity)[0])
    record(tmp_path, cycle, position, current + inertia * np.gradient(velocity, cycle))
    keys = f"reversal = true\nrated_current = 12000\ntorque_unit = 0.001\nlevel = 1.0\n{line}"
    found = run(tmp_path, cycle, keys)
    assert found.view.found.reversal is not None
    assert (
        found.view.found.reversal.lookahead,
        found.view.found.reversal.delay_cycles,
    ) == (2, 3)
    # The knots of the fit are not those of the truth.
    assert found.view.found.reversal.position_delay == pytest.approx(0.008, rel=0.01)
    assert found.view.knots is not None
    speed = np.array([0.5, 3.0, 20.0, 50.0, 100.0])
    # A unit of out is 12; the corner at 50 mm/s falls between knots of the fit.
    listed = found.view.knots.current(speed)
    np.testing.assert_allclose(listed, np.interp(speed, knots, out), atol=24.0)
