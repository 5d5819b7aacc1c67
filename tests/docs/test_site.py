"""The documentation as a browser shows it: built strictly, legible on a phone, by itself."""

import functools
import http.server
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pypdfium2
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[2]
pytestmark = [
    pytest.mark.skipif(
        not (ROOT / "mkdocs.yml").is_file(), reason="needs the source tree"
    ),
    pytest.mark.slow,
]
PAGES = sorted(
    page.relative_to(ROOT / "docs").with_suffix("").as_posix()
    for page in (ROOT / "docs").rglob("*.md")
)


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        return None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of the documentation, built with every warning as an error."""
    out = tmp_path_factory.mktemp("site")
    subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)],
        cwd=ROOT, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    handler = functools.partial(_Quiet, directory=str(out))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("width", [375, pytest.param(1200, marks=pytest.mark.heavy)])
def test_pages_fit_the_screen_and_need_nothing_from_outside(
    browser: "Browser", site: str, width: int
) -> None:
    page = browser.new_page(viewport={"width": width, "height": 800})
    noise: list[str] = []
    page.on("console", lambda message: noise.append(message.text))
    page.on(
        "request",
        lambda ask: noise.append(ask.url) if not ask.url.startswith(site) else None,
    )
    for name in PAGES:
        page.goto(f"{site}/{name}.html")
        assert page.locator("h1").count() == 1
        assert page.evaluate("document.documentElement.scrollWidth") == width, name
    assert noise == []


@pytest.mark.parametrize("name", ["parameters", "job", "library", "instrument-files"])
def test_printed_pages_are_whole_and_filled(
    browser: "Browser", site: str, name: str
) -> None:
    # The width of A4 between its margins, in CSS pixels: what is wider is cut off.
    page = browser.new_page(viewport={"width": 680, "height": 1000})
    page.goto(f"{site}/{name}.html")
    page.emulate_media(media="print")
    cut = page.evaluate(
        """() => [...document.querySelectorAll("pre, code, table, td, p, img")].filter(
            e => e.getBoundingClientRect().right > innerWidth + 1
                || (e.matches("pre, code, td") && e.clientWidth > 0
                    && e.scrollWidth > e.clientWidth + 1)).map(e => e.textContent)"""
    )
    assert cut == []
    with pypdfium2.PdfDocument(page.pdf(prefer_css_page_size=True)) as printed:
        sheets = [one.render(scale=1).to_numpy().min(axis=2) for one in printed]
    filled = [np.flatnonzero(one.min(axis=1) < 200).max() / len(one) for one in sheets]
    # The last sheet ends where the page ends.
    assert min(filled[:-1], default=1.0) > 0.25
