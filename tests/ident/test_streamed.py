"""Tables fitted from pieces: the same as in memory, however the pieces are cut."""

import functools
import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pv
import pyarrow.parquet as pq
import pytest

from axcomp.data.measurements import MeasurementError, open_large
from axcomp.ident.batch import fit_log
from axcomp.ident.fit import (
    FitError,
    Samples,
    TableEffect,
    TableFit,
    fit_streamed,
    fit_table,
)

PLANE = TableEffect((np.linspace(0.0, 100.0, 11), np.linspace(0.0, 60.0, 8)))
LINE = TableEffect((np.linspace(0.0, 100.0, 21),))


def log(layout: TableEffect, count: int, wild: float = 0.0) -> Samples:
    rng = np.random.default_rng(3)
    ends = np.array([nodes[-1] for nodes in layout.nodes])
    positions = rng.uniform(-2.0, 2.0 + ends, (count, len(ends)))
    error = 0.02 * np.sin(positions.sum(axis=1) / 25.0) + rng.normal(0, 0.002, count)
    error[rng.random(count) < wild] += 0.3
    return Samples(positions, error)


def pieces(samples: Samples, cuts: list[int]) -> Iterator[Samples]:
    for start, stop in zip([0, *cuts], [*cuts, len(samples.error)], strict=True):
        yield Samples(samples.positions[start:stop], samples.error[start:stop])


def parts(samples: Samples, count: int) -> list[functools.partial[Iterator[Samples]]]:
    ends = np.linspace(0, len(samples.error), count + 1).astype(int)
    found = []
    for start, stop in itertools.pairwise(ends):
        own = Samples(samples.positions[start:stop], samples.error[start:stop])
        found.append(functools.partial(pieces, own, [len(own.error) // 3]))
    return found


def streamed(layout: TableEffect, parts: Any, **options: Any) -> TableFit:
    return fit_streamed(layout, parts, **options).fit


def assert_same(found: TableFit, whole: TableFit, tolerance: float) -> None:
    """Compare, relative to 1 mm and to the noise; sums in another order round elsewhere."""
    np.testing.assert_allclose(found.values, whole.values, rtol=0, atol=tolerance)
    np.testing.assert_allclose(
        found.standard_deviation, whole.standard_deviation, rtol=1e-6, atol=0
    )
    np.testing.assert_array_equal(found.support, whole.support)
    assert found.noise == pytest.approx(whole.noise, rel=1e-6)


@pytest.mark.parametrize("loss", ["gauss", "huber", "student"])
@pytest.mark.parametrize("layout", [PLANE, LINE], ids=["plane", "line"])
def test_a_log_in_pieces_gives_the_table_that_it_gives_in_memory(
    layout: TableEffect, loss: str
) -> None:
    samples = log(layout, 45_000, wild=0.001)
    whole = fit_table(layout, samples, loss=loss)
    found = streamed(layout, parts(samples, 4), loss=loss)
    # The issue asks for 1e-9 mm.
    assert_same(found, whole, 1e-9)
    assert found.converged == whole.converged
    assert f"{45_000} readings" in found.message


UNEVEN = TableEffect(
    (np.array([0.0, 10.0, 30.0, 60.0, 70.0, 100.0]), np.linspace(0.0, 60.0, 9))
)
FEW = TableEffect((np.linspace(0.0, 100.0, 5), np.linspace(0.0, 60.0, 4)))


@pytest.mark.parametrize(
    "loss", [pytest.param("gauss", marks=pytest.mark.heavy), "student"]
)
@pytest.mark.parametrize("straight", [False, True], ids=["bent", "straight"])
@pytest.mark.parametrize("layout", [UNEVEN, FEW], ids=["uneven", "few"])
def test_small_grids_end_at_the_same_smoothness(
    layout: TableEffect, straight: bool, loss: str
) -> None:
    # Where the evidence hardly tells the weights, the search must still end in one place.
    samples = log(layout, 3_000, wild=0.001)
    if straight:
        slope = 1e-4 * samples.positions.sum(axis=1)
        noise = np.random.default_rng(8).normal(0.0, 0.002, len(slope))
        samples = Samples(samples.positions, slope + noise)
    whole = fit_table(layout, samples, loss=loss)
    found = streamed(layout, parts(samples, 4), loss=loss)
    assert_same(found, whole, 1e-9)
    for name, weight in whole.smoothness.items():
        # A table moves by far less than its deviation when a weight moves by a thousandth.
        assert found.smoothness[name] == pytest.approx(weight, rel=1e-3)


def test_a_log_that_scans_line_by_line_is_fitted() -> None:
    samples = log(PLANE, 6_000)
    place = samples.positions[np.argsort(samples.positions[:, 1])].copy()
    place[:, 1] = np.repeat(np.linspace(0.0, 60.0, 6), 1_000)
    samples = Samples(place, samples.error)
    for loss in ("gauss", "huber"):
        found = streamed(PLANE, parts(samples, 3), loss=loss, smoothness=1.0)
        whole = fit_table(PLANE, samples, smoothness=1.0, loss=loss)
        assert_same(found, whole, 1e-9)
    stuck = Samples(np.column_stack([place[:, 0], np.ones(6_000)]), samples.error)
    with pytest.raises(FitError, match="all readings stand at 1 along axis 2"):
        streamed(PLANE, parts(stuck, 3))


def test_least_squares_reads_the_log_once() -> None:
    samples = log(PLANE, 5_000)
    reads = 0

    def part() -> Iterator[Samples]:
        nonlocal reads
        for piece in pieces(samples, [1_000, 2_500]):
            reads += len(piece.error)
            yield piece

    streamed(PLANE, [part], loss="gauss")
    # Once, and its first piece beforehand to know about where the readings lie.
    assert reads == 5_000 + 1_000


def test_a_fixed_smoothness_is_the_same_as_in_memory() -> None:
    samples = log(LINE, 30_000)
    whole = fit_table(LINE, samples, smoothness=0.5, loss="gauss")
    found = streamed(LINE, parts(samples, 3), smoothness=0.5, loss="gauss")
    assert_same(found, whole, 1e-12)


def test_who_sums_which_part_does_not_change_a_bit() -> None:
    samples = log(PLANE, 20_000)
    alone = streamed(PLANE, parts(samples, 5), loss="student")
    with ThreadPoolExecutor(3) as pool:
        together = streamed(PLANE, parts(samples, 5), loss="student", apply=pool.map)
    assert np.array_equal(alone.values, together.values)


def test_readings_that_do_not_determine_the_table_are_refused() -> None:
    with pytest.raises(FitError, match="found no readings"):
        streamed(LINE, [lambda: []])
    with pytest.raises(FitError, match="2 readings for 21 nodes"):
        streamed(LINE, parts(log(LINE, 2), 1), loss="huber")
    with pytest.raises(FitError, match="loss: found 'cauchy'"):
        streamed(LINE, parts(log(LINE, 50), 1), loss="cauchy")
    with pytest.raises(FitError, match="smoothness: found 'rough'"):
        streamed(LINE, parts(log(LINE, 50), 1), smoothness="rough")


def write_log(path: Path, samples: Samples) -> None:
    table = pa.table(
        {
            "note": ["x"] * len(samples.error),
            "e": samples.error,
            "x": samples.positions[:, 0],
        }
    )
    if path.suffix == ".csv":
        pv.write_csv(table, path)
    else:
        pq.write_table(table, path, row_group_size=700)


@pytest.mark.parametrize("name", ["log.parquet", "log.csv"])
def test_a_file_comes_in_pieces_row_by_row(tmp_path: Path, name: str) -> None:
    samples = log(LINE, 5_000)
    write_log(tmp_path / name, samples)
    large = open_large(tmp_path / name, 0)
    assert large is not None
    found = large.parts(("x", "e"), 3, 400)
    assert len(found) == (1 if name.endswith("csv") else 3)
    cut = [table for part in found for table in part.tables()]
    for column, true in (("x", samples.positions[:, 0]), ("e", samples.error)):
        read = np.concatenate([table.column(column).values for table in cut])
        assert np.array_equal(read, true)  # both formats keep every digit


def test_more_parts_than_row_groups_are_no_more_than_these(tmp_path: Path) -> None:
    write_log(tmp_path / "log.parquet", log(LINE, 1_000))
    large = open_large(tmp_path / "log.parquet", 0)
    assert large is not None
    assert len(large.parts(("x",), 9, 400)) == 2


@pytest.mark.parametrize("name", ["log.parquet", "log.csv"])
def test_what_a_log_lacks_is_said_with_its_row(tmp_path: Path, name: str) -> None:
    numbers = [*map(float, range(50))]
    gap = [*numbers[:7], None, *numbers[8:]]
    table = pa.table({"x": numbers, "gap": gap, "word": ["a", "b"] * 25})
    pq.write_table(table, tmp_path / "log.parquet")
    pv.write_csv(table, tmp_path / "log.csv")
    with pytest.raises(MeasurementError, match=r"(row 8, |:9: )column 'gap'"):
        fit_log(tmp_path / name, LINE, ("x",), "gap")
    with pytest.raises(MeasurementError, match="column 'word': found 'a'"):
        fit_log(tmp_path / name, LINE, ("x",), "word")
    with pytest.raises(MeasurementError, match="no column 'nothing'"):
        fit_log(tmp_path / name, LINE, ("x",), "nothing")


def test_a_file_read_ahead_gives_what_it_gives_in_memory(tmp_path: Path) -> None:
    samples = log(PLANE, 40_000)
    table = pa.table({"x": samples.positions[:, 0], "e": 1e3 * samples.error})
    table = table.append_column("y", [samples.positions[:, 1]])
    pq.write_table(table, tmp_path / "log.parquet", row_group_size=3_000)
    found = fit_log(
        tmp_path / "log.parquet", PLANE, ("x", "y"), "e", factor=1e-3, smoothness=0.5,
        loss="gauss",
    )  # fmt: skip
    # Sums in another order, and µm turned to mm and back: a few roundings.
    whole = fit_table(PLANE, samples, smoothness=0.5, loss="gauss")
    assert_same(found, whole, 1e-12)


@pytest.mark.parametrize("loss", ["gauss", "student"])
def test_the_number_of_threads_does_not_change_a_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, loss: str
) -> None:
    samples = log(PLANE, 60_000)
    table = pa.table({"x": samples.positions[:, 0], "e": samples.error})
    table = table.append_column("y", [samples.positions[:, 1]])
    path, columns = tmp_path / "log.parquet", ("x", "y")
    pq.write_table(table, path, row_group_size=4_000)
    found = []
    for cores in (1, 2, 3):  # one reads ahead, the others take parts side by side
        monkeypatch.setattr("os.cpu_count", lambda cores=cores: cores)
        found.append(fit_log(path, PLANE, columns, "e", smoothness=0.5, loss=loss))
    assert np.array_equal(found[0].values, found[1].values)
    assert np.array_equal(found[0].values, found[2].values)


def test_a_missing_cell_is_said_from_threads_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    samples = log(PLANE, 60_000)
    x, y = samples.positions.T.copy()
    y[41_234] = np.inf
    table = pa.table({"x": x, "y": y, "e": samples.error})
    pq.write_table(table, tmp_path / "log.parquet", row_group_size=4_000)
    for loss in ("gauss", "huber"):
        with pytest.raises(
            MeasurementError, match=r"row 41235, column 'y': found 'inf'"
        ):
            fit_log(tmp_path / "log.parquet", PLANE, ("x", "y"), "e", loss=loss)


def test_a_bad_cell_far_on_in_a_file_read_ahead_is_said(tmp_path: Path) -> None:
    x = np.tile(np.linspace(0.0, 100.0, 1_000), 50)
    x[45_678] = np.nan
    table = pa.table({"x": x, "e": np.sin(x)})
    pq.write_table(table, tmp_path / "log.parquet", row_group_size=1_000)
    with pytest.raises(MeasurementError, match="row 45679, column 'x': found"):
        fit_log(tmp_path / "log.parquet", LINE, ("x",), "e")
