"""Fits, measurements and lists in a notebook."""

import dataclasses
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import axcomp
from axcomp.data.lists import ListFile

mpl.use("Agg")


@pytest.fixture(scope="module")
def fit() -> axcomp.Fit:
    rng = np.random.default_rng(5)
    x = np.tile(np.linspace(0.0, 400.0, 81), 3)
    way = np.tile(np.repeat([1.0, -1.0], 81), 2)[: x.size]
    error = 0.01 * np.sin(x / 60.0) + 0.004 * (way < 0) + 5e-4 * rng.normal(size=x.size)
    screw = axcomp.Leadscrew("X", start=0, interval=50, points=9, bilateral=True)
    return axcomp.fit([screw], {"X.position": x, "X.error": error, "X.direction": way})


def test_a_fit_shows_its_effects_and_its_scatter(fit: axcomp.Fit) -> None:
    page = fit._repr_html_()
    assert "<td>leadscrew</td><td>18</td>" in page
    assert "Scatter of one reading: X 0.000" in page
    head, row, scatter = repr(fit).splitlines()  # and no page of arrays
    assert head.split()[:2] == ["effect", "values"]
    assert row.split()[:2] == ["leadscrew", "18"]
    assert scatter.startswith("Scatter of one reading: X 0.000")


def test_a_plot_holds_the_values_of_the_model_at_its_nodes(fit: axcomp.Fit) -> None:
    (axes,) = fit.plot()
    drawn = np.asarray(axes.lines[0].get_xydata())
    model = fit["leadscrew"].model
    np.testing.assert_array_equal(drawn[:, 0], np.arange(9) * 50.0)
    np.testing.assert_array_equal(drawn[:, 1], np.asarray(model.pos))


def test_one_effect_is_drawn_into_the_axes_that_are_given(fit: axcomp.Fit) -> None:
    own = Figure().subplots()
    assert fit["leadscrew"].plot(own) is own


def test_a_measurement_shows_its_roles_with_unit_and_range(tmp_path: Path) -> None:
    file = tmp_path / "laser.csv"
    file.write_text("x,dx\n0,1\n10,3\n20,2\n")
    log = axcomp.read(file, {"X.position": "x", "X.error": ("dx", "um")})
    assert (
        "<td>X.error</td><td>mm</td><td>0.001</td><td>0.003</td>" in log._repr_html_()
    )


def test_a_name_with_signs_of_html_is_shown_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "laser.csv"
    file.write_text("x,dx\n0,1\n10,3\n")
    log = axcomp.read(file, {"X.position": "x", "X.error": "dx"})
    log = dataclasses.replace(log, name="<b>x</b>")
    assert "&lt;b&gt;x&lt;/b&gt;" in log._repr_html_()


def test_a_list_shows_its_entries_and_counts_the_rest() -> None:
    rows = "".join(f"kw.crosscomp.table[{k}].correction {k}\n" for k in range(100))
    page = ListFile.parse(
        f"kopf.achs_nr 3\n{rows}".encode(), "achskw3.lis"
    )._repr_html_()
    assert "<td>kopf.achs_nr</td><td>3</td>" in page
    assert "41 more entries" in page


@pytest.mark.parametrize(("times", "said"), [(1, True), (3, False)])
def test_a_scatter_that_no_reading_tells_is_called_a_guess(
    times: int, said: bool
) -> None:
    place = np.tile(np.arange(0.0, 101.0, 10.0), times)
    noise = 5e-4 * np.random.default_rng(1).normal(size=len(place))
    readings = {"X.position": place, "X.error": 0.01 * np.sin(place / 30) + noise}
    screw = axcomp.Leadscrew("X", start=0.0, interval=10.0, points=11)
    fit = axcomp.fit([screw], readings, smoothness=0, loss="gauss")
    assert ("scatter and standard deviations are a guess" in repr(fit)) == said
