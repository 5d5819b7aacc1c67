"""Errors over a volume: a known machine, measured in several ways, fitted and predicted."""

import dataclasses
import doctest
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import axcomp
from axcomp.ident.core import FitError
from axcomp.ident.volumetric import (
    Undetermined,
    VolumetricFit,
    _fit,
    undetermined_sentence,
)
from axcomp.models import GeometricErrors

NOISE = 1e-3
"""1 µm."""
MACHINE = axcomp.Geometry((0.0, 0.0, 0.0), (160.0, 140.0, 90.0), (6, 5, 5))
LOW, HIGH = MACHINE.volume
FUNCTIONS = [f"E{d}{a}" for a in "XYZ" for d in "XYZABC"]
TOOLS_ONLY = {"ECY", "EAZ", "EBZ", "ECZ"}
"""Rotations with nothing but the tool as a lever in the chain XYZ."""


def truth() -> GeometricErrors:
    """A machine with functions of some 10 µm and 10 µrad: offset, slope and a curve each."""
    rng = np.random.default_rng(0)
    errors: dict[str, np.ndarray | float] = {"EA0Z": 2e-5, "EB0Z": -1e-5, "EC0Y": 3e-5}
    for name in FUNCTIONS:
        count = MACHINE.points["XYZ".index(name[2])]
        along = np.linspace(0.0, 1.0, count)
        offset, slope, curve, phase = rng.normal(size=4)
        size = 1e-2 if name[1] in "XYZ" else 1e-5
        errors[name] = size * (
            offset + slope * along + curve * np.sin(3 * along + phase)
        )
    return GeometricErrors.of(MACHINE.nodes, errors)


TRUTH = truth()
Beams = Iterator[tuple[np.ndarray, np.ndarray]]
"""Positions and directions of one set-up after the other."""


def anywhere(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(LOW, HIGH, (count, 3))


def true(position: np.ndarray, tool: np.ndarray | None = None) -> np.ndarray:
    """Return the errors of the truth, of as many positions at a time: compiled once."""
    rows = np.resize(position, (1000, 3))
    tools = np.resize(np.zeros(3) if tool is None else tool, (1000, 3))
    return np.asarray(TRUTH.error(rows, tools))[: len(position)]


def measured(position: np.ndarray, tool: np.ndarray | None = None) -> np.ndarray:
    error = true(position, tool)
    return error + NOISE * np.random.default_rng(7).normal(size=error.shape)


def regular() -> np.ndarray:
    lines = [np.linspace(*ends) for ends in zip(LOW, HIGH, (9, 8, 7), strict=True)]
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)


def diagonals() -> np.ndarray:
    """The four body diagonals, 31 points each."""
    share = np.linspace(0.0, 1.0, 31)[:, None]
    starts = [LOW, *(np.where(np.arange(3) == k, HIGH, LOW) for k in range(3))]
    return np.concatenate([a + (HIGH + LOW - 2 * a) * share for a in starts])


def plane() -> np.ndarray:
    position = anywhere(500, 3)
    position[:, 2] = 120.0
    return position


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def named(fit: VolumetricFit) -> dict[str, set[str]]:
    """Shapes that are undetermined, by name, without what only other tools show."""
    found: dict[str, set[str]] = {}
    for each in fit.undetermined:
        for name, shapes in () if each.tools else each.shapes:
            found.setdefault(name, set()).update(shapes)
    return found


@pytest.fixture(scope="module")
def scattered() -> VolumetricFit:
    position = anywhere(500, 1)
    return axcomp.fit_volumetric(MACHINE, axcomp.Points(position, measured(position)))


# ----------------------------------------------------------------------- at unseen points


def test_500_points_with_1_um_noise_predict_unseen_points(
    scattered: VolumetricFit,
) -> None:
    unseen = anywhere(500, 2)
    found = scattered.predict(unseen)
    error = found.error - true(unseen)
    # 1.5 × noise is asked for; 1500 numbers of some 60 effective unknowns leave 0.2.
    assert rms(error) <= 0.4 * NOISE
    assert scattered.noise == pytest.approx(NOISE, rel=0.08)  # 3 sd of 1500 readings
    # The deviations are honest: their ratio is 1 within what smooth errors share.
    assert 0.7 < rms(error / found.standard_deviation) < 1.4


def remembering(shape: tuple[int, ...], seed: int) -> np.ndarray:
    """Noise that forgets a tenth from point to point, in each component by itself."""
    noise = NOISE * np.random.default_rng(seed).normal(size=shape)
    for k in range(1, len(noise)):
        noise[k] = 0.9 * noise[k - 1] + np.sqrt(1.0 - 0.9**2) * noise[k]
    return noise


def test_deviations_know_of_noise_that_remembers() -> None:
    # Line by line as a machine is measured: X back and forth, then Y, then Z.
    position = regular().reshape(9, 8, 7, 3).transpose(2, 1, 0, 3).copy()
    position[:, 1::2] = position[:, 1::2, ::-1]
    place, unseen, inside = position.reshape(-1, 3), anywhere(500, 2), []
    noises = [remembering(place.shape, seed) for seed in range(5)]
    fits = [
        axcomp.fit_volumetric(MACHINE, axcomp.Points(place, true(place) + noise))
        for noise in noises
    ]
    for fit in fits:
        found = fit.predict(unseen)
        ratio = np.abs(found.error - true(unseen)) / found.standard_deviation
        inside.append(np.mean(ratio < 2.0))
    # By white noise it would be 45 %.
    assert np.mean(inside) > 0.88
    assert "Points that follow each other err alike" in " ".join(fits[0].remarks())


def test_independent_noise_is_no_drift(scattered: VolumetricFit) -> None:
    assert scattered.drift is None
    assert "err alike" not in " ".join(scattered.remarks())


@pytest.mark.parametrize(
    ("limit", "number"),
    [pytest.param("_LARGE", 1, marks=pytest.mark.heavy), ("_MANY", 120)],
)
def test_many_unknowns_know_of_a_drift_by_their_shapes_and_first_points(
    limit: str, number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = from_set_ups([*circles(), *beams()])
    error = exact.error + remembering(exact.error.shape, 0)
    points, unseen = dataclasses.replace(exact, error=error), anywhere(100, 2)
    whole = axcomp.fit_volumetric(MACHINE, points).predict(unseen)
    monkeypatch.setattr(_fit, limit, number)
    rough = axcomp.fit_volumetric(MACHINE, points).predict(unseen)
    ratio = rough.standard_deviation / whole.standard_deviation
    # By white noise it would be half.
    assert 0.7 < np.median(ratio) < 1.3


def test_a_grid_predicts_unseen_points_of_a_machine() -> None:
    grid = axcomp.Volumetric((0.0, 0.0, 0.0), (160.0, 140.0, 90.0), (6, 5, 5))
    position, unseen = anywhere(500, 1), anywhere(500, 2)
    fit = axcomp.fit_volumetric(grid, axcomp.Points(position, measured(position)))
    error = fit.predict(unseen).error - true(unseen)
    assert rms(error) <= 1.5 * NOISE
    assert not fit.undetermined
    # The offsets of the model are what takes the error off.
    np.testing.assert_allclose(
        fit.model.offset(unseen), -fit.predict(unseen).error, rtol=0, atol=1e-12
    )


def test_what_lies_beyond_the_volume_is_unknown_and_said(
    scattered: VolumetricFit,
) -> None:
    assert "beyond the volume" not in " ".join(scattered.remarks())
    places = np.array([[800.0, 560, 360], [800.5, 560, 360], [820, 560, 360]])
    told = np.isfinite(scattered.predict(places).standard_deviation)
    assert told.all(axis=1).tolist() == [True, True, False]
    position = anywhere(300, 1)
    position[:7, 0] += HIGH[0]
    points = axcomp.Points(position, measured(position))
    fit = axcomp.fit_volumetric(MACHINE, points)
    far = position[:7, 0].max() - HIGH[0]
    assert (
        f"7 of 300 points lie beyond the volume of the model, by up to {far:.4g} mm "
        in (" ".join(fit.remarks()))
    )
    # A single node holds all along its axis.
    flat = axcomp.Geometry(MACHINE.start, MACHINE.interval, (6, 5, 1))
    assert not flat.beyond(anywhere(300, 1)).any()


def test_the_model_takes_off_all_but_the_frame(scattered: VolumetricFit) -> None:
    unseen = anywhere(500, 4)
    without = scattered.predict(unseen, frame=False).error
    np.testing.assert_allclose(
        scattered.model.offset(unseen), -without, rtol=0, atol=1e-12
    )
    assert scattered.frame is not None
    shift, turn = np.split(scattered.frame[0], 2)
    rigid = shift + np.cross(turn, unseen)
    np.testing.assert_allclose(
        scattered.predict(unseen).error - without, rigid, rtol=0, atol=1e-12
    )


# ------------------------------------------------------------------- what is determined


def test_quantities_that_no_gauge_touches_are_those_of_the_truth(
    scattered: VolumetricFit,
) -> None:
    model = scattered.model
    for name in set(FUNCTIONS) - TOOLS_ONLY:
        found, true = (np.asarray(each[name]) for each in (model, TRUTH))
        degree = 1 if name[1] == name[2] or name[1] in "ABC" else 2
        # Offsets (and slopes of straightness) belong to the gauge: taken off both.
        places = np.linspace(-1.0, 1.0, len(true))
        free = np.vander(places, degree)
        left = np.eye(len(true)) - free @ np.linalg.pinv(free)
        # Less than the noise of one reading, at the longest lever of an angle.
        lever = 1.0 if name[1] in "XYZ" else float(max(HIGH))
        assert rms(left @ (found - true)) * lever < 1.5 * NOISE, name


def test_the_squareness_is_that_of_the_truth_with_its_straightness(
    scattered: VolumetricFit,
) -> None:
    # Tilt of Y against X: the angle, both straightness slopes and the mean yaw of X.
    def slope(name: str) -> float:
        places = TRUTH.nodes["XYZ".index(name[2])].positions
        return float(np.polyfit(places, TRUTH[name], 1)[0])

    expected = (
        float(TRUTH["EC0Y"] + jnp.mean(TRUTH["ECX"])) - slope("EXY") - slope("EYX")
    )
    spread = float(scattered.standard_deviation["EC0Y"])
    assert abs(float(scattered.model["EC0Y"]) - expected) < 4.0 * spread
    assert spread < 1e-6  # less than 1 µm/m, or the test says nothing


def test_rules_fix_what_may_be_moved_and_say_so(scattered: VolumetricFit) -> None:
    zero = {gauge.zero for gauge in scattered.gauges}
    assert ("EXY", "slope") in zero
    assert ("EAX", "offset") in zero
    assert not {name for name, _ in zero} & {"EA0Z", "EB0Z", "EC0Y", "frame"}
    for name, shape in zero:
        values = np.asarray(scattered.model[name])
        line = np.polyfit(np.linspace(-1.0, 1.0, len(values)), values, 1)
        # Zero but for rounding of numbers of 1e-2.
        assert abs(line[0 if shape == "slope" else 1]) < 1e-12
    one = next(each for each in scattered.gauges if each.zero == ("EXY", "slope"))
    assert ("EC0Y", "angle") in one.among


def test_rotations_that_only_tools_show_are_named_and_zero(
    scattered: VolumetricFit,
) -> None:
    assert {each.names[0] for each in scattered.undetermined} == TOOLS_ONLY
    assert all(each.tools for each in scattered.undetermined)
    for name in TOOLS_ONLY:
        assert not np.asarray(scattered.model[name]).any()
        assert np.isinf(scattered.standard_deviation[name]).all()
    sentence = undetermined_sentence(scattered.undetermined[0])
    assert "only tools of different offsets do" in sentence
    # With another tool such errors would show: nothing is said of it.
    other = scattered.predict(anywhere(500, 1), tool=np.array([0.0, 0.0, -50.0]))
    assert np.isinf(other.standard_deviation).all()


def test_tools_of_different_offsets_tell_all_21_errors() -> None:
    rng, position = np.random.default_rng(5), anywhere(500, 1)
    tools = np.array([[0.0, 0, 0], [50, 20, -100], [0, 80, -200]])[
        rng.integers(0, 3, 500)
    ]
    points = axcomp.Points(position, measured(position, tools), tool=tools)
    fit = axcomp.fit_volumetric(MACHINE, points)
    assert fit.undetermined == ()
    unseen, tool = anywhere(500, 2), np.array([30.0, -40.0, -150.0])
    found = fit.predict(unseen, tool)
    error = found.error - true(unseen, tool)
    assert rms(error) <= 1.5 * NOISE
    assert np.isfinite(found.standard_deviation).all()


# ------------------------------------------------------------- three choices of points


def test_a_grid_of_points_determines_all_but_the_tools() -> None:
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(regular(), measured(regular())))
    assert named(fit) == {}
    unseen = anywhere(500, 2)
    assert rms(fit.predict(unseen).error - true(unseen)) < NOISE


def test_body_diagonals_with_a_laser_leave_scales_and_squareness_as_sums() -> None:
    place = diagonals()
    along = np.repeat(
        [place[31 * k + 30] - place[31 * k] for k in range(4)], 31, axis=0
    )
    unit = along / np.linalg.norm(along, axis=1)[:, None]
    error = np.sum(measured(place) * unit, axis=1)
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(place, error, along))
    found = named(fit)
    # Four readings at each distance from the middle against all functions there.
    assert {"slope", "curve"} <= found["EXX"] & found["EYY"] & found["EZZ"]
    assert {"EB0Z", "EC0Y", "frame"} <= set(found)
    assert np.isinf(fit.standard_deviation["EXX"]).all()
    assert np.isinf(fit.standard_deviation["EC0Y"])
    assert np.isinf(fit.predict(anywhere(500, 2)).standard_deviation).all()


@pytest.mark.parametrize("jitter", [0.0, 1e-6, 1e-3, 1e-2])
def test_what_a_laser_on_one_diagonal_leaves_open_stays_small(jitter: float) -> None:
    place = LOW + (HIGH - LOW) * np.linspace(0.0, 1.0, 100)[:, None]
    place = np.clip(
        place + jitter * np.random.default_rng(9).normal(size=place.shape), LOW, HIGH
    )
    along = np.tile(HIGH - LOW, (100, 1))
    error = np.sum(measured(place) * along, axis=1) / np.linalg.norm(HIGH - LOW)
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(place, error, along))
    # Levers along the beam show nothing: noise must not stand for what they would show.
    assert np.abs(fit.model.offset(anywhere(500, 2))).max() < 0.5
    assert np.isinf(fit.predict(anywhere(500, 2)).standard_deviation).all()


@pytest.mark.parametrize("kind", ["edges", "circles"])
def test_zeros_of_set_ups_do_not_enter_what_is_left_open(kind: str) -> None:
    points = from_set_ups(edges() if kind == "edges" else circles())
    run = np.asarray(points.run)
    far = np.random.default_rng(5).normal(size=run.max() + 1)[run]
    unseen, sizes = anywhere(500, 2), []
    for more in (0.0, far):
        moved = dataclasses.replace(points, error=points.error + more)
        fit = axcomp.fit_volumetric(MACHINE, moved)
        sizes.append(np.asarray(fit.model.offset(unseen)))
    # Zeros 20 times as large, and a machine of 60 µm: half of them went into its law.
    np.testing.assert_allclose(sizes[0], sizes[1], atol=NOISE)
    assert np.abs(sizes[1]).max() < 2.0 * np.abs(true(unseen)).max()


def test_body_diagonals_with_vectors_leave_curves_as_sums() -> None:
    place = diagonals()
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(place, measured(place)))
    found = named(fit)
    assert {"EXX", "EYY", "EZZ", "EXY", "EYZ"} <= set(found)
    assert all("curve" in found[name] for name in ("EXX", "EYY", "EZZ"))
    # On the diagonals themselves everything is known.
    known = fit.predict(place)
    assert np.isfinite(known.standard_deviation).mean() > 0.8
    assert rms(known.error - true(place)) < NOISE


def test_one_plane_leaves_what_z_does_and_angles_that_act_like_functions() -> None:
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(plane(), measured(plane())))
    groups = {each.names: each for each in fit.undetermined}
    # z is a constant lever: pitch of X acts like its position error.
    assert groups[("EXX", "EBX")].shapes == (
        ("EXX", ("slope", "curve")),
        ("EBX", ("slope", "curve")),
    )
    assert ("EYY", "EAY") in groups
    assert groups[("EZZ", "frame")].shapes[0] == ("EZZ", ("slope", "curve"))
    sentence = undetermined_sentence(groups[("EXX", "EBX")])
    assert "show only sums of EXX (slope, curve) and EBX (slope, curve)" in sentence
    # What the plane does tell stays good: the field on it, and the yaw of X.
    inside = plane()
    found = fit.predict(inside)
    assert rms(found.error - true(inside)) < 0.5 * NOISE
    assert np.isfinite(found.standard_deviation).all()
    assert np.isfinite(fit.standard_deviation["ECX"]).all()
    above = inside + np.array([0.0, 0.0, 150.0])
    assert np.isinf(fit.predict(above).standard_deviation).mean() > 0.9


def test_two_planes_leave_what_bends_along_z() -> None:
    position = plane()
    position[::2, 2] += 200.0
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(position, measured(position)))
    found = named(fit)
    assert all("curve" in found[name] for name in ("EXZ", "EYZ", "EZZ"))
    assert np.isfinite(fit.predict(position).standard_deviation).mean() > 0.9
    between = position * [1, 1, 0] + [0, 0, 220]
    assert np.isinf(fit.predict(between).standard_deviation).mean() > 0.9


def test_a_block_in_the_middle_lacks_places_towards_the_ends() -> None:
    inner = LOW + 0.25 * (HIGH - LOW) + 0.5 * regular()
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(inner, measured(inner)))
    lacking = [each for each in fit.undetermined if not each.tools]
    assert lacking
    for each in lacking:
        assert undetermined_sentence(each).endswith("out to the ends of X, Y and Z.")
    # Who follows it: nothing is left.
    both = np.concatenate([inner[::2], regular()[::2]])
    wide = axcomp.fit_volumetric(MACHINE, axcomp.Points(both, measured(both)))
    assert named(wide) == {}


def test_lasers_along_the_edges_lack_readings_across_them() -> None:
    place, along = map(np.concatenate, zip(*edges(), strict=True))
    run = np.repeat(np.arange(12), 41)
    error = np.sum(measured(place) * along, axis=1)
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(place, error, along, run=run))
    lacking = [each for each in fit.undetermined if not each.tools]
    assert lacking
    assert all("across the measured ones" in undetermined_sentence(e) for e in lacking)
    # Who follows it, with vectors on the same lines: nothing is left.
    vectors = axcomp.fit_volumetric(MACHINE, axcomp.Points(place, measured(place)))
    assert named(vectors) == {}


def test_a_plane_of_points_leaves_a_grid_without_its_third_axis() -> None:
    grid = axcomp.Volumetric((0.0, 0.0, 0.0), (160.0, 140.0, 90.0), (6, 5, 5))
    fit = axcomp.fit_volumetric(grid, axcomp.Points(plane(), measured(plane())))
    assert [each.names for each in fit.undetermined] == [("X",), ("Y",), ("Z",)]
    assert all("Z" in dict(each.shapes)[each.names[0]] for each in fit.undetermined)


# ---------------------------------------------------------------------- kinds of points


def test_readings_along_directions_from_set_ups_with_zeros_of_their_own() -> None:
    rng, position = np.random.default_rng(8), anywhere(900, 6)
    along = rng.normal(size=(900, 3))
    unit = along / np.linalg.norm(along, axis=1)[:, None]
    run = rng.integers(0, 3, 900)
    error = np.sum(measured(position) * unit, axis=1) + np.array([0.0, 5.0, -3.0])[run]
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(position, error, along, run=run))
    unseen = anywhere(500, 2)
    assert rms(fit.predict(unseen).error - true(unseen)) < 1.5 * NOISE
    assert named(fit) == {}


def circles() -> Beams:
    """Circles of a ball bar about nine centres, a set-up each, in three planes."""
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    for x in (180.0, 400.0, 620.0):
        for y in (180.0, 280.0, 380.0):
            for first, second in ((0, 1), (1, 2), (0, 2)):
                along = np.zeros((60, 3))
                along[:, first], along[:, second] = np.cos(turn), np.sin(turn)
                yield np.array([x, y, 180.0]) + 170.0 * along, along


def beams() -> Beams:
    """Lines through the volume: edges, and diagonals of the faces and of all of it."""
    corners = [LOW + (HIGH - LOW) * np.array(way) for way in np.ndindex(2, 2, 2)]
    for start, end in itertools.combinations(corners, 2):
        place = start + (end - start) * np.linspace(0.02, 0.98, 41)[:, None]
        yield place, np.tile((end - start) / np.linalg.norm(end - start), (41, 1))


def edges() -> Beams:
    """Those of the lines that go along one axis."""
    return ((place, along) for place, along in beams() if along[0].max() == 1.0)


def from_set_ups(set_ups: Iterable[tuple[np.ndarray, np.ndarray]]) -> axcomp.Points:
    """Readings of set-ups whose zero (length) and centre are off by some 50 and 20 µm."""
    rng = np.random.default_rng(4)
    places, ways, errors, runs = [], [], [], []
    for run, (place, along) in enumerate(set_ups):
        centre, zero = 0.02 * rng.normal(size=3), 0.05 * rng.normal()
        error = np.sum((true(place) - centre) * along, axis=1) + zero
        places.append(place)
        ways.append(along)
        errors.append(error + NOISE * rng.normal(size=len(place)))
        runs.append(np.full(len(place), run))
    return axcomp.Points(
        *map(np.concatenate, (places, errors, ways)), run=np.concatenate(runs)
    )


def test_the_unknown_centres_of_a_ball_bar_do_not_enter_the_errors() -> None:
    fit = axcomp.fit_volumetric(MACHINE, from_set_ups([*circles(), *beams()]))
    assert named(fit) == {}
    unseen = anywhere(500, 2)
    found = fit.predict(unseen)
    # Set-ups that stand anywhere show no shift and no turn of all: taken off.
    levers = np.stack([np.cross(axis, unseen) for axis in np.eye(3)], axis=-1)
    rigid = np.concatenate([np.tile(np.eye(3), (500, 1, 1)), levers], axis=-1)
    columns, error = rigid.reshape(-1, 6), (found.error - true(unseen)).ravel()
    error -= columns @ np.linalg.lstsq(columns, error)[0]
    # 3000 readings of some 150 effective unknowns: a third of the noise leaves room.
    assert rms(error) < 0.4 * NOISE
    assert fit.noise == pytest.approx(NOISE, rel=0.05)  # 3 sd of 3000 readings
    # The deviations are honest: their ratio is 1 within what smooth errors share.
    assert 0.6 < rms(error / found.standard_deviation.ravel()) < 1.4


def test_a_ball_bar_alone_leaves_the_scale_of_all_axes_and_says_so() -> None:
    fit = axcomp.fit_volumetric(MACHINE, from_set_ups(circles()))
    found = named(fit)
    # Scale of all axes, together with the lengths and the centres.
    assert all("slope" in found[name] for name in ("EXX", "EYY", "EZZ"))
    assert "zeros of the set-ups" in found
    assert np.isinf(fit.predict(anywhere(500, 2)).standard_deviation).mean() > 0.99


def test_wild_readings_are_left_out() -> None:
    position = anywhere(500, 1)
    error = measured(position)
    error[::40] += 0.5
    error[3, 1] = np.nan
    fit = axcomp.fit_volumetric(MACHINE, axcomp.Points(position, error))
    unseen = anywhere(500, 2)
    assert rms(fit.predict(unseen).error - true(unseen)) < 0.5 * NOISE


def test_a_chain_and_a_reference_far_from_the_machine_change_nothing_seen() -> None:
    position, unseen = anywhere(500, 1), anywhere(500, 2)
    points = axcomp.Points(position, measured(position))
    moved = axcomp.Geometry(
        MACHINE.start, MACHINE.interval, MACHINE.points, reference=(5e3, -5e3, 5e3)
    )
    near, far = (axcomp.fit_volumetric(each, points) for each in (MACHINE, moved))
    # The same space of errors; smoothness means another thing by a share of the noise.
    assert rms(near.predict(unseen).error - far.predict(unseen).error) < 0.3 * NOISE
    assert named(far) == {}
    other = axcomp.Geometry(
        *[MACHINE.start, MACHINE.interval, MACHINE.points], chain="ZYX"
    )
    wrong = axcomp.fit_volumetric(other, points)
    # Levers of the wrong chain do not describe the machine.
    assert wrong.noise > 1.15 * near.noise  # 1500 readings know it to 2 %


def test_a_measurement_file_gives_points(tmp_path: Path) -> None:
    position = anywhere(30, 1)
    roles = [f"{axis}.{kind}" for kind in ("position", "error") for axis in "XYZ"]
    rows = np.hstack([position, measured(position)])
    file = tmp_path / "points.csv"
    header = ",".join(f"{role} [mm]" for role in roles)
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.17g")
    columns = {role: (f"{role} [mm]", "mm") for role in roles}
    points = axcomp.Points.of(axcomp.read(file, columns))
    np.testing.assert_array_equal(points.position, position)
    np.testing.assert_array_equal(points.error, measured(position))


# --------------------------------------------------------------------------- refusals


def test_too_few_readings_are_refused() -> None:
    position = anywhere(4, 1)
    with pytest.raises(FitError, match="found 12 readings, expected more than 12"):
        axcomp.fit_volumetric(MACHINE, axcomp.Points(position, measured(position)))


@pytest.mark.other_types
def test_directions_and_tools_that_are_none_are_refused() -> None:
    position, flat = anywhere(4, 1), np.ones((4, 2))
    for name, error in (
        ("direction", np.zeros(4)),
        ("tool", np.zeros((4, 3))),
        ("run", np.zeros((4, 3))),
    ):
        wrong: Any = {name: flat}
        with pytest.raises(FitError, match=rf"{name}: found shape \(4, 2\), expected"):
            axcomp.Points(position, error, **wrong)
    along = np.array([[1.0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0]])
    with pytest.raises(FitError, match="direction: found 2 of length 0, expected"):
        axcomp.Points(position, np.zeros(4), along)


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    position = anywhere(4, 1)
    with pytest.raises(FitError, match=r"error: found shape \(4,\), expected \(4, 3\)"):
        axcomp.Points(position, np.zeros(4))
    for wrong in (np.zeros((4, 2)), np.zeros((0, 3)), np.zeros(3)):
        with pytest.raises(FitError, match=r"position: .* expected \(points, 3\)"):
            axcomp.Points(wrong, wrong)
    rows = np.arange(12.0).reshape(4, 3)
    lists: Any = rows.tolist()
    np.testing.assert_array_equal(
        axcomp.Points(lists, lists).readings.value, rows.ravel()
    )
    with pytest.raises(FitError, match="tool: found 2 rows, expected 4"):
        axcomp.Points(position, np.zeros((4, 3)), tool=np.zeros((2, 3)))
    nothing = axcomp.Points(position, np.full((4, 3), np.nan))
    with pytest.raises(FitError, match="no point with a position and an error"):
        axcomp.fit_volumetric(MACHINE, nothing)


def test_what_one_block_does_not_show_is_said_of_it_alone() -> None:
    alone = Undetermined((("EXZ", ("slope", "curve")),), 2, tools=False)
    assert "do not show EXZ (slope, curve): measure" in undetermined_sentence(alone)


def test_the_recipes_of_the_document_run_as_they_stand() -> None:
    recipes = Path(__file__).parents[3] / "docs" / "volumetric.md"
    found = doctest.testfile(str(recipes), module_relative=False)
    assert found.attempted > 10
    assert found.failed == 0
