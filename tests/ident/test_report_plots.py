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
from axcomp.ident.report._style import house_style, to_svg
from axcomp.ident.report.table._fitted import Fitted, branches_of
from axcomp.ident.report.table._lines import change_plot, curve_plot
from axcomp.ident.report.table._maps import cell_means, coverage_maps, error_map
from axcomp.ident.report.table._plane import hatch
from axcomp.ident.report.table._readings import bin_means, readings_of
from axcomp.ident.report.table._residuals import residual_plot, runs_plot
from axcomp.ident.report.table._spread import spread_of, spread_plot
from axcomp.ident.report.table._words import damped_wavelengths

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


def test_old_list_is_drawn_only_where_there_was_one(
    cross: Make, leadscrew: Make
) -> None:
    assert change_plot(leadscrew(old=False), MM) is None
    fit = cross(old=True)
    plot = change_plot(fit, MM)
    assert plot is not None
    assert fit.old_table is not None
    change = 1000 * (fit.table[""] - fit.old_table[""])
    largest = change[np.argmax(np.abs(change))]
    assert f"largest change is {number(largest, signed=True)} µm" in plot.caption


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
    table = Fitted(("X", "Y"), nodes, 0, none, none, np.where(mask, 0, 3))
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


def test_cell_means_put_each_reading_to_its_nearest_node(plane: Make) -> None:
    fit = plane(columns=5, rows=4, readings=300)
    readings = readings_of(fit, MM)
    table = branches_of(fit, MM)[0]
    cells = cell_means(table, readings)
    keep = readings.sound
    x, y = readings.positions[keep].T
    i = np.abs(table.nodes[0][:, None] - x).argmin(axis=0)
    j = np.abs(table.nodes[1][:, None] - y).argmin(axis=0)
    at = (i == 1) & (j == 2)
    assert cells.count[2, 1] == at.sum() > 0
    # Sums in another order differ by rounding only.
    assert cells.mean[2, 1] == pytest.approx(readings.predicted[keep][at].mean(), 1e-9)


def test_one_reading_per_node_is_judged_by_the_predicted_scatter(plane: Make) -> None:
    fit = plane(columns=65, rows=33, readings=900)
    readings = readings_of(fit, MM)
    cells = cell_means(branches_of(fit, MM)[0], readings)
    assert cells.basis == "predicted scatter"
    # 1 to 1.2 times the noise of 2 µm, a little less where two share a node.
    assert 1.7 < cells.chance < 2.4
    many = cell_means(branches_of(plane(), MM)[0], readings_of(plane(), MM))
    assert many.basis == "scatter of the readings"


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
    assert "Over X that is more than chance" in plot.caption


def test_error_bars_that_are_too_small_are_called_so(leadscrew: Make) -> None:
    fit = leadscrew()
    view = fit.samples
    small = dataclasses.replace(
        fit, samples=dataclasses.replace(view, predicted_sd=view.predicted_sd / 2)
    )
    honest, proud = (spread_plot(readings_of(f, MM), MM) for f in (fit, small))
    assert honest is not None
    assert proud is not None
    assert "taken at their word" in honest.caption
    assert "too small" in proud.caption


def test_spread_compares_like_with_like(plane: Make) -> None:
    spread = spread_of(readings_of(plane(), MM))
    assert spread is not None
    # The synthetic sd is 0 to 20 % too large, evenly; 3 600 readings give 1.2 %.
    stated = np.sqrt(np.mean((1 + 0.2 * np.linspace(0, 1, 1001)) ** 2))
    assert spread.ratio == pytest.approx(1 / stated, rel=0.04)


def test_few_readings_predicted_from_afar_say_nothing_of_the_others(
    leadscrew: Make,
) -> None:
    fit = leadscrew()
    wide = fit.samples.predicted_sd.copy()
    wide[:5] *= 50.0
    far = dataclasses.replace(
        fit, samples=dataclasses.replace(fit.samples, predicted_sd=wide)
    )
    plain, spread = (spread_of(readings_of(each, MM)) for each in (fit, far))
    assert plain is not None
    assert spread is not None
    # Five of them no longer count among the z.
    assert spread.ratio == pytest.approx(plain.ratio, rel=0.05)
    assert spread.predicted == pytest.approx(plain.predicted, rel=0.05)


def test_run_effects_name_the_farthest_run(leadscrew: Make) -> None:
    plot = runs_plot(leadscrew(), MM)
    assert plot is not None
    assert (
        "Run 0 lies farthest from the mean of the 5 runs: −2.0 ± 0.60 µm"
        in plot.caption
    )
    none = dataclasses.replace(leadscrew().fit, runs=())
    assert runs_plot(dataclasses.replace(leadscrew(), fit=none), MM) is None


def test_wavelength_in_the_text_is_damped_to_one_half(cross: Make) -> None:
    fit = cross(count=200)
    weights = {"order 2, axis 1": 40.0, "order 4, axis 1": 900.0}
    fit = dataclasses.replace(fit, fit=dataclasses.replace(fit.fit, smoothness=weights))
    (wavelength,) = damped_wavelengths(fit).values()
    assert wavelength is not None
    # Smooth a wave of that length on a ring of nodes, four readings at each.
    size = 200
    ring = np.eye(size)
    second = np.roll(ring, 1, 0) - 2 * ring + np.roll(ring, -1, 0)
    fourth = second @ second
    prior = 40 * second.T @ second + 900 * fourth.T @ fourth
    turns = round(size * (fit.nodes[0][1] - fit.nodes[0][0]) / wavelength)
    wave = np.cos(2 * np.pi * turns * np.arange(size) / size)
    smooth = np.linalg.solve(4 * np.eye(size) + prior, 4 * wave)
    # Whole turns on the ring: up to 2 % off the wavelength, steep in its 8th power.
    assert smooth[0] == pytest.approx(0.5, abs=0.08)


@pytest.mark.parametrize("kind", ["leadscrew", "cross", "plane"])
def test_nothing_is_cut_off_and_every_axis_has_a_unit(
    kind: str, request: pytest.FixtureRequest
) -> None:
    fit = request.getfixturevalue(kind)(old=True)
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


def test_many_equal_marks_carry_their_style_once(cross: Make) -> None:
    fit = cross()
    figure = curve_plot(fit, readings_of(fit, MM), MM).figure
    svg = to_svg(figure, "curve")
    marks = re.findall(r"<use [^>]*>", svg)
    assert len(marks) > 100
    assert sum("style=" in mark for mark in marks) < 0.2 * len(marks)


def test_rotary_axes_are_shown_in_thousandths_of_a_degree(cross: Make) -> None:
    fit = dataclasses.replace(cross(), unit="deg")
    scale = scale_of(fit.unit)
    (axes,) = curve_plot(fit, readings_of(fit, scale), scale).figure.axes
    assert axes.get_xlabel() == "X in °"
    assert axes.get_ylabel() == "error of Y in 0.001°"


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
