import dataclasses
import pickle
import tomllib

import pytest

from axcomp.models import ConventionError, Conventions


def test_defaults_are_those_of_the_page_on_semantics() -> None:
    assert Conventions().to_dict() == {
        "plane_sign": 1,
        "plane_index": "ji",
        "plane_input": "command",
        "cross_sign": 1,
        "cross_edge": "hold",
        "cross_list": "slave",
        "leadscrew_sign": -1,
        "leadscrew_input": "all",
        "direction_source": "command",
        "start_direction": 1,
        "backlash_reference": 1,
        "backlash_start": "direction",
        "temperature_sign": 1,
        "temperature_filter": "switching",
        "table_filter": "switching",
        "filter_delay": 0,
        "external_limit": "offset",
        "friction_sign": 1,
        "friction_below": "hold",
        "friction_above": "hold",
        "friction_rest": "zero",
        "friction_build_up": "first",
        "friction_decay": "zero",
        "friction_overlap": "product",
        "friction_delay": "all",
        "crosstalk_sign": 1,
        "crosstalk_accelerate": "sign",
        "crosstalk_undirected": "own",
        "crosstalk_velocity": "master",
        "crosstalk_rest": 1,
        "crosstalk_above": "hold",
        "crosstalk_outside": "hold",
        "crosstalk_surface": "grid",
        "crosstalk_input": "command",
    }


def test_every_convention_names_its_rule_its_meaning_and_its_choices() -> None:
    for convention in Conventions().listing():
        assert convention.rule.startswith("S-")
        assert convention.meaning.endswith(".")
        assert "\n" not in convention.meaning
        assert len(convention.choices) > 1
        assert convention.default in convention.choices
        assert convention.value == convention.default


def test_every_choice_can_be_taken_and_is_listed_as_taken() -> None:
    for convention in Conventions().listing():
        for choice in convention.choices:
            taken = Conventions.from_dict({convention.name: choice})
            listed = {c.name: c.value for c in taken.listing()}
            assert listed[convention.name] == choice


def test_conventions_come_back_from_their_dictionary_and_from_toml() -> None:
    own = Conventions(cross_edge="zero", leadscrew_sign=1)
    assert Conventions.from_dict(own.to_dict()) == own
    text = 'cross_edge = "zero"\nleadscrew_sign = 1\n'
    assert Conventions.from_dict(tomllib.loads(text)) == own


def test_conventions_are_frozen_and_hashable() -> None:
    assert hash(Conventions()) == hash(Conventions())
    with pytest.raises(dataclasses.FrozenInstanceError):
        Conventions().plane_sign = -1  # type: ignore[misc]


def test_an_unknown_name_is_refused_with_the_nearest_known_one() -> None:
    with pytest.raises(ConventionError, match=r"'plan_sgn'.*such as 'plane_sign'"):
        Conventions.from_dict({"plan_sgn": -1})


@pytest.mark.parametrize("value", [0, 2, "1", True, None, [1]])
def test_a_value_that_is_none_of_the_choices_is_refused(value: object) -> None:
    with pytest.raises(
        ConventionError, match=r"'plane_sign': found .*, expected 1 or -1"
    ):
        Conventions.from_dict({"plane_sign": value})


def test_the_error_survives_pickling() -> None:
    error = ConventionError("plane_sgn", "an unknown name", "a known one")
    copy = pickle.loads(pickle.dumps(error))
    assert (copy.name, str(copy)) == ("plane_sgn", str(error))
