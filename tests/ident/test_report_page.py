"""The report as a browser shows it: on a phone, on a screen, on paper."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pypdfium2
import pytest
from playwright.sync_api import Browser, Page

from axcomp.ident.job import JobResult, TableResult
from axcomp.ident.report import write_report

Make = Callable[..., TableResult]
MakeJob = Callable[..., JobResult]


@pytest.fixture(scope="module")
def report(
    leadscrew: Make,
    cross: Make,
    plane: Make,
    job: MakeJob,
    tmp_path_factory: pytest.TempPathFactory,
) -> str:
    out = tmp_path_factory.mktemp("report")
    page, *_ = write_report(job(leadscrew(), cross(), plane()), out)
    return page.as_uri()


def open_page(browser: Browser, address: str, width: int) -> tuple[Page, list[str]]:
    """Open a page and return it with all that it asks for or complains of."""
    page = browser.new_page(viewport={"width": width, "height": 800})
    noise: list[str] = []
    page.on("console", lambda message: noise.append(message.text))
    page.on("pageerror", lambda error: noise.append(str(error)))
    page.on("request", lambda request: noise.append(request.url))
    page.goto(address)
    return page, [one for one in noise if one != address]


@pytest.mark.slow
@pytest.mark.parametrize("width", [375, 1200])
def test_report_fits_the_screen_and_asks_for_nothing(
    browser: "Browser", report: str, width: int
) -> None:
    page, noise = open_page(browser, report, width)
    assert noise == []
    assert page.evaluate("document.documentElement.scrollWidth") == width
    clipped = page.evaluate(
        """() => [...document.querySelectorAll("table, p, pre, li")].filter(
            e => e.scrollWidth > e.clientWidth + 1 || e.getBoundingClientRect().right
                > document.documentElement.clientWidth).map(e => e.textContent)"""
    )
    assert clipped == []


@pytest.mark.slow
def test_words_in_the_plots_can_be_read_on_a_phone(
    browser: "Browser", report: str
) -> None:
    page, _ = open_page(browser, report, 375)
    heights = page.evaluate(
        """() => [...document.querySelectorAll("svg.plot text")].map(
            e => e.getBBox().height * e.getScreenCTM().a)"""
    )
    written = [height for height in heights if height > 0]
    # On a phone a CSS pixel is 1/160 inch: letters of 1 mm, as in a footnote.
    assert len(written) > 50
    assert min(written) > 7.0
    # The whole plot is on the screen, and nothing of it is to be moved into sight.
    widths = page.evaluate(
        """() => [...document.querySelectorAll(".canvas")].map(
            e => [e.scrollWidth, e.clientWidth])"""
    )
    assert all(inner <= outer <= 375 for inner, outer in widths)


@pytest.mark.slow
def test_words_in_the_plots_do_not_run_into_each_other(
    browser: "Browser", leadscrew: Make, plane: Make, job: MakeJob, tmp_path: Path
) -> None:
    report, *_ = write_report(
        job(leadscrew(), plane(columns=13, rows=11, width=600.0)), tmp_path
    )
    page, _ = open_page(browser, report.as_uri(), 1200)
    over = page.evaluate(
        """() => [...document.querySelectorAll("svg.plot")].flatMap(plot => {
            const words = [...plot.querySelectorAll("text")].map(
                e => [e.textContent, e.getBoundingClientRect()]).filter(e => e[1].width);
            return words.flatMap(([one, a], k) => words.slice(k + 1).filter(([_, b]) =>
                Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2 &&
                Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4
            ).map(([other]) => one + " | " + other));
        })"""
    )
    assert over == []


@pytest.mark.slow
def test_tap_on_a_plot_enlarges_it_and_the_wheel_zooms(
    browser: "Browser", report: str
) -> None:
    page, _ = open_page(browser, report, 375)
    plot = page.locator(".canvas svg").first
    plot.click()
    shown = page.locator("dialog svg.plot")
    before = shown.bounding_box()
    page.mouse.move(180, 400)
    page.mouse.wheel(0, -500)
    after = shown.bounding_box()
    assert before is not None
    assert after is not None
    assert after["width"] > 2 * before["width"]
    page.get_by_role("button", name="Close").click()
    assert not page.locator("dialog").is_visible()


@pytest.mark.slow
def test_first_screen_on_a_phone_says_verdict_and_next_step(
    browser: "Browser", report: str
) -> None:
    page, _ = open_page(browser, report, 375)
    first = page.locator(".front")
    box = first.bounding_box()
    assert box is not None
    assert box["y"] + box["height"] < 800
    for words in ("sign unproven", "No measurement has settled", "Next"):
        assert words in first.inner_text()


@pytest.mark.slow
def test_printed_pages_are_filled(browser: "Browser", report: str) -> None:
    page, _ = open_page(browser, report, 1200)
    with pypdfium2.PdfDocument(page.pdf(prefer_css_page_size=True)) as printed:
        sheets = [one.render(scale=1).to_numpy().min(axis=2) for one in printed]
    filled = [np.flatnonzero(one.min(axis=1) < 250).max() / len(one) for one in sheets]
    # The last sheet ends where the report ends.
    assert min(filled[:-1]) > 0.25
