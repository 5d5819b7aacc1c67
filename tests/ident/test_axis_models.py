"""Models of an axis → lists → models, and what no list can hold."""

import dataclasses
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import (
    AxisModels,
    ExchangeError,
    ModelUnit,
    load_model,
    write_lists,
)
from axcomp.models import (
    Backlash,
    ConstantParameter,
    Cross,
    Crosstalk,
    EquidistantNodes,
    FrictionCompensation,
    FrictionTable,
    Leadscrew,
    Plane,
    Setpoints,
    TemperatureLine,
    surface_through,
)

RNG = np.random.default_rng(7)


def values(*shape: int) -> np.ndarray:
    """Return values of some µm that no list unit meets."""
    return RNG.normal(scale=0.01, size=shape)


def friction(level: float = 1.0) -> FrictionCompensation:
    speeds = Setpoints(np.array([0.001, 2.0, 40.0, 300.0, 300.001]))
    currents = level * np.array([90.0, 71.0, 80.0, 120.0, 120.0])
    return FrictionCompensation(FrictionTable(speeds, currents), 2, 0.0005, 3)


SCREW = Leadscrew(EquidistantNodes(-10.0, 7.5, 12), values(12), values(12))
MODELS: dict[str, Any] = {
    "cross": Cross(Setpoints(np.array([0.0, 3.3, 10.0])), values(3)),
    "plane": Plane.rectangular((-5.0, 0.1), (10.0, 20.0), values(4, 5)),
    "leadscrew": SCREW,
    "crosstalk": Crosstalk(
        surface_through(np.array([[0.0], [50.0], [120.0]])), values(4, 3), 900.0, -700.0
    ),
    "friction": friction(),
    "temperature": TemperatureLine(
        ConstantParameter(12.0), ConstantParameter(-0.0123), ConstantParameter(11.5e-6)
    ),
}
MASTERS = {"cross": (1,), "plane": (1, 2), "crosstalk": (2, 1)}
LISTED = {"friction": "list"}


def test_models_come_back_from_their_lists_to_rounding(tmp_path: Path) -> None:
    given = AxisModels(3, MODELS, MASTERS, LISTED)
    files = write_lists(given, tmp_path)
    assert [file.name for file in files] == ["achskw3.lis", "achsmds3.add.lis"]
    machine = tmp_path / "achsmds3.lis"
    machine.write_bytes(b"kopf.achs_nr 3\n" + files[1].read_bytes())
    found = load_model(files[0], machine)
    assert found.axis == 3
    assert found.masters == MASTERS
    assert set(found) == set(MODELS)
    for name, model in MODELS.items():
        # Half a list unit of 0.1 µm; nodes, currents and rates are whole list units.
        assert eqx.tree_equal(found[name], model, atol=0.5001e-4, rtol=1e-12), name
    again = write_lists(found, tmp_path / "again")
    assert again[0].read_bytes() == files[0].read_bytes()


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("cross", Cross(Setpoints(np.array([0.0, 10.0])), values(2), held=False)),
        ("friction", dataclasses.replace(friction(), held_at_rest=True)),
        ("friction", dataclasses.replace(friction(), decays_to_zero=False)),
    ],
)
def test_a_model_of_rules_that_no_list_holds_is_refused(
    tmp_path: Path, name: str, model: Cross | FrictionCompensation
) -> None:
    masters = {"cross": (1,)} if name == "cross" else {}
    units = LISTED if name == "friction" else {}
    models = AxisModels(3, {name: model}, masters, units)
    with pytest.raises(ExchangeError, match=f"the {name} of axis 3: found .* no list"):
        write_lists(models, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_backlash_goes_into_the_axis_list(tmp_path: Path) -> None:
    machine = tmp_path / "achsmds1.lis"
    machine.write_text("kopf.achs_nr 1\nlr_param.anwahl_losekomp 0 # off\n")
    number: Any = np.int64(1)  # of a table of axes
    given = AxisModels(number, {"backlash": Backlash(0.0123, reference=1, cycles=5)})
    (file,) = write_lists(given, tmp_path / "out", lists={1: machine})
    assert file.name == "achsmds1.lis"
    assert "# off" in file.read_text()
    assert eqx.tree_equal(load_model(file)["backlash"], given["backlash"])


def test_an_existing_list_keeps_all_but_the_table(tmp_path: Path) -> None:
    first = AxisModels(3, MODELS, MASTERS, LISTED)
    old = write_lists(first, tmp_path)[0]
    small = Leadscrew(EquidistantNodes(0.0, 20.0, 4), values(4), values(4))
    new = write_lists(AxisModels(3, {"leadscrew": small}), tmp_path, lists={3: old})[0]
    found = load_model(new)
    assert found["leadscrew"].pos.shape == (4,)
    assert eqx.tree_equal(found["plane"], load_model(old)["plane"])
    assert len(ListFile.read(new).table("kw.ssfk", "neg")) == 4


def test_a_list_that_was_not_handed_over_is_kept_aside(tmp_path: Path) -> None:
    models = AxisModels(1, {"leadscrew": SCREW})
    mine = tmp_path / "achskw1.lis"
    mine.write_text("kopf.achs_nr 1\nkw.crosscomp.unit 1\n")
    before = mine.read_bytes()
    write_lists(models, tmp_path)
    assert (tmp_path / "kept" / mine.name).read_bytes() == before
    # What is as it was, and what is edited on request, leaves no copy.
    write_lists(models, tmp_path)
    write_lists(models, tmp_path, lists={1: mine})
    assert len(list((tmp_path / "kept").iterdir())) == 1


def test_a_written_list_that_was_edited_by_hand_is_kept_aside(tmp_path: Path) -> None:
    models = AxisModels(1, {"leadscrew": SCREW})
    path = write_lists(models, tmp_path)[0]
    edited = path.read_bytes() + b"# tuned by hand\n"
    path.write_bytes(edited)
    write_lists(models, tmp_path)
    assert (tmp_path / "kept" / path.name).read_bytes() == edited


def test_currents_are_written_as_shares_of_the_rated_one(tmp_path: Path) -> None:
    # 12.5 A rated, and one unit of `out` is a thousandth of it.
    unit = ModelUnit("A", size=0.0125)
    amperes = AxisModels(3, {"friction": friction(0.0125)}, units={"friction": unit})
    found = load_model(write_lists(amperes, tmp_path)[0])
    law = found["friction"].law
    np.testing.assert_array_equal(law.values, MODELS["friction"].law.values)


@pytest.mark.parametrize("size", [-0.0125, 0.0, np.inf, np.nan, "0.0125", True])
def test_a_unit_is_a_positive_number(size: object) -> None:
    with pytest.raises(ExchangeError, match="expected a positive number"):
        ModelUnit("A", size=size)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("models", "units", "message"),
    [
        (
            {"friction": friction()},
            {"friction": "A"},
            r"frict_comp\.table\[\]\.out: .* A",
        ),
        ({"friction": friction()}, {}, r"no stated unit.*shares of the rated torque"),
        ({"leadscrew": SCREW}, {"leadscrew": "um"}, r"kw\.ssfk\.table\[\]\.pos: .* um"),
        ({"leadscrew": SCREW}, {"cross": "um"}, "units of axis 3: found cross"),
        ({"leadscrew": friction()}, {}, "a FrictionCompensation as leadscrew"),
        ({"plane": MODELS["plane"]}, {}, "masters of plane: found 0 axis numbers"),
        (
            {"cross": Cross(SCREW.nodes, values(12), -1.0)},
            {},
            r"sign -1, expected .*cross_sign",
        ),
        ({"leadscrew": SCREW, "backlash": Backlash(0.01)}, {}, "contains the backlash"),
    ],
)
def test_what_no_list_holds_is_refused_by_name(
    models: dict[str, Any], units: dict[str, str], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ExchangeError, match=message):
        write_lists(AxisModels(3, models, units=units), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "masters", "found"),
    [("cross", (3,), "3"), ("plane", (1, 3), "1, 3"), ("plane", (1, 1), "1, 1")],
)
def test_an_axis_that_is_its_own_master_is_refused(
    name: str, masters: tuple[int, ...], found: str, tmp_path: Path
) -> None:
    models = AxisModels(3, {name: MODELS[name]}, masters={name: masters})
    message = f"masters of the {name} of axis 3: found {found}, expected other axes"
    with pytest.raises(ExchangeError, match=message):
        write_lists(models, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.other_types
def test_lists_of_other_axes_are_not_left_out(tmp_path: Path) -> None:
    models = AxisModels(1, {"leadscrew": SCREW})
    old = write_lists(models, tmp_path / "old")[0]
    with pytest.raises(
        ExchangeError, match=r"lists: found axes \[2\], expected some of"
    ):
        write_lists(models, tmp_path / "new", lists={2: old})
    with pytest.raises(ExchangeError, match="models: found Leadscrew, expected AxisM"):
        write_lists(SCREW, tmp_path / "new")  # type: ignore[arg-type]
    with pytest.raises(ExchangeError, match="expected one AxisModels per axis"):
        write_lists([models, models], tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_lists_of_two_axes_are_not_one_axis(tmp_path: Path) -> None:
    files = [
        write_lists(AxisModels(k, {"leadscrew": SCREW}), tmp_path)[0] for k in (1, 2)
    ]
    with pytest.raises(ExchangeError, match=r"lists of the axes \[1, 2\]"):
        load_model(*files)
