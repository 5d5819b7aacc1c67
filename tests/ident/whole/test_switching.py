"""What an axis does by itself where a compensation comes or goes."""

import json
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import Reading, controller_from_lists
from axcomp.ident.proof.axis import largest_step, switching_cycles
from axcomp.models import CompCommand, Conventions, Motion, commanded

from .mill import AXES, CROSS, cross_list, edge, fit, measured


def steps_of(listing: ListFile, y: float) -> np.ndarray:
    """Return what the controller moves Z by per cycle, where COMP ON comes at rest."""
    controller = controller_from_lists([listing], Reading(Conventions()), axes=[2, 3])
    still = np.zeros((40, 2))
    place = still + np.array([y, 0.0])
    off = CompCommand(0, 1, False, ("cross",))
    on = CompCommand(5, 1, True, ("cross",))
    active = commanded(controller, 40, [off, on])
    offsets, _ = controller.run(
        controller.start(), Motion(place, still, still, active=active)
    )
    return np.diff(np.asarray(offsets.offset[:, 1]))


def test_switching_a_sag_is_spread_by_n_cycles_in_the_list(tmp_path: Path) -> None:
    edge(tmp_path, size=0.12)
    assert fit(tmp_path, AXES + measured("edge") + CROSS) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    # 120 µm at mid travel; the smallest number of cycles that keeps 20 µm in each.
    assert listing.integer("kw.crosscomp.n_cycles") == 10
    steps = np.abs(steps_of(listing, 150.0))
    assert 0.015 < steps.max() <= 0.02
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    (check,) = [c for c in result["fits"][0]["gate"] if c["name"] == "max_switching"]
    # The gate says what the controller does, and of the largest offset, some µm more.
    assert check["value"] == pytest.approx(steps.max(), rel=0.05)
    assert any(
        "n_cycles 10 spreads it" in r["message"] for r in result["fits"][0]["remarks"]
    )


def test_small_table_needs_no_n_cycles(tmp_path: Path) -> None:
    edge(tmp_path, size=0.01)
    assert fit(tmp_path, AXES + measured("edge") + CROSS) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    assert listing.integer("kw.crosscomp.n_cycles") is None


def test_sag_of_almost_a_millimetre_is_stopped_and_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edge(tmp_path, size=0.9)
    assert fit(tmp_path, AXES + measured("edge") + CROSS) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "FAILED max_switching" in said
    assert "FAILED max_jump" in said
    assert "datum" in said
    listing = ListFile.read(tmp_path / "out" / "rejected" / "achskw3.lis")
    assert listing.integer("kw.crosscomp.n_cycles") == 20
    # Truth, by the controller: 0.9 mm within 20 cycles is more than 20 µm in one.
    assert np.abs(steps_of(listing, 150.0)).max() > 0.06
    assert not (tmp_path / "out" / "achskw3.lis").exists()


@pytest.mark.parametrize(("size", "chosen"), [(0.12, True), (0.9, False)])
def test_n_cycles_is_left_to_the_job_only_where_the_most_are_enough(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], size: float, chosen: bool
) -> None:
    edge(tmp_path, size=size)
    assert fit(tmp_path, AXES + measured("edge") + CROSS + "n_cycles = 3\n") == 1
    said = " ".join(capsys.readouterr().out.split())
    assert ("leave n_cycles out of the job" in said) == chosen


def test_sag_passes_where_the_builder_allows_it(tmp_path: Path) -> None:
    edge(tmp_path, size=0.9)
    gate = (
        "[gate]\nmax_switching = 0.1\nmax_jump = 1.0\nmax_step = 1.0\nmax_slope = 50\n"
    )
    assert fit(tmp_path, AXES + measured("edge") + CROSS + gate) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    assert np.abs(steps_of(listing, 150.0)).max() <= 0.1


def test_n_cycles_of_the_job_is_kept_and_judged(tmp_path: Path) -> None:
    edge(tmp_path, size=0.12)
    assert fit(tmp_path, AXES + measured("edge") + CROSS + "n_cycles = 3\n") == 1
    (check,) = [
        c
        for c in json.loads((tmp_path / "out" / "result.json").read_text())["fits"][0][
            "gate"
        ]
        if c["name"] == "max_switching"
    ]
    assert not check["passed"]
    assert "kw.crosscomp.n_cycles 3" in check["where"]


def test_existing_n_cycles_that_is_enough_stays(tmp_path: Path) -> None:
    edge(tmp_path, size=0.12)
    (tmp_path / "z.lis").write_text(cross_list(size=0.11))
    (tmp_path / "zm.lis").write_text("kopf.achs_nr 3\nlr_param.crosscomp 1\n")
    axes = AXES + 'list = "z.lis"\nmachine_data = "zm.lis"\n'
    assert fit(tmp_path, axes + measured("edge", "active = []") + CROSS) == 0
    listing = ListFile.read(tmp_path / "out" / "achskw3.lis")
    assert listing.integer("kw.crosscomp.n_cycles") == 20


def test_largest_step_is_that_of_the_filter_of_the_controller() -> None:
    listing = ListFile.parse(cross_list(size=0.12).encode())
    found = np.abs(steps_of(listing, 150.0)).max()
    assert largest_step(0.12, 20) == pytest.approx(found, rel=1e-9)
    assert largest_step(0.12, 1) == largest_step(0.12, 0) == 0.12


def test_no_smaller_number_of_cycles_would_do() -> None:
    for jump in (0.021, 0.05, 0.11, 0.25):
        cycles = switching_cycles(jump, 0.02)
        assert cycles is not None
        assert largest_step(jump, cycles) <= 0.02 < largest_step(jump, cycles - 1)
    assert switching_cycles(0.019, 0.02) is None
    assert switching_cycles(0.9, 0.02) == 20
    # The controller takes 20 at most, and none beyond.
    assert switching_cycles(0.12, 0.02, 25) == switching_cycles(0.12, 0.02)
    assert switching_cycles(0.01, 0.02, 25) == 2


@pytest.mark.parametrize(("cycles", "told"), [(0, True), (2, True), (20, False)])
def test_a_reload_while_an_old_table_acts_goes_by_the_cycles_of_the_old_one(
    tmp_path: Path, cycles: int, told: bool
) -> None:
    edge(tmp_path, size=0.12)
    old = cross_list(size=0.11).replace("n_cycles 20", f"n_cycles {cycles}")
    (tmp_path / "z.lis").write_text(old)
    (tmp_path / "zm.lis").write_text("kopf.achs_nr 3\nlr_param.crosscomp 1\n")
    axes = AXES + 'list = "z.lis"\nmachine_data = "zm.lis"\n'
    fit(tmp_path, axes + measured("edge", 'active = ["cross"]') + CROSS)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    said = " ".join(r["message"] for r in result["fits"][0]["remarks"])
    assert ("Reload it with the drives off" in said) == told


def test_abrupt_table_of_the_list_is_named_with_the_value_to_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edge(tmp_path, size=0.01)
    entries = [
        "kopf.achs_nr 3",
        "kw.ssfk.unit 1",
        "kw.ssfk.interval 1000000",
        "kw.ssfk.kw_startpos -5000000",
        "kw.ssfk.kw_nr_max 6",
    ]
    entries += [f"kw.ssfk.table[{k}].pos {100 * k}" for k in range(6)]
    (tmp_path / "z.lis").write_text("\n".join(entries) + "\n")
    heat = (
        "kopf.achs_nr 3\nlr_param.ssfk 1\nlr_param.temp_comp 1\n"
        "lr_param.temp_comp_offset_0 1000\n"
    )
    (tmp_path / "zm.lis").write_text(heat)
    axes = AXES + 'list = "z.lis"\nmachine_data = "zm.lis"\n'
    # What both add where Z stood is a constant that nobody knows.
    read = measured("edge", "active = []").replace('"none"', '"offset"')
    assert fit(tmp_path, axes + read + CROSS) == 0
    said = " ".join(capsys.readouterr().out.split())
    # 0.1 mm at once; sin² over 8 cycles brings 20 µm in the fastest of them.
    assert "set lr_param.temp_comp_n_cycles 8" in said
