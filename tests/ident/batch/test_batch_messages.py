"""What a batch says of tables, folders and questions that it cannot use."""

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.ident.batch import query_results, run_batch
from axcomp.ident.batch._collect import collect_jobs
from axcomp.ident.batch._folder import BatchError
from axcomp.ident.batch._table import write_results
from axcomp.ident.batch._work import Order, examine
from axcomp.ident.cli import main

JOB = '[axes.X]\nnumber = 1\n[measurements.m]\nfile = "m.csv"\n'
LASER = JOB.replace("[measurements.m]", "[measurements.laser]") + (
    '[[fits]]\ncompensation = "leadscrew"\naxis = "X"\nmeasurement = "laser"\n'
)


@pytest.mark.parametrize(
    ("table", "match"),
    [
        ("job,template\nx,a.toml\ny,a.toml\nx,a.toml\n",
         r"t\.csv: found two jobs named 'x'"),
        ("job,template\nx,nix.toml\ny,nix.toml\n",
         r"t\.csv: row 1: template .*nix\.toml: found No such file or directory, expected"),
        ("job,template\nx,bad.toml\n", r"t\.csv: row 1: template .*bad\.toml:1: not TOML"),
        ("job,template\n", r"t\.csv: found no rows, expected one per job"),
    ],
)  # fmt: skip
def test_a_table_of_jobs_is_refused_with_its_row(
    tmp_path: Path, table: str, match: str
) -> None:
    (tmp_path / "a.toml").write_text(JOB)
    (tmp_path / "bad.toml").write_text("[axes\n")
    (tmp_path / "t.csv").write_text(table)
    with pytest.raises(BatchError, match=match):
        collect_jobs([str(tmp_path / "t.csv")], tmp_path / "out")


@pytest.mark.parametrize(
    ("column", "match"),
    [
        ("measurements.lasr.file", "'lasr', expected a .*: laser .nearest: 'laser'"),
        ("axes.x.number", "'x', expected an axis of it: X .nearest: 'X'"),
        ("axes.Y.number", "'Y', expected an axis of it: X .nearest: 'X'"),
    ],
)
def test_a_column_of_a_misspelt_measurement_or_axis_is_refused(
    tmp_path: Path, column: str, match: str
) -> None:
    (tmp_path / "a.toml").write_text(LASER)
    (tmp_path / "t.csv").write_text(f"job,template,{column}\nx,a.toml,3\n")
    with pytest.raises(BatchError, match=rf"row 1: '{column}': found {match}"):
        collect_jobs([str(tmp_path / "t.csv")], tmp_path / "out")


@pytest.mark.parametrize(
    ("columns", "cells"),
    [
        ("measurements.ball.file,fits.0.measurement", "b.csv,ball"),
        ("measurements.ball.file,fits.0.measurements", "b.csv,\"['laser', 'ball']\""),
        ("measurements.ball.file,title", ",left out"),
        ("axes.Y.number,measurements.laser.columns.Y.position", "2,y"),
        ("axes.Y.number,axes.X.gantry", "2,Y"),
    ],
)
def test_a_column_may_add_a_measurement_or_axis_that_the_job_uses(
    tmp_path: Path, columns: str, cells: str
) -> None:
    (tmp_path / "a.toml").write_text(LASER)
    (tmp_path / "t.csv").write_text(f"job,template,{columns}\nx,a.toml,{cells}\n")
    (task,) = collect_jobs([str(tmp_path / "t.csv")], tmp_path / "out")
    assert task.fault is None


def test_a_row_without_its_template_does_not_end_the_fleet(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(JOB)
    rows = "x,a.toml,mill-1,2026-11-20,X\ny,nix.toml,mill-2,20.11.2026,X\n"
    head = "job,template,machine.id,machine.measured_at,fits.0.axis\n"
    (tmp_path / "t.csv").write_text(head + rows)
    out = tmp_path / "out"
    out.mkdir()
    tasks = [each.as_file() for each in collect_jobs([str(tmp_path / "t.csv")], out)]
    *_, lost = examine(tasks, Order(str(out), "t"))
    (row,) = lost.rows
    assert "row 2: template" in row["reason"]
    assert (row["machine_id"], row["axis"]) == ("mill-2", "X")
    write_results(out, lost.rows)
    (row,) = query_results(str(out)).to_pylist()
    assert row["machine_id"] == "mill-2"


@pytest.mark.parametrize("name", ["t.csv", "a.toml"])
def test_a_table_or_template_that_is_no_utf_8_is_refused_as_a_job_is(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / "a.toml").write_text(JOB)
    (tmp_path / "t.csv").write_text("job,template\nx,a.toml\n")
    with (tmp_path / name).open("ab") as file:
        file.write("# Fräse,a.toml\n".encode("latin-1"))
    line = 3 if name == "t.csv" else 5
    match = rf"{name}:{line}: found byte 0xe4, expected UTF-8 text"
    with pytest.raises(AxcompError, match=match):
        collect_jobs([str(tmp_path / "t.csv")], tmp_path / "out")


def test_a_history_that_is_none_is_told_before_the_night(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(JOB)
    with pytest.raises(
        BatchError, match=r"nigth.*expected the folder of a finished batch"
    ):
        run_batch([tmp_path / "a.toml"], tmp_path / "out", history=[tmp_path / "nigth"])
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_no_utf_8_is_refused_before_any_job_runs(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path / "m") + b"\xfchle.toml"))
    path.write_text(JOB)
    with pytest.raises(BatchError, match=r"'m\\udcfchle', expected one that is UTF-8"):
        collect_jobs([str(path)], tmp_path / "out")


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan])
def test_a_time_limit_that_is_none_is_refused(tmp_path: Path, limit: float) -> None:
    with pytest.raises(BatchError, match="expected seconds above 0"):
        run_batch([tmp_path / "a.toml"], tmp_path / "out", time_limit=limit)


def test_one_name_in_a_table_and_in_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text(JOB)
    (tmp_path / "t.csv").write_text("job,template\nx,x.toml\n")
    asked = [str(tmp_path / "t.csv"), str(tmp_path / "x.toml")]
    with pytest.raises(BatchError, match=r"t\.csv, .*found two jobs named 'x'"):
        collect_jobs(asked, tmp_path / "out")


def test_a_file_in_place_of_the_folder_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.toml").write_text(JOB)
    out = tmp_path / "there"
    out.write_text("")
    assert main(["batch", str(tmp_path / "x.toml"), "--out", str(out)]) == 1
    assert "there: found a file, expected a folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("asked", "match"),
    [
        ({"where": "not pased"}, r'WHERE not pased: .*"pased" not found .*: "passed"'),
        ({"select": "job, from_file_rm"}, '"from_file_rm" not found .*"from_file_rms"'),
        ({"order": "jobb"}, 'ORDER BY jobb: .*"jobb" not found .*"job"'),
        ({"where": "passed = 'x"}, "passed = 'x: Parser Error"),
    ],
)
def test_a_question_with_a_typo_names_the_nearest_column(
    tmp_path: Path, asked: dict[str, str], match: str
) -> None:
    write_results(tmp_path, [])
    with pytest.raises(BatchError, match=match):
        query_results(
            tmp_path, asked.get("where"), asked.get("select", "*"), asked.get("order")
        )


def test_no_answer_is_a_header_and_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_results(tmp_path, [])
    assert main(["results", str(tmp_path), "--select", "job, axis"]) == 0
    said = capsys.readouterr()
    assert said.out == "job,axis\n"
    assert said.err == "No row answers that.\n"


def test_the_process_that_looks_after_a_batch_needs_no_estimators() -> None:
    # They take seconds to import, and its workers import them anyway.
    code = (
        "import sys, axcomp.ident.batch\n"
        "print({'jax', 'scipy', 'axcomp.ident.fit', 'axcomp.ident.job'} & set(sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "set()"


def test_lists_of_which_nothing_shows_that_they_help_are_counted(
    tmp_path: Path,
    fleet: Callable[[Path, int], list[str]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = fleet(tmp_path / "jobs", 2)
    scatter = tmp_path / "jobs" / f"{names[1]}.csv"
    head, *rows = scatter.read_text().splitlines()
    noise = np.random.default_rng(1).standard_cauchy(len(rows))
    lines = [row.split(",") for row in rows]
    for line, error in zip(lines, noise, strict=True):
        line[1] = f"{error:.3f}"
    scatter.write_text("\n".join([head, *map(",".join, lines)]))
    job, out = str(tmp_path / "jobs" / "*.toml"), str(tmp_path / "out")
    main(["batch", job, "--out", out, "--workers", "1"])
    said = " ".join(capsys.readouterr().err.split())
    assert "2 lists lie in unverified/" in said
    assert (
        "Of 1 list among them nothing shows yet that it helps: do not load it" in said
    )
    page = (tmp_path / "out" / "summary.html").read_text()
    assert "Of 1 of them nothing shows yet that" in page
