"""The library's face: the recipes of docs/library.md, and its effects."""

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import axcomp
from axcomp import models
from axcomp.ident.core import FitError
from axcomp.ident.fit import Constraint, Samples, TableEffect, fit_table

RECIPES = Path(__file__).parents[2] / "docs" / "library.md"


def test_the_recipes_run_as_they_stand() -> None:
    found = doctest.testfile(str(RECIPES), module_relative=False)
    assert found.attempted > 50
    assert found.failed == 0


def test_importing_the_library_loads_no_numerical_package() -> None:
    code = (
        "import sys, axcomp; dir(axcomp);"
        "print(*{'jax', 'numpy', 'casadi', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == ""


def test_every_name_of_the_library_is_there() -> None:
    names = dir(axcomp)
    assert {"read", "fit", "fit_model", "Leadscrew", "load_model"} <= set(names)
    assert all(getattr(axcomp, name).__doc__ for name in names)
    with pytest.raises(AttributeError, match="no attribute 'Leadscew'"):
        axcomp.Leadscew  # noqa: B018


def test_a_measurement_is_fitted_as_it_is_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    target = np.tile(np.concatenate([np.arange(6), np.arange(5, -1, -1)]) * 50.0, 4)
    way = np.tile(np.repeat([1.0, -1.0], 6), 4)
    error = 2.0 - 8.0 * (way < 0) + rng.normal(scale=0.5, size=48)
    rows = np.column_stack([target, error, np.repeat(np.arange(4), 12)])
    file = tmp_path / "laser.csv"
    np.savetxt(file, rows, delimiter=",", header="x,dx,run", comments="", fmt="%.4f")
    columns = {"X.position": "x", "X.error": ("dx", "um"), "run": "run"}
    log = axcomp.read(file, columns)
    # The direction is that of the order of the targets.
    fit = axcomp.fit([axcomp.Backlash("X")], log)
    # Two means of 24 readings with 0.5 µm each: 0.15 µm; four of these.
    assert float(fit["backlash"].model.width) == pytest.approx(-0.008, abs=0.0006)
    assert fit["backlash"].standard_deviation.width == pytest.approx(0.00015, rel=0.4)
    assert fit.held_out["X"] == pytest.approx(0.0005, rel=0.4)


def test_what_an_axis_lags_behind_its_command_is_no_error(tmp_path: Path) -> None:
    time = np.arange(0.0, 20.0, 0.005)
    command = 200.0 + 150.0 * np.sin(0.8 * time) + 40.0 * np.sin(2.2 * time)
    scale = command - 0.01 * np.gradient(command, time)
    noise = 1e-5 * np.random.default_rng(5).normal(size=time.size)
    laser = scale + 0.005 * np.sin(scale / 50.0) + noise
    rows = np.column_stack([time, command, scale, laser])
    file = tmp_path / "log.csv"
    np.savetxt(file, rows, delimiter=",", header="t,c,s,l", comments="", fmt="%.6f")
    columns = {"time": "t", "X.position": "c", "X.encoder": "s", "X.actual": "l"}
    table = axcomp.Leadscrew("X", start=20.0, interval=20.0, points=19)
    fit = axcomp.fit([table], axcomp.read(file, columns))
    # The clocks are brought together to some 10 µs, at 150 mm/s; the lag is up to 2 mm.
    np.testing.assert_allclose(
        fit["leadscrew"].model.pos, 0.005 * np.sin(table.nodes / 50.0), atol=1.5e-3
    )


def test_effects_and_datum_are_stated_in_the_words_of_a_job() -> None:
    plane = axcomp.Plane("Z", ("X", "Y"), start=[0, 0], interval=[5, 5], points=[3, 4])
    assert [len(nodes) for nodes in plane.grid] == [3, 4]
    data = along_x(1)
    one, other = (
        axcomp.fit([SCREW], data, datum=at)["leadscrew"].model
        for at in (100.0, {"at": [100.0]})
    )
    np.testing.assert_array_equal(one.pos, other.pos)
    with pytest.raises(FitError, match="datum: found zero, expected at"):
        axcomp.fit([SCREW], data, datum={"zero": 100.0})


@pytest.mark.other_types
@pytest.mark.parametrize(
    ("role", "given", "found"),
    [
        ("X.position", ["a"] * 5, "<U1 of shape (5,)"),
        ("X.error", np.ones((5, 1)), "float64 of shape (5, 1)"),
        ("X.error", 1.0, "float64 of shape ()"),
        ("X.position", np.zeros(0), "float64 of shape (0,)"),
        ("X.error", np.ones(5) + 1j, "complex128 of shape (5,)"),
    ],
)
def test_readings_that_are_no_row_of_numbers_are_refused(
    role: str, given: Any, found: str
) -> None:
    data = {"X.position": np.arange(5.0), "X.error": np.arange(5.0)}
    words = f"{role}: found {found}, expected one number per row"
    with pytest.raises(FitError, match=re.escape(words)):
        axcomp.fit([SCREW], data | {role: given})


def test_models_of_a_fit_take_the_error_off() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0.0, 100.0, (2, 600))
    acceleration = rng.choice([-900.0, 0.0, 900.0], 600)
    velocity = np.where(rng.random(600) < 0.5, -50.0, 50.0)
    law = 0.002 * np.sin(x / 30.0) * y / 100.0
    error = law + 0.003 * (acceleration > 0) + 0.0002 * rng.normal(size=600)
    effects = [
        axcomp.Plane("Z", ("X", "Y"), start=(0, 0), interval=(10, 20), points=(11, 6)),
        axcomp.Crosstalk("Z", "X", acceleration=900.0, deceleration=-900.0),
        axcomp.Cross("W", master="X", setpoints=[0.0, 30.0, 55.0, 100.0]),
    ]
    data = {
        "X.position": x, "Y.position": y, "Z.error": error, "W.error": 1e-4 * x,
        "X.acceleration": acceleration, "X.velocity": velocity,
    }  # fmt: skip
    fit = axcomp.fit(effects, data)
    plane, talk = fit["plane"].model, fit["crosstalk"].model
    left = error + plane.offset(np.column_stack([x, y]))
    left += talk.offset(acceleration, velocity)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(0.0002, rel=0.1)
    assert np.max(np.abs(fit["cross"].model.offset(x) + 1e-4 * x)) < 1e-5
    assert fit["plane"].standard_deviation.values.shape == plane.values.shape


@pytest.mark.other_types
def test_friction_is_fitted_from_the_current() -> None:
    time = np.arange(0.0, 60.0, 0.005)
    velocity = 60.0 * np.sin(2 * np.pi * time / 7.0) + 20.0 * np.sin(time)
    acceleration = np.gradient(velocity, time)
    current = 1.2 * np.sign(velocity) + 0.01 * velocity + 0.002 * acceleration
    current += np.random.default_rng(5).normal(scale=0.02, size=len(time))
    recording = {
        "time": time, "X.velocity": velocity, "X.acceleration": acceleration,
        "X.current": current,
    }  # fmt: skip
    fit = axcomp.fit([axcomp.Friction("X")], recording)
    law = fit["friction"].model
    # One reading scatters by 0.02 A; thousands of them stand behind each speed.
    assert float(law(np.array([40.0]))[0]) == pytest.approx(1.6, abs=0.02)
    with pytest.raises(
        FitError, match=r"X\.current: found one that opposes the motion"
    ):
        axcomp.fit([axcomp.Friction("X")], recording | {"X.current": -current})
    ahead = {name: values[velocity > 0.0] for name, values in recording.items()}
    with pytest.raises(FitError, match="motion in positive direction only"):
        axcomp.fit([axcomp.Friction("X")], ahead)
    with pytest.raises(FitError, match="found active or constraints of it"):
        axcomp.fit(
            [axcomp.Friction("X")], recording, constraints={"friction": ["monotone"]}
        )
    with pytest.raises(FitError, match="inertia: found 'auto', expected 'fit' or"):
        axcomp.Friction("X", inertia="auto")  # type: ignore[arg-type]


def along_x(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = np.tile(np.concatenate([np.arange(9), np.arange(8, -1, -1)]) * 25.0, 5)
    error = 0.005 * np.cos(x / 40.0) + 2e-5 * x + 0.3
    run = np.repeat(np.arange(5), 18)
    return {"X.position": x, "X.error": error + 3e-4 * rng.normal(size=90), "run": run}


SCREW = axcomp.Leadscrew("X", start=0, interval=25, points=9)
NODES = models.EquidistantNodes(0.0, 25.0, 9)


def in_both_directions() -> dict[str, np.ndarray]:
    data = along_x(3)
    way = np.tile(np.repeat([1.0, -1.0], 9), 5)
    error = data["X.error"] - 0.006 * (way < 0)
    return data | {"X.direction": way, "X.error": error}


def test_directions_are_one_and_minus_one_or_words() -> None:
    data, stack = in_both_directions(), [SCREW, axcomp.Backlash("X")]
    way = data["X.direction"]
    forwards = way > 0
    width = axcomp.fit(stack, data)["backlash"].model.width
    assert float(width) == pytest.approx(-0.006, abs=3e-4)
    words = {"X.direction": np.where(forwards, "+", "-")}
    assert float(axcomp.fit(stack, data | words)["backlash"].model.width) == width
    mixed = np.array([None if k == 3 else each for k, each in enumerate(way)], object)
    for given in (way.astype(object), way.astype(str), mixed):
        found = axcomp.fit(stack, data | {"X.direction": given})["backlash"].model.width
        assert float(found) == pytest.approx(float(width), abs=3e-4)
    # Taken for numbers, these would make the backlash twice as wide.
    for wrong, found in ((forwards, "False"), (1 * forwards, "0"), (3 * forwards, "3")):
        with pytest.raises(FitError, match=f"direction: found {found}, expected 1 and"):
            axcomp.fit(stack, data | {"X.direction": wrong})


@pytest.mark.other_types
def test_arrays_may_be_lists_or_of_single_precision() -> None:
    data, stack = in_both_directions(), [SCREW, axcomp.Backlash("X")]
    plain = axcomp.fit(stack, data)
    lists = axcomp.fit(stack, {role: each.tolist() for role, each in data.items()})
    assert np.array_equal(lists["leadscrew"].model.pos, plain["leadscrew"].model.pos)
    short = {role: np.float32(each) for role, each in data.items() if role != "run"}
    single = axcomp.fit(stack, data | short)
    # 0.3 mm in single precision is known to 3e-8 mm.
    assert single["leadscrew"].model.pos == pytest.approx(
        np.asarray(plain["leadscrew"].model.pos), abs=1e-6
    )
    alone = axcomp.fit(axcomp.Backlash("X"), data)  # type: ignore[arg-type]
    assert [*alone] == ["backlash"]


def test_a_table_where_nothing_was_measured_is_refused() -> None:
    beyond = axcomp.Leadscrew("X", start=1000, interval=25, points=9)
    with pytest.raises(FitError, match="at X = 0 to 200, expected some from 1000 to"):
        axcomp.fit([beyond], along_x(0))
    nowhere = along_x(0) | {"X.position": np.full(len(along_x(0)["X.error"]), np.nan)}
    with pytest.raises(FitError, match="at X = NaN, expected some from 1000 to"):
        axcomp.fit([beyond], nowhere)


def test_one_word_is_a_constraint_and_none_is_no_constraint() -> None:
    data = along_x(5)
    words: list[Constraint | list[Constraint]] = ["monotone", ["monotone"], []]
    pos = [
        axcomp.fit([SCREW], data, constraints={"leadscrew": own})["leadscrew"].model.pos
        for own in words
    ]
    np.testing.assert_array_equal(pos[0], pos[1])
    np.testing.assert_array_equal(
        pos[2], axcomp.fit([SCREW], data)["leadscrew"].model.pos
    )


def test_files_are_those_of_the_fit_and_what_was_active_stays(tmp_path: Path) -> None:
    data = along_x(1)
    fit = axcomp.fit([SCREW], data, datum=100.0)
    result = fit.write(tmp_path, axes={"X": {"number": 2, "limits": [0.0, 200.0]}})
    assert result.passed
    written = axcomp.load_model(tmp_path / "achskw2.lis")["leadscrew"]
    # Half a list unit, and the joint fit beside that of one table: a part of σ (0.1 µm).
    np.testing.assert_allclose(
        written.pos, fit["leadscrew"].model.pos, rtol=0, atol=1.5e-4
    )
    assert float(written.offset(np.array([100.0]))[0]) == pytest.approx(0, abs=1e-4)
    value, deviation = fit.datum["X"]
    at_datum = 0.005 * np.cos(2.5) + 2e-5 * 100 + 0.3
    assert value == pytest.approx(at_datum, abs=4 * (deviation + 1e-4))
    # Measured with the list: nothing is left, so the new list is the old one.
    left = data["X.error"] + np.asarray(written.offset(data["X.position"]))
    data = data | {"X.error": left}
    again = axcomp.fit([SCREW], data, active={"leadscrew": written}, datum=100.0)
    np.testing.assert_allclose(
        again["leadscrew"].model.pos, written.pos, rtol=0, atol=2e-4
    )
    result = again.write(tmp_path / "new", lists={2: tmp_path / "achskw2.lis"})
    assert result.passed
    assert result.job["measurements"]["readings"]["active"] == ["leadscrew"]
    newer = axcomp.load_model(tmp_path / "new" / "achskw2.lis")["leadscrew"]
    np.testing.assert_allclose(
        newer.pos, again["leadscrew"].model.pos, rtol=0, atol=1.5e-4
    )
    assert fit.verdict["leadscrew"].startswith("Computed; sign unproven")


@pytest.mark.parametrize("remove", ["none", "offset"])
def test_the_table_holds_the_constant_unless_it_is_the_instruments(
    remove: Literal["none", "offset"],
) -> None:
    data = along_x(1)
    fit = axcomp.fit([SCREW], data, remove=remove)
    corrected = data["X.error"] + fit["leadscrew"].model.offset(data["X.position"])
    # The mean of the errors is 0.3 mm and what the law has over the axis, to 0.1 µm.
    kept = float(np.mean(data["X.error"])) if remove == "offset" else 0.0
    assert np.mean(corrected) == pytest.approx(kept, abs=1e-4)
    assert fit.datum["X"][0] == 0.0


def test_the_slope_of_an_instrument_is_taken_off() -> None:
    data = along_x(2)
    fit = axcomp.fit([SCREW], data, remove="line")
    tilted = data | {"X.error": data["X.error"] + 0.5 + 3e-4 * data["X.position"]}
    again = axcomp.fit([SCREW], tilted, remove="line")
    np.testing.assert_allclose(
        again["leadscrew"].model.pos, fit["leadscrew"].model.pos, rtol=0, atol=1e-9
    )


def test_wild_readings_of_a_few_runs_do_not_fail_the_fit() -> None:
    # Started from least squares, the fit of this seed ends with a node whose readings are
    # all wild: that start is given up, not the fit.
    rng = np.random.default_rng(203)
    place, run = np.tile(np.linspace(-350.0, 150.0, 26), 6), np.repeat(np.arange(6), 26)
    error = 0.004 * np.sin(place / 80.0) + 0.001 * rng.normal(size=6)[run]
    error += 0.0007 * rng.normal(size=156)
    wild = rng.random(156) < 0.05
    way = rng.choice([-1.0, 1.0], wild.sum())
    error[wild] += way * rng.uniform(0.02, 1.0, wild.sum())
    screw = axcomp.Leadscrew("X", setpoints=place[:26])
    fit = axcomp.fit([screw], {"X.position": place, "X.error": error, "run": run})
    # 147 readings tell their noise to 1/√(2·120) = 6 %, twice.
    assert fit.noise["X"] == pytest.approx(0.0007, rel=0.13)


def test_a_table_goes_on_straight_beyond_the_last_reading() -> None:
    # The rule that moves its mean into the datum must not leave a step there.
    rng, nodes = np.random.default_rng(4), np.linspace(0.0, 400.0, 21)
    place = rng.uniform(0.0, 230.0, 300)
    error = 0.02 + 1e-5 * place + 2e-4 * rng.normal(size=300)
    for way in (1.0, -1.0):
        ends = 400.0 * (way < 0) + way * place
        screw = axcomp.Leadscrew("X", setpoints=nodes)
        found = axcomp.fit([screw], {"X.position": ends, "X.error": error})["leadscrew"]
        left = np.asarray(found.model.pos)[:: int(way)] - 0.02 - 1e-5 * nodes
        assert (np.abs(left) < 3.0 * found.standard_deviation.pos[:: int(way)]).all()


def test_the_joint_covariance_is_that_of_repeated_fits() -> None:
    fits = [
        axcomp.fit([SCREW], along_x(k), smoothness=0.0, loss="gauss") for k in range(60)
    ]
    values = np.array([fit["leadscrew"].model.pos for fit in fits])
    stated = np.mean([fit.covariance("leadscrew") for fit in fits], axis=0)
    seen = np.cov(values.T)
    # 60 draws tell a variance to 18 %, and the sum of 9 of them to less than that.
    assert np.trace(seen) == pytest.approx(np.trace(stated), rel=0.3)
    size = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    assert np.abs((seen - stated) / size).max() < 0.7
    with pytest.raises(KeyError):
        fits[0].covariance("cross")


def test_a_table_has_the_deviations_that_it_has_as_a_single_table() -> None:
    rng, nodes = np.random.default_rng(3), np.linspace(0.0, 400.0, 21)
    places = np.tile(nodes, 2)
    error = np.tile(1e-3 * rng.normal(size=21), 2) + 1e-3 * rng.normal(size=42)
    screw = axcomp.Leadscrew("X", start=0, interval=20, points=21)
    fit = axcomp.fit([screw], {"X.position": places, "X.error": error})["leadscrew"]
    alone = fit_table(TableEffect((nodes,)), Samples(places[:, None], error))
    # One estimator by two ways: only rounding stands between them.
    np.testing.assert_allclose(fit.model.pos, alone.values, rtol=0, atol=1e-9)
    spread = fit.standard_deviation.pos
    np.testing.assert_allclose(spread, alone.standard_deviation, rtol=1e-6)


def test_a_table_knows_that_few_runs_do_not_tell_their_mean() -> None:
    rng, nodes = np.random.default_rng(5), np.linspace(0.0, 200.0, 9)
    run, offsets = np.repeat([0, 1, 2], 9), np.array([-4e-3, 1e-3, 3e-3])
    error = offsets[run] + 1e-4 * rng.normal(size=27)
    data = {"X.position": np.tile(nodes, 3), "X.error": error, "run": run}
    screw = axcomp.Leadscrew("X", start=0, interval=25, points=9)
    fit = axcomp.fit([screw], data)
    # The mean of three runs that scatter by 3.6 µm, and Student's t of two degrees.
    common = 3.6e-3 / np.sqrt(3.0) * 4.53 / 2.0
    assert fit["leadscrew"].standard_deviation.pos == pytest.approx(common, rel=0.05)
    covariance = fit.covariance("leadscrew")
    assert covariance == pytest.approx(np.full((9, 9), common**2), rel=0.1)
    # What is the instrument's is no doubt of the machine's table.
    own = axcomp.fit([screw], data, remove="offset")["leadscrew"]
    assert np.max(own.standard_deviation.pos) < 1e-4


def repeated(runs: int, own: np.ndarray, seed: int) -> Any:
    """Return a screw of 21 nodes, run there and back, each with an error of its own as well."""
    rng, nodes = np.random.default_rng(seed), np.linspace(0.0, 400.0, 21)
    place = np.tile(np.concatenate([nodes, nodes[::-1]]), runs)
    error = 0.01 * np.sin(place / 60.0) + own + 5e-4 * rng.normal(size=place.size)
    data = {"X.position": place, "X.error": error, "run": np.repeat(range(runs), 42)}
    screw = axcomp.Leadscrew("X", start=0, interval=20, points=21)
    return axcomp.fit([screw], data)["leadscrew"]


@pytest.mark.parametrize("runs", [5, 20])
def test_slopes_of_runs_leave_the_mean_of_a_table_certain(runs: int) -> None:
    slopes = 1e-3 * np.random.default_rng(8).normal(size=runs)
    line = np.linspace(-1.0, 1.0, 21)
    own = np.outer(slopes, np.concatenate([line, line[::-1]])).ravel()
    found = repeated(runs, own, 9)
    # 0.5 µm in 42 readings per run; as a drift over all of them it was 1.2 µm, however many.
    assert 0.5 < found.common / (5e-4 / np.sqrt(42.0 * runs)) < 4.0
    # The ends err by the mean of the slopes: half to twice that, as runs tell it of themselves.
    ends = np.asarray(found.standard_deviation.pos)[[0, -1]]
    mean = np.std(slopes, ddof=1) / np.sqrt(runs)
    assert np.all((0.5 * mean < ends) & (ends < 2.0 * mean))


def test_a_reference_that_wanders_through_all_runs_leaves_their_mean_uncertain() -> (
    None
):
    walk = 1e-4 * np.random.default_rng(3).normal(size=210).cumsum()
    found = repeated(5, walk, 9)
    # Some 1 µm from its beginning on; what the runs differ by, as if each was by itself, says half.
    assert found.common > 3e-4


@pytest.mark.other_types
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"datum": 300.0}, "found 300, expected 0 to 200"),
        (
            {"remove": "lin"},
            "remove: found 'lin', expected one of 'none', 'offset', 'line",
        ),
        ({"solver": "optimistix"}, "expected one of 'factor', 'ipopt'"),
        ({"datum": [1.0, 2.0]}, "expected a table alone"),
        ({"active": {"cross": None}}, "found cross among active"),
        ({"constraints": {"leadscrew": abs}, "solver": "factor"}, "solver='ipopt'"),
        ({"constraints": abs}, "expected them by name"),
        (
            {"constraints": {"leadscrew": lambda m: jnp.diff(m.pos) > 0}},
            "found truth values",
        ),
        ({"drift": -1}, "drift: found -1, expected a whole number of 0 or more"),
        ({"drift": "auto"}, "drift: found 'auto'"),
        ({"drift": 2.5}, "drift: found 2.5"),
        ({"smoothness": None}, "smoothness: found None, expected 'auto' or a number"),
        (
            {"active": {"leadscrew": models.Backlash(0.1)}},
            "active: found a Backlash as leadscrew, expected a Leadscrew",
        ),
        (
            {"active": {"leadscrew": models.Leadscrew(NODES, np.ones(9), -np.ones(9))}},
            "of two directions, of which one would be lost",
        ),
    ],
)
def test_options_that_do_not_fit_together_are_refused(
    options: dict[str, object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        axcomp.fit([SCREW], along_x(0), **options)  # type: ignore[arg-type]


@pytest.mark.other_types
def test_files_need_the_numbers_of_the_axes(tmp_path: Path) -> None:
    fit = axcomp.fit([SCREW], along_x(0))
    with pytest.raises(FitError, match="found no number of X"):
        fit.write(tmp_path)
    for axes in (["X"], {"X": "1"}, {"X": 1.0}):
        with pytest.raises(FitError, match=r"axes: found .*, expected numbers or keys"):
            fit.write(tmp_path, axes=axes)  # type: ignore[arg-type]
    number: Any = np.int64(1)
    assert fit.write(tmp_path, axes={"X": number}).files[0].name == "achskw1.lis"
    with pytest.raises(FitError, match="lists: found axis 3"):
        fit.write(tmp_path, lists={3: "a.lis"}, axes={"X": 1})


def test_a_backlash_alone_is_written_with_the_places_that_its_fit_did_not_need(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(24)
    x = np.tile(np.r_[0.0:401.0:40.0, 400.0:-1.0:-40.0], 5)
    way = np.tile(np.repeat([1.0, -1.0], 11), 5)
    error = -7e-3 * (way < 0) + 3e-4 * rng.standard_normal(len(x))
    data = {"X.position": x, "X.error": error, "X.direction": way}
    result = axcomp.fit([axcomp.Backlash("X")], data).write(tmp_path, axes={"X": 1})
    assert result.passed
    assert "lose" in (tmp_path / "achsmds1.add.lis").read_text()


def test_what_no_write_has_made_is_not_written_over(tmp_path: Path) -> None:
    fit = axcomp.fit([SCREW], in_both_directions())
    job = tmp_path / "job.toml"
    fit.write(tmp_path, axes={"X": 1})
    fit.write(tmp_path, axes={"X": 2})  # over its own
    job.write_text("# mine\n" + job.read_text())
    mine = job.read_bytes()
    with pytest.raises(
        FitError, match=r"found job\.toml and readings\.parquet in .* lost"
    ):
        fit.write(tmp_path, axes={"X": 1})
    assert job.read_bytes() == mine
    job.unlink()
    with pytest.raises(FitError, match=r"found readings\.parquet in"):
        fit.write(tmp_path, axes={"X": 1})


def test_a_job_is_not_written_where_it_would_fit_something_else(tmp_path: Path) -> None:
    data = along_x(0)
    rising = {"leadscrew": lambda model: jnp.diff(model.pos)}
    fit = axcomp.fit([SCREW], data, constraints=rising)
    with pytest.raises(FitError, match="found constraints of leadscrew as a function"):
        fit.write(tmp_path, axes={"X": 1})
    old = fit["leadscrew"].model
    with pytest.raises(FitError, match="leadscrew was active while measuring"):
        _ = axcomp.fit([SCREW], data, active={"leadscrew": old}).verdict
    warm = 20.0 + np.random.default_rng(1).random(90)
    data |= {"Y.error": 1e-3 * warm, "temperature.a": warm}
    heat = [
        axcomp.Temperature(axis, sensors={"offset": "a"}, reference_temperature=zero)
        for axis, zero in (("X", 20.0), ("Y", 22.0))
    ]
    with pytest.raises(FitError, match="reference temperatures of 20 and 22 °C"):
        axcomp.fit(heat, data).write(tmp_path, axes={"X": 1, "Y": 2})


def test_a_list_is_not_replaced_before_it_is_said_that_it_was_off(
    tmp_path: Path,
) -> None:
    old = axcomp.fit([SCREW], along_x(0))["leadscrew"].model
    path = axcomp.write_lists(axcomp.AxisModels(1, {"leadscrew": old}), tmp_path)[0]
    with pytest.raises(
        axcomp.AxcompError, match="leadscrew of X already, expected active ="
    ):
        axcomp.fit([SCREW], along_x(1)).write(tmp_path / "out", lists={1: path})
    fit = axcomp.fit([SCREW], along_x(1), active={})
    assert fit.write(tmp_path / "off", lists={1: path}).files


def test_a_table_that_was_off_beside_one_that_was_on_is_not_added_to(
    tmp_path: Path,
) -> None:
    old = axcomp.fit([SCREW], along_x(0))["leadscrew"].model
    lists = {}
    for axis in (1, 2):
        models = axcomp.AxisModels(axis, {"leadscrew": old})
        lists[axis] = axcomp.write_lists(models, tmp_path)[0]
    data = {**along_x(1), "Y.position": np.arange(90.0), "Y.error": np.zeros(90)}
    other = axcomp.Leadscrew("Y", start=0, interval=30, points=4)
    fit = axcomp.fit([SCREW, other], data, active={"X.leadscrew": old})
    with pytest.raises(FitError, match=r"found Y\.leadscrew in .* and not active"):
        fit.write(tmp_path / "out", lists=lists, axes={"X": 1, "Y": 2})


@pytest.mark.other_types
@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([axcomp.Leadscrew("X", start=0, interval=10, points=3)], r"'X\.position'"),
        ([axcomp.Backlash("X"), axcomp.Backlash("X")], "twice"),
        ([], "effects: found none"),
        ([axcomp.Backlash], "effects: found <class"),
    ],
)
def test_what_cannot_be_fitted_is_refused(
    effects: list[axcomp.Backlash], message: str
) -> None:
    data = {"X.direction": np.tile([1.0, -1.0], 20), "X.error": np.arange(40.0)}
    with pytest.raises(FitError, match=message):
        axcomp.fit(effects, data)


def test_nodes_are_given_one_way() -> None:
    with pytest.raises(FitError, match="either setpoints or start"):
        _ = axcomp.Leadscrew("X", start=0.0, interval=1.0).nodes
    nodes = axcomp.Leadscrew("X", start=0.0, interval=0.1, points=5).nodes
    # Readings written 0.3 lie on the node 3 · 0.1.
    assert nodes[3] == 0.3
    line = np.arange(3.0)
    with pytest.raises(FitError, match="either nodes or start"):
        axcomp.Plane("Z", ("X", "Y"), (line, line), interval=(1.0, 1.0))
    with pytest.raises(FitError, match="either sensor or sensors"):
        axcomp.Temperature("X")


def test_a_table_that_cannot_be_is_refused_in_words() -> None:
    # In a process of its own, where nobody checks the types of arguments.
    code = """
import axcomp
line = {"start": 0, "interval": 10, "points": 5}
pair = {key: (value, value) for key, value in line.items()}
for kind, given in (
    (axcomp.Cross, line | {"master": "X"}),
    (axcomp.Plane, pair | {"masters": ("Y", "Y")}),
    (axcomp.Plane, pair | {"masters": ("Y",)}),
    (axcomp.Plane, line | {"masters": ("Y", "Z")}),
    (axcomp.Leadscrew, line | {"points": 5.5}),
    (axcomp.Leadscrew, line | {"start": (0,)}),
    (axcomp.Leadscrew, {"setpoints": 0.0}),
):
    try:
        print(kind("X", **given))
    except axcomp.AxcompError as error:
        print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    start = "found start 0, interval 10 and points 5.5"
    for line, words in zip(
        done.stdout.splitlines(),
        (
            "cross of X over X: found the axis X twice, expected another master",
            "plane of X over Y and Y: found the axis Y twice, expected another master",
            "plane of X: found masters ('Y',), expected two, one per master",
            "plane of X: found start 0, expected two, one per master",
            f"leadscrew of X: {start}, expected two numbers and a whole number",
            "leadscrew of X: found start (0,), interval 10 and points 5, expected two",
            "leadscrew of X: expected at least two nodes in ascending order",
        ),
        strict=True,
    ):
        assert line.startswith(words)


@pytest.mark.parametrize(("word", "lag"), [("auto", "fit"), ("none", 0.0), (60, 60)])
def test_a_lag_has_the_words_of_a_job(word: str, lag: float | str) -> None:
    sensors = {"offset": "spindle", "coefficient": "scale"}
    assert axcomp.Temperature("X", sensor="scale", lag=word).lags == {"scale": lag}
    effect = axcomp.Temperature("X", sensors=sensors, lag={"spindle": word})
    assert effect.lags == {"spindle": lag, "scale": 0.0}
    with pytest.raises(FitError, match="found lag 'non', expected 'fit'"):
        axcomp.Temperature("X", sensor="scale", lag="non")


def test_temperatures_of_a_law_may_be_a_list() -> None:
    warm = np.linspace(18.0, 30.0, 60)
    law: Any = {"offset": np.array([18.0, 20.0, 30.0])}
    effect = axcomp.Temperature("X", sensors={"offset": "a"}, law=law)
    law["offset"] = law["offset"].tolist()
    listed = axcomp.Temperature("X", sensors={"offset": "a"}, law=law)
    data = {"X.error": 1e-3 * np.minimum(warm, 20.0), "temperature.a": warm}
    one, other = (
        axcomp.fit([each], data)["temperature"].model.entry(0.0 * warm, warm[:, None])
        for each in (effect, listed)
    )
    np.testing.assert_array_equal(one, other)
    with pytest.raises(FitError, match="or temperatures in ascending order"):
        axcomp.Temperature("X", sensor="a", law={"offset": np.array([25.0, 20.0])})


def test_a_clock_that_goes_back_beside_a_temperature_is_refused() -> None:
    warm, time = np.linspace(20.0, 25.0, 40), 60.0 * np.arange(40.0)
    data = {"X.error": 1e-3 * warm, "temperature.scale": warm, "time": time}
    effect = axcomp.Temperature("X", sensors={"offset": "scale"})
    axcomp.fit([effect], data)
    with pytest.raises(FitError, match="time: goes back to 300 s at index 20"):
        axcomp.fit([effect], data | {"time": time - 900.0 * (time >= 1200.0)})


def test_a_slope_that_no_temperature_moves_is_in_no_coefficient() -> None:
    rng = np.random.default_rng(4)
    warm, place = np.repeat(np.linspace(16.0, 26.0, 6), 9), np.tile(np.arange(9.0), 6)
    place = 50.0 * place
    error = (30e-6 + 12e-6 * (warm - 20.0)) * place + rng.normal(0.0, 3e-4, 54)
    data = {"X.position": place, "X.error": error, "temperature.scale": warm}
    fit = axcomp.fit([axcomp.Temperature("X", sensor="scale")], data)
    law, sigma = fit["temperature"].model, fit["temperature"].standard_deviation
    found = np.asarray(law.coefficient.values)
    deviation = np.asarray(sigma.coefficient.values)
    # The controller takes the error off; a slope of 30 µm/m would be 20 deviations.
    truth = -12e-6 * (np.asarray(law.coefficient.nodes.points) - 20.0)
    assert np.all(np.abs(found - truth) < 4.0 * deviation)
    assert np.all(deviation < 1.5e-6)
    assert fit.joint is not None
    beside = fit.joint.part("leadscrew of X")
    assert np.ptp(beside.values) == pytest.approx(30e-6 * 400.0, abs=1e-3)
    assert [*fit] == ["temperature"]


def test_lags_of_several_sensors_are_no_job(tmp_path: Path) -> None:
    warm, position = np.repeat([20.0, 22.0, 25.0], 5), np.tile(np.arange(5.0), 3)
    data = {
        "X.position": 100 * position,
        "X.error": 1e-3 * (warm - 20.0) * (1.0 + position),
        "temperature.spindle": warm,
        "temperature.scale": warm,
        "time": 60.0 * np.arange(15.0),
    }
    sensors = {"offset": "spindle", "coefficient": "scale"}
    effect = axcomp.Temperature("X", sensors=sensors, lag={"spindle": 10.0})
    fit = axcomp.fit([effect], data)
    with pytest.raises(FitError, match="with several lags, expected one"):
        fit.write(tmp_path, axes={"X": 1})


@pytest.mark.parametrize(
    ("effect", "roles"),
    [
        (
            axcomp.Leadscrew("X", start=0, interval=1, points=3, bilateral=True),
            {"X.position", "X.direction"},
        ),
        (
            axcomp.Temperature("X", sensors={"offset": "scale"}, lag="fit"),
            {"temperature.scale", "time"},
        ),
        (
            axcomp.Crosstalk(
                "Y", "X", acceleration=1, deceleration=-1, adaptation=("Z",),
                positions=[[0], [1]],
            ),
            {"X.acceleration", "X.velocity", "Z.position"},
        ),
        (axcomp.Friction("X"), {"time", "X.velocity", "X.acceleration", "X.current"}),
    ],
)  # fmt: skip
def test_an_effect_names_the_roles_that_it_needs(
    effect: axcomp.Leadscrew, roles: set[str]
) -> None:
    assert set(effect.roles) == roles


@pytest.mark.parametrize("loss", ["student", "huber"])
def test_a_run_that_is_far_off_does_not_end_a_fit(
    loss: Literal["student", "huber"],
) -> None:
    # None of its readings was believed at first, and nothing then told its offset.
    rng = np.random.default_rng(12)
    target, run = np.tile(np.linspace(0.0, 200.0, 11), 5), np.repeat(np.arange(5), 11)
    error = 1e-4 * rng.standard_normal(55) + np.where(run == 3, 0.046, 0.0)
    found = axcomp.fit(
        [axcomp.Leadscrew("X", start=0, interval=20, points=11)],
        {"X.position": target, "X.error": error, "run": run},
        loss=loss,
    )
    assert found.converged
    # The mean of the other runs, to the noise of a reading.
    assert np.mean(found["leadscrew"].model.pos) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("loss", ["student", "gauss"])
def test_a_run_that_contradicts_the_others_counts_as_in_the_files(
    loss: Literal["student", "gauss"], tmp_path: Path
) -> None:
    # Every run counts alike, the short one too.
    rng, nodes = np.random.default_rng(12), np.linspace(0.0, 200.0, 11)
    target, run = np.tile(nodes, 5)[:-4], np.repeat(list("abcde"), 11)[:-4]
    offsets = {"a": 1e-4, "b": -3e-4, "c": 2e-4, "d": 0.025, "e": 6e-4}
    own = np.array([offsets[name] for name in run])
    fit = axcomp.fit(
        [axcomp.Leadscrew("X", start=0, interval=20, points=11)],
        {"X.position": target, "X.error": own + 1e-4 * rng.normal(size=51), "run": run},
        loss=loss,
    )
    assert fit.suspect_runs == {"X": ("d",)}
    counts = "count" if loss == "gauss" else "do not count"
    assert f"contradict the others, and {counts} in their mean: d." in str(fit)
    screw = fit["leadscrew"]
    counted = [offsets[name] for name in "abcde" if loss == "gauss" or name != "d"]
    # Of 40 readings of 0.1 µm or more; runs that lie 0.4 µm, or 11 µm, apart leave the mean open.
    assert np.mean(screw.model.pos) == pytest.approx(np.mean(counted), abs=5e-5)
    deviation = np.mean(screw.standard_deviation.pos)
    assert deviation > 5e-3 if loss == "gauss" else deviation < 5e-4
    fit.write(tmp_path, axes={"X": 1})
    (file,) = tmp_path.rglob("achskw1.lis")
    written = axcomp.load_model(file)["leadscrew"]
    # Half a unit of the list, and what the drift that a job grants each run makes of a node.
    np.testing.assert_allclose(written.pos, screw.model.pos, rtol=0, atol=1.5e-4)
    assert float(np.mean(written.pos - screw.model.pos)) == pytest.approx(0, abs=4e-5)


def test_a_node_of_wild_readings_alone_leaves_the_others_as_certain_as_they_are() -> (
    None
):
    rng, place = np.random.default_rng(0), np.repeat(np.arange(0.0, 101.0, 10.0), 8)
    error = 1e-4 * rng.normal(size=88)
    error[place == 50.0] = rng.choice([-1.0, 1.0], 8) * rng.uniform(3.0, 9.0, 8)
    cross = axcomp.Cross("Y", master="X", start=0, interval=10, points=11)
    data = {"X.position": place, "Y.error": error}
    fit = axcomp.fit([cross], data, smoothness=0)
    deviation = np.asarray(fit["cross"].standard_deviation.values)
    # Eight readings of 0.1 µm each; 80 of them tell that to some 10 %.
    others = np.delete(deviation, 5)
    np.testing.assert_allclose(others, 1e-4 / np.sqrt(8.0), rtol=0.2)
    assert deviation[5] > 0.1


def test_a_plane_that_holds_a_cross_says_which_to_leave_out() -> None:
    # Nodes every 50 and every 80 mm: almost all that one of them follows the other does.
    rng = np.random.default_rng(1)
    grid = np.meshgrid(np.linspace(0, 400, 21), np.linspace(0, 800, 17))
    u, v = (np.tile(each.ravel(), 2) for each in grid)
    error = 0.01 * np.sin(u / 90) * np.cos(v / 80) + 3e-4 * rng.standard_normal(u.size)
    found = axcomp.fit(
        [
            axcomp.Cross("W", master="V", start=0, interval=50, points=17),
            axcomp.Plane(
                "W", ("U", "V"), start=(0, 0), interval=(40, 80), points=(11, 11)
            ),
        ],
        {"U.position": u, "V.position": v, "W.error": error},
    )
    (said,) = found.undetermined
    assert "the plane of W over U and V holds all that goes over V alone" in str(said)
    assert "leave the cross of W over V out" in str(said)


def test_what_no_reading_shows_of_a_law_has_no_deviation() -> None:
    rng = np.random.default_rng(1)
    acceleration = rng.choice([-900.0, 0.0, 900.0], 200)
    # Nobody slowed down on the way back.
    velocity = np.where(acceleration < 0, 50.0, rng.choice([-50.0, 50.0], 200))
    talk = axcomp.Crosstalk(
        "Z", "X", acceleration=900, deceleration=-900, velocity_dependent=True
    )
    fit = axcomp.fit(
        [talk, axcomp.Backlash("Y")],
        {
            "X.acceleration": acceleration, "X.velocity": velocity,
            "Z.error": 3e-4 * rng.normal(size=200),
            "Y.direction": np.ones(200), "Y.error": 3e-4 * rng.normal(size=200),
        },
    )  # fmt: skip
    support = fit["crosstalk"].support
    deviation = np.ravel(fit["crosstalk"].standard_deviation.values)
    assert list(support == 0) == list(np.isinf(deviation)) == [False] * 3 + [True]
    assert np.isinf(fit["backlash"].standard_deviation.width)


def test_friction_is_written_of_a_recording_without_positions(tmp_path: Path) -> None:
    time = np.arange(0.0, 40.0, 0.01)
    velocity = 60.0 * np.sin(2 * np.pi * time / 7.0) + 20.0 * np.sin(time)
    current = 1.2 * np.sign(velocity) + 0.01 * velocity
    current += np.random.default_rng(5).normal(scale=0.02, size=len(time))
    recording = {
        "time": time, "X.velocity": velocity, "X.current": current,
        "X.acceleration": np.gradient(velocity, time),
    }  # fmt: skip
    fit = axcomp.fit([axcomp.Friction("X")], recording)
    fit.write(tmp_path, axes={"X": 1})
    (written,) = json.loads((tmp_path / "result.json").read_text())["fits"]
    curve = written["parameters"]["curve"]
    # One reading scatters by 0.02 A; hundreds of them stand behind each speed.
    assert np.interp(40.0, curve["velocity"], curve["current"]) == pytest.approx(
        float(fit["friction"].model(np.array([40.0]))[0]), abs=0.01
    )


def test_the_motion_of_a_file_is_derived_where_it_was_not_recorded(
    tmp_path: Path,
) -> None:
    time = np.arange(0.0, 40.0, 0.004)
    velocity = 60.0 * np.cos(2 * np.pi * time / 7.0) + 20.0 * np.cos(time)
    position = 60.0 * 7.0 / (2 * np.pi) * np.sin(2 * np.pi * time / 7.0)
    position = np.round(position + 20.0 * np.sin(time), 4)  # as an encoder counts
    current = 1.2 * np.sign(velocity) + 0.01 * velocity
    current += np.random.default_rng(5).normal(scale=0.02, size=len(time))
    rows = np.stack([time, position, current], axis=1)
    head = "time,X.position,X.current"
    np.savetxt(tmp_path / "log.csv", rows, "%.6f", ",", header=head, comments="")
    fit = axcomp.fit([axcomp.Friction("X")], axcomp.read(tmp_path / "log.csv"))
    law = fit["friction"].model
    # One reading scatters by 0.02 A; hundreds of them stand behind each speed.
    assert float(law(np.array([40.0]))[0]) == pytest.approx(1.6, abs=0.01)


def test_the_held_out_error_leaves_out_what_the_noise_leaves_out() -> None:
    rng = np.random.default_rng(6)
    place = np.tile(np.arange(0.0, 401.0, 20.0), 6)
    error = 4e-3 * np.sin(place / 90.0) + rng.normal(scale=3e-4, size=len(place))
    error[[17, 60]] += 0.5
    run = np.repeat(np.arange(6), 21)
    screw = axcomp.Leadscrew("X", start=0, interval=20, points=21)
    fit = axcomp.fit([screw], {"X.position": place, "X.error": error, "run": run})
    # Two readings of 126 that are 0.5 mm off would make 0.06 mm.
    assert fit.held_out["X"] < 1.3 * fit.noise["X"]


def test_writing_names_the_role_that_a_job_needs_and_no_file_of_its_own(
    tmp_path: Path,
) -> None:
    way = np.tile([1.0, -1.0], 50)
    noise = 1e-4 * np.random.default_rng(0).normal(size=100)
    found = axcomp.fit(
        [axcomp.Backlash("X")], {"X.direction": way, "X.error": 2e-3 * way + noise}
    )
    with pytest.raises(FitError, match=r"write: found no X\.position among the read"):
        found.write(tmp_path, axes={"X": 1})


def test_a_list_that_is_not_what_was_active_is_refused(tmp_path: Path) -> None:
    old = axcomp.fit([SCREW], along_x(0))["leadscrew"].model
    other = eqx.tree_at(lambda model: model.pos, old, old.pos.at[4].add(0.03))
    written = axcomp.AxisModels(1, {"leadscrew": other})
    path = axcomp.write_lists(written, tmp_path)[0]
    fit = axcomp.fit([SCREW], along_x(1), active={"leadscrew": old})
    with pytest.raises(FitError, match="the active model of leadscrew by"):
        fit.write(tmp_path / "out", lists={1: path})
