"""Each instrument's file, made a job by `axcomp new`, answered, and fitted: once."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from axcomp.ident.cli import main

from ...conftest import leave_drawings_out
from .instruments import (
    write_laser,
    write_motion,
    write_probe,
    write_pushed,
    write_scope,
    write_straightness,
    write_thermal,
)

Answered = Callable[[str], dict[str, Any]]

_WRITERS = {
    "laser": write_laser,
    "straightness": write_straightness,
    "probe": write_probe,
    "scope": write_scope,
    "thermal": write_thermal,
    "motion": write_motion,
    "pushed": write_pushed,
}
_ANSWERS = {
    "laser": ["number = 1", "datum = { at = 0.0 }"],
    "straightness": ["number = 1", "number = 2", 'remove = "line"'],
    "probe": ["number = 1", "number = 2", "number = 3", 'remove = "offset"'],
    "scope": ["number = 1", "rated_current = 9.0", "torque_unit = 0.001"],
    "thermal": ["number = 1"],
    "motion": ["number = 1", 'remove = "offset"'],
    "pushed": ["number = 1", "number = 2"],
}
"""What a person at the machine would type, in the order of the questions."""


def answer(job: Path, answers: Sequence[str]) -> None:
    """Answer the questions of a job as a person does: each on the line of its key."""
    lines = job.read_text(encoding="utf-8").splitlines()
    for each in answers:
        key = each.partition("=")[0]
        own = [k for k, line in enumerate(lines) if line.startswith(f"#? {key}")]
        exact = [k for k in own if lines[k].startswith(f"#? {each}")]
        lines[(exact or own)[0]] = each
    job.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the job that `axcomp new` writes for the file of an instrument."""
    jobs: dict[str, Path] = {}

    def job_of(name: str) -> Path:
        if name not in jobs:
            folder = tmp_path_factory.mktemp(name)
            file = folder / f"{name}.csv"
            _WRITERS[name](file)
            jobs[name] = folder / "job.toml"
            assert main(["new", str(file), "--out", str(jobs[name])]) == 0
        return jobs[name]

    return job_of


@pytest.fixture(scope="session")
def fitted(written: Callable[[str], Path]) -> Answered:
    """Return the fit in `result.json` of an instrument's job, its questions answered."""
    results: dict[str, dict[str, Any]] = {}

    def fit_of(name: str) -> dict[str, Any]:
        if name not in results:
            asked = written(name)
            job = asked.with_name("answered.toml")
            job.write_bytes(asked.read_bytes())
            answer(job, _ANSWERS[name])
            out = job.parent / "out"
            with pytest.MonkeyPatch.context() as patch:
                leave_drawings_out(patch)
                assert main(["fit", str(job), "--out", str(out)]) == 0
            results[name] = json.loads((out / "result.json").read_text())["fits"][0]
        return results[name]

    return fit_of
