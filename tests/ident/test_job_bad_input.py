"""Measurements that make no table: one line, nothing written."""

from pathlib import Path

import pytest

from axcomp.data.errors import AxcompError
from axcomp.ident.job import JobError, OutputError, run_job

JOB = """
[axes.X]
number = 1
[measurements.m]
file = "m.csv"
remove = "none"
columns = { "X.position" = "x", "X.error" = { column = "e", unit = "um" } }
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "m"
smoothness = 0
start = 0.0
interval = 10.0
points = 5
"""
ROWS = "x,e\n" + "".join(f"{2 * k},{k % 7}\n" for k in range(21))


def run(folder: Path, rows: str = ROWS, old: str = "", new: str = "") -> None:
    assert old in JOB
    (folder / "m.csv").write_text(rows)
    (folder / "job.toml").write_text(JOB.replace(old, new))
    run_job(folder / "job.toml", folder / "out")


def refused(
    folder: Path, match: str, rows: str = ROWS, old: str = "", new: str = ""
) -> None:
    with pytest.raises(AxcompError, match=match) as caught:
        run(folder, rows, old, new)
    assert "\n" not in str(caught.value)
    assert list((folder / "out").glob("**/*")) == []


@pytest.mark.parametrize("cell", ["nan", "inf", "-inf", "", "abc"])
def test_cell_that_is_no_number_is_named(tmp_path: Path, cell: str) -> None:
    refused(tmp_path, r"m.csv:7: .*expected a finite number|m.csv:7: .*number",
            ROWS.replace("\n10,5\n", f"\n10,{cell}\n"))  # fmt: skip


def test_missing_column_is_named_with_the_nearest(tmp_path: Path) -> None:
    refused(tmp_path, "m.csv: .*'err'", old='column = "e"', new='column = "err"')


def test_wrong_unit_is_named_with_the_accepted_ones(tmp_path: Path) -> None:
    refused(tmp_path, "m.csv: .*found unit 's', expected", old='"um"', new='"s"')


def test_missing_role_says_what_it_is_for(tmp_path: Path) -> None:
    refused(
        tmp_path, "expected 'X.position' for the leadscrew fit of X",
        old='"X.position" = "x", ', new="",
    )  # fmt: skip


def test_empty_file_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "m.csv: ", rows="")


def test_header_without_rows_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "m.csv: ", rows="x,e\n")


def test_equal_positions_are_refused(tmp_path: Path) -> None:
    rows = "x,e\n" + "".join(f"20,{k % 7}\n" for k in range(21))
    refused(tmp_path, r"job.toml:8: fits\[0\]: leadscrew of X from m: .*", rows=rows)


def test_readings_too_few_to_judge_their_noise_are_refused(tmp_path: Path) -> None:
    refused(
        tmp_path, r"fits\[0\]: leadscrew of X from m: .*", "x,e\n0,1\n40,2\n",
        old="interval = 10.0\npoints = 5", new="interval = 40.0\npoints = 2",
    )  # fmt: skip


def test_direction_that_cannot_be_derived_is_refused(tmp_path: Path) -> None:
    rows = "x,run,e\n" + "".join(f"{10 * (k % 5)},{k % 3},1\n" for k in range(30))
    (tmp_path / "m.csv").write_text(rows)
    text = JOB.replace("columns = {", 'columns = { "run" = "run",')
    text = text.replace("smoothness = 0", "smoothness = 0\nbilateral = true")
    (tmp_path / "job.toml").write_text(text)
    with pytest.raises(AxcompError, match="direction of X cannot be derived"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_node_between_list_units_is_refused(tmp_path: Path) -> None:
    refused(
        tmp_path, r"fits\[0\].interval: found 9.99995, expected a multiple of 0.0001",
        old="interval = 10.0", new="interval = 9.99995",
    )  # fmt: skip


def test_node_beyond_sgn32_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "last node: found .*expected a value from -214748",
            old="interval = 10.0", new="interval = 60000.0")  # fmt: skip


def test_value_beyond_its_type_is_refused_and_never_wrapped(tmp_path: Path) -> None:
    # 4 mm is 40 000 list units, more than one manual lets a leadscrew value be.
    rows = "x,e\n" + "".join(f"{2 * k},4000\n" for k in range(21))
    refused(tmp_path, r"kw.ssfk.table\[\].pos: found 4 mm or °, expected a value from",
            rows=rows)  # fmt: skip


def test_table_beyond_max_points_of_an_old_build_is_refused(tmp_path: Path) -> None:
    rows = "x,e\n" + "".join(f"{k / 10},1\n" for k in range(1600))
    small = "start = 0.0\ninterval = 10.0\npoints = 5"
    big = "start = 0.0\ninterval = 0.1\npoints = 1600"
    old_build = '[controller]\nbuild = "V3.1.3070.0"\n'
    (tmp_path / "m.csv").write_text(rows)
    (tmp_path / "job.toml").write_text(old_build + JOB.replace(small, big))
    with pytest.raises(
        JobError, match="max_points: found a table that needs 1601 on b"
    ):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_max_points_below_the_table_is_refused(tmp_path: Path) -> None:
    refused(tmp_path, "kw.ssfk.max_points: found 3, expected at least 6",
            old="points = 5", new="points = 5\nmax_points = 3")  # fmt: skip


def test_list_of_another_axis_is_refused(tmp_path: Path) -> None:
    (tmp_path / "achskw2.lis").write_text("kopf.achs_nr 2\nkopf.log_achs_name Y\n")
    refused(
        tmp_path, r"axes.X.list: found a list of axis 2 \(kopf.achs_nr\), expected ax",
        old="number = 1", new='number = 1\nlist = "achskw2.lis"',
    )  # fmt: skip


def test_cross_nodes_short_of_the_software_limits_are_refused(tmp_path: Path) -> None:
    job = JOB.replace("[axes.X]", "[axes.Y]\nnumber = 2\n[axes.X]\nlimits = [-5, 40]")
    job = job.replace('"X.error"', '"Y.error"').replace(
        'compensation = "leadscrew"\naxis = "X"',
        'compensation = "cross"\naxis = "Y"\nmaster = "X"',
    )
    (tmp_path / "m.csv").write_text(ROWS)
    (tmp_path / "job.toml").write_text(job)
    with pytest.raises(
        JobError, match="nodes from 0 to 40, expected them to reach the"
    ):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_modulo_table_must_cover_the_range_of_the_axis(tmp_path: Path) -> None:
    job = JOB.replace("[axes.X]", '[axes.X]\ntype = "rotary"\nmodulo = [0.0, 360.0]')
    job = job.replace("smoothness = 0", "smoothness = 0\nmodulo = true")
    (tmp_path / "m.csv").write_text(ROWS)
    (tmp_path / "job.toml").write_text(job.replace('"um"', '"deg"'))
    with pytest.raises(JobError, match="found nodes from 0 to 40, expected the modulo"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_output_folder_that_is_a_file_is_refused_first(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    (tmp_path / "m.csv").write_text("")  # would be refused too, later
    (tmp_path / "job.toml").write_text(JOB)
    with pytest.raises(OutputError, match="out: cannot write into the output folder"):
        run_job(tmp_path / "job.toml", tmp_path / "out")


def test_lists_are_never_written_onto_their_sources(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(ROWS)
    source = "kopf.achs_nr 1\nkopf.log_achs_name X\n"
    (tmp_path / "achskw1.lis").write_text(source)
    job = JOB.replace("number = 1", 'number = 1\nlist = "achskw1.lis"')
    (tmp_path / "job.toml").write_text(job)
    with pytest.raises(OutputError, match="is an input and is never written"):
        run_job(tmp_path / "job.toml", tmp_path)
    assert (tmp_path / "achskw1.lis").read_text() == source


def test_misspelt_key_of_the_compensation_is_named(tmp_path: Path) -> None:
    match = (
        r"job.toml:\d+: fits\[0\].compensaton: unknown key \(nearest: 'compensation'\)"
    )
    refused(tmp_path, match, old="compensation =", new="compensaton =")


def test_misspelt_key_of_the_second_measurement_is_named(tmp_path: Path) -> None:
    match = r"verify.jobs: unknown key \(nearest: 'job'\)"
    refused(tmp_path, match, old="[[fits]]", new='[verify]\njobs = "a"\n[[fits]]')


def test_axis_is_not_its_own_gantry_partner(tmp_path: Path) -> None:
    match = "axes.X.gantry: found 'X', expected another axis"
    refused(tmp_path, match, old="number = 1", new='number = 1\ngantry = "X"')
