"""Friction jobs in a batch: fitted, proven and written as if each were alone."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from axcomp.ident.fit import Gathering
from axcomp.ident.job import run_job

Fleet = Callable[[Path, int], list[str]]


@pytest.mark.slow
def test_friction_jobs_of_a_batch_are_those_of_single_runs_to_the_bit(
    tmp_path: Path, friction_fleet: Fleet
) -> None:
    names = friction_fleet(tmp_path / "jobs", 3)

    def run(name: str, folder: str) -> None:
        run_job(tmp_path / "jobs" / f"{name}.toml", tmp_path / folder / name)

    for name in names[::2]:
        run(name, "alone")
    found = Gathering().run([partial(run, name, "beside") for name in names])
    assert found == [None] * len(names)
    for name in names[::2]:
        one, other = tmp_path / "alone" / name, tmp_path / "beside" / name
        results = []
        for folder in (one, other):
            result = json.loads((folder / "result.json").read_bytes())
            result.pop("wall_time")
            results.append(result)
        assert results[0] == results[1]
        for file in results[0]["files"]:
            if file != "result.json":
                assert (one / file).read_bytes() == (other / file).read_bytes()
