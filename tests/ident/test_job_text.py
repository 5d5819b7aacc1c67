"""A job as text: what is written is read again, and an edit keeps what it does not name."""

import datetime
import tomllib
from typing import Any

import numpy as np
import pytest

from axcomp.ident._job_text import edited_job, job_text

FITS = [{"compensation": "leadscrew", "axis": "X", "start": 0.0, "modulo": True}]


def test_a_written_job_holds_its_values() -> None:
    job = {
        "title": 'Mill "7" – µ',
        "axes": {"X": {"number": 1, "limits": [0.0, 1.5]}, "Y 2": {"number": 2}},
        "measurements": {"m": {"columns": {"X.error": {"column": "e", "unit": "um"}}}},
        "controller": {"cycle_time": 0.001, "build": None},
        "machine": {"measured_at": datetime.date(2026, 11, 20)},
        "fits": [{"axis": "X", "bilateral": True}, {"axis": "Y 2", "smoothness": 0}],
        "gate": {},
    }
    text = job_text(job)
    found = tomllib.loads(text)
    # What has no value is left out.
    assert found.pop("controller") == {"cycle_time": 0.001}
    names = ("title", "axes", "measurements", "machine", "fits")
    assert found == {key: job[key] for key in names}
    assert "[axes.X]\nnumber = 1\nlimits = [0.0, 1.5]" in text


def test_numbers_of_numpy_are_written_as_those_of_python() -> None:
    job = {"a": np.float64(1e-5), "b": np.int64(3), "c": np.array([1.5, np.inf])}
    assert tomllib.loads(job_text(job)) == {"a": 1e-5, "b": 3, "c": [1.5, np.inf]}


@pytest.mark.parametrize(
    "text",
    [
        '[measurements.p]\nfile = "a"\ndatum = { at = 0.0 } # zero\n',
        'fits = []\n[measurements.p]\nfile = "a"\n[measurements.p.datum]\nat = 0.0\n',
        '[measurements]\np = { file = "a", datum = { at = 0.0 } }\n',
        'measurements.p.file = "a"\nmeasurements.p.datum.at = 0.0\n[[fits]]\naxis = "Y"\n',
        '[measurements."p"]\nremove = "line"\nfile = "a"\ndatum.at = 0.0\n',
        '[measurements.p]\nfile = "a"\n[[fits]]\naxis = "Y"\n[fits.steady]\nwithin = 1.0\n'
        '[axes.X]\nnumber = 1\n[[fits]]\naxis = "Z"\n[measurements.p.datum]\nat = 0.0\n',
    ],
)
def test_an_edit_sets_and_removes_keys_however_they_are_written(text: str) -> None:
    keys = {"datum": None, "remove": "offset", "drift": 3}
    expected: dict[str, Any] = tomllib.loads(text) | {"fits": FITS}
    del expected["measurements"]["p"]["datum"]
    expected["measurements"]["p"] |= {"remove": "offset", "drift": 3}
    assert tomllib.loads(edited_job(text, {"p": keys}, FITS)) == expected


def test_an_edit_keeps_comments_and_layout() -> None:
    text = '''# Mill """7"""
[axes.X]  # the long one
number=1

[measurements.p]
file   = 'a.csv'   # of Monday
drift = 2  # by eye

[gate]  # as agreed
max_step = 0.05
'''
    new = edited_job(text, {"p": {"drift": 4}}, FITS)
    kept, written = new.split("\n[[fits]]\n")
    assert kept == text.replace("drift = 2", "drift = 4")
    assert written == job_text({"fits": FITS}).removeprefix("[[fits]]\n") + "\n"


def test_a_new_key_stands_before_the_comment_of_the_next_table() -> None:
    text = '[measurements.p]\nfile = "a.csv"\n\n# as agreed\n[gate]\nmax_step = 0.05\n'
    new = edited_job(text, {"p": {"remove": "none"}}, FITS)
    kept = text.replace('"a.csv"\n', '"a.csv"\nremove = "none"\n')
    assert new.startswith(kept)


def test_a_new_key_stands_before_the_tables_below_and_their_comments() -> None:
    text = (
        '[measurements.p]\nfile = "a.csv"\n# of Monday\n[measurements.p.columns]\n'
        '"X.position" = "x"\n\n# the corner\n[measurements.p.datum]\nat = 0.0\n'
    )
    new = edited_job(text, {"p": {"remove": "none", "datum": {"at": 1.0}}}, FITS)
    kept = text.replace('"a.csv"\n', '"a.csv"\nremove = "none"\ndatum = { at = 1.0 }\n')
    kept = kept.replace("[measurements.p.datum]\nat = 0.0\n", "")
    assert new.startswith(kept)


def test_a_comment_behind_an_empty_list_of_fits_is_kept() -> None:
    text = '[measurements.p]\nfile = "a"\n'
    new = edited_job(f"fits = []  # as found\n{text}", {"p": {"drift": 4}}, FITS)
    assert new == f"{text}drift = 4\n\n# as found\n\n{job_text({'fits': FITS})}\n"
