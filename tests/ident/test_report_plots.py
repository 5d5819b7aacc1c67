"""What the plots draw, by their artists, and whether the captions are true."""

import dataclasses
import re
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path

from axcomp.ident.job import TableResult
from axcomp.ident.report._body import Plot
from axcomp.ident.report._scale import number, percent, place, scale_of
from axcomp.ident.report._section import section_of
from axcomp.ident.report._style import house_style
from axcomp.ident.report.table._fitted import (
    Fitted,
    bin_means,
    branches_of,
    readings_of,
)
from axcomp.ident.report.table._lines import curve_plot
from axcomp.ident.report.table._maps import coverage_maps, error_map, hatch
from axcomp.ident.report.table._residuals import residual_plot

Make = Callable[..., TableResult]
MM = scale_of("mm")


@pytest.fixture(autouse=True)
def style() -> Iterator[None]:
    with house_style():
        yield


def shifted(fit: TableResult, extra: np.ndarray) -> TableResult:
    samples = fit.samples
    return dataclasses.replace(
        fit, samples=dataclasses.replace(samples, predicted=samples.predicted + extra)
    )


def labelled(figure: Figure, label: str) -> list[Line2D]:
    lines = [line for axes in figure.axes for line in axes.lines]
    return [line for line in lines if str(line.get_label()) == label]


def test_curve_draws_each_direction_with_its_own_marker(leadscrew: Make) -> None:
    fit = leadscrew()
    plot = curve_plot(fit, readings_of(fit, MM), MM)
    (axes,) = plot.figure.axes
    bars = [box for box in axes.containers if "table" in str(box.get_label())]
    assert [box.get_label() for box in bars] == [
        "table ± 2 sd, moving +",
        "table ± 2 sd, moving −",
    ]
    markers = [str(box.lines[0].get_marker()) for box in bars]  # type: ignore[attr-defined]
    assert markers == [">", "<"]


def test_curve_shows_values_and_two_standard_deviations_in_micrometres(
    cross: Make,
) -> None:
    fit = cross()
    (axes,) = curve_plot(fit, readings_of(fit, MM), MM).figure.axes
    (bar,) = [box for box in axes.containers if box.get_label() == "table ± 2 sd"]
    line, _, (ends,) = bar.lines  # type: ignore[attr-defined]
    np.testing.assert_allclose(line.get_ydata(), 1000 * fit.fit.values)
    assert isinstance(ends, LineCollection)
    height = [np.ptp(np.asarray(segment)[:, 1]) for segment in ends.get_segments()]
    np.testing.assert_allclose(height, 4000 * fit.fit.standard_deviation)


def test_unmeasured_nodes_have_hollow_marks_and_are_counted(leadscrew: Make) -> None:
    fit = leadscrew()
    plot = curve_plot(fit, readings_of(fit, MM), MM)
    (axes,) = plot.figure.axes
    hollow = [box for box in axes.containers if box.get_label() == "not measured"]
    assert sum(box.lines[0].get_xdata().size for box in hollow) == 6  # type: ignore[attr-defined]
    assert "6 nodes are not measured" in plot.caption


def test_the_line_of_a_curve_passes_through_unmeasured_nodes_as_well(
    leadscrew: Make,
) -> None:
    fit = leadscrew()
    (axes,) = curve_plot(fit, readings_of(fit, MM), MM).figure.axes
    drawn = [np.asarray(line.get_ydata(), float) for line in axes.lines]
    for values in 1000 * fit.fit.values:
        assert any(len(y) == len(values) and np.allclose(y, values) for y in drawn)


def test_wild_readings_stand_at_the_edge_and_do_not_stretch_the_frame(
    leadscrew: Make,
) -> None:
    fit = leadscrew()
    (axes,) = curve_plot(fit, readings_of(fit, MM), MM).figure.axes
    low, high = axes.get_ylim()
    assert high - low < 100  # µm; the wild readings are 300 µm off
    (wild,) = [line for line in axes.lines if str(line.get_marker()) == "x"]
    assert set(np.asarray(wild.get_ydata(), float)) <= {low, high}


def test_many_nodes_get_a_band_instead_of_bars(cross: Make) -> None:
    fit = cross(count=1000)
    (axes,) = curve_plot(fit, readings_of(fit, MM), MM).figure.axes
    assert not axes.containers
    assert len(axes.collections) == 1


def test_map_shows_the_error_and_hatches_exactly_the_unmeasured_nodes(
    plane: Make,
) -> None:
    fit = plane()
    axes, _ = error_map(fit, readings_of(fit, MM), MM).figure.axes
    (mesh,) = [item for item in axes.collections if isinstance(item, QuadMesh)]
    np.testing.assert_allclose(np.asarray(mesh.get_array()), 1000 * fit.fit.values)
    np.testing.assert_array_equal(hatched(axes, fit.nodes), fit.fit.support == 0)


def hatched(axes: Axes, nodes: Sequence[np.ndarray]) -> np.ndarray:
    """Return which nodes lie inside what is hatched."""
    (drawn,) = [item for item in axes.collections if isinstance(item, ContourSet)]
    assert drawn.hatches == ["////"]
    grid = np.stack(np.meshgrid(*nodes), axis=-1)
    # What lies within two outlines is in a hole.
    inside = [
        Path(outline).contains_points(grid.reshape(-1, 2))
        for path in drawn.get_paths()
        for outline in path.to_polygons()
    ]
    return np.asarray(np.sum(inside, axis=0).reshape(grid.shape[:2]) % 2 == 1)


@given(
    st.lists(st.lists(st.booleans(), min_size=7, max_size=7), min_size=1, max_size=9)
)
@settings(deadline=None)
def test_what_is_hatched_is_what_has_no_readings(rows: list[list[bool]]) -> None:
    mask = np.array([*rows, [False] * 7])
    nodes = np.arange(7.0) * 30.0, np.arange(float(len(mask))) * 20.0
    none = np.zeros(mask.shape)
    axes = Figure().subplots()
    table = Fitted(("X", "Y"), ("mm", "mm"), nodes, 0, none, none, np.where(mask, 0, 3))
    hatch(axes, table)
    if mask.any():
        np.testing.assert_array_equal(hatched(axes, nodes), mask)
    else:
        assert not axes.collections


def test_coverage_caption_names_the_worst_measured_node(plane: Make) -> None:
    fit = plane()
    caption = coverage_maps(fit, MM).caption
    known = fit.fit.support > 0
    worst = 1000 * fit.fit.standard_deviation[known].max()
    assert f"the worst {number(worst)} µm" in caption
    assert (
        f"{fit.fit.support[known].min()} to {fit.fit.support.max()} readings" in caption
    )


def test_slices_are_means_with_standard_errors() -> None:
    where = np.array([0.0, 1.0, 2.0, 9.0, 10.0])
    bins = bin_means(where, np.array([1.0, 2.0, 3.0, 5.0, 7.0]), 2)
    np.testing.assert_array_equal(bins.count, [3, 2])
    np.testing.assert_allclose(bins.mean, [2.0, 6.0])
    # sd 1 of three, sd √2 of two.
    np.testing.assert_allclose(bins.error, [1 / np.sqrt(3), 1.0])


def test_clean_residuals_are_called_chance(leadscrew: Make) -> None:
    fit = leadscrew()
    plot = residual_plot(fit, readings_of(fit, MM), MM)
    assert plot is not None
    assert "no more than chance" in plot.caption


def test_left_over_wave_is_called_more_than_chance(leadscrew: Make) -> None:
    fit = leadscrew()
    wave = 0.003 * np.sin(fit.samples.positions[:, 0] / 60)
    fit = shifted(fit, wave)
    plot = residual_plot(fit, readings_of(fit, MM), MM)
    assert plot is not None
    assert "Over X the means of slices stand out more than by chance" in plot.caption


def test_error_bars_that_are_too_small_are_called_so(leadscrew: Make) -> None:
    fit = leadscrew()
    view = fit.samples
    small = dataclasses.replace(
        fit, samples=dataclasses.replace(view, predicted_sd=view.predicted_sd / 2)
    )
    honest, proud = (uncertainty(each) for each in (fit, small))
    assert "taken at their word" in honest
    assert "too small" in proud


def uncertainty(fit: TableResult) -> str:
    return dict(section_of(fit, 1).body.facts)["Uncertainty"]


def times_predicted(fit: TableResult) -> float:
    """Return how many times the predicted deviation is seen."""
    found = re.search(r"what remains is ([0-9.]+) ×", uncertainty(fit))
    assert found is not None
    return float(found[1])


def test_spread_compares_like_with_like(plane: Make) -> None:
    # The synthetic sd is 0 to 20 % too large, evenly; 3 600 readings give 1.2 %.
    stated = np.sqrt(np.mean((1 + 0.2 * np.linspace(0, 1, 1001)) ** 2))
    assert times_predicted(plane()) == pytest.approx(1 / stated, rel=0.04)


def test_few_readings_predicted_from_afar_say_nothing_of_the_others(
    leadscrew: Make,
) -> None:
    fit = leadscrew()
    wide = fit.samples.predicted_sd.copy()
    wide[:5] *= 50.0
    far = dataclasses.replace(
        fit, samples=dataclasses.replace(fit.samples, predicted_sd=wide)
    )
    # Five of them no longer count among the rest.
    assert times_predicted(far) == pytest.approx(times_predicted(fit), rel=0.05)
    plain, spread = (uncertainty(each).partition(" µm")[0] for each in (fit, far))
    assert plain == spread


def test_run_effects_name_the_farthest_run(leadscrew: Make) -> None:
    facts = dict(section_of(leadscrew(), 1).body.facts)
    farthest = "Run 0 lies farthest from the mean of the 5 runs: −2.0 ± 0.60 µm"
    assert farthest in facts["Runs"]
    none = dataclasses.replace(leadscrew().fit, runs=())
    alone = dataclasses.replace(leadscrew(), fit=none)
    assert "Runs" not in dict(section_of(alone, 1).body.facts)


@pytest.mark.parametrize("kind", ["leadscrew", "cross", "plane"])
def test_nothing_is_cut_off_and_every_axis_has_a_unit(
    kind: str, request: pytest.FixtureRequest
) -> None:
    fit = request.getfixturevalue(kind)()
    plots: tuple[Plot, ...] = tuple(section_of(fit, 1).body.plots)
    for plot in plots:
        figure = plot.figure
        figure.draw_without_rendering()
        width, height = figure.get_size_inches()
        box = figure.get_tightbbox()
        # A marker on the frame may stand out by half its size, 0.05 inch.
        assert box.x0 > -0.05, plot.name
        assert box.y0 > -0.05, plot.name
        assert box.x1 < width + 0.05, plot.name
        assert box.y1 < height + 0.05, plot.name
        assert plot.caption.endswith("."), plot.caption
        units = ("µm", "mm", "sd", "run", "row", "density", "readings per node")
        for axes in figure.axes:
            for text in (axes.get_xlabel(), axes.get_ylabel()):
                assert not text or any(unit in text for unit in units), text


@pytest.mark.parametrize(
    ("unit", "of_master", "error"), [("deg", "mm", "m°"), ("mm", "°", "µm")]
)
def test_masters_are_shown_in_their_own_unit_whatever_that_of_the_error(
    cross: Make, unit: str, of_master: str, error: str
) -> None:
    fit = dataclasses.replace(cross(), unit=unit, units=(of_master,))
    scale = scale_of(fit.unit)
    (axes,) = curve_plot(fit, readings_of(fit, scale), scale).figure.axes
    assert axes.get_xlabel() == f"X in {of_master}"
    assert axes.get_ylabel() == f"error of Y in {error}"
    place = branches_of(fit, scale)[0].where(0)
    assert place.endswith(of_master)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (-0.001, "0.00"), (-0.5, "−0.50"), (122.84, "122.8"),
     (1234.6, "1235"), (float("nan"), "–")],
)  # fmt: skip
def test_numbers_are_written_for_reading(value: float, text: str) -> None:
    assert number(value) == text


def test_shares_never_round_to_all_or_nothing() -> None:
    assert percent(0.0004) == "less than 0.1 %"
    assert percent(0.9996) == "more than 99.9 %"
    assert percent(1.0) == "100 %"
    assert place(-12.500) == "−12.5"
