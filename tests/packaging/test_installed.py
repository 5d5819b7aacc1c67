"""What packaging can break: modules, data files, commands. Run from the wheel, too."""

import importlib
import os
import pkgutil
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

import axcomp

COMMANDS = (
    "batch", "check", "demo", "diff", "discover", "doctor", "fit", "iso230", "probe",
    "read", "results", "show", "simulate", "verify",
)  # fmt: skip


def _run(
    *arguments: str, folder: Path | None = None
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "axcomp", *arguments],
        cwd=folder, capture_output=True, text=True, check=False,
        env=os.environ | {"COLUMNS": "200"},
    )  # fmt: skip


def test_every_pinned_version_runs_on_the_first_python_3_11() -> None:
    # Debian 12 has 3.11.2: one package that wants a later one, and nothing is installed.
    wanted = {
        one.name: SpecifierSet(one.metadata["Requires-Python"])
        for one in distributions()
        if "Requires-Python" in one.metadata
    }
    assert "axcomp" in wanted
    late = [name for name, versions in wanted.items() if "3.11.0" not in versions]
    assert late == []


def test_every_module_can_be_imported() -> None:
    names = [
        module.name
        for module in pkgutil.walk_packages(axcomp.__path__, "axcomp.")
        if not module.name.endswith("__main__")
    ]
    # The library has some hundreds of modules; an empty walk would prove nothing.
    assert len(names) > 200
    for name in names:
        importlib.import_module(name)


def test_types_and_templates_are_installed() -> None:
    root = Path(axcomp.__file__).parent
    assert (root / "py.typed").is_file()
    assert list((root / "ident" / "report").glob("*.jinja"))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    found = _run(command, "--help")
    assert found.returncode == 0, found.stderr
    assert "Usage" in found.stdout


@pytest.mark.heavy  # from source `test_cli_demo.py` shows it
def test_the_demo_writes_lists_that_are_valid(tmp_path: Path) -> None:
    found = _run("demo", "--out", "demo", folder=tmp_path)
    assert found.returncode == 0, found.stderr
    lists = sorted(str(path) for path in (tmp_path / "demo").rglob("achskw*.lis"))
    assert lists
    assert (tmp_path / "demo").rglob("report.html")
    checked = _run("check", lists[-1])
    assert checked.returncode == 0, checked.stdout
