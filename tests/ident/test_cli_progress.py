"""What commands say while they work: a spinner on a terminal, plain lines elsewhere."""

import time

import pytest

from axcomp.ident.cli import _console
from axcomp.ident.cli._console import working


def test_a_terminal_sees_what_goes_on_once_it_takes_long(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with working("reading the job"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(_console, "_SOON", 0.0)
    with working("reading the job") as step:
        end = time.monotonic() + 10.0
        said = ""
        while "fitting" not in said and time.monotonic() < end:
            step("fitting")
            time.sleep(0.05)
            said += capsys.readouterr().err
    assert "fitting" in said


def test_elsewhere_the_steps_of_long_work_are_plain_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    with working("reading the job") as step:
        step("fitting")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(_console, "_LONG", -1.0)
    with working("reading the job", every=60.0) as step:
        step("fitting")
        step("proving")  # within a minute of the other one
    assert capsys.readouterr().err == "fitting\n"
