"""The report as a page: self-contained, escaped, true, with the load sheet last."""

import dataclasses
import html
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.ident.job import (
    Code,
    ConventionState,
    GateCheck,
    JobResult,
    MeasuredAgain,
    Remark,
    SecondMeasurement,
    SecondMeasurementError,
    TableResult,
    Verdict,
)
from axcomp.ident.proof import Diagnosis
from axcomp.ident.report import write_report
from axcomp.ident.report._section import section_of

Make = Callable[..., TableResult]
MakeJob = Callable[..., JobResult]


def page_of(result: JobResult, out: Path) -> str:
    page, *_ = write_report(result, out)
    return page.read_text("utf-8")


def words(page: str) -> str:
    """The text of a page as a reader sees it, blanks collapsed, drawings left out."""
    page = re.sub(r"<(style|svg|script|dialog).*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", page)).split())


def again(fit: TableResult, size: float, verdict: str = "right") -> TableResult:
    """A fit whose list was measured again, with the error that is left."""
    rng = np.random.default_rng(11)
    view = fit.samples
    error = size * rng.normal(size=len(view.before))
    sign = -1 if verdict == "sign" else 1
    seen = SecondMeasurement("laser", view.positions, error, view.direction, view.run)
    found = Diagnosis(3, fit.compensation, verdict, 1.0 * sign, 1.0, "so it is", sign)
    before, after = (fit.error[key].sound.rms for key in ("before", "predicted"))
    return dataclasses.replace(
        fit,
        again=MeasuredAgain(
            {"file": "after.toml", "sha256": "ab" * 32, "date": "2026-11-22"},
            seen,
            found,
            before,
            after,
        ),
        conventions=(ConventionState("leadscrew_sign", "-1", "verified", "", "sign"),),
    )


@pytest.fixture(scope="module")
def drawn(
    leadscrew: Make, cross: Make, plane: Make, job: MakeJob,
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, ...]:  # fmt: skip
    """Page and plots of a job of three tables."""
    result = job(leadscrew(), cross(), plane())
    return write_report(result, tmp_path_factory.mktemp("drawn"))


def test_page_needs_no_other_file_and_no_network(drawn: tuple[Path, ...]) -> None:
    page = drawn[0].read_text("utf-8")
    assert "http:" not in page
    assert "https:" not in page
    assert "<script src" not in page
    assert "<link" not in page
    assert "@import" not in page
    for target in re.findall(r'(?:href|src)="([^"]*)"', page):
        assert target.startswith(("#", "data:image/png;base64,")), target
    for target in re.findall(r"url\(([^)]*)\)", page):
        assert target.startswith("#"), target


def test_every_plot_is_in_the_page_and_a_readable_file(
    drawn: tuple[Path, ...],
) -> None:
    page, *plots = drawn
    assert page.read_text("utf-8").count("<svg ") == len(plots) > 8
    for plot in plots:
        assert plot.parent == page.parent / "plots"
        assert ET.parse(plot).getroot().tag.endswith("svg")


def test_ids_of_the_drawings_do_not_collide_on_the_page(
    drawn: tuple[Path, ...],
) -> None:
    page = drawn[0].read_text("utf-8")
    svgs = re.findall(r"<svg .*?</svg>", page, flags=re.DOTALL)
    # Names of groups such as figure_1 may repeat; what is *referred to* must not.
    used = [set(re.findall(r'(?:href="|url\()#([^")]+)', svg)) for svg in svgs]
    assert sum(map(len, used)) == len(set().union(*used))


def test_same_result_gives_the_same_bytes(
    leadscrew: Make, job: MakeJob, tmp_path: Path
) -> None:
    first = write_report(job(leadscrew()), tmp_path / "a")
    again = write_report(job(leadscrew()), tmp_path / "b")
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in again]


@pytest.mark.usefixtures("no_drawing")
def test_report_ends_with_the_load_sheet(
    cross: Make, job: MakeJob, tmp_path: Path
) -> None:
    page = page_of(job(cross()), tmp_path)
    heading = re.findall(r"<h2[^>]*>(.*?)</h2>", page)[-1]
    assert heading.startswith("Load sheet")
    assert words(page).endswith("Copy achskw3.lis to the folder of the axis lists.")


def test_text_of_the_user_is_escaped_everywhere(
    cross: Make, job: MakeJob, tmp_path: Path
) -> None:
    bad = "<b onload='x'>$\\frac{1}$ & \"Ω\""
    fit = dataclasses.replace(
        cross(), axis="Y<i>$_2$", remarks=(Remark("error", bad),), masters=("X&$a^b$",)
    )
    result = job(
        fit, title=bad, machine={"id": bad}, inputs={bad: "00"}, job={"title": bad}
    )
    page = page_of(result, tmp_path)
    assert "<b onload" not in page
    assert "Y<i>" not in page
    assert bad in words(page)
    drawn = re.search(r"<svg .*?</svg>", page, flags=re.DOTALL)
    assert drawn is not None
    # A dollar sign is a letter, not the start of a formula.
    assert "X&amp;$a^b$" in drawn[0]


@pytest.mark.usefixtures("no_drawing")
def test_verdict_states_the_figures_and_that_nothing_is_verified(
    leadscrew: Make, job: MakeJob, tmp_path: Path
) -> None:
    fit = leadscrew()
    before, after = fit.error["before"], fit.error["predicted"]
    text = words(page_of(job(fit), tmp_path))
    assert (
        f"falls from {1000 * before.rms:.1f} µm rms"
        f" (largest {1000 * before.max:.1f} µm) to {1000 * after.rms:.1f} µm rms"
    ) in text
    assert fit.judgement.verdict is Verdict.UNPROVEN
    assert "Computed; sign unproven: on readings that the fit did not see" in text
    assert "No measurement has settled leadscrew_sign" in text
    assert "passed unproven" in text
    assert "ISO 230-2:2014" in text


@pytest.mark.usefixtures("no_drawing")
def test_a_list_that_promises_no_gain_sends_nobody_to_settle_its_sign(
    leadscrew: Make, job: MakeJob, tmp_path: Path
) -> None:
    fit = leadscrew()
    error = dict(fit.error) | {"predicted": fit.error["before"]}
    text = words(page_of(job(dataclasses.replace(fit, error=error)), tmp_path))
    assert "No gain shown:" in text
    assert "No measurement has settled:" not in text
    assert "Next:" not in text
    text = words(page_of(job(fit), tmp_path))
    assert "Next: Copy achskw3.lis" in text


@pytest.mark.usefixtures("no_drawing")
def test_failed_gate_is_loud_and_says_where(
    leadscrew: Make, job: MakeJob, tmp_path: Path
) -> None:
    check = GateCheck("max_slope", 31.0, 20.0, "µm/mm", False, "between X = 5 and 6 mm")
    fit = dataclasses.replace(leadscrew(), gate=(check,))
    text = words(page_of(job(fit), tmp_path))
    assert "Do not load: the gate stopped this list. max slope 31 µm/mm" in text
    assert "between X = 5 and 6 mm failed" in text
    assert "FAILED stop" in text


@pytest.mark.usefixtures("no_drawing")
def test_list_that_would_not_help_is_not_called_good(
    cross: Make, job: MakeJob, tmp_path: Path
) -> None:
    fit = cross()
    fit = dataclasses.replace(
        fit, error={**fit.error, "predicted": fit.error["before"]}
    )
    assert "Nothing shows yet that this list helps" in words(
        page_of(job(fit), tmp_path)
    )
    failed = GateCheck("gain", 2.0, 1.0, "mm", False, "on runs held out")
    fit = dataclasses.replace(fit, gate=(*fit.gate, failed))
    assert "This list would not help, do not load it" in words(
        page_of(job(fit), tmp_path)
    )


@pytest.mark.usefixtures("no_drawing")
@pytest.mark.parametrize(
    ("size", "verdict", "code", "sentence"),
    [
        (
            0.0018,
            "right",
            Code.VERIFIED,
            "Verified: on readings that the fit did not see",
        ),
        (0.006, "right", Code.LESS_THAN_PREDICTED, "Better, but less than predicted"),
        (
            0.05,
            "right",
            Code.NO_BETTER,
            "Take the list out again: a second measurement",
        ),
        (0.04, "sign", Code.DIAGNOSED, "the list doubles the error: sign"),
    ],
)
def test_second_measurement_decides_the_verdict(
    leadscrew: Make, job: MakeJob, tmp_path: Path,
    size: float, verdict: str, code: Code, sentence: str,
) -> None:  # fmt: skip
    # Before: 19 µm rms; predicted: 2 µm.
    fit = again(leadscrew(), size, verdict)
    assert [reason.code for reason in fit.judgement.reasons] == [code]
    text = words(page_of(job(fit), tmp_path))
    assert sentence in text
    assert fit.measured is not None
    assert f"found {1000 * fit.measured.figures.rms:.1f} µm rms" in text
    verified = "Verified by a second measurement with the list active: after.toml"
    assert (verified in text) == (code in (Code.VERIFIED, Code.LESS_THAN_PREDICTED))
    assert "nothing here is verified" not in text


def test_figures_outweigh_a_diagnosis_that_something_else_may_have_blurred(
    leadscrew: Make,
) -> None:
    # Before: 19 µm rms; predicted: 2 µm. Twice the list would have left 19 µm.
    fit = again(leadscrew(), 0.0018, "twice")
    assert fit.judgement.verdict is Verdict.REJECTED
    assert fit.again is not None
    assert fit.measured is not None
    seen = dataclasses.replace(fit.measured, added=0.019)
    shown = dataclasses.replace(fit.again, readings=seen)
    assert dataclasses.replace(fit, again=shown).judgement.verdict is Verdict.GOOD


@pytest.mark.usefixtures("no_drawing")
def test_second_measurement_that_shows_nothing_verifies_nothing(
    leadscrew: Make, job: MakeJob, tmp_path: Path
) -> None:
    # No error of its own, and a diagnosis that does not tell; the sign is settled already.
    fit = again(leadscrew(), 0.0018, "cannot tell")
    assert fit.again is not None
    fit = dataclasses.replace(fit, again=dataclasses.replace(fit.again, readings=None))
    assert fit.judgement.verdict is Verdict.UNPROVEN
    text = words(page_of(job(fit), tmp_path))
    assert "Not verified by a second measurement (after.toml, 2026-11-22)" in text
    assert "(so it is)" in text


def test_second_measurement_with_gaps_is_refused() -> None:
    with pytest.raises(
        SecondMeasurementError, match=r"again\.csv: found 2 readings, 1 of them numbers"
    ):
        SecondMeasurement("again.csv", np.zeros((2, 1)), np.array([0.0, np.nan]))


@pytest.mark.usefixtures("no_drawing")
def test_errors_come_before_warnings_before_infos(
    cross: Make, job: MakeJob, tmp_path: Path
) -> None:
    remarks = (Remark("info", "AAA"), Remark("error", "CCC"), Remark("warning", "BBB"))
    fit = dataclasses.replace(cross(), remarks=remarks)
    text = words(page_of(job(fit), tmp_path))
    assert text.index("error CCC") < text.index("warning BBB") < text.index("info AAA")


@pytest.mark.usefixtures("no_drawing")
def test_wild_readings_are_counted_and_named_by_row(
    plane: Make, job: MakeJob, tmp_path: Path
) -> None:
    fit = plane()
    wild = np.flatnonzero(fit.fit.wild)
    worst = wild[np.argmax(np.abs(fit.samples.before[wild]))]
    text = words(page_of(job(fit), tmp_path))
    assert f"{wild.size} of 3 684" in text
    assert f"Wild readings: the 12 largest of {wild.size}" in text
    shown = f"{worst + 1:,}".replace(",", " ")
    assert f"{shown} X = {fit.samples.positions[worst, 0]:.3f}".rstrip("0") in text


@pytest.mark.usefixtures("no_drawing")
@pytest.mark.parametrize("wild", [False, True])
def test_figures_of_the_standard_say_that_they_hold_wild_readings(
    leadscrew: Make, wild: bool
) -> None:
    fit = leadscrew()
    before = fit.error["before"]
    if wild:
        before = dataclasses.replace(before, without_wild=before)
    fit = dataclasses.replace(fit, error={**fit.error, "before": before})
    meanings = {name: said for name, (said, _) in section_of(fit, 1).rows.items()}
    assert ("with wild readings" in meanings["A"]) == wild
    assert "wild" not in meanings["rms"]


def test_no_half_written_page_is_left_behind(
    cross: Make, job: MakeJob, tmp_path: Path
) -> None:
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OSError, match="directory"):
        write_report(job(cross()), tmp_path)
    assert not list(tmp_path.rglob("*.part"))


def test_job_without_fits_still_gives_a_page(job: MakeJob, tmp_path: Path) -> None:
    result = job(remarks=(Remark("error", "probe.csv: no column 'dz'."),))
    assert "error probe.csv: no column 'dz'." in words(page_of(result, tmp_path))


@pytest.mark.slow
def test_million_readings_and_ten_thousand_nodes_make_a_small_page(
    plane: Make, job: MakeJob, tmp_path: Path
) -> None:
    fit = plane(columns=101, rows=101, readings=1_000_000)
    files = write_report(job(fit), tmp_path)
    # All plots are in the page once more; a mail server takes 5 MB.
    assert sum(path.stat().st_size for path in files) < 5_000_000
    assert "readings are drawn" in words(files[0].read_text("utf-8"))
