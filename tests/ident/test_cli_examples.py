"""The examples that ``--help`` shows, run in a folder such as a user has."""

import inspect
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.core import TyperGroup

from axcomp.ident.cli import main
from axcomp.ident.cli._app import COMMANDS, app

X = np.linspace(0.0, 400.0, 21)
OLD = """\
kopf.achs_nr 1
kopf.log_achs_name X
Ende
"""
BENT = """\
kopf.achs_nr 3
kw.crosscomp.unit 1
kw.crosscomp.master_ax_nr 1
kw.crosscomp.last_index 1
kw.crosscomp.table[0].setpoint 0
kw.crosscomp.table[0].correction 0
kw.crosscomp.table[1].setpoint 4000000
kw.crosscomp.table[1].correction 150
Ende
"""
JOB = """
[axes.X]
number = 1
limits = [0.0, 400.0]
list = "{folder}achskw1.lis"
[measurements.laser]
file = "{folder}{file}"
axis = "X"
active = {active}
remove = "none"
"""
FIT = """
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
bilateral = true
start = 0.0
interval = 20.0
points = 21
"""


def laser(path: Path, share: float, seed: int) -> None:
    """Write five runs in both directions of what is left of a screw's error."""
    rng = np.random.default_rng(seed)
    lines = ["run,direction,target [mm],error [um]"]
    for run in range(1, 6):
        for way in (1, -1):
            true = 15.0 * np.sin(X / 90.0) + 2.0 * way
            error = share * true + 0.3 * rng.normal(size=X.size)
            lines += [
                f"{run},{way:+d},{x:g},{e:.3f}" for x, e in zip(X, error, strict=True)
            ]
    path.write_text("\n".join(lines) + "\n")


def prepared(folder: Path) -> None:
    """Write what a user has before the first command."""
    laser(folder / "laser_x.csv", 1.0, 1)
    laser(folder / "laser_again.csv", 0.02, 2)
    (folder / "achskw1.lis").write_text(OLD)
    (folder / "achskw3.lis").write_text(BENT)
    (folder / "machines").mkdir()
    plain = {"file": "laser_x.csv", "active": "[]"}
    (folder / "machines" / "a.toml").write_text(JOB.format(folder="../", **plain) + FIT)
    after = JOB.format(folder="", file="laser_again.csv", active='["leadscrew"]')
    listed = after.replace('"achskw1.lis"', '"axcomp-out/achskw1.lis"')
    (folder / "after.toml").write_text(listed)
    time = np.arange(0.0, 2.0, 0.001)
    place = 200.0 - 200.0 * np.cos(np.pi * time)
    np.savetxt(
        folder / "motion.csv",
        np.stack([time, place], axis=1),
        "%.6f",
        ",",
        header="time,A1.position",
        comments="",
    )


def logged(folder: Path) -> None:
    """Write the log of a controller that adds what the lists say."""
    motion = (folder / "motion.csv").read_text().splitlines()
    added = (folder / "offsets.csv").read_text().splitlines()
    at = added[0].split(",").index("A1.leadscrew")
    rows = [f"{a},{b.split(',')[at]}" for a, b in zip(motion, added, strict=True)]
    (folder / "log.csv").write_text("\n".join(rows) + "\n")


def examples_of(command: Callable[..., Any]) -> list[str]:
    """Return the lines that the docstring of a command gives as examples."""
    lines = inspect.cleandoc(command.__doc__ or "").partition("\nExamples:\n")[2]
    return [line.strip() for line in lines.splitlines()]


@pytest.mark.slow
@pytest.mark.usefixtures("no_drawing")
def test_every_example_works_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prepared(tmp_path)
    monkeypatch.chdir(tmp_path)
    for name, command in COMMANDS.items():
        lines = examples_of(command)
        if name == "demo":
            continue  # takes long; its own tests run it
        for line in lines:
            if name == "fit" and line == lines[0]:
                # What a person does with the questions of the new job.
                plain = {"file": "laser_x.csv", "active": "[]"}
                job = JOB.format(folder="", **plain) + FIT
                Path("job.toml").write_text(job)
            if name == "verify":
                logged(tmp_path)
            command, *words = shlex.split(line)
            assert command == "axcomp"
            assert words[0] == name
            status = main(words)
            assert status == 0, f"{line}: {capsys.readouterr().err}"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_the_examples(
    name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    assert main([name, "--help"]) == 0
    shown = capsys.readouterr().out
    assert all(line in shown for line in examples_of(COMMANDS[name]))


def test_a_shell_can_complete_the_commands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_AXCOMP_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "axcomp co")
    monkeypatch.setenv("COMP_CWORD", "1")
    main([])
    assert "convert" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "nearest"), [(["fti"], "'fit'"), (["fit", "--ot"], "--out")]
)
def test_a_mistyped_word_names_the_nearest(
    words: list[str], nearest: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert nearest in capsys.readouterr().err


def test_every_option_says_what_it_is() -> None:
    group = typer.main.get_command(app)
    assert isinstance(group, TyperGroup)
    silent = [
        f"{name} {parameter.name}"
        for name, command in group.commands.items()
        for parameter in command.params
        if not getattr(parameter, "help", None)
    ]
    assert silent == []
