"""Draws the pictures of the compensation pages from `axcomp.models` (``make docs``)."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axcomp import models
from axcomp.ident.report._style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    house_style,
    to_svg,
)

TRAVEL = np.linspace(-50.0, 450.0, 1001)
NODES = models.EquidistantNodes(0.0, 50.0, 9)
SAG = 1e-3 * np.array([0.0, 3.0, 6.0, 9.0, 10.0, 9.0, 5.0, 1.0, -2.0])


def _curve(axes: Axes, x: object, y: object, label: str, color: str = BLUE) -> None:
    axes.plot(np.asarray(x), 1e3 * np.asarray(y), color=color, label=label)


def _leadscrew(axes: Axes) -> None:
    table = models.Leadscrew(NODES, SAG, SAG + 0.004)
    for way, color, words in ((1.0, BLUE, "moving +"), (-1.0, ORANGE, "moving −")):
        offset = table.offset(TRAVEL, np.full(TRAVEL.shape, way))
        _curve(axes, TRAVEL, offset, f"offset, {words}", color)
    places = np.asarray(NODES.positions)
    axes.plot(places, 1e3 * SAG, "o", color=GREY, label="entries (error), moving +")
    axes.set(xlabel="position of the axis in mm", ylabel="µm")


def _cross(axes: Axes) -> None:
    _curve(axes, TRAVEL, models.Cross(NODES, -SAG).offset(TRAVEL), "offset of the axis")
    axes.plot(
        np.asarray(NODES.positions),
        -1e3 * SAG,
        "o",
        color=GREY,
        label="entries (offset)",
    )
    axes.set(xlabel="position of the master in mm", ylabel="µm")


def _plane(axes: Axes) -> None:
    table = models.Plane(NODES, NODES, 0.6 * SAG[:, None] + SAG[None, :])
    grid = np.linspace(-50.0, 450.0, 101)
    first, second = np.meshgrid(grid, grid)
    offset = table.offset(np.stack([first.ravel(), second.ravel()], axis=1))
    image = axes.pcolormesh(grid, grid, 1e3 * np.asarray(offset).reshape(first.shape),
                            cmap="RdBu_r", rasterized=True)  # fmt: skip
    axes.figure.colorbar(image, ax=axes, label="offset in µm")
    axes.set(xlabel="position of master 1 in mm", ylabel="position of master 2 in mm")


def _backlash(axes: Axes) -> None:
    time = np.linspace(0.0, 1.0, 400)
    position = 10.0 * np.sin(2 * np.pi * time)
    direction = np.sign(np.cos(2 * np.pi * time))
    offset = models.Backlash(0.006).offset(direction)
    axes.plot(time, position, color=GREY, label="position in mm")
    axes.plot(time, 1e3 * np.asarray(offset), color=BLUE, label="offset in µm")
    axes.set(xlabel="time in s")


def _temperature(axes: Axes) -> None:
    for warm, color in ((20.0, BLUE), (25.0, GREEN), (30.0, ORANGE)):
        growth = 1.1e-5 * (warm - 20.0)
        line = models.TemperatureLine(0.0, 2e-4 * (warm - 20.0), growth)
        offset = line.offset(TRAVEL, np.full((TRAVEL.size, 1), warm))
        _curve(axes, TRAVEL, offset, f"offset at {warm:g} °C", color)
    axes.set(xlabel="position of the axis in mm", ylabel="µm")


def _friction(axes: Axes) -> None:
    law = models.StribeckFriction(1.2, 2.0, 8.0, 1.5, 0.004)
    speed = np.linspace(-120.0, 120.0, 1201)
    knots = np.array([0.001, 4.0, 10.0, 20.0, 60.0, 130.0])
    listed = models.FrictionTable(models.Setpoints(knots), np.asarray(law(knots)))
    axes.plot(speed, np.asarray(law(speed)), color=GREY, label="law of friction")
    axes.plot(speed, np.asarray(listed(speed)), color=BLUE, label="list of 6 entries")
    axes.set(xlabel="velocity of the axis in mm/s", ylabel="current in A")


def _crosstalk(axes: Axes) -> None:
    law = models.Crosstalk(
        models.BilinearGrid((models.Setpoints([0.0, 400.0]),), (0, 1)),
        1e-3 * np.array([[2.0, 6.0], [2.0, 6.0], [-2.0, -6.0], [-2.0, -6.0]]),
        5000.0, -5000.0,
    )  # fmt: skip
    push = np.linspace(-7000.0, 7000.0, 501)
    for place, color in ((0.0, BLUE), (400.0, ORANGE)):
        where = np.full((push.size, 1), place)
        offset = law.offset(push, np.ones(push.size), where)
        _curve(axes, push, offset, f"offset, adaptation axis at {place:g} mm", color)
    axes.set(xlabel="acceleration of the master in mm/s²", ylabel="µm")


def draw(folder: Path) -> None:
    """Write one picture per compensation."""
    for make in (
        _leadscrew,
        _cross,
        _plane,
        _backlash,
        _temperature,
        _friction,
        _crosstalk,
    ):
        name = make.__name__.removeprefix("_")
        with house_style():
            figure = Figure(figsize=(6.2, 3.6), layout="constrained")
            axes = figure.subplots()
            make(axes)
            if axes.get_legend_handles_labels()[0]:
                figure.legend(loc="outside upper left", ncols=2)
            text = to_svg(figure, name)
        (folder / f"{name}.svg").write_text(text, "utf-8")


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
