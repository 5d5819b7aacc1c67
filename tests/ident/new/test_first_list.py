"""docs/your-first-list.md, followed to the letter."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from axcomp.data.lists import ListFile
from axcomp.ident.cli import main
from axcomp.ident.exchange import table_in

from .conftest import answer
from .instruments import laser_text, screw

PAGE = Path(__file__).parents[3] / "docs" / "your-first-list.md"
BLOCK = re.compile(r"```(sh|toml)\n(.*?)```", re.DOTALL)


def measured_again(folder: Path) -> None:
    """Write what the laser shows of the axis with its list: the entries are taken off."""
    listed = table_in(ListFile.read(folder / "axcomp-out" / "achskw1.lis"))
    (nodes,) = listed.nodes

    def left(x: np.ndarray, way: np.ndarray) -> np.ndarray:
        entries = [np.interp(x, nodes, each) for each in listed.entries]
        return np.asarray(screw(x, way) - np.where(way > 0.0, *entries))

    (folder / "laser_again.csv").write_text(laser_text(left, seed=21), encoding="utf-8")


@pytest.mark.slow
def test_the_first_list_is_made_loaded_and_verified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = PAGE.read_text(encoding="utf-8")
    (tmp_path / "laser.csv").write_text(laser_text(screw), encoding="utf-8")
    head = "\n".join((tmp_path / "laser.csv").read_text().splitlines()[:7])
    assert head in page
    monkeypatch.chdir(tmp_path)
    job = Path("job.toml")
    for kind, block in BLOCK.findall(page):
        if kind == "toml":
            answer(job, block.strip().splitlines())
            continue
        for line in block.strip().splitlines():
            words = shlex.split(line)[1:]
            if "laser_again.csv" in words:
                measured_again(tmp_path)
                job = Path("after.toml")
            assert main(words) == 0, f"{line}: {capsys.readouterr().err}"
            if job.name == "after.toml" and words[0] == "new":
                assert "axcomp fit JOB --after after.toml" in capsys.readouterr().out
    assert "verified" in capsys.readouterr().out.casefold()
