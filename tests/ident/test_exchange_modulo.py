"""Tables over an axis that turns: wrapped, and without a jump at the transition."""

from collections.abc import Mapping

import numpy as np
import pytest

from axcomp.data.lists import ListFile, Value, new_list
from axcomp.ident.exchange import ExchangeError, ListNodes, Reading, offset_at
from axcomp.ident.kinds.cross.entries import (
    ENTRIES as CROSS,
    CrossTable,
    cross_from_list,
    entries_of_cross,
)
from axcomp.ident.kinds.plane.entries import ENTRIES as PLANE, entries_of_plane
from axcomp.models import (
    Conventions,
    Cross,
    EquidistantNodes,
    ModuloNodes,
    Plane,
    Setpoints,
)

RULES = Conventions()
TURN = {4: (0.0, 360.0)}
TURNING = Reading(RULES, modulo=TURN)
ROUNDING = 1e-15  # values below 1e-2


def back(entries: Mapping[str, Value]) -> ListFile:
    listing = new_list({"kopf.achs_nr": 1, **entries})
    return ListFile.parse(listing.dumps(), "achskw1.lis")


def cross(values: list[float], low: float = 0.0, high: float = 360.0) -> Cross:
    nodes = Setpoints(np.linspace(low, high, len(values)))
    return Cross(ModuloNodes(nodes, TURN[4]), np.array(values))


def test_cross_over_a_turning_master_is_wrapped_and_comes_back() -> None:
    model = cross([0.0, 0.004, -0.002, 0.0])
    again = CROSS.model(back(entries_of_cross(model, (4,))), 1, TURNING)
    # Nodes every 120°: at 420° and −300° as at 60°; at −30° three quarters up from −2.
    at = np.array([[60.0], [420.0], [-300.0], [-30.0], [360.0], [720.0]])
    expected = [0.002, 0.002, 0.002, -0.0005, 0.0, 0.0]
    np.testing.assert_allclose(offset_at(again, at), expected, rtol=0, atol=ROUNDING)
    flat = cross_from_list(back(entries_of_cross(model, (4,))), RULES)
    assert float(offset_at(flat, np.array([[420.0]]))[0]) == 0.0  # held at the end


def test_offset_is_continuous_at_the_transition() -> None:
    model = cross([0.003, 0.004, -0.002, 0.003])
    near = offset_at(model, np.array([[-1e-9], [0.0], [360.0 - 1e-9]]))
    # 1e-9° times a slope of 5e-5 mm/°.
    np.testing.assert_allclose(near, 0.003, rtol=0, atol=1e-12)


def test_plane_over_a_turning_master_is_wrapped_and_comes_back() -> None:
    values = np.array([[0.0, 0.001, 0.0], [0.002, 0.003, 0.002]])
    model = Plane(
        ModuloNodes(EquidistantNodes(np.array(0.0), np.array(180.0), 3), TURN[4]),
        EquidistantNodes(np.array(0.0), np.array(10.0), 2),
        values,
    )
    again = PLANE.model(back(entries_of_plane(model, (4, 2))), 1, TURNING)
    at = np.array([[90.0, 0.0], [450.0, 0.0], [-90.0, 10.0], [360.0, 5.0]])
    found = offset_at(again, at)
    np.testing.assert_allclose(found, [5e-4, 5e-4, 2.5e-3, 1e-3], rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("first", [True, False])
def test_plane_that_jumps_is_not_written(first: bool) -> None:
    nodes = EquidistantNodes(np.array(0.0), np.array(180.0), 3)
    turning = ModuloNodes(nodes, TURN[4])
    values = np.arange(9.0).reshape(3, 3) * 1e-4
    pair = (turning, nodes) if first else (nodes, turning)
    match = f"along master {1 if first else 2}: found 0 at the start and {2 if first else 6}"
    with pytest.raises(ExchangeError, match=match):
        entries_of_plane(Plane(*pair, values), (4, 2))


def test_cross_that_jumps_is_not_written() -> None:
    with pytest.raises(ExchangeError, match="found 0 at the start and 1 at the end"):
        entries_of_cross(cross([0.0, 0.004, 0.0001]), (4,))


def test_nodes_beyond_the_turn_are_not_written() -> None:
    with pytest.raises(
        ExchangeError, match="nodes from -10 to 370, expected nodes with"
    ):
        entries_of_cross(cross([0.0, 0.004, 0.0], -10.0, 370.0), (4,))


def test_table_that_a_fit_goes_round_with_is_one_for_the_list_too() -> None:
    nodes = ListNodes((0, 900_000, 3_600_000))
    table = CrossTable(1, (4,), (nodes,), RULES, periodic=True)
    entries = table.entries(np.array([5, 9, 5]))
    model = table.read(back(entries))
    # 45° lies halfway from 0 to 90.
    found = offset_at(model, np.array([[405.0]]))
    np.testing.assert_allclose(found, 7e-4, rtol=0, atol=ROUNDING)
    with pytest.raises(ExchangeError, match="found 5 at the start and 6 at the end"):
        table.entries(np.array([5, 9, 6]))
