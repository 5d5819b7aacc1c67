"""What axis and start-up lists say: printed examples by hand, both ways."""

import jax.numpy as jnp
import numpy as np
import pytest

from axcomp.data.lists import ListFile, check, new_list
from axcomp.ident.exchange import (
    ExchangeError,
    ListTarget,
    entries_of_activation,
)
from axcomp.ident.external import ExternalAxis, entries_of_external_axis
from axcomp.ident.kinds import kind
from axcomp.ident.kinds.backlash.entries import backlash_from_list, entries_of_backlash
from axcomp.ident.kinds.temperature.entries import (
    entries_of_temperature,
    temperature_from_list,
)
from axcomp.models import (
    Backlash,
    ConstantParameter,
    Conventions,
    TemperatureCurve,
    TemperatureLine,
)

RULES = Conventions()
ROUNDING = 1e-15  # sums of numbers below 1 mm


def parse(text: str) -> ListFile:
    return ListFile.parse(text.encode(), "achsmds1.lis")


def written(entries: dict[str, int | str] | dict[str, int | float | str]) -> ListFile:
    """A list of these entries, written, checked and read back."""
    listing = new_list({"kopf.achs_nr": 1} | entries)
    assert list(check([listing])) == []
    return ListFile.parse(listing.dumps(), "back.lis")


# ---------------------------------------------------------------------------- backlash

# [001] p.13, as printed: 1000 is 0.1 mm, reference flank in positive direction.
BACKLASH = """getriebe[0].lose 1000 #0,1 um backlash
lr_param.anwahl_losekomp 1 #Positive direction
lr_param. n_backlash_cyc 10 #Number of filter cycles
"""


def test_printed_backlash_is_taken_off_on_the_way_back() -> None:
    found = backlash_from_list(parse(BACKLASH), RULES)
    assert found is not None
    np.testing.assert_array_equal(found.offset(np.array([1.0, -1.0])), [0.0, -0.1])
    assert found.cycles == 10
    other = backlash_from_list(parse(BACKLASH.replace("komp 1", "komp 2")), RULES)
    assert other is not None
    np.testing.assert_array_equal(other.offset(np.array([1.0, -1.0])), [0.1, 0.0])


def test_reference_flank_is_a_convention() -> None:
    rules = Conventions(backlash_reference=-1)
    found = backlash_from_list(parse(BACKLASH), rules)
    assert found is not None
    assert found.reference == -1
    assert (
        entries_of_backlash(found, target=ListTarget(rules=rules))[
            "lr_param.anwahl_losekomp"
        ]
        == 1
    )


def test_backlash_that_is_off_is_none() -> None:
    assert backlash_from_list(parse("getriebe[0].lose 7\n"), RULES) is None


@pytest.mark.parametrize("reference", [1, -1])
def test_backlash_comes_back_from_its_entries(reference: int) -> None:
    assert reference in (1, -1)
    model = Backlash(jnp.array(-0.0123), 1 if reference == 1 else -1, 7)
    back = backlash_from_list(written(entries_of_backlash(model)), RULES)
    assert back is not None
    assert (float(back.width), back.reference, back.cycles) == (-0.0123, reference, 7)


def test_backlash_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ExchangeError, match=r"lose: found 4 mm or °, expected .* 3.27"):
        entries_of_backlash(Backlash(jnp.array(4.0)))
    with pytest.raises(ExchangeError, match=r"cyc: found 20, expected at most 19"):
        entries_of_backlash(Backlash(jnp.array(0.1), 1, 20))
    with pytest.raises(ExchangeError, match=r"losekomp: found 3, expected 0, 1 or 2"):
        backlash_from_list(parse("lr_param.anwahl_losekomp 3\n"), RULES)


# ------------------------------------------------------------------------- temperature

# [001] p.24, as printed but for the units in brackets.
TEMPERATURE = """lr_param.temp_comp 1
lr_param.temp_comp_position_0 100
lr_param.temp_comp_offset_0 40
lr_param.temp_comp_coefficient 4000
lr_param.temp_comp_n_cycles 20
"""


def test_printed_temperature_line_by_hand() -> None:
    found = temperature_from_list(parse(TEMPERATURE), RULES)
    assert found is not None
    place = jnp.array([0.01, 0.0, 100.0, -200.0])
    # 4 µm at 0.01 mm and 4 µm more per mm: at 100 mm 0.004 + 0.004 · 99.99.
    expected = [0.004, 0.00396, 0.40396, -0.79604]
    none = jnp.zeros((4, 0))
    np.testing.assert_allclose(
        found.offset(place, none), expected, rtol=0, atol=ROUNDING
    )
    assert found.cycles == 20
    turned = temperature_from_list(parse(TEMPERATURE), Conventions(temperature_sign=-1))
    assert turned is not None
    np.testing.assert_allclose(
        turned.offset(place, none), -np.array(expected), rtol=0, atol=ROUNDING
    )


def line(coefficient: float, cycles: int = 5) -> TemperatureLine:
    numbers = (ConstantParameter(jnp.array(x)) for x in (250.0, -0.0123, coefficient))
    return TemperatureLine(*numbers, cycles=cycles)


def test_temperature_line_comes_back_from_its_entries() -> None:
    entries = entries_of_temperature(line(11.5e-6))
    back = temperature_from_list(written(entries), RULES)
    assert back is not None
    place = jnp.linspace(-500.0, 500.0, 11)
    none = jnp.zeros((11, 0))
    np.testing.assert_allclose(
        back.offset(place, none),
        line(11.5e-6).offset(place, none),
        rtol=0,
        atol=ROUNDING,
    )
    assert entries["lr_param.temp_comp_coefficient"] == 11.5


def test_temperature_line_that_does_not_fit_is_refused() -> None:
    curve = TemperatureCurve.of([20.0, 30.0], [0.0, 1e-5])
    zero = ConstantParameter(jnp.array(0.0))
    with pytest.raises(
        ExchangeError, match=r"coefficient: found a curve over the temp"
    ):
        entries_of_temperature(TemperatureLine(zero, zero, curve))
    with pytest.raises(ExchangeError, match=r"coefficient: found 20000 µm/m"):
        entries_of_temperature(line(0.02))
    with pytest.raises(ExchangeError, match=r"n_cycles: found 20, expected at most 19"):
        entries_of_temperature(line(1e-6, cycles=20))


@pytest.mark.parametrize("value", ["x", "1,5", "1e999", "nan"])
def test_coefficient_that_is_no_number_is_refused(value: str) -> None:
    text = TEMPERATURE.replace("coefficient 4000", f"coefficient {value}")
    with pytest.raises(ExchangeError, match=r"achsmds1.lis:4: .*expected a number"):
        temperature_from_list(parse(text), RULES)


# ------------------------------------------------------------- activation


def test_activation_comes_back_from_its_entries() -> None:
    listing = written(entries_of_activation(["cross", "leadscrew", "friction"]))
    names = ("cross", "plane", "leadscrew", "friction", "crosstalk", "backlash")
    on = [name for name in names if kind(name).entries.is_activated(listing)]
    assert on == ["cross", "leadscrew", "friction"]
    with pytest.raises(
        ExchangeError, match="found backlash without its reference flank"
    ):
        entries_of_activation(["backlash"])


# ------------------------------------------------------------- external compensation


def test_external_limits_are_entries_of_the_axis_list() -> None:
    limits = ExternalAxis(warning=0.2, error=0.5, acceleration=1500.9)
    entries = entries_of_external_axis(limits)
    assert entries == {
        "lr_param.ext_comp.warn_limit": 2000,
        "lr_param.ext_comp.err_limit": 5000,
        "lr_param.ext_comp.max_a": 1500,
    }
    with pytest.raises(ExchangeError, match=r"err_limit: found 0, expected .*70585"):
        entries_of_external_axis(ExternalAxis(0.0, 0.0, None))
