"""Inequalities that written tables keep: ``constraints`` in a job and in Python."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls

import axcomp
from axcomp.ident.core import FitError
from axcomp.ident.fit import Constraint
from axcomp.ident.job import JobError, JobResult, TableResult, run_job

NODES = np.arange(0.0, 401.0, 20.0)
BESIDE = """group = "X"
[[fits]]
compensation = "backlash"
axis = "X"
measurement = "laser"
group = "X"
"""
KEEPS = 'solver = "ipopt"\nconstraints = ["monotone"]'


def truth(place: np.ndarray) -> np.ndarray:
    """Return an error in mm that rises everywhere, in the middle hardly."""
    return 0.004 * np.tanh((place - 60.0) / 40.0) + 0.006 * np.tanh(
        (place - 340.0) / 40.0
    )


def screw(folder: Path, keys: str = "", measurement: str = "") -> Path:
    """Write a job of a noisy leadscrew that rises, measured in both directions."""
    rng = np.random.default_rng(4)
    rows = []
    for run in range(6):
        for way in (1, -1):
            for place in NODES[::way]:
                error = truth(place) - 0.003 * (way < 0) + 0.0015 * rng.normal()
                rows.append(f"{place},{1e3 * error:.3f},{run},{way}")
    (folder / "laser.csv").write_text("x,dx,run,way\n" + "\n".join(rows) + "\n")
    path = folder / "job.toml"
    path.write_text(f"""[axes.X]
number = 1
[measurements.laser]
file = "laser.csv"
remove = "none"
{measurement}
[measurements.laser.columns]
run = "run"
"X.position" = "x"
"X.error" = {{ column = "dx", unit = "um" }}
"X.direction" = "way"
[[fits]]
compensation = "leadscrew"
axis = "X"
measurement = "laser"
start = 0.0
interval = 20.0
points = 21
bilateral = true
{keys}
""")
    return path


def only(result: JobResult) -> TableResult:
    (found,) = result.fits
    assert isinstance(found, TableResult)
    return found


def test_a_noisy_leadscrew_is_written_monotone(tmp_path: Path) -> None:
    # Without a prior every node follows its own scatter.
    free = only(run_job(screw(tmp_path, "smoothness = 0"), tmp_path / "free"))
    keys = f"smoothness = 0\n{KEEPS}"
    held = only(run_job(screw(tmp_path, keys), tmp_path / "held"))
    assert any(np.diff(each).min() < 0 for each in free.table.values())
    lists = axcomp.load_model(tmp_path / "held" / "achskw1.lis")
    written = lists["leadscrew"]
    for each, name in ((written.pos, "pos"), (written.neg, "neg")):
        assert np.diff(each).min() >= 0
        np.testing.assert_allclose(each, held.table[name], atol=1e-9)
    # Each fold keeps them, too: what is held out is left by tables that rise.
    assert held.error["predicted"].rms <= free.error["predicted"].rms
    off = [np.std(one.table["pos"] - truth(NODES)) for one in (free, held)]
    assert off[1] < off[0]
    assert any("monotone" in remark.message for remark in held.remarks)


def test_entries_that_keep_above_zero_continue_an_active_list(tmp_path: Path) -> None:
    old = np.linspace(0.0, 0.004, 21)
    model = axcomp.models.Leadscrew(
        axcomp.models.EquidistantNodes(0.0, 20.0, 21), old, old
    )
    axcomp.write_lists(axcomp.AxisModels(1, {"leadscrew": model}), tmp_path)
    keys = 'solver = "ipopt"\nconstraints = ["non-negative", "monotone"]'
    path = screw(tmp_path, keys, 'active = ["leadscrew"]\ndatum = { at = 60.0 }')
    text = path.read_text().replace("number = 1", 'number = 1\nlist = "achskw1.lis"')
    path.write_text(text.replace('remove = "none"\n', ""))
    held = only(run_job(path, tmp_path / "out"))
    both = np.stack([held.table["pos"], held.table["neg"]])
    assert both.min() == 0.0
    assert np.diff(both).min() >= 0.0
    # The datum stays the zero of what was measured: old + residual is old there.
    assert both[:, 3].mean() == pytest.approx(old[3], abs=1e-4)


@pytest.mark.parametrize(
    ("keys", "measurement", "match"),
    [
        ('constraints = ["monotone"]', "", "solver 'factor', expected 'ipopt'"),
        (f"{KEEPS}\n{BESIDE}", "", "found in a group, expected a fit of its own"),
        (
            f"modulo = true\n{KEEPS}",
            "",
            "found 'monotone' for a table that goes round, expected one with two ends",
        ),
        (KEEPS, "stream = true", "a log that is read in pieces, expected stream = fal"),
    ],
)
def test_what_cannot_be_kept_is_refused(
    tmp_path: Path, keys: str, measurement: str, match: str
) -> None:
    path = screw(tmp_path, keys, measurement)
    if "group" in keys:  # backlash stands beside a table of one direction only
        path.write_text(path.read_text().replace("bilateral = true\n", ""))
    if "modulo" in keys:
        turn = 'number = 1\ntype = "rotary"\nmodulo = [0.0, 400.0]'
        path.write_text(path.read_text().replace("number = 1", turn))
    if "stream" in measurement:  # a log, long enough to be read in pieces
        place = 200.0 + 200.0 * np.sin(np.arange(40_000) / 500.0)
        way = np.sign(np.gradient(place))
        rows = np.column_stack([place, 1e3 * truth(place), way])
        head, name = "x,dx,way", tmp_path / "laser.csv"
        np.savetxt(name, rows, "%.4f", ",", header=head, comments="")
        path.write_text(path.read_text().replace('run = "run"\n', ""))
    with pytest.raises(JobError, match=match):
        run_job(path, tmp_path / "out")


def test_a_plane_rises_over_one_master_and_falls_over_the_other() -> None:
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0.0, 100.0, (2, 600))
    error = (
        0.01 * np.tanh((x - 50) / 15) - 0.004 * y / 100 + 0.003 * rng.normal(size=600)
    )
    table = axcomp.Plane(
        "Z", ("X", "Y"), start=(0.0, 0.0), interval=(10.0, 20.0), points=(11, 6)
    )
    data = {"X.position": x, "Y.position": y, "Z.error": error}
    monotone: list[Constraint] = ["monotone"]
    free, held = (
        axcomp.fit([table], data, smoothness=0.01, constraints=words)["plane"].model
        for words in (None, {"plane": monotone})
    )
    # Entries of a plane are offsets: they go against the error. To IPOPT's tolerance.
    for model, keeps in ((free, False), (held, True)):
        ways = np.diff(model.values, axis=1), -np.diff(model.values, axis=0)
        assert all((each.max() < 1e-7) == keeps for each in ways)


@pytest.mark.parametrize("offset", [0.0, 0.005])
def test_a_table_that_may_not_be_negative_is_the_most_probable_one(
    offset: float,
) -> None:
    rng = np.random.default_rng(0)
    x = rng.uniform(0.0, 200.0, 300)
    error = offset + 0.01 * np.tanh((x - 100.0) / 30.0) + 0.003 * rng.normal(size=300)
    table = axcomp.Leadscrew("X", start=0.0, interval=10.0, points=21)
    data = {"X.position": x, "X.error": error}
    fit = axcomp.fit(
        [table], data, smoothness=0.05, loss="gauss", solver="ipopt",
        constraints={"leadscrew": ["non-negative"]},
    )  # fmt: skip
    cell = np.minimum((x / 10.0).astype(int), 19)
    design = np.zeros((300, 21))
    design[np.arange(300), cell] = 1.0 - (x / 10.0 - cell)
    design[np.arange(300), cell + 1] = x / 10.0 - cell
    bends = np.sqrt(0.05) * np.diff(np.eye(21), 2, axis=0)
    best, _ = nnls(np.vstack([design, bends]), np.append(error, np.zeros(19)))
    # The constant of the axis moves with the entries: held, they were 7 µm off.
    np.testing.assert_allclose(fit["leadscrew"].model.pos, best, atol=1e-7)


def test_words_go_into_the_job_and_fit_tables_only(tmp_path: Path) -> None:
    place = np.tile(NODES, 4)
    error = truth(place) + 0.002 * np.random.default_rng(1).normal(size=place.size)
    data = {"X.position": place, "X.error": error, "run": np.repeat(np.arange(4), 21)}
    table = axcomp.Leadscrew("X", start=0.0, interval=20.0, points=21)
    words: dict[str, list[Constraint]] = {"leadscrew": ["monotone"]}
    fit = axcomp.fit([table], data, smoothness=0.0, constraints=words)
    found = fit["leadscrew"].model.pos
    assert np.diff(found).min() > -1e-8
    written = only(fit.write(tmp_path / "out", axes={"X": 1})).table["pos"]
    assert np.diff(written).min() >= 0.0
    # The same law: rounding, and what two loops of the robust loss are apart.
    np.testing.assert_allclose(written, found, atol=2e-4)
    play = axcomp.Backlash("X")
    data["X.direction"] = np.tile([1.0, -1.0], 42)
    with pytest.raises(FitError, match="found monotone, expected a function"):
        axcomp.fit([play], data, constraints={"backlash": ["monotone"]})
