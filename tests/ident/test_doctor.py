"""The doctor: right where the data can tell, silent where they cannot."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.exchange import ExchangeError, Reading
from axcomp.ident.proof import Diagnosis, Measured, diagnose, not_judged
from axcomp.models import Conventions

NODES = np.arange(0.0, 801.0, 20.0)
ERROR = np.round(
    0.02 * np.sin(NODES / 60)
    + 5e-5 * NODES
    + 0.006 * np.random.default_rng(2).normal(size=NODES.size),
    4,
)
LIST = ListFile.parse(
    (
        "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 200000\n"
        f"kw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max {NODES.size}\n"
        "kw.ssfk.set_pos_without_comp 1\n"
        + "".join(
            f"kw.ssfk.table[{k}].pos {round(1e4 * value)}\n"
            for k, value in enumerate(ERROR)
        )
    ).encode(),
    "achskw1.lis",
)
DOCTOR = ["doctor", "achskw1.lis", "--before", "before.toml"]
TARGETS = np.arange(0.0, 801.0, 10.0)
RUNS = 10
X = np.tile(np.concatenate([TARGETS, TARGETS[::-1]]), RUNS)
WAY = np.tile(np.repeat([1, -1], TARGETS.size), RUNS)
SIZE = float(np.std(np.interp(X, NODES, ERROR)))


def error(x: np.ndarray) -> np.ndarray:
    return np.interp(x, NODES, ERROR)


EFFECTS = {
    "right": -error(X),
    "sign": error(X),
    "unit": -10.0 * error(X),
    "small unit": -0.1 * error(X),
    "unit of mm": -1000.0 * error(X),
    "shift": -error(X - 12.0),
    "twice": -2.0 * error(X),
    "wrong axis": np.zeros(X.size),
}


def draw(
    effect: np.ndarray, noise: float, rng: np.random.Generator, other: bool = False
) -> Diagnosis:
    """Return the diagnosis of one pair of measurements; of two axes with `other`."""

    def reading(values: np.ndarray) -> np.ndarray:
        return np.asarray(values + noise * rng.normal(size=X.size))

    before = [Measured(1, {1: X}, reading(error(X)), None)]
    after = [Measured(1, {1: X}, reading(error(X) + effect), None)]
    if other:
        # The list acts on axis 2, along the positions of axis 1.
        place = {1: X, 2: np.zeros(X.size)}
        before.append(Measured(2, place, reading(0.0 * X), None))
        after.append(Measured(2, place, reading(-error(X)), None))
    found = diagnose([LIST], before, after, Reading(Conventions()))
    assert len(found) == 1
    return found[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [
        name if name == "sign" else pytest.param(name, marks=pytest.mark.heavy)
        for name in sorted(EFFECTS)
    ],
)
def test_99_of_100_draws_are_right_at_noise_of_a_third_of_the_error(fault: str) -> None:
    rng = np.random.default_rng(17)
    draws = [draw(EFFECTS[fault], SIZE / 3, rng).verdict for _ in range(100)]
    word = "unit" if "unit" in fault else fault
    assert Counter(draws)[word] >= 99


@pytest.mark.heavy
def test_another_axis_is_named_in_99_of_100_draws() -> None:
    rng = np.random.default_rng(18)
    found = [draw(EFFECTS["wrong axis"], SIZE / 3, rng, other=True) for _ in range(100)]
    named = [(one.verdict, one.value) for one in found]
    assert named.count(("wrong axis", 2.0)) >= 99


@pytest.mark.parametrize("fault", sorted(EFFECTS))
def test_one_draw_of_each_fault_is_right(fault: str) -> None:
    one = draw(EFFECTS[fault], SIZE / 3, np.random.default_rng(4))
    assert one.verdict == ("unit" if "unit" in fault else fault)


@pytest.mark.parametrize("entry", [None, 20])
def test_a_list_that_is_right_but_for_one_entry_is_not_called_right_without_more(
    entry: int | None,
) -> None:
    run = ERROR.copy()
    if entry is not None:
        run[entry] += 0.05
    effect = -np.interp(X, NODES, run)
    one = draw(effect, 4e-4, np.random.default_rng(4))
    assert one.verdict == "right"
    whole = one.sentence == "right: the list adds what it says"
    assert whole == (entry is None)
    if entry is not None:
        assert f"near A1 = {NODES[entry]:.4g}, as if an entry" in one.sentence


GAP = 0.006 + 0.002 * np.sin(NODES / 200.0)


def two_way(
    effect: np.ndarray,
    rng: np.random.Generator,
    noise: float,
    ahead: np.ndarray = ERROR,
    gap: np.ndarray = GAP,
    x: np.ndarray = X,
    way: np.ndarray = WAY,
) -> Diagnosis:
    """Return the diagnosis of a table of two columns, measured in both directions."""
    lines = [
        "kopf.achs_nr 1", "kw.ssfk.unit 1", "kw.ssfk.interval 200000", "kw.ssfk.bilateral 1",
        f"kw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max {NODES.size}",
        "kw.ssfk.set_pos_without_comp 1",
    ]  # fmt: skip
    for name, values in (("pos", ahead), ("neg", ahead - gap)):
        entries = np.rint(1e4 * values).astype(int)
        lines += [f"kw.ssfk.table[{k}].{name} {v}" for k, v in enumerate(entries)]
    listing = ListFile.parse(("\n".join(lines) + "\n").encode(), "achskw1.lis")
    bare = np.interp(x, NODES, ahead) - np.interp(x, NODES, gap) * (way < 0)
    before, after = (
        [Measured(1, {1: x}, values + noise * rng.normal(size=x.size), way)]
        for values in (bare, bare + effect)
    )
    (found,) = diagnose([listing], before, after, Reading(Conventions()))
    return found


def test_lost_motion_that_came_since_is_no_fault_of_a_list_without_directions() -> None:
    rng = np.random.default_rng(4)
    lost = 0.008 * (WAY < 0)
    before, after = (
        [Measured(1, {1: X}, values + 5e-4 * rng.normal(size=X.size), WAY)]
        for values in (error(X), -lost)
    )
    (found,) = diagnose([LIST], before, after, Reading(Conventions()))
    assert (found.verdict, found.sign) == ("right", 1)
    assert "beside a difference of the directions that no list adds" in found.sentence


@pytest.mark.parametrize(
    ("missing", "verdict", "words"),
    [
        (0.0, "right", "right: the list adds what it says"),
        (0.1, "right", "right: the list adds what it says"),
        (1.0, "other", "are missing between the directions, as if one column"),
        (-1.0, "other", "too many lie between the directions, as if the backlash"),
        (2.0, "swapped", "directions swapped"),
    ],
)
def test_difference_of_the_directions_that_is_missing_or_twice_is_not_called_right(
    missing: float, verdict: str, words: str
) -> None:
    # Rows of both directions alternate from place to place, and so does what is left.
    gap = np.interp(X, NODES, GAP)
    effect = -error(X) + gap * (WAY < 0) + 0.5 * missing * gap * WAY
    rng = np.random.default_rng(3)
    draws = [two_way(effect, rng, 2e-3) for _ in range(10)]
    assert {one.verdict for one in draws} == {verdict}
    assert all(words in one.sentence for one in draws)


@pytest.mark.parametrize(
    ("size", "length", "slope"), [(0.012, 130.0, -2e-5), (-0.020, 250.0, 0.0)]
)
def test_another_curve_is_no_table_that_lies_elsewhere_and_settles_no_sign(
    size: float, length: float, slope: float
) -> None:
    # The list was never loaded, and something smooth acts in both directions alike.
    ahead, gap = 3e-5 * NODES + 0.008 * np.sin(NODES / 90), np.full(NODES.size, 0.006)
    x = np.tile(np.concatenate([NODES, NODES[::-1]]), 5)
    way = np.tile(np.repeat([1, -1], NODES.size), 5)
    effect = size * np.sin(x / length) + slope * x
    one = two_way(effect, np.random.default_rng(1), 4e-4, ahead, gap, x, way)
    assert one.verdict in {"other", "cannot tell"}, one.sentence
    assert not one.sign


@pytest.mark.parametrize("fault", ["right", "sign", "small unit", "shift", "twice"])
def test_in_strong_noise_nothing_is_guessed(fault: str) -> None:
    rng = np.random.default_rng(19)
    draws = Counter(draw(EFFECTS[fault], 60 * SIZE, rng).verdict for _ in range(12))
    # At odds of 99 to 1, a dozen draws of pure noise have no verdict.
    assert draws == {"cannot tell": 12}


def test_verdicts_have_a_value_and_a_sentence() -> None:
    rng = np.random.default_rng(3)
    one = draw(EFFECTS["shift"], SIZE / 10, rng)
    # The places that are tried are 5 mm apart (800 mm in 160).
    assert one.value == pytest.approx(12.0, abs=3.0)
    assert one.sentence.endswith("mm further")
    assert draw(EFFECTS["sign"], SIZE / 10, rng).sentence == "added with opposite sign"
    assert draw(EFFECTS["small unit"], SIZE / 10, rng).value == 0.1
    large = draw(EFFECTS["unit of mm"], SIZE / 10, rng)
    assert large.sentence == "unit is 1000 times larger"
    other = draw(EFFECTS["wrong axis"], SIZE / 10, rng, other=True)
    assert other.sentence == "acts on A2 instead of A1"


@pytest.mark.parametrize("fault", ["right", "twice", "sign"])
def test_beside_a_temperature_line_no_fault_is_named(fault: str) -> None:
    # What a PLC adds stands in no list, and may look like any fault of a table.
    machine = ListFile.parse(
        b"kopf.achs_nr 1\nlr_param.ssfk 1\nlr_param.temp_comp 1\n"
        b"lr_param.temp_comp_position_0 0\nlr_param.temp_comp_offset_0 0\n"
        b"lr_param.temp_comp_coefficient 0.0\n",
        "achsmds1.lis",
    )
    rng = np.random.default_rng(9)
    noise = SIZE / 10 * rng.normal(size=(2, X.size))
    before = [Measured(1, {1: X}, error(X) + noise[0], None)]
    after = [Measured(1, {1: X}, error(X) + EFFECTS[fault] + noise[1], None)]
    found = diagnose([LIST, machine], before, after, Reading(Conventions()))
    verdicts = {one.compensation: (one.verdict, one.sign) for one in found}
    told = ("right", 1) if fault == "right" else ("cannot tell", 0)
    assert verdicts == {"leadscrew": told, "temperature": ("cannot tell", 0)}
    (screw,) = [one for one in found if one.compensation == "leadscrew"]
    words = f"{fault} (100 %), or what another list of the axis adds"
    assert (words in screw.sentence) == (fault != "right")


@pytest.mark.parametrize(("times", "verdict"), [(1.0, "right"), (-1.0, "sign")])
def test_beside_a_temperature_line_the_flank_of_a_backlash_is_told(
    times: float, verdict: str
) -> None:
    # No temperature moves an axis one way where it goes up and another where it comes back.
    machine = ListFile.parse(
        b"kopf.achs_nr 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 120\n"
        b"lr_param.temp_comp 1\nlr_param.temp_comp_position_0 0\n"
        b"lr_param.temp_comp_offset_0 0\nlr_param.temp_comp_coefficient 0.0\n",
        "achsmds1.lis",
    )
    lost, warm = 0.012 * (WAY < 0), 2e-5 * X
    noise = 1e-3 * np.random.default_rng(10).normal(size=(2, X.size))
    before = [Measured(1, {1: X}, lost + noise[0], WAY)]
    after = [Measured(1, {1: X}, (1.0 - times) * lost + warm + noise[1], WAY)]
    found = diagnose([machine], before, after, Reading(Conventions()))
    assert {one.compensation: one.verdict for one in found}["backlash"] == verdict


def test_a_factor_that_is_no_fault_is_said_and_not_guessed() -> None:
    one = draw(-0.5 * error(X), SIZE / 10, np.random.default_rng(5))
    assert one.verdict == "cannot tell"
    # The factor is known to a hundredth or two.
    assert "cannot tell: what it does is 0.5" in one.sentence


@pytest.mark.parametrize(("times", "acts"), [(1e-3, -1.0), (0.0, -1.0), (0.1, 0.0)])
def test_errors_too_good_to_be_of_the_machine_are_refused(
    times: float, acts: float
) -> None:
    # Of the opposite sign, read in mm for µm; a column that stands at zero; not loaded, in 10 µm.
    noise = 1e-3 * np.random.default_rng(5).normal(size=(2, X.size))
    before = [Measured(1, {1: X}, error(X) + noise[0], WAY)]
    after = [Measured(1, {1: X}, times * ((1 - acts) * error(X) + noise[1]), WAY)]
    with pytest.raises(ExchangeError, match="is their unit right"):
        diagnose([LIST], before, after, Reading(Conventions()))


def test_a_wild_reading_changes_nothing() -> None:
    effect = EFFECTS["sign"].copy()
    effect[100] += 5.0
    assert draw(effect, SIZE / 3, np.random.default_rng(6)).verdict == "sign"


@pytest.mark.parametrize("fault", ["right", "sign", "twice"])
def test_a_list_that_acts_at_few_places_is_told_like_any_other(fault: str) -> None:
    end = LIST.dumps().decode().splitlines()
    rise = np.clip(NODES - 740.0, 0.0, None) / 60.0 * 0.05
    values = iter(np.rint(1e4 * rise).astype(int))
    lines = [
        f"{line.rpartition(' ')[0]} {next(values)}" if "].pos " in line else line
        for line in end
    ]
    listing = ListFile.parse("\n".join(lines).encode() + b"\n", "achskw1.lis")
    times = {"right": -1.0, "sign": 1.0, "twice": -2.0}[fault]
    first, rng = np.interp(X, NODES, rise), np.random.default_rng(3)
    before, after = (
        [Measured(1, {1: X}, values + 1e-3 * rng.normal(size=X.size), None)]
        for values in (first, (1.0 + times) * first)
    )
    (found,) = diagnose([listing], before, after, Reading(Conventions()))
    assert found.verdict == fault


def test_wild_readings_at_places_that_were_read_twice_change_nothing() -> None:
    places = NODES[::2]
    twice, rng = np.tile(places, 2), np.random.default_rng(9)
    before, after = (
        [Measured(1, {1: twice}, values + 1e-3 * rng.normal(size=twice.size), None)]
        for values in (error(twice), 0.0 * twice)
    )
    after[0].error[[0, 13, 26]] += 0.3
    (found,) = diagnose([LIST], before, after, Reading(Conventions()))
    assert found.verdict == "right"


def test_places_of_the_second_measurement_may_be_others() -> None:
    rng = np.random.default_rng(7)
    places = np.tile(np.arange(3.0, 799.0, 7.0), 5)
    before = [Measured(1, {1: X}, error(X) + 1e-3 * rng.normal(size=X.size), None)]
    noise = 1e-3 * rng.normal(size=places.size)
    after = [Measured(1, {1: places}, 2 * error(places) + noise, None)]
    one = diagnose([LIST], before, after, Reading(Conventions()))[0]
    assert one.verdict == "sign"


PLAY = ListFile.parse(
    b"kopf.achs_nr 1\nlr_param.ssfk 1\nlr_param.anwahl_losekomp 1\ngetriebe[0].lose 120\n",
    "achsmds1.lis",
)


def path_of(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """X and Y of a log, the speed of X and its direction: targets anywhere, speeds of all sizes."""
    rng = np.random.default_rng(seed)
    legs = [np.array([400.0])]
    for _ in range(120):
        step = rng.uniform(0.1, 1.0)
        aim = rng.uniform(0.0, 800.0)
        count = max(int(abs(aim - legs[-1][-1]) / step), 2)
        legs.append(np.linspace(legs[-1][-1], aim, count + 1)[1:])
    x = np.concatenate(legs)
    speed = np.gradient(x) * 250.0
    y = 200.0 + 200.0 * np.sin(np.arange(len(x)) / rng.uniform(150.0, 250.0))
    return x, y, speed, np.where(np.diff(x, prepend=x[0] - 1.0) >= 0, 1, -1)


@pytest.mark.parametrize(
    ("sign", "said"),
    [
        (1.0, {"right"}),
        (-1.0, {"sign"}),
        pytest.param(0.0, {"cannot tell", "wrong axis"}, marks=pytest.mark.heavy),
    ],
)
def test_logs_of_other_paths_judge_each_list_by_the_axes_that_it_follows(
    sign: float, said: set[str]
) -> None:
    rng = np.random.default_rng(8)
    before, after = [], []
    for measured, factor in ((before, 0.0), (after, sign)):
        x, y, speed, way = path_of(int(rng.integers(1000)))
        noise = 5e-4 * rng.normal(size=(2, len(x)))
        own = error(x) + np.where(way > 0, 0.0, 0.012)
        # The delay of the instrument is known to 10 µs: 2 µm at 200 mm/s.
        late = 1e-5 * speed
        left = own - factor * error(x) - factor * np.where(way > 0, 0.0, 0.012)
        left += 0.9 * rng.choice([-1.0, 1.0]) * late
        place = {1: x, 2: y}
        measured.append(Measured(1, place, left + noise[0], way, late=late))
        other = 0.01 * np.sin(y / 80.0) + 2e-6 * x + noise[1]
        measured.append(Measured(2, place, other, None))
    found = diagnose([LIST, PLAY], before, after, Reading(Conventions()))
    assert {one.verdict for one in found} <= said, [one.sentence for one in found]
    # Y has an error of its own, and nothing of what these lists say.
    assert not [one.sentence for one in found if "instead of" in one.sentence]


@pytest.mark.parametrize(("shift", "said"), [(90.0, "further"), (270.0, "back")])
def test_a_turn_is_shifted_by_the_shorter_way_round(shift: float, said: str) -> None:
    rng = np.random.default_rng(4)
    nodes = np.arange(0.0, 361.0, 15.0)
    values = 0.02 * np.sin(np.deg2rad(nodes)) + 0.01 * np.cos(np.deg2rad(2 * nodes))
    lines = [
        "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 150000\nkw.ssfk.kw_startpos 0",
        f"kw.ssfk.kw_nr_max {len(nodes)}\nkw.ssfk.modulo 1",
        "kw.ssfk.set_pos_without_comp 1",
    ]
    lines += [f"kw.ssfk.table[{k}].pos {1e4 * v:.0f}" for k, v in enumerate(values)]
    turning = ListFile.parse(("\n".join(lines) + "\n").encode(), "achskw1.lis")
    places = np.tile(np.arange(0.0, 360.0, 5.0), 4)

    def law(x: np.ndarray) -> np.ndarray:
        return np.interp(np.mod(x, 360.0), nodes, values)

    noise = 1e-4 * rng.standard_normal((2, len(places)))
    left = law(places) - law(places - shift)
    before, after = (
        [Measured(1, {1: places}, error + part, None)]
        for error, part in zip((law(places), left), noise, strict=True)
    )
    reading = Reading(Conventions(), modulo={1: (0.0, 360.0)})
    (found,) = diagnose([turning], before, after, reading)
    assert found.sentence == f"table applied 90.0 ° {said}"


@pytest.mark.parametrize("shift", [0.0, 12.0])
def test_few_readings_that_cannot_tell_a_shift_say_so(shift: float) -> None:
    rng = np.random.default_rng(1)
    places = np.sort(rng.choice(TARGETS, 12, replace=False))
    noise = SIZE / 3 * rng.normal(size=(2, places.size))
    before = [Measured(1, {1: places}, error(places) + noise[0], None)]
    left = error(places) - error(places - shift)
    after = [Measured(1, {1: places}, left + noise[1], None)]
    one = diagnose([LIST], before, after, Reading(Conventions()))[0]
    # Of 12 places 60 mm apart none has a neighbour within the 20 mm of the nodes.
    assert one.verdict == "cannot tell"
    assert "or shifted by up to" in one.sentence


def test_lists_that_act_in_motion_are_named_as_not_judged() -> None:
    lines = (
        "kopf.achs_nr 1", "kw.crosstalk.mode 1", "kw.crosstalk.master_dyn_ax_nr 2",
        "kw.crosstalk.acceleration 2000", "kw.crosstalk.deceleration -2000",
        "kw.crosstalk.position[0].correction_accelerate_dir_pos 300",
        "frict_comp.mode 3", "frict_comp.table_entries 1",
        "frict_comp.table[0].in 1000", "frict_comp.table[0].out 40",
    )  # fmt: skip
    other = ListFile.parse(("\n".join(lines) + "\n").encode(), "achskw1.lis")
    told = not_judged([other], Conventions(), {1: "X"})
    assert [line.split(": ")[:2] for line in told] == [
        ["X crosstalk", "not judged"],
        ["X friction", "not judged"],
    ]
    assert "another axis accelerates" in told[0]
    assert "current and no position" in told[1]


def test_an_axis_that_was_not_measured_is_refused() -> None:
    other = [Measured(2, {2: X}, 0.0 * X, None)]
    with pytest.raises(ExchangeError, match="lists for A1; measured both times: A2"):
        diagnose([LIST], other, other, Reading(Conventions()))


@pytest.fixture
def shop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with the list of X in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "achskw1.lis").write_bytes(LIST.dumps())
    return tmp_path


def write_job(folder: Path, name: str, effect: float) -> None:
    rng = np.random.default_rng(8)
    values = error(X) + effect * -error(X) + 2e-3 * rng.normal(size=X.size)
    rows = np.stack([X, values, WAY], axis=1)
    np.savetxt(
        folder / f"{name}.csv", rows, fmt="%.6f", delimiter=",",
        header="X.position,X.error,X.direction", comments="",
    )  # fmt: skip
    (folder / f"{name}.toml").write_text(
        f'[axes.X]\nnumber = 1\n[measurements.laser]\nfile = "{name}.csv"\n'
    )


@pytest.mark.parametrize(
    ("effect", "status", "sentence"),
    [
        (1.0, 0, "X leadscrew: right: the list adds what it says\n"),
        (2.0, 1, "X leadscrew: applied twice\n"),
    ],
)
def test_the_command_needs_no_fits_and_its_status_says_whether_all_is_right(
    shop: Path,
    capsys: pytest.CaptureFixture[str],
    effect: float,
    status: int,
    sentence: str,
) -> None:
    write_job(shop, "before", 0.0)
    write_job(shop, "after", effect)
    assert main([*DOCTOR, "--after", "after.toml"]) == status
    assert capsys.readouterr().out == sentence
    assert main([*DOCTOR, "--after", "after.toml", "--json"]) == status
    assert '"verdict"' in capsys.readouterr().out


def test_an_axis_measured_beside_the_one_with_the_list_has_none_and_need_not(
    shop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_job(shop, "before", 0.0)
    write_job(shop, "after", 1.0)
    for name in ("before", "after"):
        job, table = shop / f"{name}.toml", shop / f"{name}.csv"
        head, *rows = table.read_text().splitlines()
        table.write_text("\n".join([head + ",Y.error", *(f"{r},0.001" for r in rows)]))
        active = '["leadscrew"]' if name == "after" else "[]"
        job.write_text(job.read_text() + f"active = {active}\n[axes.Y]\nnumber = 2\n")
    assert main([*DOCTOR, "--after", "after.toml"]) == 0
    assert "not judged" not in capsys.readouterr().err


def test_a_part_of_the_travel_is_said_to_be_no_more(
    shop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_job(shop, "before", 0.0)
    write_job(shop, "after", 1.0)
    table = shop / "after.csv"
    head, *rows = table.read_text().splitlines()
    near = [row for row in rows if float(row.split(",")[0]) < 400.0]
    table.write_text("\n".join([head, *near]))
    assert main([*DOCTOR, "--after", "after.toml"]) == 0
    assert "shows X = 0 to 390 only" in " ".join(capsys.readouterr().err.split())


def test_what_was_switched_and_no_list_has_is_not_called_right(
    shop: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_job(shop, "before", 0.0)
    write_job(shop, "after", 1.0)
    for name, active in {"before": "[]", "after": '["leadscrew", "backlash"]'}.items():
        with (shop / f"{name}.toml").open("a") as file:
            file.write(f"active = {active}\n")
    assert main([*DOCTOR, "--after", "after.toml"]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "X backlash: not judged: it was switched between the measurements" in said


def write_log(folder: Path, name: str, feed: float, effect: float) -> None:
    """Write a recording of X that never stops, 50 ms behind its command."""
    time = np.arange(0.0, 800.0 / feed, 0.02)
    way = feed * time
    actual = way - 0.05 * feed + (1.0 - effect) * error(way)
    rows = np.stack([time, way, actual], axis=1)
    np.savetxt(
        folder / f"{name}.csv", rows, fmt="%.6f", delimiter=",",
        header="time,X.position,X.actual", comments="",
    )  # fmt: skip
    (folder / f"{name}.toml").write_text(
        f'[axes.X]\nnumber = 1\n[measurements.laser]\nfile = "{name}.csv"\n'
    )


def test_a_log_in_motion_that_holds_the_following_error_is_refused(
    shop: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_log(shop, "before", 10.0, 0.0)
    write_log(shop, "after", 20.0, 1.0)
    assert main([*DOCTOR, "--after", "after.toml"]) == 1
    shown = capsys.readouterr()
    assert not shown.out
    assert "before.csv: line 2: found X moving" in shown.err


def test_a_marker_for_no_reading_is_refused(
    shop: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_job(shop, "before", 0.0)
    write_job(shop, "after", 1.0)
    lines = (shop / "after.csv").read_text().splitlines()
    lines[3] = "20.000000,9.9e37,1"
    (shop / "after.csv").write_text("\n".join(lines) + "\n")
    assert main([*DOCTOR, "--after", "after.toml"]) == 1
    assert "line 4: found 9.9e+37 mm" in capsys.readouterr().err


def test_a_list_in_increments_names_what_the_doctor_has(
    shop: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = LIST.dumps().replace(b"kw.ssfk.unit 1", b"kw.ssfk.unit 0")
    (shop / "achskw1.lis").write_bytes(text)
    write_job(shop, "before", 0.0)
    write_job(shop, "after", 1.0)
    assert main([*DOCTOR, "--after", "after.toml"]) == 1
    shown = capsys.readouterr().err
    assert "increment = … of the axis in the job" in shown
    assert "--increment" not in shown


def plane_list(table: np.ndarray) -> bytes:
    """A plane of axis 5 over 11 and 12, nodes every 50 mm; entries in 0.1 µm."""
    prefix = "kw.crosscomp2"
    head = (
        f"kopf.achs_nr 5\n{prefix}.unit 1\n{prefix}.grid QUADRATIC\n"
        f"{prefix}.interval 500000\n{prefix}.last_index_master1 {table.shape[1] - 1}\n"
        f"{prefix}.last_index_master2 {table.shape[0] - 1}\n"
        f"{prefix}.master1_ax_nr 11\n{prefix}.master2_ax_nr 12\n"
    )
    rows = [
        f"{prefix}.table[{j}][{i}].correction {v}\n"
        for (j, i), v in np.ndenumerate(table)
    ]
    return (head + "".join(rows)).encode()


def test_the_master_along_which_a_plane_is_shifted_is_named_as_in_the_job() -> None:
    rng = np.random.default_rng(5)
    table = np.rint(200 * rng.normal(size=(7, 9))).astype(int)
    listing = ListFile.parse(plane_list(table), "achskw5.lis")
    u, v = (
        each.ravel()
        for each in np.meshgrid(np.arange(0, 401.0, 20), np.arange(0, 301.0, 20))
    )
    law = RegularGridInterpolator(
        (50.0 * np.arange(7), 50.0 * np.arange(9)), 1e-4 * table
    )
    added = law(np.stack([v, np.clip(u - 25.0, 0.0, 400.0)], axis=-1))
    place = {11: u, 12: v}
    before, after = (
        [Measured(5, place, values + 1e-4 * rng.normal(size=u.size), None)]
        for values in (0.0 * u, added)
    )
    names = {5: "W", 11: "U", 12: "V"}
    (found,) = diagnose([listing], before, after, Reading(Conventions()), names=names)
    assert found.verdict == "shift"
    assert found.sentence == "table applied 25.0 mm further along U"


def test_a_plane_that_was_measured_with_another_set_up_is_right_beside_a_slope() -> (
    None
):
    rng = np.random.default_rng(6)
    table = np.rint(200 * rng.normal(size=(7, 9))).astype(int)
    listing = ListFile.parse(plane_list(table), "achskw5.lis")
    ends = np.arange(0, 401.0, 20), np.arange(0, 301.0, 20)
    u, v = (each.ravel() for each in np.meshgrid(*ends))
    law = RegularGridInterpolator(
        (50.0 * np.arange(7), 50.0 * np.arange(9)), 1e-4 * table
    )
    added = law(np.stack([v, u], axis=-1)) + 2e-4 * u  # a straightedge at 0.2 mm/m
    before, after = (
        [Measured(5, {11: u, 12: v}, values + 1e-4 * rng.normal(size=u.size), None)]
        for values in (0.0 * u, added)
    )
    (found,) = diagnose([listing], before, after, Reading(Conventions()))
    assert (found.verdict, found.sign) == ("right", 1)
    assert found.sentence.endswith("beside a slope that no list adds (the set-up of the"
                                   " instrument?)")  # fmt: skip


@pytest.mark.parametrize("along", [0, 1])
def test_a_mirrored_plane_is_not_called_shifted(along: int) -> None:
    places = np.meshgrid(np.arange(0, 401.0, 50), np.arange(0, 301.0, 50))
    x, y = (each.ravel() for each in places)
    error = 0.02 * np.sin(x / 170) * np.cos(y / 120) + 0.03 * (x / 400) * (y / 300)
    table = np.rint(-1e4 * error.reshape(7, 9)).astype(int)
    added = 1e-4 * np.flip(table, along).ravel()
    rng = np.random.default_rng(6)
    before, after = (
        [Measured(5, {11: x, 12: y}, values + 8e-4 * rng.normal(size=x.size), None)]
        for values in (error, error + added)
    )
    listing = ListFile.parse(plane_list(table), "achskw5.lis")
    (found,) = diagnose([listing], before, after, Reading(Conventions()))
    assert found.verdict == "other"
    assert "no single fault of this list explains" in found.sentence
