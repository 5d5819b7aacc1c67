"""What `axcomp.fit` and its neighbours refuse, and what they take although it looks strange."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

import axcomp
from axcomp import models

PLACES = np.tile(np.arange(0.0, 201.0, 25.0), 6)
RUNS = np.repeat(np.arange(6), 9)
SCREW = axcomp.Leadscrew("X", start=0, interval=25, points=9)
LINES: dict[str, Any] = {"start": (0, 0), "interval": (25, 25), "points": (9, 9)}


def along_x(seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    error = 4e-3 * np.sin(PLACES / 40.0) + 2e-4 * rng.normal(size=PLACES.size)
    return {"X.position": PLACES, "X.error": error, "run": RUNS}


def sinus(screw: models.Leadscrew, x: Any) -> Any:
    return screw.offset(x)


def linear(smoothness: Any = 0.0, measured: Any = None) -> Any:
    made = models.Leadscrew(models.EquidistantNodes(0.0, 25.0, 9), jnp.zeros(9), None)
    readings = along_x()["X.error"] if measured is None else measured
    return axcomp.fit_linear(made, sinus, PLACES, readings, smoothness=smoothness)


def modelled(**options: Any) -> Any:
    made = models.Backlash(jnp.asarray(0.0))
    readings = options.pop("measured", along_x()["X.error"])
    return axcomp.fit_model(
        made, lambda m, x: m.width + 0 * x, PLACES, readings, **options
    )


def of(**options: Any) -> axcomp.Fit:
    return axcomp.fit([SCREW], along_x(), **options)


def drive() -> dict[str, Any]:
    time = np.arange(4000) / 100.0
    velocity = 20.0 * np.sin(0.5 * time)
    current = 0.5 * np.sign(velocity) + 0.01 * velocity
    acceleration = 10.0 * np.cos(0.5 * time)
    names = ("velocity", "acceleration", "current")
    values = (velocity, acceleration, current)
    own = {f"X.{name}": value for name, value in zip(names, values, strict=True)}
    return {"time": time, **own}


@pytest.mark.other_types
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: of(smoothness=np.array([1.0, 2.0])), "smoothness: found"),
        (lambda: of(smoothness={"leadscrew": 1.0}), "smoothness: found"),
        (lambda: of(active=["leadscrew"]), "active: expected models by name"),
        (lambda: of(datum="abc"), "datum: found 'abc'"),
        (lambda: of(datum={"at": None}), "datum: found None"),
        (lambda: of(datum=[[1.0]]), "datum: found"),
        (lambda: of(constraints={"leadscrew": None}), "found None, expected words"),
        (lambda: of(constraints={"leadscrew": [None]}), "expected words or a function"),
        (lambda: of(remove=["line"]), "remove: found"),
        (lambda: axcomp.fit(None, along_x()), "effects: found None"),  # type: ignore[arg-type]
        (
            lambda: axcomp.fit([axcomp.Plane("X", ("Y", "X"), **LINES)], along_x()),
            "plane of X over Y and X: found the axis X twice, expected another master",
        ),
        (lambda: axcomp.Friction("X", inertia=None), "inertia: found None"),  # type: ignore[arg-type]
        (
            lambda: axcomp.fit(
                [SCREW], along_x() | {"run": np.array([None, *RUNS[1:]], object)}
            ),
            "run: found numbers beside names",
        ),
        (
            lambda: axcomp.fit(
                [SCREW], along_x() | {"run": np.ma.masked_less(RUNS, 1)}
            ),
            "run: found masked rows",
        ),
        (
            lambda: jax.grad(
                lambda e: axcomp.fit([SCREW], along_x() | {"X.error": e}).noise["X"]
            )(jnp.asarray(along_x()["X.error"])),
            "X.error: found traced values, expected numbers: fit_linear is",
        ),
        (lambda: axcomp.Leadscrew("X", setpoints=[0.0, 200.0, np.inf]), "two nodes"),
        (
            lambda: axcomp.Temperature("X", sensor="a", lag={"b": 5.0}),
            "found lag of b, expected of its sensors",
        ),
        (
            lambda: axcomp.fit([axcomp.Friction("X")], drive(), loss="huber"),
            "loss: found",
        ),
        (
            lambda: axcomp.fit([axcomp.Friction("X")], drive(), smoothness=1.0),
            "smoothness: found 1.0 of a friction",
        ),
        (
            lambda: axcomp.fit([axcomp.Friction("X")], drive(), datum=1.0),
            "datum: found",
        ),
        (lambda: linear((1.0, 2.0, 3.0)), "smoothness: found"),
        (lambda: linear(()), "smoothness: found"),
        (lambda: linear(None), "smoothness: found None"),
        (lambda: linear("auto"), "smoothness: found 'auto'"),
        (lambda: linear(measured="abc"), "measured: found str"),
        (lambda: modelled(priors={"width": (None, 10.0)}), "a pair of numbers"),
        (lambda: modelled(noise="a"), "noise: found 'a'"),
        (lambda: modelled(fitted=[1]), "fitted: found 1"),
        (lambda: modelled(max_steps=2.5), "max_steps: found 2.5"),
        (lambda: modelled(measured=None), "measured: found NoneType"),
        (
            lambda: modelled(measured=np.ma.masked_less(PLACES, 1.0)),
            "reading 0 is not finite",
        ),
    ],
)
def test_what_is_no_argument_is_refused_in_words(
    call: Callable[[], Any], message: str
) -> None:
    with pytest.raises(axcomp.AxcompError, match=message):
        call()


@pytest.mark.other_types
@pytest.mark.parametrize(
    "options",
    [
        {"columns": {"X.position": None}},
        {"columns": {"X.position": ("a", "mm", "b")}},
        {"rows": 5},
    ],
)
def test_what_says_nothing_of_a_table_is_refused_in_words(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    (tmp_path / "a.csv").write_text("a,b\n1,2\n3,4\n")
    with pytest.raises(axcomp.AxcompError, match=r"found .*, expected"):
        axcomp.read(tmp_path / "a.csv", **options)


@pytest.mark.other_types
@pytest.mark.parametrize("name", ["cross", ["leadscrew"]])
def test_a_covariance_is_that_of_one_effect(name: Any) -> None:
    words = "expected one of leadscrew"
    with pytest.raises(KeyError, match=f"covariance: found .*{words}"):
        of().covariance(name)


@pytest.mark.other_types
def test_lists_of_an_axis_without_a_number_are_refused(tmp_path: Path) -> None:
    own = axcomp.AxisModels("X", {"backlash": models.Backlash(jnp.asarray(0.01))})  # type: ignore[arg-type]
    with pytest.raises(axcomp.AxcompError, match="axis: found 'X'"):
        axcomp.write_lists(own, tmp_path)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("of_file", [False, True])
def test_what_becomes_of_the_readings_after_a_fit_does_not_change_its_lists(
    tmp_path: Path, of_file: bool
) -> None:
    data: Any = {name: values.copy() for name, values in along_x().items()}
    if of_file:
        rows = np.column_stack([data["X.position"], data["X.error"]])
        file, names = tmp_path / "laser.csv", "X.position,X.error"
        np.savetxt(file, rows, delimiter=",", header=names, comments="")
        data = axcomp.read(file, {"X.position": "X.position", "X.error": "X.error"})
    fit = axcomp.fit([SCREW], data)
    error = (data.values if of_file else data)["X.error"]
    np.negative(error, out=error)
    written = fit.write(tmp_path / "out", axes={"X": 1}).files[0]
    # Half a list unit, and the joint fit beside that of one table: a part of σ (0.1 µm).
    np.testing.assert_allclose(
        axcomp.load_model(tmp_path / "out" / written)["leadscrew"].pos,
        fit["leadscrew"].model.pos,
        rtol=0,
        atol=1.5e-4,
    )


def test_masked_readings_are_left_out() -> None:
    data = along_x()
    wild = data["X.error"].copy()
    wild[3] = 5.0
    hidden = np.ma.masked_array(wild, mask=np.arange(wild.size) == 3)
    missed = np.where(np.arange(wild.size) == 3, np.nan, wild)
    values = [
        axcomp.fit([SCREW], data | {"X.error": error}, loss="gauss")["leadscrew"]
        for error in (hidden, missed)
    ]
    np.testing.assert_array_equal(values[0].model.pos, values[1].model.pos)


@pytest.mark.parametrize("since", ["2026-11-27T08:00:00", None])
def test_instants_are_seconds_from_the_first(since: str | None) -> None:
    data = along_x()
    seconds = np.arange(PLACES.size) * 0.5
    ticks = (seconds * 1e9).astype("m8[ns]")
    clock = ticks if since is None else np.datetime64(since) + ticks
    fits = [
        axcomp.fit([SCREW], data | {"time": time}, drift=1) for time in (seconds, clock)
    ]
    np.testing.assert_array_equal(*(fit["leadscrew"].model.pos for fit in fits))


def test_a_clock_that_stands_within_each_run_is_taken() -> None:
    data, epoch = along_x(), 1.7e9
    drifting = axcomp.fit([SCREW], data | {"time": epoch + 60.0 * RUNS}, drift=1)
    plain = axcomp.fit([SCREW], data)
    # No instant lies between the ends of a run: there is no drift to take off.
    np.testing.assert_allclose(
        drifting["leadscrew"].model.pos, plain["leadscrew"].model.pos, atol=1e-4
    )


def test_directions_in_bytes_are_words() -> None:
    two = axcomp.Leadscrew("X", start=0, interval=25, points=9, bilateral=True)
    forwards = RUNS % 2 == 0
    ways = [np.where(forwards, b"up", b"down"), np.where(forwards, 1, -1)]
    fits = [axcomp.fit([two], along_x() | {"X.direction": way}) for way in ways]
    np.testing.assert_array_equal(*(fit["leadscrew"].model.pos for fit in fits))


EFFECTS = {
    "Leadscrew('X', setpoints='abc')": "at least two nodes",
    "Leadscrew('X', setpoints=[[0.0, 1.0], [2.0, 3.0]])": "at least two nodes",
    "Plane('Z', masters=None, start=(0, 0), interval=(1, 1), points=(9, 9))": "masters",
    "Temperature('X', sensor='a', law={'offset': 2.0})": "found law 2.0",
    "Temperature('X', sensor='a', law={'offset': None})": "found law None",
    "Temperature('X', sensor='a', lag=[1.0, 2.0])": "found lag [1.0, 2.0]",
    "Temperature('X', sensor='a', reference='intersection')": "found reference",
    "Crosstalk('X', 'Y', 100, -100, 'Z1', ['a'])": "found positions",
    "Crosstalk('X', 'Y', 100, -100, 'Z1', [0.0, 50.0])": "taken",
}
"""Calls of other types than annotated, and what they answer."""


def test_effects_of_other_types_are_refused_in_words_or_understood() -> None:
    # In a process of its own: here the types of the arguments are checked at run time.
    program = f"""
import axcomp
for call in {[*EFFECTS]!r}:
    try:
        made = eval("axcomp." + call)
        assert made.masters == ("Y", "Z1") and made.points.tolist() == [[0.0], [50.0]]
        print("taken")
    except axcomp.AxcompError as refusal:
        print(refusal)
"""
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    answers = ran.stdout.splitlines()
    for answer, expected in zip(answers, EFFECTS.values(), strict=True):
        assert expected in answer


def test_what_is_held_out_leaves_wild_readings_out_as_the_noise_does() -> None:
    data = along_x()
    error = data["X.error"].copy()
    error[::10] += np.where(np.arange(6) % 2, 0.5, -0.5)
    fits = [
        axcomp.fit([SCREW], data | {"X.error": own}, loss="huber")
        for own in (data["X.error"], error)
    ]
    # One reading of each run is wild, ± 0.5 mm: its pull on the others is bounded.
    left = [fit.held_out["X"] for fit in fits]
    assert left[1] < 5.0 * left[0]


def test_deviations_at_a_datum_are_those_of_the_differences() -> None:
    nodes, rough = SCREW.grid[0], 2e-3 * np.random.default_rng(99).normal(size=9)
    true, at = rough - rough[4], np.arange(9) != 4
    ratios, doubts = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        error = np.interp(PLACES, nodes, rough) + 0.7
        error += 5e-4 * rng.normal(size=PLACES.size)
        data = {"X.position": PLACES, "X.error": error, "run": RUNS}
        fit = axcomp.fit([SCREW], data, datum=100.0)
        one = fit["leadscrew"]
        deviation = np.asarray(one.standard_deviation.pos)
        assert deviation[4] == 0.0
        spread = np.sqrt(np.diag(fit.covariance("leadscrew")))
        # One matrix by parts and as a whole: rounding.
        np.testing.assert_allclose(spread, deviation, rtol=1e-6, atol=1e-9)
        ratios.append((np.asarray(one.model.pos) - true)[at] / deviation[at])
        value, doubt = fit.datum["X"]
        doubts.append((value - 0.7 - rough[4]) / doubt)
    # 320 values, of which those of a fit hang together: 95.4 % ± 2.5.
    assert 0.92 <= np.mean(np.abs(ratios) < 2.0) <= 0.99
    assert np.sqrt(np.mean(np.square(doubts))) < 1.3  # 40 of them: 1 ± 0.11


def test_a_zero_of_the_instrument_is_the_mean_although_runs_are_offset() -> None:
    nodes = np.arange(0.0, 401.0, 20.0)
    places = np.tile(np.concatenate([nodes, nodes[::-1]]), 5)
    run, rng = np.repeat(np.arange(5), 42), np.random.default_rng(3)
    offsets = np.array([0.0, 0.0, 0.0, 0.0, 6e-3])
    error = 0.7 + offsets[run] + 5e-4 * rng.normal(size=210)
    screw = axcomp.Leadscrew("X", start=0, interval=20, points=21)
    data = {"X.position": places, "X.error": error, "run": run}
    fit = axcomp.fit([screw], data, remove="offset")["leadscrew"]
    # The run apart counts in full: what is left of the mean is rounding.
    assert np.mean(fit.model.pos) == pytest.approx(0.0, abs=1e-5)


def test_tables_of_a_linear_stack_have_the_names_of_the_docstring() -> None:
    made = models.Leadscrew(models.EquidistantNodes(0.0, 25.0, 9), jnp.zeros(9), None)

    def both(stack: Any, x: Any) -> Any:
        return sinus(stack[0], x) + stack[1]

    readings = along_x()["X.error"]
    fits = [
        axcomp.fit_linear(
            (made, 0.0), both, PLACES, readings, smoothness=own, solver=solver
        )
        for own, solver in (({"0": 2.0}, None), (2.0, lx.Cholesky()))
    ]
    # Two factors of one matrix: rounding.
    np.testing.assert_allclose(fits[0][0].pos, fits[1][0].pos, atol=1e-12)


def test_a_table_is_as_good_as_its_columns() -> None:
    pa = pytest.importorskip("pyarrow")
    found = axcomp.fit([SCREW], pa.table({**along_x(), "remark": ["?"] * PLACES.size}))
    assert np.array_equal(found["leadscrew"].model.pos, of()["leadscrew"].model.pos)


def test_a_name_that_looks_like_a_role_and_is_none_is_refused() -> None:
    message = r"found 'X\.directon', expected 'X\.direction'"
    with pytest.raises(axcomp.AxcompError, match=message):
        axcomp.fit([SCREW], {**along_x(), "X.directon": np.ones(PLACES.size)})
