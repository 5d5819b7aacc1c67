"""What is there is named, and nothing else; confounded data are said, not guessed."""

import dataclasses
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from axcomp.data.signals import filtered_motion
from axcomp.ident.cli import main
from axcomp.ident.discover import DiscoverError, Discovery, Observed, discover
from axcomp.ident.job import run_job

MINUTES = 600.0
ROWS = 5_000


def named(found: Discovery) -> set[tuple[str, str, tuple[str, ...]]]:
    return {(one.compensation, one.axis, one.masters) for one in found.found}


def kernel_cannot(found: Discovery) -> list[str]:
    return [
        one.sentence
        for one in found.unexplained
        if one.verdict == "the kernel cannot express this"
    ]


def doubts(found: Discovery) -> list[str]:
    return [
        one.sentence
        for one in found.unexplained
        if one.verdict == "the data cannot tell"
    ]


def look(
    virtual: ModuleType, *effects: Any, axes: str = "XY", **noise: float
) -> Discovery:
    """Return what is found in ten minutes of the error of X."""
    motion = virtual.motion(1, axes, MINUTES, ROWS)
    return discover(
        virtual.observe(motion, {"X": list(effects)}, 1, **noise), tuple(axes)
    )


@pytest.fixture(scope="module")
def whole(virtual: ModuleType) -> Discovery:
    """Half an hour of three axes with every compensation at once, thinned."""
    motion = virtual.motion(4, "XYZ", 1800.0, 8_000)
    effects = {
        "X": [
            virtual.line("X", 1, 0.008),
            virtual.bilateral("X", 2, 0.003),
            virtual.heat("X", ("frame", 2e-3), ("frame", 5e-6)),
            virtual.crosstalk("Y", 0.004, "Z"),
        ],
        "Y": [
            virtual.line("X", 3, 0.006),
            virtual.line("Y", 4, 0.005),
            virtual.reversal("Y", 0.004),
            virtual.crosstalk("X", 0.003),
            virtual.heat("Y", ("frame", 0.0), ("frame", 5e-6)),
        ],
        "Z": [
            virtual.surface("X", "Y", 5, 0.007),
            virtual.line("Z", 6, 0.003),
            virtual.heat("Z", ("frame", 1.5e-3), ("frame", 0.0)),
        ],
    }
    return discover(virtual.observe(motion, effects, 4), ("X", "Y", "Z"))


@pytest.mark.slow
def test_all_compensations_at_once_are_named_and_no_other(whole: Discovery) -> None:
    assert named(whole) == {
        ("leadscrew", "X", ()),
        ("temperature", "X", ()),
        ("crosstalk", "X", ("Y", "Z")),
        ("leadscrew", "Y", ()),
        ("backlash", "Y", ()),
        ("cross", "Y", ("X",)),
        ("crosstalk", "Y", ("X",)),
        ("temperature", "Y", ()),
        ("leadscrew", "Z", ()),
        ("plane", "Z", ("X", "Y")),
        ("temperature", "Z", ()),
    }
    assert not whole.confused
    assert not whole.unexplained


@pytest.mark.slow
def test_what_is_found_comes_with_all_that_a_job_needs(whole: Discovery) -> None:
    keys = {(one.compensation, one.axis): one.keys for one in whole.found}
    assert keys["leadscrew", "X"] == {"bilateral": True}
    assert keys["temperature", "X"] == {"sensor": "frame"}
    assert keys["temperature", "Z"] == {"sensors": {"offset": "frame"}}
    assert keys["crosstalk", "X"] == {"master": "Y", "mode": 2, "adaptation": "Z"}
    assert keys["crosstalk", "Y"] == {"master": "X", "mode": 1}
    assert keys["plane", "Z"] == {"masters": ["X", "Y"]}
    assert {one.group for one in whole.found} == {"X", "Y", "Z"}


@pytest.mark.slow
def test_shares_add_up_and_noise_is_that_of_the_readings(whole: Discovery) -> None:
    for axis in whole.axes:
        shares = [one.share for one in whole.found if one.axis == axis.axis]
        assert shares == sorted(shares, reverse=True)
        # What is missing from one is noise and drift: a few per cent of the square.
        assert 0.85 < sum(shares) <= 1.001
        # 0.5 µm were added; the median of 16 000 readings tells that to 1 %.
        assert axis.noise == pytest.approx(5e-4, rel=0.05)


@pytest.mark.parametrize(
    ("there", "count", "seed"),
    [(True, 60, 5), (True, 100, 5), (False, 60, 1), (False, 100, 5), (False, 100, 12)],
)
def test_few_readings_name_no_more_than_is_there(
    virtual: ModuleType, there: bool, count: int, seed: int
) -> None:
    effects = [virtual.line("X", 1, 0.008), virtual.reversal("X", 0.004)]
    motion = virtual.motion(seed, "XY", MINUTES, 3_000)
    data = virtual.observe(motion, {"X": effects if there else []}, seed)
    some = np.sort(np.random.default_rng(seed).permutation(3_000)[:count])
    found = discover(data.take(some), ("X", "Y"))
    there_is = {("leadscrew", "X", ()), ("backlash", "X", ())}
    assert named(found) == (there_is if there else set())


@pytest.mark.parametrize("what", ["numbered", "no reading", "stopped"])
def test_counters_and_clocks_that_fail_hide_nothing(
    virtual: ModuleType, what: str
) -> None:
    effects = [virtual.line("X", 1, 0.008), virtual.reversal("X", 0.004)]
    data = virtual.observe(virtual.motion(1, "XY", MINUTES, 3_000), {"X": effects}, 1)
    lost = np.random.default_rng(0).random(3_000) < 0.01
    changed = {
        # Readings that are numbered are no runs of one reading each.
        "numbered": {"run": np.arange(3_000)},
        "no reading": {"time": np.where(lost, np.nan, data.time)},
        "stopped": {"time": np.zeros(3_000)},
    }
    found = discover(dataclasses.replace(data, **changed[what]), ("X", "Y"))
    assert named(found) == {("leadscrew", "X", ()), ("backlash", "X", ())}
    # 0.5 µm were added; the drift is known beside it.
    assert found.axes[0].noise == pytest.approx(5e-4, rel=0.05)


def test_drift_and_wild_readings_are_no_compensation(virtual: ModuleType) -> None:
    found = look(virtual)
    assert not found.found
    assert not found.unexplained
    reasons = {(one.compensation, one.masters): one.reason for one in found.rejected}
    assert reasons["leadscrew", ()] == "nothing of it in the error"
    assert ("temperature", ()) in reasons


def wound_up(motion: Any) -> np.ndarray:
    """Return an error that builds up over 5 mm after a reversal."""
    place, way = motion.position["X"], motion.direction["X"]
    turned = np.flatnonzero(np.diff(way, prepend=way[0]))
    last = np.searchsorted(turned, np.arange(len(way)), side="right") - 1
    start = place[np.maximum(turned[np.maximum(last, 0)] - 1, 0)]
    gone = np.abs(place - start)
    return np.asarray(0.003 * way * (1.0 - 2.0 * np.exp(-gone / 5.0)))


@pytest.fixture(scope="module")
def foreign(virtual: ModuleType) -> Discovery:
    """Ten minutes of a delay and a fine period in X, and of what Y shares with X."""
    motion = virtual.motion(1, "XY", MINUTES, 8_000)
    effects = {
        "X": [
            virtual.line("X", 3, 0.004),
            lambda m: -2e-5 * m.velocity["X"],
            lambda m: 8e-4 * np.sin(2 * np.pi * m.position["X"] / 5.0),
        ],
        "Y": [
            lambda m: 2e-3 * m.direction["X"],
            lambda m: 5e-8 * (m.position["X"] - 250) * (m.position["Y"] - 250),
        ],
    }
    return discover(virtual.observe(motion, effects, 1), ("X", "Y"))


def test_what_the_kernel_lacks_is_not_given_to_what_it_has(foreign: Discovery) -> None:
    # A delay is no backlash, neither is a jump where another axis reverses.
    assert named(foreign) == {("leadscrew", "X", ())}


@pytest.mark.parametrize(
    "words",
    [
        "Error of X that follows its velocity, as a delay",
        "Jump of Y where X reverses",
        "Error of Y over Y that changes with X",
    ],
)
def test_what_the_kernel_lacks_is_named(foreign: Discovery, words: str) -> None:
    assert any(each.startswith(words) for each in kernel_cannot(foreign))


def test_a_periodic_error_finer_than_a_table_is_named_with_its_period(
    foreign: Discovery,
) -> None:
    (one,) = (each for each in foreign.unexplained if "repeats" in each.sentence)
    # 100 periods in the travel, told to a fifth of one.
    period = float(one.sentence.split(" every ")[1].split()[0])
    assert period == pytest.approx(5, abs=0.01)
    assert one.rms == pytest.approx(8e-4 / np.sqrt(2), rel=0.3)
    assert "finer than a table" in one.sentence


def test_an_error_that_builds_up_after_reversals_is_beyond_the_kernel(
    virtual: ModuleType,
) -> None:
    found = look(virtual, wound_up)
    assert named(found) == {("backlash", "X", ())}
    assert any("hysteresis with memory" in each for each in kernel_cannot(found))


def test_growth_without_a_sensor_asks_for_one(virtual: ModuleType) -> None:
    motion = virtual.motion(1, "XY", MINUTES, ROWS)
    motion = dataclasses.replace(motion, temperature={})

    def grows(m: Any) -> np.ndarray:
        return np.asarray(1e-5 * m.time / m.time[-1] * m.position["X"])

    effects = {"X": [virtual.line("X", 3, 0.004), grows]}
    found = discover(virtual.observe(motion, effects, 1), ("X", "Y"))
    assert any("Record the temperature" in each for each in kernel_cannot(found))
    assert any(
        one.reason == "could not be looked for: no temperature was recorded"
        for one in found.rejected
    )


def test_two_crosses_of_one_axis_become_a_plane(virtual: ModuleType) -> None:
    motion = virtual.motion(1, "XYZ", MINUTES, ROWS)
    effects = {"Z": [virtual.line("X", 4, 0.004), virtual.line("Y", 7, 0.003)]}
    found = discover(virtual.observe(motion, effects, 1), ("X", "Y", "Z"))
    assert named(found) == {("plane", "Z", ("X", "Y"))}
    assert "one cross table only" in found.found[0].sentence


def test_the_direction_in_a_crosstalk_is_seen(virtual: ModuleType) -> None:
    def against_motion(motion: Any) -> np.ndarray:
        hard = motion.acceleration["Y"] * np.sign(motion.velocity["Y"])
        return np.asarray(4e-3 * hard / 1500.0)

    found = look(virtual, against_motion)
    assert [one.keys for one in found.found] == [
        {"master": "Y", "mode": 1, "velocity_dependent": True}
    ]


def test_strokes_that_are_all_alike_adapt_no_crosstalk_to_their_own_place(
    virtual: ModuleType,
) -> None:
    step = 0.01
    hard = np.repeat([1.0, 0.0, -1.0, 0.0], [20, 60, 20, 20]) * 1500.0
    cycle = np.concatenate([hard, -hard])
    a = np.tile(cycle, 100)
    v = step * np.cumsum(a)
    x = 20.0 + step * np.cumsum(v)
    rest = np.zeros_like(a)
    still = {"X": x, "Z": rest}
    motion = virtual.Motion(
        step * np.arange(len(a)),
        still,
        {"X": v, "Z": rest},
        {"X": a, "Z": rest},
        {"X": virtual.held_sign(v), "Z": rest + 1.0},
        {},
    )
    effects = {"Z": [virtual.crosstalk("X", 8e-3), lambda m: 6e-3 * np.cos(x / 25.0)]}
    recorded = virtual.observe(motion, effects, 1, drift=0.0, wild=0.0)
    found = discover(recorded, ("X", "Z"))
    keys = {one.compensation: one.keys for one in found.found}
    # The strokes begin and end at the same places: place and sign are one and the same.
    assert keys["crosstalk"] == {"master": "X", "mode": 1}


def test_strokes_from_one_place_adapt_no_crosstalk_to_where_they_end(
    virtual: ModuleType,
) -> None:
    step, lengths = 0.002, [40, 50, 60, 70]
    stroke = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0, 0.0]) * 3000.0
    a = np.tile(np.concatenate([np.repeat(stroke, n) for n in lengths]), 6)
    v = step * np.cumsum(a)
    x = 200.0 + step * np.cumsum(v)
    a, v, x = np.tile(a, 2), np.tile(v, 2), np.tile(x, 2)
    rest, w = np.zeros_like(a), np.repeat([50.0, 350.0], len(a) // 2)
    motion = virtual.Motion(
        step * np.arange(len(a)),
        {"X": x, "Y": rest, "Z": w},
        {"X": v, "Y": rest, "Z": rest},
        {"X": filtered_motion(step * np.arange(len(a)), x).acceleration},
        {"X": virtual.held_sign(v)},
        {},
    )
    pushed = a / 3000.0 * (8e-3 + 4e-5 * w)
    recorded = virtual.observe(motion, {"Y": [lambda m: pushed]}, 1, 3e-4, 0.0, 0.0)
    (found,) = discover(recorded, ("X", "Y", "Z")).found
    # X always accelerates forward at 200 mm: nothing shows what it does there elsewhere.
    assert (found.keys["mode"], found.keys["adaptation"]) == (2, "Z")


def test_masters_that_moved_together_are_said_and_not_guessed(
    virtual: ModuleType,
) -> None:
    motion = virtual.motion(1, "XY", MINUTES, ROWS)
    same = {
        name: {"X": channel["X"], "Y": channel["X"]}
        for name in ("position", "velocity", "acceleration", "direction")
        for channel in [getattr(motion, name)]
    }
    motion = dataclasses.replace(motion, **same)
    recorded = virtual.observe(motion, {"Z": [virtual.line("X", 5, 0.004)]}, 1)
    found = discover(recorded, ("X", "Y", "Z"))
    assert not found.found
    assert found.confused
    (sentence,) = doubts(found)
    assert sentence.startswith(
        "The data cannot tell: cross of Z over X or cross of Z over Y"
    ) or sentence.startswith(
        "The data cannot tell: cross of Z over Y or cross of Z over X"
    )


def to_and_fro(virtual: ModuleType, **temperature: np.ndarray) -> Any:
    time = np.arange(0.0, MINUTES, 0.06)
    phase = (time / 5.0) % 2.0
    place = 500.0 * np.where(phase < 1, phase, 2 - phase)
    way = np.where(phase < 1, 1.0, -1.0)
    one = {"X": place}, {"X": 100.0 * way}, {"X": 0.0 * way}, {"X": way}
    return virtual.Motion(time, *one, dict(temperature))


def test_backlash_at_one_feed_may_be_a_delay_and_that_is_said(
    virtual: ModuleType,
) -> None:
    effects = {"X": [virtual.line("X", 3, 0.004), virtual.reversal("X", 0.004)]}
    found = discover(virtual.observe(to_and_fro(virtual), effects, 1), ("X",))
    assert named(found) == {("leadscrew", "X", ())}
    (sentence,) = doubts(found)
    assert "backlash of X or error of X that follows its velocity" in sentence
    assert "another feed" in sentence


def test_temperature_that_rises_with_position_is_said_and_not_guessed(
    virtual: ModuleType,
) -> None:
    rng = np.random.default_rng(0)
    motion = to_and_fro(virtual)
    warm = (
        20.0 + motion.position["X"] / 100.0 + 0.02 * rng.normal(size=len(motion.time))
    )
    motion = dataclasses.replace(motion, temperature={"frame": warm})

    def grows(m: Any) -> np.ndarray:
        return np.asarray(2e-3 * (m.temperature["frame"] - 20.0))

    found = discover(virtual.observe(motion, {"X": [grows]}, 1), ("X",))
    assert not found.found
    assert found.confused
    (sentence,) = doubts(found)
    assert "temperature" in sentence
    assert "leadscrew of X" in sentence


def test_one_direction_only_leaves_backlash_unseen(virtual: ModuleType) -> None:
    motion = to_and_fro(virtual)
    recorded = virtual.observe(motion, {"X": [virtual.line("X", 3, 0.004)]}, 1)
    forth = recorded.take(recorded.direction["X"] > 0)
    found = discover(forth, ("X",))
    assert named(found) == {("leadscrew", "X", ())}
    why = {one.compensation: one.reason for one in found.rejected}["backlash"]
    assert why == "could not be looked for: X was read at one direction only"


@pytest.mark.parametrize("differ", [False, True])
def test_five_runs_over_nine_targets_suffice(differ: bool) -> None:
    rng = np.random.default_rng(0)
    targets = np.arange(0.0, 801.0, 100.0)
    place = np.tile(np.concatenate([targets, targets[::-1]]), 5)
    way = np.tile(np.repeat([1.0, -1.0], 9), 5)
    run = np.repeat(np.arange(5), 18)
    error = 0.01 * np.sin(place / 150) + 0.003 * way + 5e-4 * rng.normal(size=90)
    error += 1e-3 * rng.normal(size=5)[run]  # set-ups: no compensation
    if differ:
        error += 0.002 * way * np.cos(place / 200)
    found = discover(
        Observed(
            time=None,
            run=run,
            source=np.zeros(90, dtype=np.int64),
            position={"X": place},
            error={"X": error},
            direction={"X": way},
        ),
        ("X",),
    )
    if differ:
        assert [one.keys for one in found.found] == [{"bilateral": True}]
    else:
        assert named(found) == {("leadscrew", "X", ()), ("backlash", "X", ())}
    assert not found.unexplained


def test_nothing_measured_is_refused() -> None:
    nothing = Observed(
        time=None,
        run=np.zeros(5, dtype=np.int64),
        source=np.zeros(5, dtype=np.int64),
        position={"X": np.arange(5.0)},
    )
    with pytest.raises(DiscoverError, match="no measured error and no current"):
        discover(nothing, ("X",))
    few = dataclasses.replace(nothing, error={"X": np.zeros(5)})
    with pytest.raises(DiscoverError, match="5 readings of the error of X"):
        discover(few, ("X",))


def plane_with(wild: float) -> Discovery:
    """Return what is found in a plane of 20 x 20 points, one of them off by so many mm."""
    x, y = map(np.ravel, np.meshgrid(*2 * [np.linspace(0.0, 300.0, 20)]))
    error = 0.02 * np.sin(x / 120) * np.cos(y / 100)
    error += 2e-3 * np.random.default_rng(1).normal(size=400)
    error[133] += wild
    rows = np.zeros(400, dtype=np.int64)
    position = {"X": x, "Y": y}
    data = Observed(run=rows, source=rows, position=position, error={"Z": error})
    return discover(data, ("X", "Y", "Z"))


@pytest.mark.parametrize("wild", [10.0, 1000.0])
def test_one_wild_reading_hides_no_plane(wild: float) -> None:
    found = plane_with(wild)
    assert named(found) == {("plane", "Z", ("X", "Y"))}
    # 20 x 20 readings hold 10.9 µm of plane about 2 µm of noise, so 97 % of the square.
    assert found.found[0].share == pytest.approx(0.97, abs=0.03)


@pytest.mark.parametrize(("cold", "names"), [(20.0, 1), (24.0, 2)])
def test_a_law_that_is_zero_at_the_reference_needs_no_leadscrew(
    cold: float, names: int
) -> None:
    rng = np.random.default_rng(1)
    time = np.arange(3600.0)
    place = 400.0 * rng.random(3600)
    warm = cold + 3.0 - 3.0 * np.cos(2 * np.pi * time / 1700.0)
    error = 1.1e-5 * (warm - 20.0) * place + 5e-4 * rng.normal(size=3600)
    rows = np.zeros(3600, dtype=np.int64)
    sensor = {"scale": warm + 0.01 * rng.normal(size=3600)}
    data = Observed(
        time=time, run=rows, source=rows, position={"X": place}, error={"X": error},
        temperature=sensor,
    )  # fmt: skip
    found = discover(data, ("X",))
    # Where 20 °C was not measured the law is zero at 24 °C, as that of a fit is, and what
    # the axis shows there, 11e-6 x 4 K over 400 mm or 5.1 µm rms, is a leadscrew.
    kinds = ["temperature", "leadscrew"][:names]
    assert [one.compensation for one in found.found] == kinds
    if names == 2:
        assert found.found[1].rms == pytest.approx(5.1e-3, rel=0.05)


def test_a_warm_up_may_be_a_drift_and_a_fit_says_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 7200.0, 20.0)
    warm = 6.0 * (1.0 - np.exp(-time / 2000.0))
    error = 4e-3 * warm + 5e-4 * rng.normal(size=360)
    sensor = 20.0 + warm + 0.02 * rng.normal(size=360)
    table = np.column_stack([time, np.full(360, 100.0), error, sensor])
    header = "time [s],Z.position [mm],Z.error [mm],temperature.frame"
    np.savetxt(tmp_path / "log.csv", table, "%.6f", ",", header=header, comments="")
    job = (
        '[axes.Z]\nnumber = 3\n[measurements.m]\nfile = "log.csv"\nremove = "offset"\n'
    )
    fit = '[[fits]]\ncompensation = "temperature"\naxis = "Z"\nmeasurement = "m"\n'
    fit += 'sensors = { offset = "frame" }\nlag = "none"\n'
    (tmp_path / "job.toml").write_text(job + fit)
    assert main(["discover", str(tmp_path / "job.toml")]) == 1
    doubt = "temperature offset of Z by frame or drift of the instrument at Z"
    assert f"the data cannot tell: {doubt}" in capsys.readouterr().out
    (result,) = run_job(tmp_path / "job.toml", tmp_path / "out").fits
    assert any(
        f"The data cannot tell: {doubt}" in each.message for each in result.remarks
    )


GROWING = """\
[axes.X]
number = 1
[measurements.m]
file = "log.csv"
remove = "none"
"""


def growing(folder: Path, run: np.ndarray, noise: np.ndarray) -> None:
    """A scale that grows by 11 µm/m/K about its end while it warms by 6 K, for 50 minutes."""
    rng = np.random.default_rng(2)
    time = 10.0 * np.arange(len(noise))
    place, warm = (
        rng.uniform(0.0, 800.0, len(noise)),
        6.0 * (1.0 - np.exp(-time / 1000.0)),
    )
    error = 1.1e-5 * warm * place + 4e-3 * np.sin(place / 120.0) + noise
    sensor = 20.0 + warm + 0.02 * rng.normal(size=len(noise))
    table = np.column_stack([time, run, place, error, sensor])
    header = "time [s],run,X.position [mm],X.error [mm],temperature.frame"
    np.savetxt(folder / "log.csv", table, "%.6f", ",", header=header, comments="")
    (folder / "job.toml").write_text(GROWING)


DOUBT = (
    "he data cannot tell: temperature offset of X by frame or drift of the instrument"
)


def test_a_shift_that_may_be_a_drift_is_told_beside_a_growth_that_may_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    noise = 6e-4 * np.random.default_rng(1).normal(size=300)
    growing(tmp_path, np.arange(300) // 60, noise)
    new = tmp_path / "new.toml"
    assert main(["discover", str(tmp_path / "job.toml"), "--write", str(new)]) == 1
    said, beside = capsys.readouterr()
    assert DOUBT in said
    # Who runs the written job a month later reads it there.
    assert "the lists of this job may hold a part of it" in " ".join(beside.split())
    assert new.read_text().startswith(f"# T{DOUBT}")
    # The growth along the axis is no drift: the temperature is found.
    assert "temperature of X: " in said
    fits = run_job(new, tmp_path / "out").fits
    (heat,) = [fit for fit in fits if fit.compensation == "temperature"]
    assert any(DOUBT in each.message for each in heat.remarks)


def test_a_job_that_states_a_drift_leaves_the_shift_to_it_and_can_be_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, noise = np.random.default_rng(1), np.zeros(300)
    for k, each in enumerate(6e-4 * rng.normal(size=300)):  # it wanders
        noise[k] = 0.8 * noise[k - 1] + each
    growing(tmp_path, np.zeros(300), noise)
    new = tmp_path / "new.toml"
    assert main(["discover", str(tmp_path / "job.toml"), "--write", str(new)]) == 1
    assert DOUBT in capsys.readouterr().out
    text = new.read_text()
    assert 'sensors = { coefficient = "frame" }' in text
    assert "drift = " in text
    run_job(new, tmp_path / "out")
    # With the shift asked for as well, the whole temperature was left out.
    assert (tmp_path / "out" / "temperature_X.csv").exists()


def test_the_lag_behind_a_sensor_is_told(virtual: ModuleType) -> None:
    motion = virtual.motion(1, "XY", 1800.0, ROWS)
    body = np.asarray(motion.temperature["spindle"])
    share = 1.0 - np.exp(-np.diff(motion.time, prepend=0.0) / 45.0)
    late = np.empty_like(body)
    late[0] = body[0]
    for k in range(1, len(body)):
        late[k] = late[k - 1] + share[k] * (body[k] - late[k - 1])
    recorded = virtual.observe(motion, {"X": [lambda _: 2e-3 * (late - 30.0)]}, 1)
    (one,) = discover(recorded, ("X", "Y")).found
    assert one.keys == {"sensors": {"offset": "spindle"}}
    # The last step of the search is 9 % wide.
    lag = float(one.sentence.split("spindle by about ")[1].split()[0])
    assert lag == pytest.approx(45.0, rel=0.1)


def test_pysindy_selects_and_its_libraries_carry_the_terms(
    virtual: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    import pysindy

    kept: list[int] = []
    plain = pysindy.STLSQ.fit

    def fit(self: Any, *rows: Any, **options: Any) -> Any:
        result = plain(self, *rows, **options)
        kept.append(int(np.count_nonzero(self.coef_)))
        return result

    monkeypatch.setattr(pysindy.STLSQ, "fit", fit)
    monkeypatch.setattr(pysindy.TensoredLibrary, "transform", nothing_but_zeros)
    assert not look(virtual, virtual.line("X", 3, 0.004)).found
    monkeypatch.undo()
    monkeypatch.setattr(pysindy.STLSQ, "fit", fit)
    found = look(virtual, virtual.line("X", 3, 0.004))
    assert named(found) == {("leadscrew", "X", ())}
    # Two selections of twelve pairs of halves, each by a thresholded regression of 9 terms.
    assert len(kept) == 48
    assert set(kept) <= {1, 2}


def nothing_but_zeros(self: Any, rows: Any) -> Any:
    """Return features as a library would that has no functions."""
    return np.zeros((len(rows), self.n_output_features_))


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_runs_that_drift_far_are_told(drift: float) -> None:
    rng = np.random.default_rng(1)
    x, y = (g.ravel() for g in np.meshgrid(np.arange(9.0) * 75, np.arange(6.0) * 80))
    place = {"X": np.tile(x, 3), "Y": np.tile(y, 3)}
    rows = len(place["X"])
    time = np.arange(rows) * 4.0
    error = 0.008 * np.sin(place["X"] / 150) * np.cos(place["Y"] / 170)
    error += drift * (1.0 - np.exp(-time / 200)) + 5e-4 * rng.normal(size=rows)
    found = discover(
        Observed(
            time=time,
            run=np.repeat(np.arange(3), len(x)),
            source=np.zeros(rows, dtype=np.int64),
            position=place,
            error={"Z": error},
            direction={},
        ),
        ("X", "Y", "Z"),
    )
    told = [one.sentence for one in found.unexplained if one.what == "runs of Z"]
    assert len(told) == (drift > 0.0)
    assert all("The runs of Z differ, or drift meanwhile" in one for one in told)
