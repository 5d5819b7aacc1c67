"""A compensation that the library does not know: one folder, and one line in the table."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.data.lists import ListFile, _registry, registry
from axcomp.data.measurements import read_log
from axcomp.ident import kinds
from axcomp.ident.cli import main
from axcomp.ident.exchange import (
    AxisLists,
    AxisModels,
    Motion,
    Reading,
    controller_from_lists,
    load_model,
    simulate,
    write_lists,
)
from axcomp.ident.proof import GateLimits
from axcomp.ident.proof.axis import Travel, judge_workspace
from axcomp.ident.proof.verify import verify_log
from axcomp.models import Conventions, Motion as ControllerMotion

NEW = "offset"
LIST = f"kopf.achs_nr 1\nkw.{NEW}.value 123\n"
SCREW = """kw.ssfk.unit 1
kw.ssfk.interval 1000000
kw.ssfk.kw_nr_max 2
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 1000
"""
PLACES = np.linspace(0.0, 90.0, 10)


@pytest.fixture(autouse=True)
def added(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Add the folder of the compensation, and its name to the table."""
    toy = str(Path(__file__).parent / "toy")
    monkeypatch.setattr(kinds, "__path__", [*kinds.__path__, toy])
    monkeypatch.setattr(kinds, "NAMES", (*kinds.NAMES, NEW))
    monkeypatch.setattr(_registry, "_files", [*_registry._files])
    yield
    kinds.kind.cache_clear()
    registry.cache_clear()
    for name in [n for n in sys.modules if n.startswith(f"{kinds.__name__}.{NEW}")]:
        del sys.modules[name]


def listing(text: str = LIST, name: str = "achskw1.lis") -> ListFile:
    return ListFile.parse(text.encode(), name)


def moving() -> Motion:
    return Motion({1: PLACES}, {}, np.arange(10.0))


def test_new_kind_goes_from_list_to_model_and_back(tmp_path: Path) -> None:
    (tmp_path / "achskw1.lis").write_text(LIST)
    found = load_model(tmp_path / "achskw1.lis")
    assert float(found[NEW].value) == 0.0123
    write_lists(found, tmp_path / "out", lists={1: tmp_path / "achskw1.lis"})
    assert (
        ListFile.read(tmp_path / "out" / "achskw1.lis").integer("kw.offset.value")
        == 123
    )
    added = ListFile.read(tmp_path / "out" / "achsmds1.add.lis")
    assert added.integer("lr_param.offset") == 1


def test_new_kind_acts_beside_a_leadscrew_that_looks_up_with_it() -> None:
    (found,) = simulate([listing(LIST + SCREW)], moving(), Reading(Conventions()))
    np.testing.assert_array_equal(found.parts[NEW], 0.0123)
    screw = -0.001 * (PLACES + 0.0123)
    # Beyond 0.1 mm of error one rounding of numbers around 90.
    np.testing.assert_allclose(found.total, 0.0123 + screw, atol=1e-14)


def test_new_kind_is_off_where_the_axis_list_does_not_switch_it_on() -> None:
    off = listing("kopf.achs_nr 1\nlr_param.ssfk 1\n", "achsmds1.lis")
    (found,) = simulate([listing(LIST + SCREW), off], moving(), Reading(Conventions()))
    assert list(found.parts) == ["leadscrew"]


def test_controller_is_differentiable_in_the_parameter_of_a_new_kind() -> None:
    controller = controller_from_lists([listing()], Reading(Conventions()))
    still = np.zeros((10, 1))
    motion = ControllerMotion(PLACES[:, None], still, still)

    def total(value: jax.Array) -> jax.Array:
        (axis,) = controller.axes
        law = type(axis.further[NEW].law)(value)  # type: ignore[call-arg]
        moved = jax.tree.unflatten(jax.tree.structure(controller), jax.tree.leaves(law))
        return moved.run(moved.start(), motion)[0].offset.sum()

    # The same in each of ten cycles.
    assert jax.grad(total)(jnp.asarray(0.0)) == pytest.approx(10.0, rel=1e-14)


def test_new_kind_is_judged_with_the_whole_axis() -> None:
    loaded = AxisLists(1, listing(LIST + SCREW), None, Reading(Conventions()))
    travel = Travel({1: "X"}, {1: (0.0, 90.0)}, frozenset(), ({},), "mm", 0.001)
    checks, jumps = judge_workspace(loaded, travel, GateLimits(max_jump=0.2))
    assert jumps[NEW] == pytest.approx(0.0123, rel=1e-12)
    (jump,) = [check for check in checks if check.name == "max_jump"]
    # At the last node of the table: 0.0123 mm against its 0.1 mm.
    assert jump.value == pytest.approx(0.1 - 0.0123, abs=1e-12)


def log(folder: Path, sign: float) -> Path:
    """Write a log of the sum of all offsets, with the new one of either sign."""
    screw = -0.001 * PLACES
    rows = zip(PLACES, screw + sign * 0.0123, strict=True)
    lines = ["A1.position,A1.offset", *(f"{x:.4f},{value:.7f}" for x, value in rows)]
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("sign", "verdict"), [(1.0, "agrees"), (-1.0, "sign")])
def test_verify_tells_what_a_controller_does_with_a_new_kind(
    tmp_path: Path, sign: float, verdict: str
) -> None:
    alone = SCREW + "kw.ssfk.set_pos_without_comp 1\n"
    found = verify_log(
        [listing(LIST + alone)], read_log(log(tmp_path, sign)), Reading(Conventions())
    )
    verdicts = {one.compensation: one.verdict for one in found.verdicts}
    assert verdicts[NEW] == (verdict,)
    assert verdicts["leadscrew"] == ("agrees",)


def test_new_kind_has_its_step_of_a_probe(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "achskw1.lis").write_text(LIST)
    out = tmp_path / "probe"
    options = ["--travel", "A1=0:500", "--out", str(out), "--json"]
    assert main(["probe", str(tmp_path / "achskw1.lis"), *options]) == 0
    (step,) = json.loads(capsys.readouterr().out)["steps"]
    assert (step["keyword"], step["outcomes"][0]["seen"]) == ("OFFSET", "+10 µm")
    assert ListFile.read(out / "achskw1.lis").integer("kw.offset.value") == 100
    assert ListFile.read(out / "achsmds1.add.lis").integer("lr_param.offset") == 1


def test_model_of_another_compensation_is_refused_by_name() -> None:
    models = AxisModels(1, {NEW: 3.0})
    with pytest.raises(ValueError, match=r"a float as offset, .*offset \(Constant\)"):
        models.to_entries()
