"""How late an instrument is, told from the true error by changes of speed."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    MeasurementError,
    measurement,
    read_table,
    with_error,
    without_motion,
)
from axcomp.data.signals import (
    InstrumentClock,
    aligned_error,
    encoder_spline,
    estimate_instrument,
    last_direction,
    standing,
    travel_direction,
)

STEP = 0.002
NOISE = 0.0005
LATE, RATE = 0.0037, 2e-6


def path(time: np.ndarray) -> np.ndarray:
    """Return positions in mm of an axis that goes to and fro at changing speeds."""
    slow = 1.0 + 0.4 * np.sin(2 * np.pi * time / 17.0)
    return 150.0 + 120.0 * np.sin(2 * np.pi * time / 3.7) * slow


def true_error(time: np.ndarray) -> np.ndarray:
    """Return a pitch error and a backlash of 8 µm."""
    place = path(time)
    way = np.sign(path(time + 1e-5) - path(time - 1e-5))
    pitch = 4e-5 * place + 0.004 * np.sin(2 * np.pi * place / 300.0)
    return np.asarray(pitch - 0.004 * way)


def record(
    seed: int, seconds: float = 120.0, every: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time, encoder and a late reference with outliers."""
    rng = np.random.default_rng(seed)
    time = STEP * every * np.arange(round(seconds / STEP / every))
    at = time - LATE - RATE * time
    reference = path(at) + true_error(at) + NOISE * rng.standard_normal(time.size)
    wrong = rng.random(time.size) < 0.005
    reference[wrong] += rng.uniform(-0.05, 0.05, int(wrong.sum()))
    return time, path(time), reference


@pytest.mark.parametrize(
    "seeds", [range(1), pytest.param(range(1, 5), marks=pytest.mark.heavy)]
)
def test_delay_and_rate_lie_within_their_deviations_beside_error_and_backlash(
    seeds: range,
) -> None:
    scores, rates = [], []
    for seed in seeds:
        found = estimate_instrument(*record(seed))
        assert found.determined
        true = LATE + RATE * found.middle
        scores.append((found.delay - true) / found.standard_deviation)
        rates.append((found.rate - RATE) / found.rate_deviation)
        # 0.4 µm at 200 mm/s; the bow of the pitch within a window is most of it.
        assert found.standard_deviation < 2e-6
    # The bow counts as chance, so that the deviations are rather too large.
    assert np.sqrt(np.mean(np.square(scores))) < 2.0
    assert np.sqrt(np.mean(np.square(rates))) < 2.0


@pytest.mark.parametrize("every", [1, 5])
def test_error_that_is_left_is_the_true_one_with_its_noise(every: int) -> None:
    time, encoder, reference = record(3, every=every)
    clock = estimate_instrument(time, encoder, reference)
    found = aligned_error(time, encoder, reference, clock)
    assert found.valid.mean() > 0.95
    left = (found.error - true_error(found.instants))[found.valid]
    # The outliers stand apart; the rest scatters as the instrument does.
    spread = 1.4826 * np.median(np.abs(left - np.median(left)))
    assert spread == pytest.approx(NOISE, rel=0.05)


def test_backlash_at_one_speed_is_not_told_from_a_delay() -> None:
    time = STEP * np.arange(30_000)
    phase = np.mod(time, 4.0)
    encoder = 50.0 * np.where(phase < 2.0, phase, 4.0 - phase)
    rng = np.random.default_rng(1)
    reference = encoder + NOISE * rng.standard_normal(time.size)
    found = estimate_instrument(time, encoder, reference)
    assert not found.determined
    assert found.statement.startswith("the delay of the instrument cannot be told")


@pytest.mark.heavy  # what it moves is small beside one scatter
def test_side_from_which_an_axis_came_to_its_start_moves_no_delay() -> None:
    coarse, rest = 0.004, 0.6  # as noisy as the backlash is large: nothing stands out
    scores = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        time = STEP * np.arange(15_000)
        at = time - rest
        moves, seen = path(np.maximum(at, 0.0)), path(np.maximum(at - LATE, 0.0))
        # It sets off in positive direction, and has come to its start in negative one.
        error = true_error(np.maximum(at - LATE, 0.0)) + 0.008 * (at < LATE)
        reference = seen + error + coarse * rng.standard_normal(time.size)
        found = estimate_instrument(time, moves, reference)
        assert found.determined
        scores.append((found.delay - LATE) / found.standard_deviation)
    # Their mean scatters by 0.3; with the rows before the first motion it is 1.0.
    assert abs(np.mean(scores)) < 0.5


def test_axis_that_stands_tells_no_delay() -> None:
    time = STEP * np.arange(1000)
    found = estimate_instrument(time, np.full(1000, 3.0), np.full(1000, 3.001))
    assert not found.determined
    assert "nothing moves" in found.statement


def test_samples_too_far_apart_give_no_error_rather_than_a_wrong_one() -> None:
    time = 0.12 * np.arange(1000)
    hard = 40.0 * np.abs(np.sin(2 * np.pi * time / 5.0)) ** 3  # its jerk jumps
    rng = np.random.default_rng(5)
    dense = np.abs(np.sin(2 * np.pi * (time - 0.06) / 5.0)) ** 3
    reference = 40.0 * dense + NOISE * rng.standard_normal(time.size)
    clock = InstrumentClock(0.06, 0.0, 60.0, 0.0, 0.0, True, "late by half a sample")
    found = aligned_error(time, hard, reference, clock)
    spline = encoder_spline(time, hard)
    assert spline is not None
    raw = np.abs(reference - np.asarray(spline(clock.instants(time))))
    assert np.max(raw[1:]) > 0.01  # what a spline would make of the turns
    # Half the scatter at most is allowed for; the largest of 1000 readings is 3.5 times.
    assert np.abs(found.error[found.valid]).max(initial=0.0) < 5 * NOISE
    assert found.valid.mean() < 0.9


def test_direction_is_held_at_rest_and_taken_back_to_the_start() -> None:
    speed = np.array([0.0, 0.0, 5.0, 0.001, -3.0, 0.0, 2.0])
    found = last_direction(speed, 0.01)
    np.testing.assert_array_equal(found, [1, 1, 1, 1, -1, -1, 1])


def test_standing_begins_when_the_loop_has_settled() -> None:
    time = 0.1 * np.arange(20)
    place = np.where(np.arange(20) < 5, 10.0 * np.arange(20), 40.0)
    found = standing(time, place, settled=0.3)
    np.testing.assert_array_equal(np.flatnonzero(found), np.arange(7, 20))


def written(tmp_path, columns: dict[str, np.ndarray]):  # type: ignore[no-untyped-def]
    target = tmp_path / "log.csv"
    np.savetxt(
        target,
        np.column_stack(list(columns.values())),
        "%.7f",
        ",",
        header=",".join(columns),
        comments="",
    )
    return measurement(read_table(target))


def test_following_error_is_no_error_of_the_axis(tmp_path) -> None:  # type: ignore[no-untyped-def]
    time, encoder, reference = record(8, seconds=60.0, every=2)
    command = path(time + 0.02)  # the axis lags 20 ms behind it: up to 6 mm
    log = written(
        tmp_path,
        {
            "time": time,
            "X.position": command,
            "X.encoder": encoder,
            "X.actual": reference,
        },
    )
    found = with_error(without_motion(log, ["X"]), "X")
    at = found.values["time"]
    left = found.values["X.error"] - true_error(at)
    assert np.median(np.abs(left)) < NOISE
    # Tables meet the axis where it is, not where it is wanted to be.
    np.testing.assert_allclose(found.values["X.position"], path(at), atol=2e-4)
    assert any("which was taken off" in words for words in found.remarks)


def test_without_an_encoder_only_standstill_counts(tmp_path) -> None:  # type: ignore[no-untyped-def]
    time = 0.05 * np.arange(2000)
    phase = np.mod(time, 4.0)
    command = 20.0 * np.floor(time / 4.0) + 20.0 * np.clip(phase, 0.0, 1.0)
    lag = np.where(phase < 1.2, 0.5, 0.0)
    log = written(
        tmp_path,
        {"time": time, "X.position": command, "X.actual": command - lag + 0.003},
    )
    found = with_error(without_motion(log, ["X"]), "X")
    # The lag of half a millimetre is seen nowhere.
    np.testing.assert_allclose(found.values["X.error"], 0.003, atol=2e-7)
    assert found.rows > 1000
    assert any("at standstill count" in words for words in found.remarks)


@pytest.mark.parametrize(("stops", "kept"), [(10, False), (1, True)])
def test_a_rest_before_the_first_motion_counts_only_where_it_is_most_of_the_log(
    tmp_path: Path, stops: int, kept: bool
) -> None:
    # 4 s a stop. A single one beside 36 s at rest: another axis moved meanwhile.
    time = 0.05 * np.arange(20 * (4 if stops > 1 else 36) + 80 * stops)
    since = np.maximum(time - time[-1] + 4.0 * stops, 0.0)
    place = 20.0 * (np.floor(since / 4.0) + np.clip(np.mod(since, 4.0), 0.0, 1.0))
    log = written(
        tmp_path, {"time": time, "X.position": place, "X.actual": place + 0.003}
    )
    found = with_error(without_motion(log, ["X"]), "X")
    before = found.values["time"] < time[-1] - 4.0 * stops
    assert before.any() == kept
    assert (~before).any()


@pytest.mark.parametrize("late", [True, False])
def test_errors_that_a_logger_took_in_motion_are_freed_of_their_delay(
    tmp_path: Path, late: bool
) -> None:
    time, encoder, reference = record(8, seconds=60.0, every=2)
    if not late:
        noise = NOISE * np.random.default_rng(8).standard_normal(len(time))
        reference = encoder + true_error(time) + noise
    columns = {"time": time, "X.position": encoder, "X.error": reference - encoder}
    found = with_error(without_motion(written(tmp_path, columns), ["X"]), "X")
    left = found.values["X.error"] - true_error(found.values["time"])
    assert np.median(np.abs(left)) < NOISE
    assert any("follows its velocity" in words for words in found.remarks) == late


def test_motion_without_encoder_or_pause_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    time = 0.05 * np.arange(2000)
    log = written(
        tmp_path,
        {"time": time, "X.position": path(time), "X.actual": path(time - 0.01)},
    )
    with pytest.raises(MeasurementError, match="contains the following error"):
        without_motion(log, ["X"])


def test_readings_at_standstill_stay_as_they_are(tmp_path) -> None:  # type: ignore[no-untyped-def]
    time = 5.0 * np.arange(60)
    place = np.linspace(0.0, 300.0, 60)
    log = written(
        tmp_path, {"time": time, "X.position": place, "X.actual": place + 0.01}
    )
    assert without_motion(log, ["X"]) is log


@pytest.mark.parametrize(("size", "period"), [(1.0, 440.0), (3.0, 440.0), (1.0, 60.0)])
def test_a_pitch_error_that_bends_within_a_stroke_is_no_delay(
    size: float, period: float
) -> None:
    time = STEP * np.arange(12_000)
    # 100 mm/s there and back over 400 mm, turning at 500 mm/s².
    turn = np.convolve(
        np.where(time % 8.0 < 4.0, 100.0, -100.0), np.ones(100) / 100, "same"
    )
    place = np.cumsum(turn) * STEP
    error = size * (3e-5 * place + 0.006 * np.sin(2.0 * np.pi * place / period))
    noise = 3e-4 * np.random.default_rng(0).standard_normal(time.size)
    found = estimate_instrument(time, place, place + error + noise)
    # Taken for a line within 1.5 s, it made 7 µs per 6 µm, with a fourth of that as deviation.
    assert abs(found.delay) < 4.0 * found.standard_deviation
    assert found.standard_deviation < 5e-7


@pytest.mark.parametrize("waves", [0.5, 1.0, 2.0])
def test_a_backlash_that_bends_along_the_travel_is_no_delay(waves: float) -> None:
    time = 0.004 * np.arange(20_000)
    # Strokes of 300 mm at changing speeds, turning at 1000 mm/s² and less.
    speeds = np.tile([40.0, 80.0, 120.0, 60.0, 100.0, 30.0], 8)
    ends = np.cumsum([0.0, *(300.0 / speeds)])
    sharp = np.interp(time, ends, 300.0 * (np.arange(49) % 2))
    place = np.convolve(np.pad(sharp, 25, mode="edge"), np.ones(51) / 51, "valid")
    way = np.sign(np.gradient(place))
    play = 0.005 + 0.01 * np.sin(np.pi * waves * 2.0 * place / 300.0)
    noise = 5e-4 * np.random.default_rng(0).standard_normal(time.size)
    found = estimate_instrument(time, place, place - 0.5 * way * play + noise)
    # Taken for a line over the travel it made 14 to 20 µs, up to 15 times the deviation.
    assert abs(found.delay) < 4.0 * found.standard_deviation
    assert found.standard_deviation < 2e-6


def test_one_swing_again_and_again_tells_a_delay_beside_an_even_backlash() -> None:
    time = 0.004 * np.arange(15_000)
    # Its speed depends on the place alone: a backlash that bends would look like a delay.
    place = 100.0 * np.sin(2 * np.pi * time / 3.7)
    play = 0.004 * np.sign(np.gradient(place))
    noise = 5e-4 * np.random.default_rng(0).standard_normal(time.size)
    found = estimate_instrument(time, place, place - play + noise)
    assert found.determined
    assert abs(found.delay) < 4.0 * found.standard_deviation
    assert found.standard_deviation < 3e-7


@pytest.mark.parametrize(("noise", "digit"), [(0.0, 0.0), (1e-3, 0.0), (3e-3, 0.01)])
def test_what_an_encoder_flickers_while_it_stands_is_no_travel(
    noise: float, digit: float
) -> None:
    time = 0.004 * np.arange(5000)
    true = np.clip(
        100.0 * np.sin(time), -80.0, 80.0
    )  # stands for a second at both ends
    place = true + noise * np.random.default_rng(0).standard_normal(time.size)
    place = np.round(place / digit) * digit if digit else place
    found = travel_direction(place)
    speed = np.diff(true, prepend=true[0]) / 0.004
    moving = np.abs(speed) > 10.0
    wrong = found[moving] != np.sign(speed[moving])
    assert np.sum(wrong) == 0
    assert np.sum(np.diff(found) != 0) == 6


def test_after_a_stop_an_axis_stands_on_the_side_from_which_it_came() -> None:
    time, rate, top = 0.004 * np.arange(20_000), 2000.0, 100.0
    phase = np.mod(time, 9.0)  # to 400 mm, a rest, back, a rest
    ramp = np.minimum(
        np.minimum(np.mod(phase, 4.5), 4.05 - np.mod(phase, 4.5)), top / rate
    )
    speed = rate * np.maximum(ramp, 0.0) * np.where(phase < 4.5, 1.0, -1.0)
    place = np.concatenate([[0.0], np.cumsum(speed[:-1]) * 0.004])
    last = np.maximum.accumulate(np.where(speed != 0.0, np.arange(time.size), 0))
    way = np.sign(speed[last])
    noise = 3e-4 * np.random.default_rng(0).standard_normal(time.size)
    found = estimate_instrument(time, place, place + 0.003 * way + noise)
    # A spline through the samples swings after each stop; by its sign the play of 6 µm became
    # a delay of 35 µs, and a table had half of it with the other sign.
    assert abs(found.delay) < 4.0 * found.standard_deviation
    assert found.standard_deviation < 1e-6


def test_readings_at_a_stop_are_of_the_direction_in_which_the_axis_came(
    tmp_path,
) -> None:  # type: ignore[no-untyped-def]
    time = 0.005 * np.arange(20_000)
    stop, there = np.mod(time, 1.25), np.mod(time, 50.0) < 25.0
    # Every 1.25 s by 20 mm at 100 mm/s and 2000 mm/s², there and back, and a stop of 1 s.
    speed = 2000.0 * np.clip(np.minimum(stop, 0.25 - stop), 0.0, 0.05)
    way = np.where(there, 1.0, -1.0)
    place = np.concatenate([[0.0], np.cumsum((way * speed)[:-1]) * 0.005])
    error = 3e-3 * way + 3e-4 * np.random.default_rng(0).standard_normal(time.size)
    columns = {"time": time, "X.encoder": place, "X.actual": place + error}
    found = with_error(without_motion(written(tmp_path, columns), ["X"]), "X")
    lost = found.values["X.direction"] * found.values["X.error"]
    # Most of the readings stood, where a spline through the samples swings.
    assert np.mean(lost > 0.0) > 0.99


@pytest.mark.parametrize(
    "seeds", [range(2), pytest.param(range(2, 7), marks=pytest.mark.heavy)]
)
def test_play_beside_a_coarse_instrument_is_no_delay(seeds: range) -> None:
    ends = 20.0 + 560.0 * (np.arange(13) % 2)
    marks = np.cumsum([0.0, *np.repeat([9.0, 6.0, 14.0, 5.0, 7.5, 5.5], 2)])

    def strokes(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return place and direction on half cosines from end to end."""
        stroke = np.clip(np.searchsorted(marks, time, side="right") - 1, 0, 11)
        share = np.clip((time - marks[stroke]) / np.diff(marks)[stroke], 0.0, 1.0)
        way = np.diff(ends)[stroke]
        return ends[stroke] + way * (0.5 - 0.5 * np.cos(np.pi * share)), np.sign(way)

    time, scores = 0.004 * np.arange(23_000), []
    for seed in seeds:
        (now, _), (late, _) = strokes(time), strokes(time - LATE)
        way = strokes(time - LATE + 0.01)[1]  # it gives before the encoder has turned
        noise = 0.002 * np.random.default_rng(seed).standard_normal(time.size)
        found = estimate_instrument(time, now, late + 0.0025 * way + noise)
        assert found.determined
        scores.append((found.delay - LATE) / found.standard_deviation)
    # Their mean scatters by 0.7 and 0.45; with the rows at the turns, whose direction is not
    # known to the sample, it was -2.7.
    assert abs(np.mean(scores)) < 1.35
