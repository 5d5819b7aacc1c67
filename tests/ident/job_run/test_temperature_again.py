"""A temperature line as loaded, measured again while the machine warms up and cools down."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.cli import main
from axcomp.ident.job import AbstractResult, run_job
from axcomp.ident.report import headline_of
from axcomp.ident.report._scale import Scale

TIME = np.arange(0.0, 3 * 3600.0, 60.0)
WARM = 20.0 + 6.0 * np.where(
    TIME < 7200.0, 1.0 - np.exp(-TIME / 3000.0), 0.9 * np.exp(-(TIME - 7200.0) / 3000.0)
)
PLACE = np.tile(np.linspace(0.0, 400.0, 5), len(TIME))[: len(TIME)]
GROWTH = (4e-3 + 11e-6 * PLACE) * (WARM - 20.0)
MEASURED = """
[axes.X]
number = 1
limits = [0.0, 400.0]
[measurements.m]
file = "{name}.csv"
active = {active}
remove = "none"
[measurements.m.columns]
"X.position" = "x"
"X.error" = {{ column = "e", unit = "mm" }}
"temperature.scale" = "T"
"""
FIT = """
[[fits]]
compensation = "temperature"
axis = "X"
measurement = "m"
sensor = "scale"
lag = "none"
"""


def write(
    folder: Path,
    name: str,
    error: np.ndarray,
    active: str,
    fit: str,
    place: bool = True,
) -> Path:
    rng = np.random.default_rng(len(name))
    noisy = error + 3e-4 * rng.standard_normal(len(error))
    np.savetxt(
        folder / f"{name}.csv", np.stack([TIME, PLACE, noisy, WARM], axis=1),
        delimiter=",", header="time,x,e,T", comments="",
    )  # fmt: skip
    path = folder / f"{name}.toml"
    measured = MEASURED.format(name=name, active=active)
    if not place:
        measured = measured.replace('"X.position" = "x"\n', "")
    path.write_text(measured + fit)
    return path


def added(folder: Path) -> np.ndarray:
    """What the PLC makes the controller add, by the table beside its program."""
    rows = np.loadtxt(folder / "temperature_X.csv", delimiter=",", skiprows=1)
    offset, slope = (np.interp(WARM, rows[:, 0], rows[:, k]) for k in (1, 2))
    (one,) = json.loads((folder / "result.json").read_text())["fits"]
    found: np.ndarray = offset + 1e-6 * slope * (
        PLACE - one["parameters"]["position_0"]
    )
    return found


@pytest.mark.parametrize("slope", [0.0, 12e-6])  # of the screw, whatever the warmth
@pytest.mark.parametrize(
    ("acts", "status", "verdict", "code"),
    [
        (1.0, 0, "good", "verified"),
        (-1.0, 1, "rejected", "diagnosed"),
        (0.0, 1, "rejected", "diagnosed"),
        (2.0, 1, "rejected", "diagnosed"),
    ],
)
def test_a_temperature_line_is_measured_again(
    acts: float, status: int, verdict: str, code: str, slope: float, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH + slope * PLACE, "[]", FIT)
    assert main(["fit", str(job), "--out", str(out)]) == 0
    # Another day the zero of the instrument is another one.
    left = GROWTH + acts * added(out) + 0.002
    after = write(tmp_path, "after", left + slope * PLACE, '["temperature"]', "")
    asked = ["fit", str(job), "--out", str(out), "--after", str(after)]
    assert main(asked) == status
    (one,) = json.loads((out / "result.json").read_text())["fits"]
    assert one["verdict"] == verdict
    assert one["reasons"][0]["code"] == code
    figures = one["error"]["verified" if acts == 1.0 else "measured_again"]
    # Taken off where the line takes nothing off, not in the middle of the readings.
    truth = np.sqrt(np.mean((left - 0.002) ** 2 + 3e-4**2))
    assert figures["rms"] == pytest.approx(truth, rel=0.1)
    unsure = "the least certain sign of all"
    asks = any(unsure in remark["message"] for remark in one["remarks"])
    assert asks == (acts in (0.0, 2.0))  # where the sign is not settled
    signs = {rule["name"]: rule["state"] for rule in one["conventions"]}
    assert signs["temperature_sign"] == ("verified" if acts == 1.0 else "assumed")
    said = {1.0: "right", -1.0: "sign", 0.0: "wrong axis", 2.0: "twice"}[acts]
    assert acts == 1.0 or one["diagnosis"]["verdict"] == said
    if acts == -1.0:
        assert "temperature_sign = -1" in (out / "conventions.toml").read_text()


def verdict_of(found: AbstractResult) -> str:
    return headline_of(found, Scale("mm", "µm")).sentence


def test_a_line_that_is_wrong_where_it_is_hottest_is_not_verified(
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH, "[]", FIT)
    run_job(job, out)
    hot = np.quantile(WARM, 0.92)
    left = GROWTH + added(out) + 0.05 * (hot < WARM)
    after = write(tmp_path, "after", left, '["temperature"]', FIT)
    words = verdict_of(run_job(job, out, after=after).fits[0])
    assert words.startswith("Verified but for one place")
    assert "measure near scale = 25.4 again" in words
    # As many readings here and there are the instrument's.
    here = np.random.default_rng(0).permutation(len(WARM)) < 0.08 * len(WARM)
    left = GROWTH + added(out) + 0.05 * here
    after = write(tmp_path, "after", left, '["temperature"]', FIT)
    assert verdict_of(run_job(job, out, after=after).fits[0]).startswith("Verified:")


def test_readings_that_do_not_move_the_line_tell_no_factor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH, "[]", FIT)
    run_job(job, out)
    monkeypatch.setattr(f"{__name__}.WARM", np.full(len(WARM), 20.0))
    after = write(tmp_path, "after", 0.0 * WARM, '["temperature"]', FIT)
    words = verdict_of(run_job(job, out, after=after).fits[0])
    assert "times what it says" not in words
    assert "cannot tell" in words


def test_readings_beyond_the_temperatures_of_the_law_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH, "[]", FIT)
    run_job(job, out)
    monkeypatch.setattr(f"{__name__}.WARM", 20.0 + 2.0 * (WARM - 20.0))
    left = 2.0 * GROWTH + added(out)
    after = write(tmp_path, "after", left, '["temperature"]', FIT)
    words = verdict_of(run_job(job, out, after=after).fits[0])
    assert "readings lie beyond scale = 20 to 25." in words
    assert "(the list adds what it says)" in words


def test_an_offset_at_one_position_is_measured_again(tmp_path: Path) -> None:
    out, grows = tmp_path / "out", 6e-3 * (WARM - 20.0)
    fit = FIT.replace('sensor = "scale"', 'sensors = { offset = "scale" }')
    job = write(tmp_path, "job", grows, "[]", fit, place=False)
    assert main(["fit", str(job), "--out", str(out)]) == 0
    left = grows + added(out) + 0.002
    after = write(tmp_path, "after", left, '["temperature"]', "", place=False)
    assert main(["fit", str(job), "--out", str(out), "--after", str(after)]) == 0
    (one,) = json.loads((out / "result.json").read_text())["fits"]
    assert one["reasons"][0]["code"] == "verified"
    # Noise of the readings alone, as above.
    truth = np.sqrt(np.mean((left - 0.002) ** 2 + 3e-4**2))
    assert one["error"]["verified"]["rms"] == pytest.approx(truth, rel=0.1)


@pytest.mark.parametrize(
    ("acts", "code", "words"),
    [
        (1.0, "verified", "Verified"),
        (0.15, "less_than_predicted", "Better, but less than predicted"),
    ],
)
def test_a_copy_of_the_job_with_the_line_active_verifies_it(
    acts: float, code: str, words: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH, "[]", FIT)
    run_job(job, out)
    left = GROWTH + acts * added(out)
    after = write(tmp_path, "after", left, '["temperature"]', FIT)
    found = run_job(job, out, after=after).fits[0]
    assert str(found.judgement.reasons[0].code) == code
    sentence = headline_of(found, Scale("mm", "µm")).sentence
    assert sentence.startswith(words)
    assert ("what it does is 0.1" in sentence) == (acts < 1.0)


@pytest.mark.parametrize(
    ("screw", "line", "said"),
    [
        (1.0, 1.0, ("verified", "verified")),
        (-1.0, 1.0, ("sign", "beside")),
        (1.0, 0.0, ("beside", "wrong axis")),
        (10.0, 1.0, ("unit", "beside")),
    ],
)
def test_of_a_table_beside_a_temperature_line_the_wrong_one_is_named(
    screw: float, line: float, said: tuple[str, str], tmp_path: Path
) -> None:
    out, group = tmp_path / "out", 'group = "g"\n'
    pitch = 0.006 * np.sin(PLACE / 60.0)
    table = (
        '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "m"\n'
        f"start = 0.0\ninterval = 100.0\npoints = 5\n{group}"
    )
    job = write(tmp_path, "job", GROWTH + pitch, "[]", f"{FIT}{group}{table}")
    assert main(["fit", str(job), "--out", str(out)]) == 0
    law = np.loadtxt(out / "temperature_X.csv", delimiter=",", skiprows=1)
    offset, slope = (np.interp(WARM, law[:, 0], law[:, k]) for k in (1, 2))
    fits = json.loads((out / "result.json").read_text())["fits"]
    one, other = sorted(fits, key=lambda fit: str(fit["compensation"]))
    warm = offset + 1e-6 * slope * (PLACE - other["parameters"]["position_0"])
    entries = np.array(one["parameters"]["table"]["pos"], float)
    left = GROWTH + pitch + line * warm
    left -= screw * np.interp(
        PLACE, np.arange(5) * 100.0, entries
    )  # what it stands for
    after = write(tmp_path, "after", left, '["leadscrew", "temperature"]', "")
    main(["fit", str(job), "--out", str(out), "--after", str(after)])
    found = json.loads((out / "result.json").read_text())["fits"]
    reasons = [
        fit["reasons"][0]
        for fit in sorted(found, key=lambda fit: str(fit["compensation"]))
    ]
    assert tuple(each.get("verdict", each["code"]) for each in reasons) == said


@pytest.mark.parametrize(
    ("place", "warm", "said"),
    [
        (0.0, WARM, "which saw X at 0 mm only: measure again what it did not see"),
        (PLACE, 20.0 + 0.4 * (WARM - 20.0), "which saw scale at 20 to 22.1"),
        (PLACE, 24.0 + 0.0 * WARM, "which saw scale at 24 °C only"),
    ],
    ids=["at one place", "hardly warm", "at one temperature"],
)
def test_what_a_second_log_did_not_see_of_a_temperature_line_is_said(
    place: np.ndarray | float, warm: np.ndarray, said: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    out = tmp_path / "out"
    job = write(tmp_path, "job", GROWTH, "[]", FIT)
    run_job(job, out)
    here = __name__
    monkeypatch.setattr(f"{here}.PLACE", place + np.zeros(len(TIME)))
    monkeypatch.setattr(f"{here}.WARM", warm)
    growth = (4e-3 + 11e-6 * place) * (warm - 20.0)
    after = write(tmp_path, "after", growth + added(out), '["temperature"]', "")
    assert main(["fit", str(job), "--out", str(out), "--after", str(after)]) == 0
    (one,) = json.loads((out / "result.json").read_text())["fits"]
    assert (one["verdict"], one["reasons"][0]["code"]) == ("unproven", "in_part")
    assert said in " ".join(capsys.readouterr().out.split())
