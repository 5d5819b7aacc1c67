"""Planted backlash comes back from bidirectional readings and from reversals in traces."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import read_table
from axcomp.ident.fit import FitError
from axcomp.ident.kinds.backlash._trace import fit_backlash_trace
from axcomp.ident.kinds.backlash.effect import fit_backlash

NAME = "ess_b02_X_9pos5cyc_ISO230.dat"
ISO = Path(__file__).parents[4] / "shared/data/iso230" / NAME
TARGETS = np.arange(0.0, 401.0, 40.0)  # mm
RUNS = 5


def cycles(
    seed: int, width: float, *, tilt: float = 0.0, drift: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bidirectional runs in mm: position, error, direction, run."""
    rng = np.random.default_rng(seed)
    position = np.tile(np.r_[TARGETS, TARGETS[::-1]], RUNS)
    direction = np.tile(np.repeat([1, -1], len(TARGETS)), RUNS)
    run = np.repeat(np.arange(RUNS), 2 * len(TARGETS))
    local = width + tilt * (position / 200.0 - 1.0)
    error = 0.01 * np.sin(position / 90.0) - 0.5 * direction * local
    error += drift * np.arange(len(position)) / len(position)
    error += 1e-3 * rng.normal(size=len(position))
    return position, error, direction, run


@pytest.mark.parametrize("width", [0.012, -0.02])
def test_bidirectional_readings_give_size_and_sign(width: float) -> None:
    position, error, direction, run = cycles(1, width)
    fit = fit_backlash(position, error, direction, run=run)
    # 110 readings of 1 µm: a deviation of 0.19 µm; three of them.
    assert abs(fit.width - width) < 6e-4
    assert fit.significant
    assert fit.kind.startswith("positive" if width > 0 else "negative")
    assert fit.support == (55, 55)
    assert fit.dependence is not None
    assert not fit.dependence.significant


@pytest.mark.heavy
def test_the_planted_width_lies_within_the_stated_deviation_at_the_right_rate() -> None:
    distances = []
    alarms = 0
    for seed in range(40):
        position, error, direction, run = cycles(seed, 0.012)
        fit = fit_backlash(position, error, direction, run=run)
        distances.append((fit.width - 0.012) / fit.standard_deviation)
        assert fit.dependence is not None
        alarms += fit.dependence.significant
    # 95 % of 40 within two deviations; 7 misses have a chance below 0.4 %.
    assert (np.abs(distances) < 2.0).mean() > 0.84
    # Deviations twice too large would put 95 % within one.
    assert (np.abs(distances) < 1.0).mean() < 0.85
    assert alarms <= 2  # of 40 at a level of 1 %, and only where it matters


def test_a_drift_within_the_runs_is_not_taken_for_backlash_in_silence() -> None:
    position, error, direction, run = cycles(7, 0.012, drift=0.05)
    fit = fit_backlash(position, error, direction, run=run)
    assert fit.drift is not None
    # 50 µm over five runs: 9.5 µm within each. Drift and direction go together, so that
    # 110 readings of 1 µm tell the one to 0.7 µm and the other to 0.4 µm; three of these.
    assert fit.drift[0] == pytest.approx(0.0095, abs=2e-3)
    assert abs(fit.drift[1] - 0.012) < 1.2e-3
    assert abs(fit.width - 0.012) > 2e-3


def test_the_compensation_takes_the_step_away() -> None:
    position, error, direction, _ = cycles(1, 0.012)
    fit = fit_backlash(position, error, direction)
    for reference in (1, -1):
        model = fit.compensation(reference=reference)
        left = error + np.asarray(model.offset(direction.astype(float)))
        again = fit_backlash(position, left, direction)
        # The fit is linear but for the loss: what is left is rounding and its tolerance.
        assert abs(again.width) < 1e-5


def test_a_backlash_that_changes_along_the_axis_asks_for_a_table() -> None:
    position, error, direction, run = cycles(2, 0.012, tilt=0.006)
    fit = fit_backlash(position, error, direction, run=run)
    assert fit.dependence is not None
    assert fit.dependence.significant
    # From end to end 12 µm, each end known to about half a µm.
    np.testing.assert_allclose(fit.dependence.slope, 0.012, atol=2.5e-3)


def test_wild_readings_do_not_move_the_width() -> None:
    position, error, direction, run = cycles(3, 0.012)
    error[[5, 40, 77]] += 0.5
    fit = fit_backlash(position, error, direction, run=run)
    assert np.flatnonzero(fit.sides.wild).tolist() == [5, 40, 77]
    assert abs(fit.width - 0.012) < 6e-4


def test_positions_all_different_are_bridged_by_nodes() -> None:
    rng = np.random.default_rng(4)
    position = 400.0 * rng.random(400)
    direction = rng.choice([-1, 1], 400)
    error = 0.01 * np.sin(position / 90.0) - 0.5 * direction * 0.012
    error += 1e-3 * rng.normal(size=400)
    fit = fit_backlash(position, error, direction)
    # 400 readings of 1 µm: 0.1 µm; three of them.
    assert abs(fit.width - 0.012) < 3e-4


def test_no_backlash_is_reported_where_there_is_none() -> None:
    position, error, direction, run = cycles(5, 0.0)
    fit = fit_backlash(position, error, direction, run=run)
    assert not fit.significant
    assert fit.kind == "no backlash shows"


def test_a_direction_that_only_wild_readings_show_determines_no_backlash() -> None:
    rng = np.random.default_rng(0)
    position = np.concatenate([np.tile(TARGETS, 4), [80.0, 240.0, 320.0, 160.0]])
    direction = np.repeat([1, -1], [4 * len(TARGETS), 4])
    error = 1e-3 * rng.normal(size=len(position))
    # They contradict each other by a thousand times the noise of the others.
    error[direction < 0] = [1.0, -1.0, 0.5, -0.3]
    with pytest.raises(
        FitError, match="agree with each other do not determine the backlash"
    ):
        fit_backlash(position, error, direction)


def test_one_direction_alone_is_refused() -> None:
    position, error, direction, _ = cycles(1, 0.012)
    up = direction == 1
    with pytest.raises(FitError, match="no reading was approached in negative"):
        fit_backlash(position[up], error[up], direction[up])


def test_directions_at_different_places_are_refused() -> None:
    position, error, direction, _ = cycles(1, 0.012)
    apart = np.where(direction > 0, position, position + 1000.0)
    with pytest.raises(FitError, match="no place was approached in both directions"):
        fit_backlash(apart, error, direction)


def trace(
    seed: int,
    width: float,
    *,
    delay: float = 0.0,
    speeds: tuple[float, ...] = (20.0, 40.0, 80.0),
    uptake: float = 0.0,
    turns: int = 12,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A motion to and fro at 1 kHz: time, position, error in s and mm."""
    rng = np.random.default_rng(seed)
    parts, place = [], 0.0
    for number in range(2 * turns):
        speed = speeds[(number // 2) % len(speeds)]
        length = 20.0 + 10.0 * ((number // 2) % 3)
        share = np.arange(1, int(1000.0 * length / speed) + 1) * speed / (1e3 * length)
        smooth = length * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
        parts.append(place + (-1) ** number * smooth)
        place = float(parts[-1][-1])
    position = np.concatenate(parts)
    time = 1e-3 * np.arange(len(position))
    velocity = np.gradient(position, time)
    play = np.sign(velocity)
    if uptake > 0:
        play = np.empty(len(position))
        play[0], slope = 1.0, 2.0 / uptake
        for row in range(1, len(position)):
            step = slope * (position[row] - position[row - 1])
            play[row] = np.clip(play[row - 1] + step, -1.0, 1.0)
    error = 0.003 * np.sin(position / 10.0) - 0.5 * width * play - delay * velocity
    return time, position, error + 5e-4 * rng.normal(size=len(time))


@pytest.mark.parametrize("width", [0.015, -0.008])
def test_reversals_of_a_trace_give_the_width(width: float) -> None:
    fit = fit_backlash_trace(*trace(1, width), reach=5.0)
    # 24 strokes have 23 turns between them; the jitter of the reading is no reversal.
    assert len(fit.sides.before) == 2 * 23
    assert fit.support == (11, 12)
    # The deviation is 0.05 µm; three of them.
    assert abs(fit.width - width) < 2e-4
    assert fit.kind.startswith("positive" if width > 0 else "negative")


@pytest.mark.heavy
def test_widths_from_traces_scatter_as_stated() -> None:
    distances, delays = [], []
    for seed in range(30):
        fit = fit_backlash_trace(*trace(seed, 0.015, delay=2e-4), reach=5.0)
        assert fit.delay is not None
        distances.append((fit.width - 0.015) / fit.standard_deviation)
        delays.append((fit.delay[0] - 2e-4) / fit.delay[1])
    for each in (distances, delays):
        # 30 draws: a scatter of 1 is seen as 0.67 to 1.34 in 99 %; small samples of
        # reversals add a little.
        assert 0.6 < np.std(each) < 1.45
        assert abs(np.mean(each)) < 0.6


def test_a_delay_of_the_instrument_is_not_taken_for_backlash() -> None:
    # 0.5 ms at 80 mm/s is 80 µm between the directions, five times the backlash.
    fit = fit_backlash_trace(*trace(2, 0.015, delay=5e-4), reach=5.0)
    assert fit.delay is not None
    assert abs(fit.width - 0.015) < 3e-4
    np.testing.assert_allclose(fit.delay[0], 5e-4, rtol=0.01)


def test_at_delay_gain_the_delay_cannot_be_told_and_is_warned_of() -> None:
    rng = np.random.default_rng(3)
    # A triangle at 40 mm/s over 20 mm, at 1 kHz.
    time = 1e-3 * np.arange(12000)
    position = np.abs((40.0 * time) % 40.0 - 20.0)
    way = np.sign(np.gradient(position, time))
    error = -0.5 * 0.015 * way + 5e-4 * rng.normal(size=len(time))
    fit = fit_backlash_trace(time, position, error, reach=5.0)
    assert fit.delay is None
    # Twice the speed lies between the directions.
    assert fit.delay_gain == pytest.approx(80.0, rel=1e-3)


def test_play_that_is_taken_up_on_the_way_counts_whole() -> None:
    fit = fit_backlash_trace(*trace(4, 0.015, uptake=1.0), reach=6.0)
    # The first fifth of the reach, 1.2 mm, is left out: the play is taken up in 1 mm.
    assert abs(fit.width - 0.015) < 3e-4


def test_a_trace_without_reversals_is_refused() -> None:
    time = 1e-3 * np.arange(2000)
    with pytest.raises(FitError, match="found 0 reversals with readings within 5"):
        fit_backlash_trace(time, 40.0 * time, np.zeros(2000), reach=5.0)


def test_a_reach_that_is_none_is_refused() -> None:
    time = 1e-3 * np.arange(20)
    with pytest.raises(FitError, match=r"reach: found 0\.0, expected"):
        fit_backlash_trace(time, time, time, reach=0.0)


def test_the_width_of_a_real_axis_is_minus_the_mean_reversal_of_iso_230() -> None:
    if not ISO.exists():
        pytest.skip(f"needs ../shared/data/iso230/{NAME}")
    table = read_table(ISO)
    target, actual, run, direction = (
        table.column(name).values for name in ("target", "actual", "run", "direction")
    )
    fit = fit_backlash(
        target,
        actual - target,
        direction.astype(int),
        run=run.astype(int),
        loss="gauss",
    )
    # Nine targets by five runs both ways, nothing missing: least squares is the mean of the
    # published reversal values, −25.4 µm to the digit printed.
    np.testing.assert_allclose(fit.width, 0.0254, atol=5e-5)
    assert fit.kind.startswith("positive")
    # The published B of 33.6 µm beside a mean of 25.4: it is not the same everywhere.
    assert fit.dependence is not None
