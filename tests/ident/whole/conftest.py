"""Jobs by command line: no cache of the user, and no report, which others test."""

from pathlib import Path

import pytest

from axcomp.ident.job import JobResult


@pytest.fixture(autouse=True)
def lean(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_report(result: JobResult, out: Path) -> tuple[Path, ...]:
        return (out / "report.html",)

    # The cache is a setting of the whole process: not while other tests run in it.
    monkeypatch.setenv("AXCOMP_CACHE", "off")
    monkeypatch.setattr("axcomp.ident.report.write_report", no_report)
