"""ISO 230-2: figures by hand, the real files, gaps, and what must not matter."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from axcomp.data.errors import AxcompError
from axcomp.data.measurements import (
    Iso230,
    derive_direction,
    derive_error,
    describe_drift,
    describe_iso230,
    iso230,
    iso230_figures,
    measurement,
    read_table,
)

DATA = Path(__file__).parents[3] / "shared" / "data" / "iso230"


def evaluate(name: str) -> Iso230:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs ../shared/data/iso230/{name}")
    data = measurement(read_table(path), axis="X")
    return iso230(
        data.values["X.position"],
        derive_error(data, "X"),
        data.get("run"),
        derive_direction(data, "X"),
    )


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        (
            "ess_b02_X_9pos5cyc_ISO230.dat",
            {"B": 33.6, "B_mean": -25.4, "E": 122.8, "M": 93.7, "R": 55.2, "A": 135.3},
        ),
        (
            "ess_ecmccomgui_testdata_ISO230_2.dat",
            {"B": 4.5, "B_mean": -0.4, "E": 12.9, "M": 9.2, "R": 14.3, "A": 22.0},
        ),
    ],
)
def test_real_files_give_the_reference_figures(
    name: str, figures: dict[str, float]
) -> None:
    found = evaluate(name)
    for key, micrometres in figures.items():
        # The reference is printed to 0.1 µm.
        assert getattr(found, key) * 1e3 == pytest.approx(micrometres, abs=0.051)
    assert found.bidirectional
    assert not found.remarks


def test_drifting_runs_are_named() -> None:
    found = evaluate("ess_w42_X_ILD50_5pos5cyc_ISO230.dat")
    assert "Whole runs lie up to 5" in describe_drift(found)
    assert "measure more runs" in describe_iso230({"": found})


def test_runs_that_only_scatter_are_not_called_drift() -> None:
    assert describe_drift(evaluate("ess_ecmccomgui_testdata_ISO230_2.dat")) == ""


# Two targets, two runs: 0 ↑ 1, 3 (x̄ 2, s √2), 0 ↓ 5, 5 (x̄ 5, s 0);
# 10 ↑ 0, 0 (x̄ 0, s 0), 10 ↓ −1, −3 (x̄ −2, s √2), all in µm.
TARGET = np.array([0, 10, 10, 0, 0, 10, 10, 0], dtype=float)
ERROR = np.array([1, 0, -1, 5, 3, 0, -3, 5], dtype=float) / 1e3
RUN = np.array([1, 1, 1, 1, 2, 2, 2, 2])
DIRECTION = np.array([1, 1, -1, -1, 1, 1, -1, -1])


def test_figures_by_hand() -> None:
    found = iso230(TARGET, ERROR, RUN, DIRECTION)
    root = math.sqrt(2.0)
    by_hand = {
        "B": 3.0,  # |2 − 5|
        "B_mean": -0.5,  # (−3 + 2)/2
        "E": 7.0,  # 5 − (−2)
        "M": 4.5,  # 3.5 − (−1)
        "R": 2 * root + 3,  # 5.83 at 0; at 10 the larger of 2√2 + 2 and R↓ = 4√2 = 5.66
        "R_up": 4 * root,
        "R_down": 4 * root,
        "A": 5 - (-2 - 2 * root),
        "A_up": (2 + 2 * root) - (2 - 2 * root),
        "A_down": 5 - (-2 - 2 * root),
        "E_up": 2.0,
        "E_down": 7.0,
    }
    assert {k: v and v * 1e3 for k, v in found.figures().items()} == pytest.approx(
        by_hand
    )
    first = found.positions[0]
    assert (first.target, first.runs_up, first.runs_down) == (0.0, 2, 2)
    assert first.mean == pytest.approx(3.5e-3)
    assert (first.R_up, first.R_down) == (pytest.approx(4 * root / 1e3), 0.0)


def test_one_direction_gives_only_what_exists() -> None:
    up = DIRECTION > 0
    found = iso230(TARGET[up], ERROR[up], RUN[up], DIRECTION[up])
    assert not found.bidirectional
    bidirectional = ("A", "R", "B", "B_mean", "E", "M")
    assert all(getattr(found, key) is None for key in bidirectional)
    assert found.A_down is None
    assert found.R_up == pytest.approx(4 * math.sqrt(2) / 1e3)
    assert found.judged() == ("A_up", found.A_up)


def test_no_direction_counts_as_one_and_says_so() -> None:
    found = iso230(TARGET, ERROR, RUN, None)
    assert "taken as from one side" in found.remarks[0]
    assert found.E_up is not None
    assert found.E is None


def test_single_run_has_no_scatter_and_says_so() -> None:
    first = RUN == 1
    found = iso230(TARGET[first], ERROR[first], RUN[first], DIRECTION[first])
    assert (found.R, found.A, found.R_up) == (None, None, None)
    assert found.B == pytest.approx(4e-3)
    assert any("at least two runs" in remark for remark in found.remarks)
    assert found.judged() == ("A", None)


def test_targets_may_have_different_numbers_of_runs() -> None:
    keep = np.arange(8) != 7  # the second ↓ at 0 is missing
    found = iso230(TARGET[keep], ERROR[keep], RUN[keep], DIRECTION[keep])
    assert [p.runs_down for p in found.positions] == [1, 2]
    # Only 10 is left: 2√2 + 2 = 4.83 is less than R↓ = 4√2.
    assert found.R == pytest.approx(4 * math.sqrt(2) / 1e3)
    assert any("Targets 0 have a single approach" in remark for remark in found.remarks)
    assert any("numbers of runs differ: 1 to 2" in remark for remark in found.remarks)


def test_target_from_one_side_only_is_left_out_and_named() -> None:
    keep = ~((TARGET == 10) & (DIRECTION < 0))
    found = iso230(TARGET[keep], ERROR[keep], RUN[keep], DIRECTION[keep])
    assert any("Targets 10 were approached from one side" in r for r in found.remarks)
    assert found.B == pytest.approx(3e-3)


def test_readings_of_one_approach_are_one_run() -> None:
    twice = np.repeat(np.arange(8), 2)
    wobble = np.tile([0.0005, -0.0005], 8)
    found = iso230(TARGET[twice], ERROR[twice] + wobble, RUN[twice], DIRECTION[twice])
    once = iso230(TARGET, ERROR, RUN, DIRECTION)
    assert found.figures() == pytest.approx(once.figures())


def test_without_runs_each_reading_is_an_approach() -> None:
    assert iso230(TARGET, ERROR, None, DIRECTION).figures() == pytest.approx(
        iso230(TARGET, ERROR, RUN, DIRECTION).figures()
    )


def test_nothing_to_evaluate_is_refused() -> None:
    none = np.array([])
    with pytest.raises(AxcompError, match="found no readings"):
        iso230(none, none, None, None)


def test_run_offsets_show_the_shift_of_a_run() -> None:
    found = iso230(TARGET, ERROR + np.where(RUN == 2, 0.01, 0.0), RUN, DIRECTION)
    spread = found.run_offsets[2] - found.run_offsets[1]
    # The 10 µm, and 0: what the rows of the two runs differ by on average.
    assert spread == pytest.approx(0.01)


@settings(max_examples=40, deadline=None)
@given(order=st.permutations(range(8)))
def test_order_of_rows_does_not_matter(order: list[int]) -> None:
    mixed = iso230(TARGET[order], ERROR[order], RUN[order], DIRECTION[order])
    assert mixed.figures() == iso230(TARGET, ERROR, RUN, DIRECTION).figures()  # fsum


@settings(max_examples=40, deadline=None)
@given(shift=st.floats(-1, 1), slope=st.floats(-1e-3, 1e-3))
def test_scatter_and_reversal_ignore_what_a_table_removes(
    shift: float, slope: float
) -> None:
    plain = iso230(TARGET, ERROR, RUN, DIRECTION)
    moved = iso230(TARGET, ERROR + shift + slope * TARGET, RUN, DIRECTION)
    for key in ("R", "B", "B_mean", "R_up", "R_down"):
        # Sums of numbers up to 1 keep 1e-15 of absolute precision.
        assert getattr(moved, key) == pytest.approx(getattr(plain, key), abs=1e-13)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_accuracy_is_never_smaller_than_its_parts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target = np.tile(np.repeat([0.0, 5.0, 10.0], 3), 2)
    direction = np.repeat([1, -1], 9)
    run = np.tile([1, 2, 3], 6)
    found = iso230(target, rng.normal(size=18), run, direction)
    assert found.A is not None
    assert found.E is not None
    assert found.M is not None
    assert found.R is not None
    assert found.B is not None
    assert found.M <= found.E <= found.A
    assert found.B <= found.R


@pytest.mark.parametrize("seed", range(6))
def test_figures_alone_are_those_of_the_whole_evaluation(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = 40
    # Within 1 nm of a target, of either sign of zero, and several readings an approach.
    target = -5.0 * rng.integers(0, 4, count) + rng.choice([0.0, 2e-8], count)
    run = rng.integers(1, 4, count) if seed % 3 else None
    direction = rng.choice([-1, 1], count) if seed % 2 else None
    error = rng.normal(0.0, 1e-2, count)
    whole = iso230(target, error, run, direction)
    assert iso230_figures(target, error, run, direction) == whole.figures()
    mixed = rng.permutation(count)
    # Readings without a run count as they come.
    if run is not None:
        given = (run[mixed], None if direction is None else direction[mixed])
        assert iso230_figures(target[mixed], error[mixed], *given) == whole.figures()
