"""The table of compensations."""

import subprocess
import sys

import pytest

from axcomp.ident.kinds import NAMES, kind, kinds


def test_every_name_has_its_record() -> None:
    assert [one.name for one in kinds()] == list(NAMES)


def test_no_entry_stands_for_two_compensations() -> None:
    for field in ("prefix", "activation", "keyword", "variable"):
        values = [getattr(one, field) for one in kinds()]
        assert len(set(values)) == len(values)


def test_tables_and_no_others_name_what_their_fit_writes() -> None:
    assert all((one.entries.table is not None) == one.table for one in kinds())


def test_unknown_compensation_has_no_record() -> None:
    with pytest.raises(KeyError, match="sag"):
        kind("sag")


def test_records_and_keys_are_read_without_numerical_libraries() -> None:
    program = (
        "import sys; from axcomp.ident.kinds import kinds; kinds();"
        "print(sorted({'jax', 'numpy', 'pydantic'} & set(sys.modules)));"
        "[one.part('keys') for one in kinds()];"
        "print(sorted({'jax', 'numpy'} & set(sys.modules)))"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == ["[]", "[]"]
