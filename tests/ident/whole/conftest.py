"""Jobs by command line without a report, which others test."""

from pathlib import Path

import pytest

from axcomp.ident.job import JobResult


@pytest.fixture(autouse=True)
def lean(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_report(result: JobResult, out: Path) -> tuple[Path, ...]:
        return (out / "report.html",)

    monkeypatch.setattr("axcomp.ident.report.write_report", no_report)
