"""Files as instruments and spreadsheets leave them, each with the truth behind it.

All truths are errors (actual − commanded) in mm over positions in mm.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

Array = Float[np.ndarray, " n"]
Error = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Error in mm over positions in mm and directions."""


def screw(x: Array, way: Array) -> Array:
    """Return the error of a screw that is too long, bent, and loses motion."""
    return 4e-5 * x + 4e-3 * np.sin(x / 130.0) - 2.5e-3 * (1.0 - way)


def beam(x: Array) -> Array:
    """Return how far a bent beam pushes the axis on it aside."""
    return 9e-3 * np.sin(np.pi * x / 600.0)


def table(x: Array, y: Array) -> Array:
    """Return the height of a table that is not flat."""
    return 8e-3 * np.sin(x / 150.0) * np.cos(y / 120.0)


GROWTH, CROSSING = 1.1e-5, -200.0
"""Per K, and the place in mm that does not move."""


def growth(x: Array, temperature: Array) -> Array:
    """Return the error of a scale that grows."""
    return GROWTH * (temperature - 20.0) * (x - CROSSING)


def friction(velocity: Array) -> Array:
    """Return the current in A that friction takes at a speed in mm/s."""
    size = np.abs(velocity)
    law = 1.6 + 0.7 * np.exp(-((size / 4.0) ** 2)) + 0.006 * size
    return np.sign(velocity) * law


def _comma(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def laser_text(error_of: Error, seed: int = 11) -> str:
    """Return a German laser table: titles, semicolons, decimal commas, words for ways."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0.0, 600.0, 31)
    lines = ["Positioniermessung Portalfräse 7", "Achse: X", ""]
    lines += ["Lauf;Richtung;Soll;Abweichung", ";;mm;µm"]
    for run in range(1, 6):
        shift = 4e-4 * rng.normal()
        for way, places in ((1.0, x), (-1.0, x[::-1])):
            error = error_of(places, np.full(31, way)) + 0.0131 + shift
            error += 6e-4 * rng.normal(size=31)
            word = "vorwärts" if way > 0 else "rückwärts"
            lines += [
                f"{run};{word};{_comma(place, 3)};{_comma(1e3 * value, 2)}"
                for place, value in zip(places, error, strict=True)
            ]
    return "\n".join(lines) + "\n"


def write_laser(path: Path) -> None:
    """Write what a laser shows of a screw, all compensations off."""
    path.write_text(laser_text(screw), encoding="utf-8")


def write_straightness(path: Path) -> None:
    """A straightedge that lies askew, read with a gauge three times along X."""
    rng = np.random.default_rng(12)
    x = np.linspace(0.0, 600.0, 31)
    lines = ["Straightness of the beam, 20 Nov 2026", "run,x,straightness Y", ",mm,um"]
    for run in range(1, 4):
        reading = beam(x) - 0.212 + 6.5e-5 * x + 8e-4 * rng.normal(size=31)
        lines += [
            f"{run},{place:.1f},{1e3 * value:.1f}"
            for place, value in zip(x, reading, strict=True)
        ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_probe(path: Path) -> None:
    """A probed table: a clamp hides a corner, a chip lay under the ball once."""
    rng = np.random.default_rng(13)
    places = [
        (x, y)
        for y in np.linspace(0.0, 300.0, 13)
        for x in np.linspace(0.0, 500.0, 21)
        if not (x < 90.0 and y > 230.0)
    ]
    x, y = np.array(places).T
    dz = table(x, y) + 0.045 + 8e-4 * rng.normal(size=len(x))
    dz[100] += 0.35
    rows = zip(x, y, dz, strict=True)
    lines = ["x [mm];y [mm];dz [mm]", *(f"{a:.1f};{b:.1f};{c:.4f}" for a, b, c in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


SPEEDS = (0.6, 1.5, 4.0, 10.0, 25.0, 60.0, 150.0)
CYCLE = 0.002


def write_scope(path: Path) -> None:
    """A Scope text export of a drive: constant speeds, forth and back, torque feedback."""
    rng = np.random.default_rng(14)
    count, ramp = 350, 60
    rise = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1.0, np.arange(count) / ramp))
    shape = rise * rise[::-1]
    velocity = np.concatenate([way * v * shape for v in SPEEDS for way in (1.0, -1.0)])
    current = 0.004 * np.gradient(velocity, CYCLE) + friction(velocity)
    current = -current + 0.05 * rng.normal(size=velocity.size)
    place = 100.0 + np.cumsum(velocity) * CYCLE
    head = [
        "Name\tX axis friction",
        "File\tC:\\Scope\\x_friction.csv",
        "Starttime of export\t132959733843760000\tMontag\t15:56",
        "Endtime of export\t132959733843780000\tMontag\t15:56",
        "",
        "Name\tX.ActPos\tName\tX.ActCurrent",
        "SampleTime[ms]\t2\tSampleTime[ms]\t2",
        "Unit\tmm (Length)\tUnit\tA (Current)",
        "",
    ]
    rows = [
        f"{_comma(2.0 * k, 0)}\t{_comma(x, 5)}\t{_comma(2.0 * k, 0)}\t{_comma(i, 4)}"
        for k, (x, i) in enumerate(zip(place, current, strict=True))
    ]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


def write_thermal(path: Path) -> None:
    """Four hours of warming and cooling, the error read at six places in turn."""
    rng = np.random.default_rng(15)
    time = np.arange(0.0, 4 * 3600.0, 60.0)
    since = np.maximum(time - 0.6 * time[-1], 0.0)
    warm = (1.0 - np.exp(-time / 3000.0)) * np.exp(-since / 3000.0)
    sensor = 20.0 + 18.0 * warm + 0.02 * rng.normal(size=time.size)
    x = np.linspace(0.0, 1000.0, 6)[np.arange(time.size) % 6]
    error = growth(x, 20.0 + 18.0 * warm) + 5e-4 * rng.normal(size=time.size)
    lines = ["time,X [mm],error X [um],T_scale [°C]"]
    for k, each in enumerate(zip(x, error, sensor, strict=True)):
        stamp = f"2026-11-20 {8 + k // 60:02d}:{k % 60:02d}:00"
        lines.append(f"{stamp},{each[0]:.1f},{1e3 * each[1]:.2f},{each[2]:.3f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_motion(path: Path) -> None:
    """A laser beside the encoder while X goes forth and back at changing speeds."""
    rng = np.random.default_rng(16)
    step, delay, lag = 0.004, 0.0031, 0.01
    marks, ends = [0.0], [20.0]
    for k, speed in enumerate((60.0, 90.0, 40.0, 120.0, 75.0, 100.0)):
        for end in ((590.0, 10.0), (560.0, 30.0))[k % 2]:
            marks.append(marks[-1] + abs(end - ends[-1]) / speed)
            ends.append(end)
    time = np.arange(0.0, marks[-1], step)
    commanded, speed = _strokes(time, marks, ends)
    late, slower = _strokes(time - delay, marks, ends)
    seen = late - lag * slower
    error = screw(seen, np.where(slower < 0.0, -1.0, 1.0)) + 0.31
    actual = seen + error + 2e-3 * rng.normal(size=time.size)
    encoder = commanded - lag * speed + 1e-5 * rng.normal(size=time.size)
    header = "t [s],X_soll [mm],X_ist [mm],X_laser [mm]"
    columns = np.column_stack([time, commanded, encoder, actual])
    np.savetxt(path, columns, "%.5f", ",", header=header, comments="")


def _strokes(time: Array, marks: list[float], ends: list[float]) -> tuple[Array, Array]:
    """Return place and speed on soft strokes: half a cosine from end to end."""
    place, speed = np.full(time.size, ends[0]), np.zeros(time.size)
    for k in range(len(marks) - 1):
        inside = (time >= marks[k]) & (time < marks[k + 1])
        length, way = marks[k + 1] - marks[k], ends[k + 1] - ends[k]
        phase = np.pi * (time[inside] - marks[k]) / length
        place[inside] = ends[k] + way * (0.5 - 0.5 * np.cos(phase))
        speed[inside] = 0.5 * np.pi * way / length * np.sin(phase)
    return place, speed


def pushed(acceleration: Array, place: Array) -> Array:
    """Return how far a carriage pushes the axis that it carries, more at the far end."""
    return 5e-6 * acceleration * (0.5 + place / 600.0)


def write_pushed(path: Path) -> None:
    """A scope trace: what Y does while X, recorded with its acceleration, moves sharply."""
    rng = np.random.default_rng(17)
    step, rest = 0.004, 60
    parts, place = [np.zeros((rest, 2))], 0.0
    for _ in range(60):
        goal, hard = rng.uniform(0.0, 600.0), rng.uniform(800.0, 2000.0)
        half = max(2, round(np.sqrt(abs(goal - place) / hard) / step))
        push = (goal - place) / (half * step) ** 2
        a = np.concatenate([np.full(half, push), np.full(half, -push), np.zeros(rest)])
        v = step * np.cumsum(a)
        parts.append(np.column_stack([a, place + step * np.cumsum(v - 0.5 * step * a)]))
        place = goal
    a, x = np.concatenate(parts).T
    time = step * np.arange(a.size)
    y = 150.0 + 100.0 * np.sin(time / 7.0)
    error = 1e3 * pushed(a, x) + 0.5 * rng.normal(size=time.size)
    header = "t [s],x [mm],x acceleration [mm/s^2],y [mm],dy [um]"
    columns = np.column_stack([time, x, a, y, error])
    np.savetxt(path, columns, "%.5f", ",", header=header, comments="")
