"""Job files: every mistake ends in one line with the place, before any work."""

import datetime
import pickle
from pathlib import Path

import pytest

from axcomp.data.toml import TomlError
from axcomp.ident.job import JobError, OutputError, load_job

GOOD = """
title = "Portal mill 7"
[machine]
id = "mill-7"
measured_at = 2026-11-20
[controller]
build = "V3.1.3108.4"
cycle_time = 0.001
[axes.X]
number = 1
limits = [-10.0, 410]
[axes.Y]
number = 2
[axes.Z]
number = 3
name = "Z_ACHSE"
[measurements.probe]
file = "p.csv"
active = []
[measurements.probe.columns]
"X.position" = { column = "x", unit = "mm" }
"Y.position" = "y"
"Z.error" = { column = "dz", unit = "um" }
[[fits]]
compensation = "cross"
axis = "Z"
master = "X"
measurement = "probe"
setpoints = [-10, 200, 410.0]
[gate]
max_slope = 5
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "p.csv").write_text("x,y,dz\n0,0,1\n")
    return tmp_path


def loaded(folder: Path, old: str = "", new: str = "") -> None:
    assert old in GOOD
    (folder / "job.toml").write_text(GOOD.replace(old, new))
    load_job(folder / "job.toml")


@pytest.mark.parametrize("stated", ['"2026-11-20"', '"20.11.2026"'])
def test_a_date_in_words_is_that_date(folder: Path, stated: str) -> None:
    (folder / "job.toml").write_text(GOOD.replace("2026-11-20", stated))
    when = load_job(folder / "job.toml").spec.machine.measured_at
    assert when == datetime.date(2026, 11, 20)


@pytest.mark.parametrize("stated", ["2026-13-40", "week 47"])
def test_what_is_no_date_is_refused(folder: Path, stated: str) -> None:
    with pytest.raises(JobError, match=rf"5: machine\.measured_at: found '{stated}'"):
        loaded(folder, "2026-11-20", f'"{stated}"')


def test_good_job_loads(folder: Path) -> None:
    loaded(folder)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("max_slope", "max_slop", r"job.toml:31: gate.max_slop: unknown key"),
        ('"Y.position"', '"W.position"', r":22: .*W.position: found 'W', expected an ax"),
        ('"Y.position"', '"x.velocity"', r"x.velocity: found 'x', .*nearest: 'X'"),
        ("number = 3", "nummer = 3", r"job.toml:15: axes.Z.nummer: unknown key"),
        ('unit = "um"', 'units = "um"', r":23: .*Z.error.units: unknown key"),
        ("master =", "masters =", r"fits\[0\].masters: unknown key .*'master'"),
        ("[controller]", "[controler]", r"controler: unknown key .*'controller'"),
        ("number = 3", "number = 1", r"Z.number: found 1, which axis 'X' has"),
        ("number = 3", 'number = "3"', r"axes.Z.number: found '3', expected integer"),
        ("number = 3", "number = 65535", r"axes.Z.number: found 65535, expected .*65534"),
        ("[axes.Z]", '[axes."Z 1"]', r"axes.Z 1: found 'Z 1', expected a letter"),
        ('name = "Z_ACHSE"', 'name = "Linear axis of Z."',
         r"axes.Z.name: found 'Linear axis of Z.', expected at most 16 characters"),
        ("number = 3", "number = true", r"axes.Z.number: found true, expected integer"),
        ("number = 3", "number = 0", r"axes.Z.number: found 0, expected greater than"),
        ('"cross"', '"cros"', r"compensation: found 'cros', .*nearest: 'cross'"),
        ('"cross"', '"backlash"', r"fits\[0\].master: unknown key"),
        ('measurement = "probe"', 'measurement = "prob"', r":28: .*nearest: 'probe'"),
        ('measurement = "probe"', "", "measurement: found nothing, expected"),
        ('axis = "Z"', 'axis = "W"', r"fits\[0\].axis: found 'W', expected an axis"),
        ('master = "X"', 'master = "Z"', "the compensated axis itself"),
        ("-10, 200, 410.0", '-10, 200, "a"', r"setpoints\[2\]: found 'a', expected"),
        ("-10, 200, 410.0", "-10, nan", r"setpoints\[1\]: found nan, expected a fin"),
        ("410.0]\n[gate]", "410.0]\nstart = 1\n[gate]", "found beside setpoints"),
        ("410.0]\n[gate]", "410.0\n[gate]", r"job.toml:\d+: not TOML: "),
        ("p.csv", "q.csv", r":18: .*found 'q.csv': no such"),
        ("p.csv", ".", "found '.': a folder, expected a file"),
        ("V3.1.3108.4", "newest", r":7: controller.build: found 'newest', exp"),
        ("cycle_time = 0.001", "cycle_time = 0", "cycle_time: found 0, expected gre"),
        ("[-10.0, 410]", "[410, -10.0]", "limits: found .*expected the smaller"),
        ("[-10.0, 410]", "[410.0]", "limits: found 1 values, expected 2"),
        ("active = []", 'active = ["plan"]', r"active\[0\]: found 'plan', .*plane"),
        ("active = []", 'remove = "lines"', "remove: found 'lines', .*'line'"),
        ("number = 3", "number = 3\n# or\nnumber = 4", r":17: .*number .*after line 15"),
        ("active = []", "drift = [\n1]\ndrift = 2", r":21: .*drift .*after line 19"),
        ("[controller]", "[gate]\n[controller]", r"\[gate\] a second time, after line 6"),
        ('column = "dz"', 'value = 1, sign = 2', "sign: found 2, expected"),
        ('column = "dz"', 'column = "dz", interval = 2', "found interval, expected value"),
        ("active = []", "expansion = 11.5", "found no material_temperature"),
        ("active = []", "expansion = 11.5e-6\ndrift = 0", r"which no .*1e6 where it was 1/K"),
        ("active = []", "expansion = -11.5\ndrift = 0", "found -11.5, which no material"),
        ("active = []", "expansion = 11.5\nmaterial_temperature = 77", "found 77 °C, .*°F"),
        ("active = []", 'files = ["p.csv"]', "files: found 1 values, expected 2"),
        ('"Z_ACHSE"', '"Z#"', "axes.Z.name: found 'Z#', expected"),
        ('id = "mill-7"', 'conventions = "c.toml"', "'c.toml': no such file"),
        ("max_slope = 5", "max_slope = -5", "max_slope: found -5, expected greater"),
        ("[gate]", "smoothness = -1\n[gate]", "found -1, expected 'auto' or .* 0"),
        ("[gate]", 'loss = "huger"\n[gate]', "loss: found 'huger', .*nearest: 'huber'"),
    ],
)  # fmt: skip
def test_mistake_is_named_with_its_line(
    folder: Path, old: str, new: str, match: str
) -> None:
    with pytest.raises(TomlError, match=match) as caught:
        loaded(folder, old, new)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "keys",
    [
        'compensation = "friction"\ntable_entries = 20\ninertia = "fit"\n'
        'method = "inverse"\nreversal = true\nlevel = 0.5\nrated_current = 10.0\n',
        'compensation = "crosstalk"\nmaster = "X"\nadaptation = ["X", "Y"]\nmode = 3\n'
        "velocity_dependent = true\nacceleration = 900.0\ndeceleration = -900.0\n"
        "positions = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]\n",
    ],
)
def test_keys_of_other_compensations_are_known(folder: Path, keys: str) -> None:
    text = GOOD.partition("[[fits]]")[0] + "[[fits]]\n" + keys
    text += 'axis = "Z"\nmeasurement = "probe"\n'
    (folder / "job.toml").write_text(text)
    assert len(load_job(folder / "job.toml").spec.fits) == 1


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        (
            'compensation = "temperature"\nsteady = { senor = "s", within = 1.0 }\n',
            r"steady.senor: unknown key \(nearest: 'sensor'\)",
        ),
        (
            'compensation = "friction"\nmanual_activation = true\n',
            "manual_activation: friction has no such entry",
        ),
    ],
)
def test_mistake_in_keys_of_other_compensations_is_named(
    folder: Path, keys: str, match: str
) -> None:
    text = GOOD.partition("[[fits]]")[0] + "[[fits]]\n" + keys
    text += 'axis = "Z"\nmeasurement = "probe"\n'
    (folder / "job.toml").write_text(text)
    with pytest.raises(JobError, match=match):
        load_job(folder / "job.toml")


def test_byte_that_is_no_text_is_named_with_its_line(folder: Path) -> None:
    (folder / "job.toml").write_bytes(b'title = "x"\n# gr\xfcn\n')
    with pytest.raises(TomlError, match=r"job.toml:2: found byte 0xfc, expected UTF-8"):
        load_job(folder / "job.toml")


def test_lines_are_found_behind_long_strings_and_arrays(folder: Path) -> None:
    text = GOOD.replace(
        'title = "Portal mill 7"', 'title = """a\n[axes.Q]\nnumber = 9\n"""'
    )
    text = text.replace("[-10, 200, 410.0]", "[\n -10, # start\n 200,\n 410.0,\n]")
    text = text.replace("max_slope = 5", "max_slope = 5\nmax_stepp = 1")
    (folder / "job.toml").write_text(text)
    line = text.splitlines().index("max_stepp = 1") + 1
    with pytest.raises(JobError, match=f"job.toml:{line}: gate.max_stepp: unknown"):
        load_job(folder / "job.toml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("cycle_time = 0.001", 'cycle_time = 0.001  # """ of old'),
        ("cycle_time = 0.001", "cycle_time = 0.001  # ''' [{ of old"),
        ('"Portal mill 7"', '\'Portal """ mill\''),
        ('"Portal mill 7"', "\"Portal ''' mill\"  # [\""),
    ],
)
def test_marks_in_comments_and_strings_do_not_hide_keys(
    folder: Path, old: str, new: str
) -> None:
    text = GOOD.replace(old, new).replace("max_slope = 5", "max_slop = 5")
    (folder / "job.toml").write_text(text)
    with pytest.raises(JobError, match=r"job.toml:31: gate.max_slop: unknown"):
        load_job(folder / "job.toml")


@pytest.mark.parametrize(
    "error", [JobError("job.toml", 3, "found"), OutputError("out", "is full")]
)
def test_errors_survive_pickling(error: Exception) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert again.args == error.args
