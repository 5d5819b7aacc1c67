"""What data cannot tell apart: named, marked, and no harm to the rest."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.ident.fit.joint import (
    AbstractEffect,
    Backlash,
    Cross,
    Crosstalk,
    Delay,
    JointData,
    JointFit,
    Leadscrew,
    Plane,
    Temperature,
    fit_joint,
)

NOISE = 5e-4  # mm
X, Y = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 500.0, 11)
WARM = Temperature("X", {"offset": "T"})


def _data(seed: int, count: int = 3000, **tables: Any) -> JointData:
    """Return rows at random places with an error over X only; tables are replaced."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.0, 1000.0, count), rng.uniform(0.0, 500.0, count)
    error = 0.01 * np.sin(x / 150.0) + rng.normal(0.0, NOISE, count)
    data = JointData(
        position={"X": x, "Y": y},
        error={"X": error},
        direction={"X": rng.choice([-1.0, 1.0], count)},
        velocity={"Y": rng.uniform(-300.0, 300.0, count)},
        acceleration={"Y": rng.uniform(-1500.0, 1500.0, count)},
        temperature={"T": rng.uniform(18.0, 25.0, count)},
        time=np.linspace(0.0, 1800.0, count),
    )
    return dataclasses.replace(data, **tables)


def _pair(fit: JointFit, *names: str) -> Any:
    found = [each for each in fit.confusions if set(each.effects) == set(names)]
    assert len(found) == 1, [each.sentence for each in fit.confusions]
    return found[0]


def _known(fit: JointFit, name: str) -> bool:
    part = fit.part(name)
    return bool(part.determined.all() and np.isfinite(part.standard_deviation).all())


@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_a_temperature_that_rises_with_the_position(jitter: float) -> None:
    data = _data(1)
    rng = np.random.default_rng(2)
    # 7 K over the axis, 2 s = 2 K of it: a jitter of 0.02 K is 1e-4 of the variance.
    warm = 18.0 + 0.007 * data.position["X"] + rng.normal(0.0, jitter, len(data))
    data = dataclasses.replace(data, temperature={"T": warm})
    fit = fit_joint(
        data, [Leadscrew("X", X), WARM, Cross("X", master="Y", setpoints=Y)]
    )
    pair = _pair(fit, "leadscrew of X", "temperature of X (T)")
    assert abs(pair.correlation) > 0.9998
    assert (
        "the temperature of T changed together with the position of X" in pair.sentence
    )
    assert "Measure the same positions again at another temperature" in pair.sentence
    assert not fit.part("temperature of X (T)").determined.any()
    assert np.isinf(fit.part("temperature of X (T)").standard_deviation).all()
    assert fit.part("leadscrew of X").determined.sum() <= 1  # the middle has no slope
    assert _known(fit, "cross of X over Y")
    # The sum is as good as ever.
    left = fit.predict(data)["X"] - 0.01 * np.sin(data.position["X"] / 150.0)
    assert np.std(left) < 0.3 * NOISE


def test_masters_that_moved_together() -> None:
    data = _data(3)
    x = data.position["X"]
    data = dataclasses.replace(
        data, position={"X": x, "Y": 0.5 * x, "Z": data.position["Y"]}
    )
    stack: list[AbstractEffect] = [
        Leadscrew("X", X),
        Cross("X", master="Y", setpoints=Y),
        Cross("X", master="Z", setpoints=Y),
    ]
    fit = fit_joint(data, stack)
    pair = _pair(fit, "leadscrew of X", "cross of X over Y")
    assert "X and Y moved together. Move each of them while the others stand still" in (
        pair.sentence
    )
    assert fit.part("cross of X over Y").determined.mean() < 0.2
    assert _known(fit, "cross of X over Z")


def test_masters_of_a_plane_that_moved_together() -> None:
    data = _data(4)
    x = data.position["X"]
    data = dataclasses.replace(data, position={"X": x, "Y": 0.5 * x})
    fit = fit_joint(
        data, [Plane("X", ("X", "Y"), (X, Y)), Cross("X", master="Y", setpoints=Y)]
    )
    assert any("moved together" in each.sentence for each in fit.confusions)
    plane = fit.part("plane of X over X and Y")
    # Nodes far from the diagonal were never reached.
    assert plane.table.shape == (11, 21)
    assert not plane.determined.reshape(11, 21)[0, -1]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_one_direction_only(way: float) -> None:
    data = _data(5)
    data = dataclasses.replace(data, direction={"X": np.full(len(data), way)})
    fit = fit_joint(
        data, [Leadscrew("X", X), Backlash("X"), Cross("X", master="Y", setpoints=Y)]
    )
    found = [each for each in fit.confusions if "backlash of X" in each.effects]
    assert len(found) == 1
    assert "both directions" in found[0].sentence
    assert not fit.part("backlash of X").determined.any()
    assert _known(fit, "leadscrew of X")
    assert _known(fit, "cross of X over Y")


def test_one_direction_of_a_bilateral_leadscrew() -> None:
    data = _data(6)
    data = dataclasses.replace(data, direction={"X": np.ones(len(data))})
    fit = fit_joint(data, [Leadscrew("X", X, bilateral=True)])
    known = fit.parts[0].determined.reshape(2, -1)
    assert known[0].all()
    assert not known[1].any()
    assert [each.sentence for each in fit.confusions] == [
        "No reading shows the leadscrew of X in negative direction: measure X in both "
        "directions."
    ]


def test_an_acceleration_that_never_varied() -> None:
    data = _data(7)
    still = np.zeros(len(data))
    stack = [Leadscrew("X", X), Crosstalk("X", "Y", 1000.0, -1000.0)]
    fit = fit_joint(dataclasses.replace(data, acceleration={"Y": still}), stack)
    assert not fit.part("crosstalk of X from Y").determined.any()
    assert any("accelerate and slow down Y" in each.sentence for each in fit.confusions)
    always = dataclasses.replace(data, acceleration={"Y": still + 500.0})
    fit = fit_joint(always, stack)
    pair = _pair(fit, "crosstalk of X from Y", "datum of X")
    assert "the acceleration of Y never varied by itself" in pair.sentence
    assert _known(fit, "leadscrew of X")


def test_a_velocity_of_one_sign() -> None:
    data = _data(8)
    data = dataclasses.replace(data, velocity={"Y": np.abs(data.velocity["Y"])})
    effect = Crosstalk("X", "Y", 1000.0, -1000.0, velocity_dependent=True)
    fit = fit_joint(data, [effect, Leadscrew("X", X)])
    rows = fit.parts[0].determined.reshape(4, -1)
    assert rows[[0, 2]].all()
    assert not rows[[1, 3]].any()
    assert "acceleration in negative direction" in " ".join(
        fit.confusions[0].parameters
    )


@pytest.mark.parametrize("warm", [23.0, 20.0])  # 20 °C: nothing to correct at all
def test_a_temperature_that_never_changed(warm: float) -> None:
    data = _data(9)
    data = dataclasses.replace(data, temperature={"T": np.full(len(data), warm)})
    fit = fit_joint(data, [Leadscrew("X", X), WARM])
    assert not fit.part("temperature of X (T)").determined.any()
    assert any("temperature" in each.sentence for each in fit.confusions)
    assert _known(fit, "leadscrew of X")


def test_runs_that_stood_at_places_of_their_own() -> None:
    data = _data(10)
    run = (data.position["Y"] // 50.0).astype(np.int64)
    place = 50.0 * run + 25.0
    data = dataclasses.replace(
        data, run=run, position={"X": data.position["X"], "Y": place}
    )
    fit = fit_joint(data, [Leadscrew("X", X), Cross("X", master="Y", setpoints=Y)])
    pair = _pair(fit, "cross of X over Y", "runs of X")
    assert "Within each run go to several positions" in pair.sentence
    assert _known(fit, "leadscrew of X")


def test_three_effects_of_which_no_two_are_alike() -> None:
    data = _data(11)
    warm = 18.0 + 0.003 * data.position["X"] + 0.006 * data.position["Y"]
    data = dataclasses.replace(data, temperature={"T": warm})
    fit = fit_joint(
        data, [Leadscrew("X", X), Cross("X", master="Y", setpoints=Y), WARM]
    )
    assert len(fit.confusions) == 1
    assert set(fit.confusions[0].effects) == {part.name for part in fit.parts}
    assert not fit.part("temperature of X (T)").determined.any()


def test_a_drift_that_is_the_temperature() -> None:
    data = _data(12)
    assert data.time is not None
    data = dataclasses.replace(data, temperature={"T": 20.0 + data.time / 600.0})
    fit = fit_joint(data, [Leadscrew("X", X), WARM], drift=1)
    pair = _pair(fit, "temperature of X (T)", "runs of X")
    assert "changed together with the runs (or with the time)" in pair.sentence


def test_a_delay_beside_the_others_frees_them(mixed: Any, effects: Any) -> None:
    case = mixed(13, count=3000)
    rng = np.random.default_rng(0)
    speed = rng.uniform(-200.0, 200.0, 3000)
    data = dataclasses.replace(
        case.data,
        error={"X": case.data.error["X"] - 2e-5 * speed},
        velocity={**case.data.velocity, "X": speed},
    )
    fit = fit_joint(data, [*effects(), Delay("X")])
    delay = fit.part("delay of X")
    # 2e-5 s at 200 mm/s are 4 µm.
    assert abs(delay.values[0] - 2e-5) < 4.0 * delay.standard_deviation[0]
    assert abs(delay.values[1]) < 4.0 * delay.standard_deviation[1]
    assert not fit.confusions


def test_everything_is_told_where_everything_varies(mixed: Any, effects: Any) -> None:
    case = mixed(14, count=3000)
    fit = fit_joint(case.data, effects())
    assert not fit.confusions
    assert all(0.1 < part.share <= 1.0 for part in fit.parts)


def test_the_share_falls_as_two_effects_become_alike() -> None:
    data = _data(15)
    rng = np.random.default_rng(1)
    shares = []
    for jitter in (10.0, 2.0, 0.5):
        warm = 18.0 + 0.007 * data.position["X"] + rng.normal(0.0, jitter, len(data))
        trial = dataclasses.replace(data, temperature={"T": warm})
        shares.append(fit_joint(trial, [Leadscrew("X", X), WARM]).parts[1].share)
    # What the position explains: variance of 7 K / √12 against the jitter.
    expected = [j**2 / (j**2 + 7.0**2 / 12.0) for j in (10.0, 2.0, 0.5)]
    assert shares == pytest.approx(expected, rel=0.2)


def test_a_delay_and_its_rate_are_told_in_a_recording_of_a_day() -> None:
    data = _data(17)
    rng = np.random.default_rng(3)
    speed = rng.uniform(-200.0, 200.0, len(data))
    time = np.linspace(0.0, 86_400.0, len(data))
    late = 2e-5 + 1e-9 * (time - 43_200.0)
    data = dataclasses.replace(
        data,
        error={"X": data.error["X"] - late * speed},
        velocity={**data.velocity, "X": speed},
        time=time,
    )
    fit = fit_joint(data, [Leadscrew("X", X), Delay("X")])
    assert not fit.confusions
    part = fit.part("delay of X")
    away = (part.values - np.array([2e-5, 1e-9])) / part.standard_deviation
    assert np.abs(away).max() < 4.0
    # The sum is the truth: nothing of the delay was moved away.
    left = (
        fit.predict(data)["X"]
        + late * speed
        - 0.01 * np.sin(data.position["X"] / 150.0)
    )
    assert np.std(left) < 0.3 * NOISE
