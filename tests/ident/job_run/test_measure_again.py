"""The lists as loaded, measured again: verified, or named for what they do instead."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from axcomp.data.measurements import measurement, read_table
from axcomp.ident.cli import main
from axcomp.ident.exchange import read_conventions
from axcomp.ident.job import run_job
from axcomp.ident.job.result._second import near_of, part_of

from .screw import (
    offsets,
    old_list,
    screw_error,
    screw_job,
    state_conventions,
    table,
)

PLACES = np.arange(0.0, 401.0, 25.0)
DATA = Path(__file__).parents[4] / "shared" / "data" / "iso230"


def laser(
    path: Path,
    added: float | None,
    seed: int = 7,
    *,
    there: np.ndarray = PLACES,
    ways: int = 1,
    loaded: tuple[float, float] = (-np.inf, np.inf),
    zero: float = 0.0,
    slope: float = 0.0,
    entry: float = 0.0,
    noise: float = 3e-4,
) -> None:
    """Three runs; `added`: how many times the list acts that lies in ``out``.

    It acts within `loaded`, with the entries of the other direction where `ways` is −1; at 200 mm
    it adds `entry` more.
    """
    rng = np.random.default_rng(seed)
    target = np.tile(np.concatenate([there, there[::-1]]), 3)
    direction = np.tile(np.repeat([1, -1], len(there)), 3)
    run = np.repeat([1, 2, 3], 2 * len(there))
    # 0.3 µm of noise beside 20 µm of error.
    error = zero + slope * target + screw_error(target, direction)
    error += noise * rng.standard_normal(len(run))
    if added is not None:
        acts = (target >= loaded[0]) & (target <= loaded[1])
        adds = offsets(path.parent / "out", 1, A1=target, D=ways * direction)
        error += added * acts * adds + entry * np.interp(
            target, [175, 200, 225], [0, 1, 0]
        )
    table(
        path, "target,actual,run,direction", target, target + error, run, direction
    )  # fmt: skip


def after_job(folder: Path, added: float, head: str = "", **how: Any) -> Path:
    """The second measurement, with the list in ``out`` loaded, as a job."""
    laser(folder / "after.csv", added, seed=8, **how)
    text = (
        f'{head}[axes.X]\nnumber = 1\nlist = "out/achskw1.lis"\n'
        '[measurements.laser]\nfile = "after.csv"\nactive = ["leadscrew"]\n'
    )
    (folder / "after.toml").write_text(text)
    return folder / "after.toml"


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a job that has run once."""
    folder = tmp_path_factory.mktemp("first")
    laser(folder / "laser.csv", None)
    run_job(screw_job(folder), folder / "out")
    return folder


@pytest.fixture
def job(first: Path, tmp_path: Path) -> Path:
    """A job that has run once: its list lies in ``out``."""
    shutil.copytree(first, tmp_path, dirs_exist_ok=True)
    return tmp_path / "job.toml"


def fit(job: Path, *options: str) -> int:
    return main(["fit", str(job), "--out", str(job.parent / "out"), *options])


def result(job: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((job.parent / "out" / "result.json").read_text())
    return found


def fitted(job: Path) -> dict[str, Any]:
    fits = result(job)["fits"]
    assert isinstance(fits, list)
    return dict(fits[0])


def states(job: Path) -> dict[str, tuple[str, str]]:
    rules = fitted(job)["conventions"]
    assert isinstance(rules, list)
    return {one["name"]: (one["value"], one["state"]) for one in rules}


def test_without_a_second_measurement_the_sign_is_unproven(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job) == 0
    one = fitted(job)
    assert one["verdict"] == "unproven"
    assert one["reasons"] == [{"code": "assumed", "conventions": ["leadscrew_sign"]}]
    assert result(job)["verdict"] == "unproven"
    assert "Computed; sign unproven. Done" in capsys.readouterr().out


def test_load_sheet_begins_with_a_dial_and_ends_with_the_second_measurement(
    job: Path,
) -> None:
    sheet = run_job(job, job.parent / "out").load_sheet
    assert sheet[0].action == "Settle the sign first: leadscrew of X"
    # The list as written is largest at 200 mm moving positive, where the error is 20 µm.
    value = offsets(job.parent / "out", 1, A1=np.array([200.0]), D=np.array([1]))
    assert f"must show X moved by {1000 * value[0]:+.1f} µm" in sheet[0].detail
    assert "move slowly to X = 200 in positive direction" in sheet[0].detail
    assert "axcomp probe job.toml" in sheet[0].detail
    assert "axcomp fit job.toml --after AFTER.toml" in sheet[-1].detail


@pytest.mark.parametrize(
    ("times", "added"),
    [(1e-3, -1.0), (1 / 25.4, -1.0), (0.0, -1.0), (0.1, 0.0), (0.1, 2.0), (1e3, 1.0)],
)
def test_readings_too_good_or_bad_to_be_of_the_machine_judge_no_list(
    job: Path, times: float, added: float, capsys: pytest.CaptureFixture[str]
) -> None:
    # Millimetres, or inches, taken for what they are not; or a column that stands at zero. The
    # sign is the wrong one: the list doubles the error. A tenth of the error of a list that was
    # not loaded, or acts twice, lies near what a right one leaves. Micrometres taken for
    # millimetres speak against a list that is right.
    after = after_job(job.parent, added)
    head, *rows = (job.parent / "after.csv").read_text().splitlines()
    lines = [row.split(",") for row in rows]
    for line in lines:
        line[1] = repr(float(line[0]) + times * (float(line[1]) - float(line[0])))
    text = "\n".join([head, *map(",".join, lines)])
    (job.parent / "after.csv").write_text(text)
    assert fit(job, "--after", str(after)) == 1
    error = " ".join(capsys.readouterr().err.split())
    assert "found readings of the error that scatter by" in error
    assert "is their unit right, and their column" in error
    assert not (job.parent / "out" / "conventions.toml").exists()


def test_the_first_readings_are_no_second_measurement(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    after = after_job(job.parent, 1.0)
    shutil.copy(job.parent / "laser.csv", job.parent / "after.csv")
    assert fit(job, "--after", str(after)) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "found the readings of the first measurement (job.toml)" in said


def test_second_measurement_verifies_and_settles_the_sign(job: Path) -> None:
    after = after_job(job.parent, 1.0)
    assert fit(job, "--after", str(after)) == 0
    one = fitted(job)
    assert one["verdict"] == "good"
    error, by = one["error"], one["verified_by"]
    assert isinstance(error, dict)
    assert isinstance(by, dict)
    # Noise is left, 0.3 µm; both estimates of it rest on some hundred readings.
    assert error["verified"]["rms"] == pytest.approx(3e-4, rel=0.2)
    assert error["verified"]["rms"] == pytest.approx(error["predicted"]["rms"], rel=0.2)
    assert by["file"] == "after.toml"
    assert states(job)["leadscrew_sign"] == ("-1", "verified")
    saved = read_conventions(job.parent / "out" / "conventions.toml")
    assert saved.verified == {"leadscrew_sign"}
    page = (job.parent / "out" / "report.html").read_text("utf-8")
    assert '<div class="verdict good">Verified:' in page


def test_flipped_machine_is_named_and_nothing_is_called_verified(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    after = after_job(job.parent, -1.0)
    assert fit(job, "--after", str(after)) == 1
    shown = capsys.readouterr().out
    assert "the list doubles the error: sign" in shown
    assert "NOT CONFIRMED" in shown
    one = fitted(job)
    assert one["verdict"] == "rejected"
    assert one["verified_by"] is None
    error = one["error"]
    assert isinstance(error, dict)
    assert "verified" not in error
    # Twice the error of the bare machine, to the noise.
    again, before = error["measured_again"]["rms"], error["before"]["rms"]
    assert again == pytest.approx(2 * before, rel=0.05)
    assert states(job)["leadscrew_sign"] == ("-1", "assumed")
    saved = read_conventions(job.parent / "out" / "conventions.toml")
    assert saved.conventions.leadscrew_sign == 1
    page = (job.parent / "out" / "report.html").read_text("utf-8")
    assert '<div class="verdict bad">Take the list out again: the list doubles' in page
    assert "Verified:" not in page
    assert "assumed, and contradicted by the second measurement" in page
    assert "<b>Next:</b> Take the leadscrew of X out again" in page
    assert "The steps below are for the list that comes of that, not for" in page


def test_directions_of_a_bilateral_table_that_are_swapped_are_named(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job, "--after", str(after_job(job.parent, 1.0, ways=-1))) == 1
    (screw,) = result(job)["fits"]
    assert screw["diagnosis"]["verdict"] == "swapped"
    assert screw["verdict"] == "rejected"
    assert "directions swapped" in capsys.readouterr().out


def test_second_measurement_of_a_part_verifies_that_part_only(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # What the list does at 0 to 200 mm nobody saw: there it does not act.
    seen = np.arange(200.0, 401.0, 25.0)
    again = after_job(job.parent, 1.0, there=seen, loaded=(200.0, 400.0))
    assert fit(job, "--after", str(again)) == 0
    (screw,) = result(job)["fits"]
    assert screw["verdict"] == "unproven"
    (reason,) = screw["reasons"]
    assert reason == {"code": "in_part", "axis": "X", "low": 200.0, "high": 400.0}
    assert "X from 200 to 400 mm only" in " ".join(capsys.readouterr().out.split())


def test_second_measurement_names_the_one_place_that_its_list_makes_worse(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A node at each place that is measured: then one entry is one place.
    fine = job.read_text().replace("interval = 100.0", "interval = 25.0")
    job.write_text(fine.replace("points = 5", "points = 17"))
    run_job(job, job.parent / "out")
    assert fit(job, "--after", str(after_job(job.parent, 1.0, entry=0.008))) == 0
    (screw,) = result(job)["fits"]
    assert screw["verdict"] == "unproven"
    assert screw["reasons"] == [{"code": "near", "where": "X = 200"}]
    words = " ".join(capsys.readouterr().out.split())
    assert "measure near X = 200 again" in words


def test_second_measurement_that_says_the_list_was_off_verifies_nothing(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0)
    again.write_text(again.read_text().replace('["leadscrew"]', "[]"))
    assert fit(job, "--after", str(again)) == 1
    assert fitted(job)["verdict"] == "unproven"
    assert "the leadscrew was off while laser was measured (active)" in " ".join(
        capsys.readouterr().out.split()
    )
    assert not (job.parent / "out" / "conventions.toml").exists()


def test_second_measurement_in_one_direction_verifies_that_one_only(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0)
    head, *rows = (job.parent / "after.csv").read_text().splitlines()
    up = [row for row in rows if row.endswith(",1")]
    (job.parent / "after.csv").write_text("\n".join([head, *up]) + "\n")
    assert fit(job, "--after", str(again)) == 0
    assert fitted(job)["reasons"] == [{"code": "in_part", "direction": 1}]
    said = " ".join(capsys.readouterr().out.split())
    assert "which saw motion in + direction only" in said


def test_second_measurement_at_a_few_places_verifies_no_more_than_these(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Between them nobody looked: an entry that is 40 µm off at 200 mm does not show.
    few = np.array([0.0, 25.0, 100.0, 150.0, 250.0, 300.0, 400.0])
    again = after_job(job.parent, 1.0, there=few, entry=0.04)
    assert fit(job, "--after", str(again)) == 0
    (reason,) = fitted(job)["reasons"]
    assert reason == {"code": "in_part", "gap": ["X", 150.0, 250.0]}
    said = " ".join(capsys.readouterr().out.split())
    assert "which saw nothing of X between 150 and 250 mm" in said


@pytest.mark.parametrize(("added", "code"), [(1.0, "in_part"), (0.0, "diagnosed")])
def test_slope_that_the_second_measurement_takes_off_is_not_verified(
    job: Path, added: float, code: str, capsys: pytest.CaptureFixture[str]
) -> None:
    # The line of the first instrument was taken for the machine's.
    again = after_job(job.parent, added)
    text = again.read_text()
    again.write_text(
        text.replace("[measurements.laser]", '[measurements.laser]\nremove = "line"')
    )
    fit(job, "--after", str(again))
    reason = fitted(job)["reasons"][0]
    assert reason["code"] == code
    said = " ".join(capsys.readouterr().out.split())
    shown = 'which shows no slope over X (remove = "line"): measure again with an instrument'
    assert (shown in said) == (added == 1.0)


def test_an_entry_that_is_another_shows_where_the_same_list_acted_both_times(
    first: Path, tmp_path: Path
) -> None:
    # Of a list that was on in both measurements nothing changes: readings have to say it.
    shutil.copytree(first, tmp_path, dirs_exist_ok=True)
    (tmp_path / "old.lis").write_bytes((tmp_path / "out" / "achskw1.lis").read_bytes())
    fine = np.unique([*np.arange(0.0, 401.0, 4.0), *np.arange(0.0, 176.0, 2.0)])
    fine = fine[(fine <= 175.0) | (fine >= 225.0) | (fine == 200.0)]
    laser(tmp_path / "laser.csv", 1.0, there=fine, zero=0.004)
    path = screw_job(
        tmp_path, axis='list = "old.lis"', measurement='active = ["leadscrew"]'
    )
    run_job(path, tmp_path / "out")
    # 8 um at one place in each of three runs, by which rms without wild readings is as predicted.
    after = after_job(tmp_path, 1.0, entry=0.008, there=fine, zero=0.004)
    assert fit(path, "--after", str(after)) == 1
    (screw,) = result(path)["fits"]
    assert {"code": "near", "where": "X = 200, positive"} in screw["reasons"]


def test_places_that_were_read_once_are_judged_with_those_beside_them() -> None:
    rng = np.random.default_rng(61)
    places = rng.uniform(0.0, (400.0, 300.0), (300, 2))
    error = 7e-4 * rng.standard_normal(300)
    assert not near_of(("X", "Y"), places, error, None, 7e-4)
    alone = error.copy()
    alone[7] += 0.03  # one reading is the instrument's fault
    assert not near_of(("X", "Y"), places, alone, None, 7e-4)
    corner = (places > (300.0, 200.0)).all(axis=1)  # and one in twelve is none
    said = near_of(("X", "Y"), places, error + 0.03 * corner, None, 7e-4)
    x, y = (float(word.split("= ")[1]) for word in said.split(", "))
    assert x > 300.0
    assert y > 200.0


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [(-90.0, 90.0, ("C", 270.0, 90.0)), (0.0, 345.0, None), (-180.0, 165.0, None)],
)
def test_half_a_turn_is_a_part_wherever_it_begins(
    low: float, high: float, said: tuple[str, float, float] | None
) -> None:
    whole = np.arange(0.0, 360.0, 15.0)[:, None]
    again = np.arange(low, high + 1.0, 15.0)[:, None] % 360.0
    assert part_of(["C"], whole, again, 360.0) == said


@pytest.mark.parametrize("noise", [3e-4, 1.2e-3])
def test_zero_of_a_second_measurement_that_nobody_owns_is_asked_for(
    job: Path, capsys: pytest.CaptureFixture[str], noise: float
) -> None:
    again = after_job(job.parent, 1.0, zero=0.03, noise=noise)
    assert fit(job, "--after", str(again)) == 1
    (screw,) = result(job)["fits"]
    assert (screw["verdict"], screw["reasons"][0]["code"]) == ("unproven", "unowned")
    assert "verified" not in screw["error"]
    shown = " ".join(capsys.readouterr().out.split())
    assert "state in after.toml whose they are (datum or remove" in shown


def test_machine_that_moved_since_is_named_beside_a_list_that_acts_as_predicted(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0, zero=0.03)
    again.write_text(again.read_text() + 'remove = "none"\n')
    assert fit(job, "--after", str(again)) == 1
    verdict = " ".join(capsys.readouterr().out.split()).partition("verdict: ")[2]
    assert verdict.startswith("Take the list out again")
    assert "as predicted. Before it goes in again, find what moved X since" in verdict


def test_list_of_an_axis_that_has_warmed_up_is_not_to_be_taken_out(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0, slope=3e-5)  # 2.6 K of steel
    again.write_text(again.read_text() + 'remove = "none"\n')
    assert fit(job, "--after", str(again)) == 0
    one = fitted(job)
    assert [each["code"] for each in one["reasons"]] == ["less_than_predicted"]
    assert "beside a slope that no list adds" in one["diagnosis"]["sentence"]
    verdict = " ".join(capsys.readouterr().out.split()).partition("verdict: ")[2]
    assert verdict.startswith("Better, but less than predicted")
    assert "Find what moved X since: its temperature, or the zero" in verdict


def test_second_measurement_that_shows_nothing_is_no_success(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0)
    lines = (job.parent / "after.csv").read_text().replace("target", "shown").split()
    (job.parent / "after.csv").write_text("\n".join(lines) + "\n")
    again.write_text(again.read_text() + 'columns = { "X.error" = "actual" }\n')
    assert fit(job, "--after", str(again)) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "Not measured again" in said
    assert "'X.position'" in said


def test_zero_that_both_jobs_do_not_say_alike_is_asked_for(job: Path) -> None:
    job.write_text(job.read_text().replace('remove = "none"', 'remove = "offset"'))
    assert fit(job) == 0
    again = after_job(job.parent, 1.0, zero=0.03)
    again.write_text(again.read_text() + 'remove = "none"\n')
    assert fit(job, "--after", str(again)) == 1
    assert result(job)["fits"][0]["reasons"][0]["code"] == "unowned"


def test_part_of_the_travel_where_a_list_does_not_act_is_no_wild_reading(
    job: Path,
) -> None:
    again = after_job(job.parent, 1.0, loaded=(110.0, 400.0))
    assert fit(job, "--after", str(again)) == 1
    left = result(job)["fits"][0]["error"]["measured_again"]
    assert left["rms_without_wild"] == left["rms"] > 3e-3


def test_list_that_was_not_active_is_asked_for_and_taken_out(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job, "--after", str(after_job(job.parent, 0.0))) == 1
    assert fitted(job)["verdict"] == "rejected"
    said = " ".join(capsys.readouterr().out.split())
    assert "is not active" in said or "is it active?" in said


def test_list_that_does_a_part_only_is_told_with_what_it_does(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job, "--after", str(after_job(job.parent, 0.4))) == 1
    assert fitted(job)["verdict"] == "unproven"
    said = " ".join(capsys.readouterr().out.split())
    verdict = said.partition("verdict: Better, but less than predicted")[2]
    assert "what it does is 0.4 times what the list says" in verdict


def test_job_run_again_with_the_settled_sign_turns_the_list(job: Path) -> None:
    fit(job, "--after", str(after_job(job.parent, -1.0)))
    saved = (job.parent / "out" / "conventions.toml").read_bytes()
    (job.parent / "mill.toml").write_bytes(saved)
    state_conventions(job)
    wrong = offsets(job.parent / "out", 1, A1=np.array([200.0]), D=np.array([1]))
    assert fit(job) == 0
    right = offsets(job.parent / "out", 1, A1=np.array([200.0]), D=np.array([1]))
    assert right == pytest.approx(-wrong)
    assert fitted(job)["verdict"] == "good"


def test_rerun_keeps_the_verification_and_changed_lists_lose_it(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job, "--after", str(after_job(job.parent, 1.0))) == 0
    # A title stands in a comment of the list, and changes nothing that it says.
    job.write_text(job.read_text().replace('title = "screw"', 'title = "X"'))
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "good"
    capsys.readouterr()
    job.write_text(job.read_text().replace("points = 5", "points = 4"))
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "unproven"
    assert fitted(job)["verified_by"] is None
    assert "(after.toml) no longer counts: the lists have changed" in (
        capsys.readouterr().out
    )


def test_second_measurement_that_changed_no_longer_counts(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit(job, "--after", str(after_job(job.parent, 1.0))) == 0
    (job.parent / "after.csv").unlink()
    capsys.readouterr()
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "unproven"
    assert "it has changed since, or is gone" in capsys.readouterr().out


def test_second_measurement_of_other_lists_is_refused_and_nothing_written(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    after = after_job(job.parent, 1.0)
    listing = job.parent / "out" / "achskw1.lis"
    before = listing.read_bytes()
    job.write_text(job.read_text().replace("points = 5", "points = 4"))
    assert fit(job, "--after", str(after)) == 1
    assert "which is not the achskw1.lis that job.toml makes now" in (
        capsys.readouterr().err
    )
    assert listing.read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new"), [("axes.X", "axes.Q"), ("number = 1", "number = 2")]
)
def test_second_measurement_that_calls_its_axes_otherwise_is_refused(
    job: Path, capsys: pytest.CaptureFixture[str], old: str, new: str
) -> None:
    after = after_job(job.parent, 1.0)
    after.write_text(after.read_text().replace(old, new))
    assert fit(job, "--after", str(after)) == 1
    assert "the names and numbers of job.toml: X = 1" in capsys.readouterr().err


def test_job_may_name_its_second_measurement(job: Path) -> None:
    after_job(job.parent, 1.0)
    job.write_text(job.read_text() + '[verify]\njob = "after.toml"\n')
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "good"
    found = run_job(job, job.parent / "out")
    assert found.confirmed
    assert found.second is not None


@pytest.mark.parametrize("measured", [False, True])
def test_job_may_name_a_second_measurement_before_it_is_there(
    job: Path, capsys: pytest.CaptureFixture[str], measured: bool
) -> None:
    after_job(job.parent, 1.0)
    shutil.rmtree(job.parent / "out")  # the lists that the second job names
    readings = job.parent / "after.csv"
    kept = readings.read_bytes()
    if not measured:
        readings.unlink()
    job.write_text(job.read_text() + '[verify]\njob = "after.toml"\n')
    assert fit(job) == 0
    assert "of [verify] does not count yet" in " ".join(capsys.readouterr().out.split())
    assert fitted(job)["verdict"] == "unproven"
    readings.write_bytes(kept)
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "good"


def test_new_lists_are_written_where_the_named_measurement_is_of_old_ones(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    after_job(job.parent, 1.0)
    text = job.read_text().replace("points = 5", "points = 4")
    job.write_text(text + '[verify]\njob = "after.toml"\n')
    assert fit(job) == 0
    assert fitted(job)["verdict"] == "unproven"
    said = " ".join(capsys.readouterr().out.split())
    assert "of [verify] (after.toml) does not count" in said
    assert "load its lists and measure again" in said


def test_another_second_measurement_says_whose_place_it_takes(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    after = after_job(job.parent, 1.0)
    assert fit(job, "--after", str(after)) == 0
    assert "takes the place of" not in capsys.readouterr().out
    again = job.parent / "again.toml"
    laser(job.parent / "again.csv", 1.0, seed=21)
    again.write_text(after.read_text().replace("after.csv", "again.csv"))
    assert fit(job, "--after", str(again)) == 0
    assert "again.toml takes the place of" in " ".join(capsys.readouterr().out.split())


def test_sign_that_a_log_settled_is_not_turned_by_an_instrument(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rules = "[verified]\nleadscrew_sign = -1\n"
    (job.parent / "mill.toml").write_text(rules)
    state_conventions(job)
    assert fit(job, "--after", str(after_job(job.parent, -1.0))) == 1
    assert (job.parent / "mill.toml").read_text() == rules
    assert "was settled before and stays" in capsys.readouterr().out


def over_old(folder: Path, acts: float) -> tuple[Path, np.ndarray, np.ndarray]:
    """A job of readings with an old list that acts so often: path, columns without it, and it."""
    (folder / "old").mkdir()
    whole = old_list(folder / "old")
    kept = [line for line in whole.splitlines(True) if b"crosscomp" not in line]
    (folder / "achskw1.lis").write_bytes(b"".join(kept))
    laser(folder / "laser.csv", None)
    bare = runs_of(folder / "laser.csv")
    old = offsets(folder, 1, A1=bare[0], D=bare[3].astype(int))
    write_runs(folder / "laser.csv", bare, acts * old)
    job = screw_job(
        folder, axis='list = "achskw1.lis"', measurement='active = ["leadscrew"]'
    )
    run_job(job, folder / "out")
    return job, bare, old


def runs_of(path: Path) -> np.ndarray:
    columns: np.ndarray = np.genfromtxt(path, delimiter=",", skip_header=1).T
    return columns


def write_runs(path: Path, bare: np.ndarray, added: np.ndarray) -> None:
    rows = [bare[0], bare[1] + added, *bare[2:].astype(int)]
    table(path, "target,actual,run,direction", *rows)


@pytest.mark.parametrize(
    ("added", "verdict"), [(1.0, "right"), (-1.0, "sign"), (0.0, "")]
)
def test_new_table_over_an_active_old_one_is_judged_by_what_it_takes_off(
    tmp_path: Path, added: float, verdict: str
) -> None:
    # Nothing was switched between the measurements: what is left tells how much more is added.
    job, bare, old = over_old(tmp_path, added or 1.0)
    after = after_job(tmp_path, added)
    if not added:  # the new list was never loaded
        noise = 1e-4 * np.random.default_rng(3).standard_normal(len(old))
        write_runs(tmp_path / "after.csv", bare, old + noise)
    assert fit(job, "--after", str(after)) == int(added <= 0)
    one = fitted(job)
    assert one["verdict"] == ("good" if added > 0 else "rejected")
    if verdict:
        assert one["diagnosis"]["verdict"] == verdict
    else:
        assert one["diagnosis"]["sentence"].startswith("nothing has changed")


@pytest.mark.parametrize(
    ("new", "still", "verdict", "words"),
    [
        (0.0, 0.0, "wrong axis", "nothing is added"),
        (2.0, 0.0, "twice", "added twice"),
        (1.0, 1.0, "twice", "the list that acted before still acts beside it"),
        (-1.0, 0.0, "sign", "added with opposite sign"),
    ],
)
def test_new_table_over_an_active_old_one_is_told_apart_from_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
    new: float, still: float, verdict: str, words: str,
) -> None:  # fmt: skip
    job, _, old = over_old(tmp_path, 1.0)
    # Both lists are alike: to tell them apart takes less noise than else.
    after = after_job(tmp_path, new, noise=1e-4)
    again = runs_of(tmp_path / "after.csv")
    write_runs(tmp_path / "after.csv", again, still * old)
    assert fit(job, "--after", str(after)) == 1
    diagnosis = fitted(job)["diagnosis"]
    assert (diagnosis["verdict"], diagnosis["sentence"][: len(words)]) == (
        verdict,
        words,
    )
    assert "cannot be diagnosed" not in capsys.readouterr().out
    # Of the first measurement the sign of the old one is known to be as assumed.
    assert not (tmp_path / "out" / "conventions.toml").exists()


def test_a_list_of_the_shape_of_the_one_before_says_what_to_measure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job, _, _ = over_old(tmp_path, 1.0)
    after = after_job(tmp_path, -1.0, noise=2e-3)
    assert fit(job, "--after", str(after)) == 1
    assert fitted(job)["diagnosis"]["verdict"] == "cannot tell"
    said = " ".join(capsys.readouterr().out.split())
    assert "measure with the compensation off, and again with it on" in said


def real_job(folder: Path, name: str, nodes: list[int], runs: range) -> Path:
    """Runs of a real run table as a job that has run once."""
    if not (DATA / name).is_file():
        pytest.skip(f"needs ../shared/data/iso230/{name}")
    real_runs(folder / "laser.csv", name, runs, None)
    path = screw_job(folder)
    plain = "start = 0.0\ninterval = 100.0\npoints = 5"
    # Limits of a short axis with large errors.
    path.write_text(
        path.read_text().replace(plain, f"setpoints = {nodes}")
        + "[gate]\nmax_slope = 100\nmax_kink = 100\nmax_velocity = 100\n"
        "max_acceleration = 100000\n"
    )
    run_job(path, folder / "out")
    return path


def real_runs(path: Path, name: str, runs: range, added: float | None) -> None:
    """Runs of the real table, with the list in ``out`` acting `added` times."""
    measured = measurement(read_table(DATA / name), axis="X")
    rows = np.isin(measured.require("run"), list(runs))
    target, actual, run, way = (
        np.asarray(measured.require(role))[rows]
        for role in ("X.position", "X.actual", "run", "X.direction")
    )
    if added is not None:
        actual = actual + added * offsets(path.parent / "out", 1, A1=target, D=way)
    table(path, "target,actual,run,direction", target, actual, run, way)


B02, W42 = "ess_b02_X_9pos5cyc_ISO230.dat", "ess_w42_X_ILD50_5pos5cyc_ISO230.dat"
REAL = {
    "other runs of b02": (B02, [*range(-20, 21, 5)], range(1, 4), range(4, 6)),
    "w42 with the list": (W42, [-4, -2, 0, 2, 4], range(1, 6), range(1, 6)),
}


@pytest.mark.parametrize("added", [1.0, -1.0])
@pytest.mark.parametrize("case", sorted(REAL))
def test_real_run_table_is_verified_or_its_sign_is_named(
    tmp_path: Path, case: str, added: float
) -> None:
    name, nodes, first, second = REAL[case]
    job = real_job(tmp_path, name, nodes, first)
    after = after_job(tmp_path, added)
    real_runs(tmp_path / "after.csv", name, second, added)
    assert fit(job, "--after", str(after)) == int(added < 0)
    saved = read_conventions(tmp_path / "out" / "conventions.toml")
    assert saved.conventions.leadscrew_sign == -int(added)
    one = fitted(job)
    error, found = one["error"], one["diagnosis"]
    assert isinstance(error, dict)
    assert isinstance(found, dict)
    assert found["verdict"] == ("right" if added > 0 else "sign")
    assert ("verified" in error) == (added > 0)
    if added > 0:
        if case.startswith("w42"):  # the same readings, but for 0.05 µm of rounding
            assert error["verified"]["rms"] == pytest.approx(
                error["from_file"]["rms"], abs=5e-5
            )
        else:  # the scatter of the runs is left
            assert error["verified"]["rms"] < 0.2 * error["before"]["rms"]
    else:
        assert error["measured_again"]["rms"] > error["before"]["rms"]
        assert one["verified_by"] is None


@pytest.mark.parametrize("added", [1.0, -1.0])
def test_scatter_of_a_real_run_table_settles_nothing(
    tmp_path: Path, added: float
) -> None:
    # Its runs differ by more than their mean error: two others cannot tell the sign.
    job = real_job(tmp_path, W42, [-4, -2, 0, 2, 4], range(1, 4))
    after = after_job(tmp_path, added)
    real_runs(tmp_path / "after.csv", W42, range(4, 6), added)
    assert fit(job, "--after", str(after)) == 1
    assert fitted(job)["verified_by"] is None
    assert not (tmp_path / "out" / "conventions.toml").exists()


def test_error_that_grows_speaks_against_a_list_that_promised_nothing(
    tmp_path: Path,
) -> None:
    # Its runs scatter by more than a table takes off; thirty times the table is no scatter.
    job = real_job(tmp_path, W42, [-4, -2, 0, 2, 4], range(1, 4))
    after = after_job(tmp_path, 1.0)
    real_runs(tmp_path / "after.csv", W42, range(4, 6), 30.0)
    assert fit(job, "--after", str(after)) == 1
    assert fitted(job)["verdict"] == "rejected"


def backlash_again(folder: Path, flank: int, remove: str) -> int:
    """Fit a play of 10 µm, and verify it; what is written may take it off on the other flank."""
    rng = np.random.default_rng(9)
    target = np.tile(np.concatenate([PLACES, PLACES[::-1]]), 3)
    way = np.tile(np.repeat([1, -1], len(PLACES)), 3)
    run = np.repeat([1, 2, 3], 2 * len(PLACES))
    for name, error in (
        ("first", np.where(way < 0, 0.01, 0.0)),
        ("again", np.full(len(way), 0.0 if flank > 0 else 0.01)),
    ):
        noisy = error + 3e-4 * rng.standard_normal(len(way))
        table(folder / f"{name}.csv", "target,error,run,way", target, noisy, run, way)
        columns = '"X.position" = "target", "X.error" = "error", "X.direction" = "way", run = "run"'
        active = '["backlash"]' if name == "again" else "[]"
        (folder / f"{name}.toml").write_text(
            "[axes.X]\nnumber = 1\n[measurements.m]\n"
            f'file = "{name}.csv"\nactive = {active}\nremove = "{remove}"\n'
            f"columns = {{ {columns} }}\n"
            '[[fits]]\ncompensation = "backlash"\naxis = "X"\nmeasurement = "m"\n'
        )
    job = folder / "first.toml"
    assert main(["fit", str(job), "--out", str(folder / "out")]) == 0
    return fit(job, "--after", str(folder / "again.toml"))


@pytest.mark.parametrize(("flank", "code"), [(1, 0), (-1, 1)])
def test_a_backlash_with_the_other_flank_is_not_verified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flank: int, code: int
) -> None:
    assert backlash_again(tmp_path, flank, "none") == code
    said = " ".join(capsys.readouterr().out.split())
    assert ("right in − direction" in said) == (code == 1)
    (one,) = result(tmp_path / "first.toml")["fits"]
    (rule,) = (r for r in one["conventions"] if r["name"] == "backlash_reference")
    assert rule["state"] == ("assumed" if code else "verified")
    taken = [r for r in one["remarks"] if "The axis is taken as right" in r["message"]]
    assert len(taken) == code


@pytest.mark.parametrize("flank", [1, -1, 0])
def test_the_other_flank_is_told_beside_a_leadscrew_that_is_right(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flank: int
) -> None:
    rng = np.random.default_rng(4)
    target = np.tile(np.concatenate([PLACES, PLACES[::-1]]), 3)
    way = np.tile(np.repeat([1, -1], len(PLACES)), 3)
    run = np.repeat([1, 2, 3], 2 * len(PLACES))
    screw = 0.02 * np.sin(target / 60.0) + 0.01 * (way < 0)
    left = {1: 0.0, -1: 0.01, 0: -0.01}[flank]
    columns = '"X.position" = "target", "X.error" = "error", "X.direction" = "way", run = "run"'
    head = '[axes.X]\nnumber = 1\n[measurements.m]\nremove = "none"\n'
    for name, error, active in (
        ("first", screw, "[]"),
        # 0: everything has moved by the width, to the side to which no flank moves it.
        ("again", np.full(len(way), left), '["leadscrew", "backlash"]'),
    ):
        noisy = error + 3e-4 * rng.standard_normal(len(way))
        table(tmp_path / f"{name}.csv", "target,error,run,way", target, noisy, run, way)
        (tmp_path / f"{name}.toml").write_text(
            f'{head}file = "{name}.csv"\nactive = {active}\ncolumns = {{ {columns} }}\n'
            '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "m"\n'
            "start = 0.0\ninterval = 25.0\npoints = 17\n"
            '[[fits]]\ncompensation = "backlash"\naxis = "X"\nmeasurement = "m"\n'
        )
    job = tmp_path / "first.toml"
    assert fit(job) == 0
    assert fit(job, "--after", str(tmp_path / "again.toml")) == (flank < 0)
    lines, play = result(job)["fits"]
    said = " ".join(capsys.readouterr().out.split())
    assert ("take the other flank as the right one" in said) == (flank < 0)
    if not flank:
        assert play["verdict"] != "rejected"
    elif flank > 0:
        assert [lines["verdict"], play["verdict"]] == ["good", "good"]
        assert "backlash_reference = 1" in said
    else:
        assert play["verdict"] == "rejected"
        assert lines["reasons"][0] == {"code": "beside", "compensations": ["backlash"]}


@pytest.mark.parametrize("flank", [1, -1])
def test_a_backlash_whose_flank_no_zero_shows_is_verified_in_part(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flank: int
) -> None:
    assert backlash_again(tmp_path, flank, "offset") == 0
    (one,) = result(tmp_path / "first.toml")["fits"]
    assert one["verdict"] == "unproven"
    assert one["reasons"] == [{"code": "in_part", "zero": "backlash_reference"}]
    assert "so that backlash_reference stays assumed" in " ".join(
        capsys.readouterr().out.split()
    )


@pytest.mark.parametrize(
    ("limits", "place"),
    [((0, 400), "200 in positive"), ((0, 180), "100 in positive"), ((0, 60), "")],
)
def test_the_sheet_sends_an_axis_no_further_than_it_can_go(
    tmp_path: Path, limits: tuple[int, int], place: str
) -> None:
    laser(tmp_path / "laser.csv", None)
    axis = f'limits = {[*limits]}\nnc_name = "X1"'
    sheet = run_job(screw_job(tmp_path, axis=axis), tmp_path / "out").load_sheet
    # Of the node at 0 alone nobody can come from below.
    assert ("move slowly to" in sheet[0].detail) == bool(place)
    assert f"move slowly to X1 = {place}" in sheet[0].detail or not place


def test_what_was_read_neither_time_is_not_verified(tmp_path: Path) -> None:
    near = np.arange(0.0, 201.0, 25.0)
    laser(tmp_path / "laser.csv", None, there=near)
    job = screw_job(tmp_path)
    run_job(job, tmp_path / "out")
    assert fit(job, "--after", str(after_job(tmp_path, 1.0, there=near))) == 0
    (reason,) = fitted(job)["reasons"]
    assert reason == {"code": "in_part", "axis": "X", "low": 0.0, "high": 200.0}


def test_a_direction_of_which_a_part_was_seen_is_verified_in_part(
    job: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = after_job(job.parent, 1.0)
    head, *rows = (job.parent / "after.csv").read_text().splitlines()
    seen = [r for r in rows if r.endswith(",1") or float(r.split(",")[0]) <= 200.0]
    (job.parent / "after.csv").write_text("\n".join([head, *seen]) + "\n")
    assert fit(job, "--after", str(again)) == 0
    (reason,) = fitted(job)["reasons"]
    assert reason["code"] == "in_part"
    said = " ".join(capsys.readouterr().out.split())
    assert "which saw X in − direction from 0 to 200 mm only" in said
