"""The conventions file of a machine: saved, read, merged, and refused in one line."""

import pickle
from pathlib import Path

import pytest

from axcomp.data.toml import TomlError
from axcomp.ident.exchange import StoredConventions, read_conventions
from axcomp.models import ConventionError, Conventions


def stored() -> StoredConventions:
    start = StoredConventions(Conventions(plane_index="ij"), machine='mill "7"')
    return start.with_verified(
        {"leadscrew_sign": 1, "cross_edge": "hold"}, saved_at="2026-11-21"
    )


def test_what_is_saved_is_read(tmp_path: Path) -> None:
    path = tmp_path / "mill-7.conventions.toml"
    path.write_bytes(stored().saved_over())
    assert read_conventions(path) == stored()
    # A settled default is written, an assumed one is not.
    text = path.read_text(encoding="utf-8")
    assert text.index("[verified]") < text.index("cross_edge") < text.index("[assumed]")
    assert "plane_sign" not in text
    assert "(S-18)" in text


def test_what_a_user_wrote_into_the_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "mill.toml"
    before = (
        "# Mill in hall 3, ask Anna.\n\n[assumed]\n"
        'plane_index = "ij"  # as the manual has it\ncross_edge = "zero"\n'
        "[verified]\nplane_sign = -1  # dial gauge, May\n"
    )
    path.write_text(before)
    known = read_conventions(path)
    found = known.with_verified(
        {"cross_edge": "hold", "leadscrew_sign": -1, "plane_sign": 1},
        machine='mill "7"',
        saved_at="2026-11-28",
    )
    path.write_bytes(found.saved_over(path.read_text()))
    assert read_conventions(path) == found
    text = path.read_text()
    for words in ("ask Anna.", "# as the manual has it", "# dial gauge, May"):
        assert words in text
    # Saved once more with nothing new: not a byte is another.
    assert found.saved_over(text).decode() == text


def test_settled_rules_stay_settled_and_a_new_verdict_replaces_the_old() -> None:
    found = stored().with_verified({"leadscrew_sign": -1, "plane_sign": 1})
    assert found.verified == {"leadscrew_sign", "cross_edge", "plane_sign"}
    assert found.conventions.leadscrew_sign == -1
    assert found.machine == 'mill "7"'
    assert stored().contradicted({"leadscrew_sign": -1, "plane_sign": -1}) == (
        "leadscrew_sign",
    )
    with pytest.raises(ConventionError, match="'leadscrew_sing'"):
        stored().with_verified({"leadscrew_sing": 1})


def test_plain_names_count_as_settled(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text('cross_edge = "zero"\n[assumed]\nplane_sign = -1\n')
    found = read_conventions(path)
    assert found.verified == {"cross_edge"}
    assert (found.conventions.cross_edge, found.conventions.plane_sign) == ("zero", -1)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("plane_sign = 2\n", r"c.toml:1: convention 'plane_sign': found 2, expected 1"),
        ("\n[verified]\nplane_sing = 1\n", r"c.toml:3: .*unknown name.*'plane_sign'"),
        ("verified = 3\n", r"c.toml:1: verified: found 3, expected a table"),
        ("machine = 7\n", r"c.toml:1: machine: found 7, expected the id"),
        ("plane_sign =\n", r"c.toml:1: not TOML"),
    ],
)
def test_bad_file_is_one_line_with_its_place(
    tmp_path: Path, text: str, match: str
) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(TomlError, match=match) as caught:
        read_conventions(path)
    assert "\n" not in str(caught.value)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_file_of_another_machine_is_refused_by_jobs(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text('machine = "mill-7"\nplane_sign = -1\n')
    assert read_conventions(path, "mill-7").verified == {"plane_sign"}
    assert read_conventions(path).conventions.plane_sign == -1
    match = r"c.toml:1: found the conventions of machine 'mill-7', expected 'mill-8'"
    with pytest.raises(TomlError, match=match):
        read_conventions(path, "mill-8")
