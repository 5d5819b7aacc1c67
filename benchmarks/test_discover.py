"""What `discover` names in half an hour of a machine with every fault at once.

Slow; run one seed with ``pytest benchmarks/test_discover.py -k "seed0"``.
"""

from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from axcomp.ident.discover import discover
from axcomp.ident.job import load_job
from axcomp.ident.machine import (
    machine_with_everything,
    record,
    work_programme,
    write_motion_log,
)
from axcomp.ident.readings import observe

SEEDS = [pytest.param(seed, id=f"seed{seed}") for seed in range(10)]
OTHER = {"absent": [("backlash", "Z"), ("temperature", "Z")], "swapped": True}
JOB = """\
[axes.X]
number = 1
[axes.Y]
number = 2
[axes.Z]
number = 3
[measurements.work]
file = "log.csv"
active = []
"""


@pytest.mark.parametrize("other", [False, True], ids=["all", "other"])
@pytest.mark.parametrize("seed", SEEDS)
def test_everything_is_named_and_nothing_else(
    benchmark: BenchmarkFixture, tmp_path: Path, seed: int, other: bool
) -> None:
    work = machine_with_everything(**(OTHER if other else {}))  # type: ignore[arg-type]
    log = record(work, work_programme(1800.0, seed), seed + 100).every(18)
    write_motion_log(tmp_path / "log.csv", log)
    (tmp_path / "job.toml").write_text(JOB)
    seen = observe(load_job(tmp_path / "job.toml", fits=False))
    found = benchmark.pedantic(lambda: discover(seen.data, tuple("XYZ")), rounds=1)
    wanted = {
        ("leadscrew", "X", ()),
        ("temperature", "X", ()),
        ("leadscrew", "Y", ()),
        ("backlash", "Y", ()),
        ("cross", "Y", ("Z" if other else "X",)),
        ("crosstalk", "Y", ("X", "Z")),
        ("leadscrew", "Z", ()),
        ("plane", "Z", ("X", "Y")),
        *((("friction", axis, ())) for axis in "XYZ"),
    }
    if not other:
        wanted |= {("backlash", "Z", ()), ("temperature", "Z", ())}
    named = {(one.compensation, one.axis, one.masters) for one in found.found}
    benchmark.extra_info |= {
        "noise_um": {
            one.axis: 1e3 * one.noise for one in found.axes if one.channel == "error"
        },
        "unexplained": [one.what for one in found.unexplained],
    }
    assert named == wanted
    assert not found.confused
