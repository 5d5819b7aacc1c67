"""A machine with every fault at once, moving: one fit finds them, in truth and in sum."""

import dataclasses

import numpy as np
import pytest

from axcomp.data.measurements import Measurement
from axcomp.ident.fit.joint import (
    JointData,
    JointFit,
    Part,
    Temperature,
    fit_joint,
)
from axcomp.ident.machine import MotionLog, State, WorkingMachine

from ..joint.gauge import in_gauge
from .whole import AXES, NOISE, in_deviations, in_the_workspace


def held_out(fit: JointFit, data: JointData, kept: np.ndarray) -> dict[str, np.ndarray]:
    """Return what the fit leaves of rows it did not see, the instrument's drift aside."""
    found = {}
    for axis, value in fit.predict(data, runs=True).items():
        left = data.error[axis] - value
        found[axis] = left[np.isfinite(left) & ~kept]
    return found


def size(values: np.ndarray) -> float:
    """Return the standard deviation that most of the values show."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


@pytest.mark.slow
def test_what_is_held_out_is_left_with_the_noise(
    fit: JointFit, readings: JointData, kept: np.ndarray
) -> None:
    for left in held_out(fit, readings, kept).values():
        # 2 000 rows tell it to 2 %; the coarse nodes of this small machine add a little.
        assert size(left) < 1.08 * NOISE


@pytest.mark.slow
def test_sum_of_all_effects_is_the_error_all_over_the_workspace(
    fit: JointFit, machine: WorkingMachine, everywhere: tuple[JointData, State]
) -> None:
    for axis, wrong in in_the_workspace(fit.parts, machine, everywhere).items():
        assert np.percentile(np.abs(wrong), 99) < 0.001, axis


@pytest.mark.slow
def test_tables_lie_within_their_deviations_though_the_reference_wanders(
    fit: JointFit, machine: WorkingMachine
) -> None:
    away = in_deviations(fit, machine)
    assert len(away) == 10
    for name, ratio in away.items():
        # Gaussian values: 0.3 % beyond; those of a smooth table go together.
        assert np.mean(np.abs(ratio) < 3.0) >= 0.95, name
    every = np.concatenate(list(away.values()))
    # Nor are they too wide; 500 values, some 100 of them by themselves.
    assert 0.7 < np.sqrt(np.mean(np.square(every))) < 1.3


@pytest.mark.slow
def test_backlash_and_growth_come_out_beside_all_the_others(fit: JointFit) -> None:
    for axis, width in (("Y", 0.006), ("Z", 0.004)):
        part = fit.part(f"backlash of {axis}")
        # Coarse nodes and a delay of 1 µs at 200 mm/s leave a tenth of the noise.
        assert part.values[0] == pytest.approx(width, abs=8e-5)
    grown = fit.part("temperature of X (scale)")
    assert isinstance(grown.effect, Temperature)
    nodes = grown.effect.nodes["coefficient"]
    slope = np.diff(grown.values)[0] / np.diff(nodes)[0]
    assert slope == pytest.approx(11.5e-6, rel=0.02)
    assert not fit.confusions, [each.sentence for each in fit.confusions]


@pytest.mark.slow
def test_delay_and_rate_of_the_instrument_are_told_in_words(
    measured: Measurement, readings: JointData, machine: WorkingMachine
) -> None:
    del readings
    from axcomp.data.measurements import without_motion

    words = without_motion(measured, AXES).remarks
    assert sum("which was taken off" in each for each in words) == 3
    late = float(measured.values["time"][-1]) * machine.trackers["X"].rate
    assert late < 1e-3  # the rate is a small matter here, the delay is not


@pytest.mark.slow
def test_one_after_another_leaves_at_least_twice_the_error(
    fit: JointFit,
    readings: JointData,
    kept: np.ndarray,
    machine: WorkingMachine,
    everywhere: tuple[JointData, State],
) -> None:
    together = in_the_workspace(fit.parts, machine, everywhere)
    left = readings
    parts: list[Part] = []
    for one in fit.parts:
        if one.effect.axis != "X":
            continue
        alone = fit_joint(left, [one.effect], use=kept)
        parts += alone.parts
        axis = one.effect.axis
        error = {**left.error, axis: left.error[axis] - alone.predict(left)[axis]}
        left = dataclasses.replace(left, error=error)
    apart = in_the_workspace(parts, machine, everywhere)
    # The scale warms while X works: its growth overlaps the pitch that is fitted first.
    assert np.std(apart["X"]) > 2.0 * np.std(together["X"])


@pytest.mark.slow
def test_following_error_leaks_into_nothing(
    log: MotionLog, readings: JointData, fit: JointFit, kept: np.ndarray
) -> None:
    lag = max(float(np.abs(log.position[a] - log.encoder[a]).max()) for a in AXES)
    assert lag > 1.0  # mm: a thousand times what is looked for
    assert readings.time is not None
    truth = {a: np.interp(readings.time, log.time, log.truth[a]) for a in AXES}
    rng = np.random.default_rng(3)
    still = dataclasses.replace(
        readings,
        error={a: truth[a] + NOISE * rng.standard_normal(len(readings)) for a in AXES},
    )
    # The same places, as if each had been measured at standstill.
    calm = fit_joint(still, [part.effect for part in fit.parts], use=kept)
    for moving, standing in zip(fit.parts, calm.parts, strict=True):
        if moving.effect.compensation == "delay":
            continue
        known = moving.determined & standing.determined & (moving.support > 20)
        values = in_gauge(calm, [part.values for part in fit.parts])[0]
        change = values[fit.parts.index(moving)] - standing.values
        spread = np.hypot(moving.standard_deviation, standing.standard_deviation)
        # Drift of the instrument and the bends of the truth between nodes add to σ.
        assert np.median(np.abs(change[known]) / (spread[known] + 1e-4)) < 3.0, (
            moving.name
        )
