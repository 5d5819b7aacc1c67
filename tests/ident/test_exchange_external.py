"""External compensation made of lists, and the integers of its interface."""

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.exchange import ExchangeError, Reading
from axcomp.ident.external import external_from_lists, from_interface
from axcomp.models import Conventions

RULES = Conventions()
LISTS = [
    ListFile.parse(text.encode(), name)
    for name, text in (
        (
            "kw1",
            "kopf.achs_nr 1\nkw.ssfk.unit 1\nkw.ssfk.interval 1000000\n"
            "kw.ssfk.kw_startpos 0\nkw.ssfk.kw_nr_max 2\nkw.ssfk.table[0].pos 0\n"
            "kw.ssfk.table[1].pos 10000\nkw.crosscomp.unit 1\n"
            "kw.crosscomp.last_index 1\nkw.crosscomp.master_ax_nr 3\n"
            "kw.crosscomp.table[0].setpoint 0\nkw.crosscomp.table[0].correction 0\n"
            "kw.crosscomp.table[1].setpoint 1000000\n"
            "kw.crosscomp.table[1].correction 20000\n",
        ),
    )
]


def test_tables_of_lists_become_one_compensation_by_hand() -> None:
    model = external_from_lists(LISTS, Reading(RULES))
    # Columns are axes 1 and 3. Z = 50 moves X by 1 mm; the screw then looks at 51 mm
    # and takes 0.51 mm off.
    found = model.offsets(np.array([[50.0, 50.0]]))
    np.testing.assert_allclose(found, [[0.49, 0.0]], rtol=0, atol=1e-15)
    back = model.start(np.array([[50.49, 50.0]]))
    # The residual of 1e-10 over a slope of 0.99.
    np.testing.assert_allclose(back.positions, [[50.0, 50.0]], rtol=0, atol=2e-10)
    given = external_from_lists(LISTS, Reading(RULES), axes=(3, 2, 1))
    found = given.offsets(np.array([[50.0, 7.0, 50.0]]))
    np.testing.assert_allclose(found, [[0.0, 0.0, 0.49]], rtol=0, atol=1e-15)


def test_axis_that_the_machine_lacks_is_named() -> None:
    with pytest.raises(
        ExchangeError, match="kw1: cross: found master axis 3, which the machine"
    ):
        external_from_lists(LISTS, Reading(RULES), axes=(1, 2))


def test_table_for_each_direction_is_left_out() -> None:
    more = b"kw.ssfk.bilateral 1\nkw.ssfk.table[0].neg 0\nkw.ssfk.table[1].neg 3\n"
    listing = ListFile.parse(LISTS[0].dumps() + more, "kw1")
    model = external_from_lists([listing], Reading(RULES))
    found = model.offsets(np.array([[50.0, 50.0]]))
    np.testing.assert_allclose(found, [[1.0, 0.0]], rtol=0, atol=1e-15)


def test_interface_counts_in_1e_8_mm() -> None:
    # A position of the diagnostic data of [004] p.19.
    np.testing.assert_array_equal(
        from_interface(np.array([-1701406850])), [-17.0140685]
    )
