"""The report of a job of six axes: at most 5 s, at most 5 MB (issue: a mail server)."""

from pathlib import Path

import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.ident.job import run_job
from axcomp.ident.report import write_report

AXES = "XYZUVW"


def _job(folder: Path) -> Path:
    rng = np.random.default_rng(3)
    target = np.tile(
        np.concatenate([np.arange(0.0, 801.0, 10.0), np.arange(800.0, -1.0, -10.0)]), 5
    )
    run = np.repeat(np.arange(1, 6), 162)
    way = np.tile(np.repeat([1, -1], 81), 5)
    text = ""
    for k, axis in enumerate(AXES):
        error = 0.02 * np.sin(target / (90.0 + 10 * k)) - 0.005 * (way < 0)
        error += 5e-4 * rng.normal(size=target.size)
        rows = np.column_stack([target, error, run, way])
        np.savetxt(folder / f"{axis}.csv", rows, delimiter=",", comments="",
                   header="target,error,run,direction")  # fmt: skip
        text += (
            f"[axes.{axis}]\nnumber = {k + 1}\n[measurements.{axis}]\nfile = '{axis}.csv'\n"
            f"axis = '{axis}'\nactive = []\nremove = 'none'\n[[fits]]\n"
            f"compensation = 'leadscrew'\naxis = '{axis}'\nmeasurement = '{axis}'\n"
            "bilateral = true\nstart = 0.0\ninterval = 10.0\npoints = 81\n"
        )
    (folder / "job.toml").write_text(text)
    return folder / "job.toml"


def test_report_of_six_axes(benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    result = run_job(_job(tmp_path), tmp_path / "out")
    files = benchmark.pedantic(write_report, args=(result, tmp_path / "out"), rounds=3)
    assert benchmark.stats is not None
    size = files[0].stat().st_size
    benchmark.extra_info |= {"page_MB": size / 1e6}
    assert size <= 5e6
    assert min(benchmark.stats.stats.data) <= 5.0
