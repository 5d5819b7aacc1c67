"""What a fit refuses, in one line that says what was found and what was expected."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from axcomp.data.errors import AxcompError
from axcomp.ident.fit import FitError, Samples, TableEffect, fit_table

LINE = TableEffect((np.arange(11.0),))
PLANE = TableEffect((np.arange(5.0), np.arange(4.0)))
BILATERAL = TableEffect((np.arange(11.0),), branches=2)


def readings(count: int = 60, axes: int = 1) -> Samples:
    rng = np.random.default_rng(0)
    span = [10.0] if axes == 1 else [4.0, 3.0]
    return Samples(
        rng.uniform(0.0, span, (count, axes)),
        rng.normal(size=count),
        rng.integers(0, 2, count),
        np.arange(count) % 3,
        rng.uniform(size=count),
    )


def test_no_readings() -> None:
    with pytest.raises(FitError, match="found no readings, expected at least one per"):
        fit_table(LINE, readings(0))


def test_refusal_is_an_error_of_the_library_and_of_the_value() -> None:
    with pytest.raises(AxcompError):
        fit_table(LINE, readings(0))
    with pytest.raises(ValueError, match="no readings"):
        fit_table(LINE, readings(0))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["positions", "error", "order"])
def test_numbers_that_are_not_finite(name: str, value: float) -> None:
    samples = readings()
    column = getattr(samples, name).copy()
    column[17] = value
    broken: Any = dataclasses.replace(samples, **{name: column})
    with pytest.raises(FitError, match=f"reading 18: {name} is not finite"):
        fit_table(LINE, broken)


def test_nodes_that_do_not_ascend() -> None:
    layout = TableEffect((np.array([0.0, 2.0, 1.0, 3.0]),))
    with pytest.raises(FitError, match="nodes along axis 1 must ascend"):
        fit_table(layout, readings())


def test_all_positions_equal() -> None:
    samples = readings()
    samples.positions[:] = 3.25
    with pytest.raises(
        FitError,
        match=r"all readings stand at 3\.25 along axis 1.*spread over 11 nodes",
    ):
        fit_table(LINE, samples)


def test_all_positions_equal_along_one_axis_of_a_plane() -> None:
    samples = readings(axes=2)
    samples.positions[:, 1] = 2.0
    with pytest.raises(FitError, match="all readings stand at 2 along axis 2"):
        fit_table(PLANE, samples)


def test_fewer_readings_than_nodes() -> None:
    with pytest.raises(
        FitError, match="10 readings for 11 nodes, expected at least 11"
    ):
        fit_table(LINE, readings(10))
    with pytest.raises(
        FitError, match="19 readings for 20 nodes, expected at least 20"
    ):
        fit_table(PLANE, readings(19, axes=2))


def test_repeated_end_of_a_turn_needs_no_reading_of_its_own() -> None:
    layout = TableEffect((np.arange(11.0),), periodic=True)
    fit_table(layout, readings(10))
    with pytest.raises(FitError, match="9 readings for 10 nodes"):
        fit_table(layout, readings(9))


@pytest.mark.parametrize(("branch", "name"), [(0, "positive"), (1, "negative")])
def test_fewer_readings_than_nodes_in_one_direction(branch: int, name: str) -> None:
    samples = readings()
    assert samples.branch is not None
    few = np.flatnonzero(samples.branch == branch)[:7]
    keep = samples.branch != branch
    keep[few] = True
    with pytest.raises(
        FitError,
        match=f"7 readings in {name} direction for 11 nodes, expected at least",
    ):
        fit_table(BILATERAL, samples.take(keep))


def test_direction_missing() -> None:
    samples = dataclasses.replace(readings(), branch=None)
    with pytest.raises(FitError, match="needs the direction of every reading"):
        fit_table(BILATERAL, samples)


def test_gaps_are_accepted_where_they_are_asked_for() -> None:
    fit = fit_table(LINE, readings(10), allow_gaps=True)
    assert np.isfinite(fit.values).all()


def test_too_few_readings_to_judge_the_noise_by() -> None:
    samples = Samples(np.array([[0.0], [10.0]]), np.array([0.1, 0.2]))
    with pytest.raises(
        FitError, match="2 readings leave nothing to judge the noise by"
    ):
        fit_table(LINE, samples, allow_gaps=True)


def test_unknown_loss() -> None:
    with pytest.raises(
        FitError,
        match="loss: found 'cauchy', expected 'student', 'huber', 'trim' or 'gauss'",
    ):
        fit_table(LINE, readings(), loss="cauchy")


@pytest.mark.parametrize("smoothness", ["much", -1.0, np.nan, np.inf])
def test_unknown_smoothness(smoothness: float | str) -> None:
    with pytest.raises(
        FitError, match=r"smoothness: found .*expected 'auto' or a number"
    ):
        fit_table(LINE, readings(), smoothness=smoothness)
