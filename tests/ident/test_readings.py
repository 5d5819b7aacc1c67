"""One reader: what a column of a measurement is, whoever asks for it."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import MeasurementError
from axcomp.ident.job import Job, load_job
from axcomp.ident.readings import Rows, Tables, observe, read_outside

JOB = """
[axes.C]
number = 4
type = "rotary"
modulo = [0.0, 360.0]
[axes.X]
number = 1
[measurements.a]
file = "a.csv"
{keys}
[measurements.a.columns]
"C.position" = "c"
"X.position" = "x"
"X.error" = "dx"
"temperature.scale" = "t"
"""


def job_of(folder: Path, rows: str, keys: str = "") -> Job:
    (folder / "a.csv").write_text("c,x,dx,t\n" + rows)
    path = folder / "job.toml"
    path.write_text(JOB.format(keys=keys))
    return load_job(path, fits=False)


def rows_of(job: Job, *, gaps: bool) -> Rows:
    return Rows(job, "a", Tables(job).measured("a"), ["X"], gaps=gaps)


@pytest.mark.parametrize("gaps", [False, True])
def test_a_turning_axis_stays_in_its_range(tmp_path: Path, gaps: bool) -> None:
    rows = rows_of(job_of(tmp_path, "-10,0,0,20\n370,1,0,20\n"), gaps=gaps)
    assert rows.position("C").tolist() == [350.0, 10.0]


@pytest.mark.parametrize(
    ("limits", "read"), [("", False), ("[0.0, 300.0]", False), ("[0.0, 360.0]", True)]
)
def test_rows_of_a_raster_are_no_turns_of_an_axis_with_two_ends(
    tmp_path: Path, limits: str, read: bool
) -> None:
    # A display that leaves the limits begins anew all the same.
    rows = "".join(f"{c},{x},0,20\n" for x in range(3) for c in range(0, 341, 20))
    job = job_of(tmp_path, rows)
    stated = f"limits = {limits}" if limits else ""
    text = job.path.read_text().replace("modulo = [0.0, 360.0]", stated)
    job.path.write_text(text)
    if not read:
        with pytest.raises(MeasurementError, match="or limits, where it has two ends"):
            rows_of(load_job(job.path, fits=False), gaps=False)
        return
    places = rows_of(load_job(job.path, fits=False), gaps=False).position("C")
    assert places.max() == 340.0


def test_a_marker_for_no_reading_is_left_out_and_said(tmp_path: Path) -> None:
    job = job_of(tmp_path, "0,0,0.1,20\n0,1,9.9e37,20\n0,2,0.3,20\n")
    seen = observe(job)
    np.testing.assert_array_equal(seen.data.error["X"], [0.1, np.nan, 0.3])
    assert "1 of 3 values of X.error lie beyond 1e+09" in " ".join(seen.remarks)


def test_a_marker_for_no_reading_is_refused_where_every_row_counts(
    tmp_path: Path,
) -> None:
    job = job_of(tmp_path, "0,0,0.1,20\n0,1,9.9e37,20\n")
    with pytest.raises(MeasurementError, match=r"line 3: found 9.9e\+37 .* X.error"):
        read_outside(job)


def test_reference_and_zero_are_the_same_for_discover_and_doctor(
    tmp_path: Path,
) -> None:
    keys = 'expansion = 10.0\nmaterial_temperature = "scale"\nremove = "offset"'
    places = np.linspace(0.0, 900.0, 10)
    rows = "".join(f"0,{x},{2.0 + 3e-5 * x:.9f},23\n" for x in places)
    job = job_of(tmp_path, rows, keys)
    # 10 µm/m/K at 3 K are the slope; what stays is the zero.
    np.testing.assert_allclose(read_outside(job)[0].error, 0.0, atol=1e-12)
    np.testing.assert_allclose(observe(job).data.error["X"], 0.0, atol=1e-12)


def test_readings_that_were_missed_do_not_hide_what_a_reduction_changed(
    tmp_path: Path,
) -> None:
    keys = "expansion = 10.0\nmaterial_temperature = 23.0"
    rows = rows_of(
        job_of(tmp_path, "0,0,0,20\n0,1000,,20\n0,500,0,20\n", keys), gaps=True
    )
    rows.error("X", {"X": rows.position("X")})
    assert rows.change["X"] == pytest.approx(0.015)
