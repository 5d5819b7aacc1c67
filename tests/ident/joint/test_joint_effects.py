"""Effects as columns: what the controller's own models say, and what the data lack."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp import models
from axcomp.ident.fit import FitError
from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    Crosstalk,
    Delay,
    JointData,
    Leadscrew,
    Plane,
    Temperature,
    fit_joint,
)
from axcomp.models import (
    Conventions,
    Setpoints,
    TemperatureCurve,
    TemperatureLine,
)

from .gauge import in_gauge

X, Y = np.linspace(0.0, 1000.0, 9), np.array([0.0, 30.0, 200.0, 500.0])


@pytest.fixture(scope="module")
def data() -> JointData:
    rng = np.random.default_rng(0)
    count = 500
    return JointData(
        # Beyond both ends of the tables as well.
        position={
            "X": rng.uniform(-50.0, 1050.0, count),
            "Y": rng.uniform(-50.0, 550.0, count),
        },
        error={"X": np.zeros(count)},
        direction={"X": rng.choice([-1.0, 1.0], count)},
        velocity={"Y": rng.uniform(-100.0, 100.0, count)},
        acceleration={"Y": rng.uniform(-2500.0, 2500.0, count)},
        temperature={"T": rng.uniform(15.0, 30.0, count)},
        time=np.arange(count) / 10.0,
    )


def _curve(effect: AbstractEffect, data: JointData, seed: int = 1) -> Any:
    values = np.random.default_rng(seed).normal(0.0, 0.01, effect.size)
    return effect.block(data)[0] @ values, effect.table(values)


# All of these are sums of a few products in another order: 1e-15 of 0.05 mm.
EXACT = 1e-15


@pytest.mark.parametrize("bilateral", [False, True])
def test_a_leadscrew_is_that_of_the_controller(
    data: JointData, bilateral: bool
) -> None:
    curve, table = _curve(Leadscrew("X", X, bilateral), data)
    nodes = Setpoints(jnp.asarray(X))
    model = (
        models.Leadscrew(nodes, *table) if bilateral else models.Leadscrew(nodes, table)
    )
    expected = model.entry(data.position["X"], data.direction["X"])
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


def test_a_ring_closes(data: JointData) -> None:
    curve, table = _curve(Leadscrew("X", X, modulo=True), data)
    model = models.Leadscrew(Setpoints(jnp.asarray(X)), table, modulo=True)
    expected = np.asarray(model.entry(data.position["X"]))
    assert np.abs(curve - expected).max() < EXACT


def test_a_cross_is_that_of_the_controller(data: JointData) -> None:
    curve, table = _curve(Cross("X", master="Y", setpoints=Y), data)
    expected = models.Cross(Setpoints(jnp.asarray(Y)), table).entry(data.position["Y"])
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


@pytest.mark.parametrize("second", [Y, np.linspace(0.0, 500.0, 12)])
def test_a_plane_is_that_of_the_controller(data: JointData, second: np.ndarray) -> None:
    curve, table = _curve(Plane("X", ("X", "Y"), (X, second)), data)
    nodes = Setpoints(jnp.asarray(X)), Setpoints(jnp.asarray(second))
    places = np.column_stack([data.position["X"], data.position["Y"]])
    expected = models.Plane(*nodes, table).entry(places)
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


@pytest.mark.parametrize("reference", [1, -1])
def test_a_backlash_is_what_the_controller_takes_away(
    data: JointData, reference: int
) -> None:
    curve, width = _curve(Backlash("X", reference), data)
    model = models.Backlash(jnp.asarray(width[0]), reference)
    assert np.abs(curve + np.asarray(model.offset(data.direction["X"]))).max() < EXACT


def test_a_temperature_is_the_line_of_the_controller(data: JointData) -> None:
    law = {
        "offset": np.array([18.0, 22.0, 26.0]),
        "coefficient": np.array([18.0, 26.0]),
    }
    effect = Temperature("X", {"offset": "T", "coefficient": "T"}, 250.0, law=law)
    curve, values = _curve(effect, data)
    parts = effect.split(values)
    model = TemperatureLine(
        250.0,
        TemperatureCurve.of(law["offset"], parts["offset"]),
        TemperatureCurve.of(law["coefficient"], parts["coefficient"]),
    )
    warm = data.temperature["T"][:, None]
    expected = np.asarray(model.entry(data.position["X"], warm))
    # Coefficients of 0.01 mm/mm over 800 mm: 8 mm.
    assert np.abs(curve - expected).max() < 1e-13


@pytest.mark.parametrize("directed", [False, True])
@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_crosstalk_is_that_of_the_controller(
    data: JointData, mode: int, directed: bool
) -> None:
    points = {
        1: None,
        2: np.array([[0.0], [400.0], [1000.0]]),
        3: np.array([[0.0, 0.0], [0.0, 500.0], [1000.0, 0.0], [1000.0, 500.0]]),
    }[mode]
    axes = ("X", "Y")[: mode - 1]
    effect = Crosstalk(
        "X", "Y", 1500.0, -2000.0, axes, points, velocity_dependent=directed
    )
    curve, table = _curve(effect, data)
    model = effect.to_model(table, 1.0)
    places = np.column_stack([data.position[axis] for axis in axes]) if axes else None
    expected = model.entry(data.acceleration["Y"], data.velocity["Y"], places)
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


def test_a_crosstalk_without_entries_of_its_own_for_slowing_down(
    data: JointData,
) -> None:
    rules = Conventions(crosstalk_undirected="accelerate")
    effect = Crosstalk("X", "Y", 1500.0, -2000.0, conventions=rules)
    curve, table = _curve(effect, data)
    assert effect.size == 1
    assert np.ptp(table) == 0.0
    expected = effect.to_model(table, 1.0).entry(
        data.acceleration["Y"], data.velocity["Y"]
    )
    assert not effect.to_model(table, 1.0).own_deceleration
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


def test_direction_of_a_crosstalk_is_that_of_the_axis_that_the_rules_name(
    data: JointData,
) -> None:
    velocity = {**data.velocity, "X": -data.velocity["Y"]}
    data = dataclasses.replace(data, velocity=velocity)
    effect = Crosstalk(
        "X", "Y", 1500.0, -2000.0, velocity_dependent=True,
        conventions=Conventions(crosstalk_velocity="slave"),
    )  # fmt: skip
    curve, table = _curve(effect, data)
    model = effect.to_model(table, 1.0)
    expected = model.entry(data.acceleration["Y"], data.velocity["X"])
    assert np.abs(curve - np.asarray(expected)).max() < EXACT


def test_rows_that_lack_an_input_are_unknown_and_add_nothing(data: JointData) -> None:
    y = data.position["Y"].copy()
    y[::7] = np.nan
    holed = dataclasses.replace(data, position={**data.position, "Y": y})
    columns, known = Cross("X", master="Y", setpoints=Y).block(holed)
    assert not known[::7].any()
    assert known.sum() == np.isfinite(y).sum()
    assert not columns[::7].toarray().any()


def test_nodes_touched_by_the_noise_of_a_position_are_not_measured() -> None:
    rng = np.random.default_rng(2)
    # The axis stands at 0 again and again, and its encoder says −0.002 at times.
    x = np.maximum(rng.uniform(-300.0, 1000.0, 2000), 0.0) + rng.normal(0, 1e-3, 2000)
    y = rng.uniform(0.0, 500.0, 2000)
    error = 0.01 * np.sin(x / 150.0) + rng.normal(0.0, 5e-4, 2000)
    data = JointData(position={"X": x, "Y": y}, error={"X": error})
    nodes = np.arange(-50.0, 1001.0, 50.0)
    plane = Plane("X", ("X", "Y"), (nodes, np.linspace(0.0, 500.0, 11)))
    fit = fit_joint(data, [plane])
    known = fit.parts[0].effect.table(fit.parts[0].determined.astype(float))
    assert not fit.confusions
    assert not known[:, 0].any()
    assert known[:, 1:].all()


def test_a_slow_drift_and_a_temperature_stand_side_by_side(mixed: Any) -> None:
    case = mixed(20, count=3000)
    time = case.data.time
    drift = 0.002 * np.sin(time / 500.0) + 1e-6 * time
    error = case.parts["temperature"] + case.parts["leadscrew"] + drift
    error = error + np.random.default_rng(0).normal(0.0, 5e-4, len(time))
    data = dataclasses.replace(case.data, error={"X": error})
    stack = [
        Leadscrew("X", np.linspace(0.0, 1000.0, 21)),
        Temperature("X", {"offset": "T", "coefficient": "T"}, 200.0, lag=120.0),
    ]
    use = np.arange(3000) % 3 != 0
    fit = fit_joint(data, stack, drift=8, use=use)
    assert not fit.confusions
    part: Any = fit.part("temperature of X (T)")
    away = part.effect.nodes["offset"] - 20.0
    law = np.concatenate([1e-3 * away, 8e-6 * away])
    truth, _ = in_gauge(fit, [np.zeros(21), law])
    # The pieces of the drift follow its bends to a tenth of the noise.
    assert np.abs((part.values - truth[1]) / part.standard_deviation).max() < 5.0
    left = (error - fit.predict(data, runs=True)["X"])[~use]
    assert np.std(left) == pytest.approx(5e-4, rel=0.06)
    assert np.std((error - fit.predict(data)["X"])[~use]) > 6e-4


def test_columns_of_another_length_are_refused() -> None:
    with pytest.raises(FitError, match="error of X: found shape"):
        JointData(position={"X": np.zeros(3)}, error={"X": np.zeros(4)})


def test_a_lag_without_a_clock_is_refused(data: JointData) -> None:
    effect = Temperature("X", {"offset": "T"}, lag="fit")
    with pytest.raises(FitError, match="a lag needs the time"):
        fit_joint(dataclasses.replace(data, time=None), [effect])


def test_three_adaptation_axes_are_refused() -> None:
    with pytest.raises(FitError, match="found 3 adaptation axes, expected two"):
        Crosstalk("X", "Y", 1000.0, -1000.0, ("X", "Y", "Z"))


def test_a_temperature_on_one_axis_leaves_the_runs_of_another() -> None:
    rng = np.random.default_rng(13)
    count, nodes = 2000, np.linspace(0.0, 300.0, 7)
    run, z = rng.integers(0, 5, count), rng.uniform(0.0, 300.0, count)
    away = rng.normal(0.0, 3.0, 5)[run]  # one temperature a run
    screw = 0.003 * np.sin(nodes / 60.0)
    set_up = rng.normal(0.0, 2e-3, 5)[run]
    noise = rng.normal(0.0, 5e-4, (2, count))
    data = JointData(
        position={"X": rng.uniform(0.0, 300.0, count), "Z": z},
        error={
            "X": 1e-3 * away + noise[0],
            "Z": np.interp(z, nodes, screw) + set_up + noise[1],
        },
        temperature={"T": 20.0 + away},
        run=run,
        runs={"X": None},
    )
    fit = fit_joint(
        data,
        [Temperature("X", {"offset": "T"}, 0.0), Leadscrew("Z", nodes)],
    )
    # 2000 readings: relative standard deviation 1/√4000 = 1.6 %, three of them. With the
    # set-ups left in the readings the noise of Z would be 2 µm.
    assert fit.noise["Z"] == pytest.approx(5e-4, rel=0.05)
    left = fit.part("leadscrew of Z").values - screw
    assert np.std(left) < 3 * 5e-4 / np.sqrt(count / len(nodes))
    # The runs of X are what tells its temperature: they stay in.
    law: Any = fit.part("temperature of X (T)")
    warm = fit.predict(data)["X"]
    assert np.polyfit(away, warm, 1)[0] == pytest.approx(1e-3, rel=0.02), law.values


def test_a_delay_needs_no_model_of_the_controller() -> None:
    assert Delay("X").to_model(np.zeros(2), -1.0) is None
