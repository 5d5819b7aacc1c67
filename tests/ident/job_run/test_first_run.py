"""The NC program of a first run, carried out line by line by a small interpreter."""

from pathlib import Path

import pytest

from axcomp.ident.job import JobError, run_job

from ..nc_machine import Machine
from .screw import laser, screw_job

LEAD = ("X", "LEAD")


def program(folder: Path, axis: str = "") -> str:
    laser(folder / "laser.csv")
    result = run_job(screw_job(folder, axis=axis), folder / "out")
    names = [path.name for path in result.files if path.suffix == ".nc"]
    assert len(names) == 1
    assert any(step.action == f"Start {names[0]}" for step in result.load_sheet)
    return (folder / "out" / names[0]).read_text("ascii")


@pytest.mark.parametrize("active", [set(), {LEAD}, {LEAD, ("X", "CROSS")}])
def test_the_state_afterwards_is_the_state_before(
    tmp_path: Path, active: set[tuple[str, str]]
) -> None:
    machine = Machine({"X"}, {LEAD, ("X", "CROSS")}, set(active))
    machine.run(program(tmp_path))
    assert machine.active == active
    # In between it was off, then on.
    assert machine.switched[:2] == [("OFF", *LEAD), ("ON", *LEAD)]
    assert machine.halts == 3
    assert machine.messages == []
    assert machine.synchronised
    assert not machine.moved


def test_what_is_not_initialised_is_said_and_left_alone(tmp_path: Path) -> None:
    machine = Machine({"X"}, set(), set())
    machine.run(program(tmp_path))
    assert machine.messages == ["LEAD of X is not initialised: skipped"]
    assert machine.switched == []


def test_both_axes_of_a_gantry_are_switched_together(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    path = screw_job(tmp_path, axis='gantry = "X2"')
    text = path.read_text()
    fit = text[text.index("[measurements.laser]") :]
    fit = fit.replace(".laser]", ".second]").replace('"laser"', '"second"')
    fit = fit.replace('axis = "X"', 'axis = "X2"')
    path.write_text(f"{text}\n[axes.X2]\nnumber = 2\n{fit}")
    run_job(path, tmp_path / "out")
    text = (tmp_path / "out" / "first_run_1.nc").read_text("ascii")
    pair = {("X", "LEAD"), ("X2", "LEAD")}
    for before in (set(), pair):
        machine = Machine({"X", "X2"}, pair, set(before))
        machine.run(text)
        assert machine.active == before
        # A halt finds both on or both off.
        assert machine.at_halts == [before, set(), pair]


def test_axis_words_and_channels_come_from_the_job_and_never_from_a_list(
    tmp_path: Path,
) -> None:
    text = program(tmp_path, axis='name = "X ACHSE"\nnc_name = "X1"\nchannel = 2')
    assert "first_run_2" in text
    machine = Machine({"X1"}, {("X1", "LEAD")}, {("X1", "LEAD")})
    machine.run(text)
    assert machine.active == {("X1", "LEAD")}
    assert not (tmp_path / "out" / "first_run_1.nc").exists()


@pytest.mark.parametrize("key", ["X-1", "PORTAL"])
def test_an_axis_without_a_word_is_named_and_has_no_program(
    tmp_path: Path, key: str
) -> None:
    laser(tmp_path / "laser.csv")
    path = screw_job(tmp_path)
    text = path.read_text().replace("[axes.X]", f"[axes.{key}]")
    path.write_text(text.replace('"X"', f'"{key}"'))
    result = run_job(path, tmp_path / "out")
    assert not list((tmp_path / "out").glob("*.nc"))
    step = next(s for s in result.load_sheet if s.action == f"Give {key} a word")
    assert "set nc_name" in step.detail


def test_two_axes_of_a_channel_with_one_word_are_refused(tmp_path: Path) -> None:
    laser(tmp_path / "laser.csv")
    path = screw_job(tmp_path)
    second = '[axes.Y]\nnumber = 2\nnc_name = "X"\n'
    path.write_text(path.read_text() + second)
    with pytest.raises(JobError, match="found 'X', the word of axis 'X' in channel 1"):
        run_job(path, tmp_path / "out")
    path.write_text(
        path.read_text().replace('nc_name = "X"', 'nc_name = "X"\nchannel = 2')
    )
    run_job(path, tmp_path / "out")
