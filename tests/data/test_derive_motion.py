"""The motion of an axis from a measurement."""

from pathlib import Path

import numpy as np
import pytest

from axcomp.data.measurements import (
    Measurement,
    MeasurementError,
    MissingRole,
    derive_motion,
    is_log,
    measurement,
    on_even_clock,
    read_table,
    recorded_motion,
)


def load(folder: Path, **columns: np.ndarray) -> Measurement:
    path = folder / "motion.csv"
    names = [name.replace("_", ".") for name in columns]
    body = np.column_stack(list(columns.values()))
    rows = [",".join(f"{value!r}" for value in row) for row in body.tolist()]
    path.write_text("\n".join([",".join(names), *rows]) + "\n", encoding="utf-8")
    return measurement(read_table(path))


TIME = 1e-3 * np.arange(3000)


def test_encoder_counts_before_the_commanded_position(tmp_path: Path) -> None:
    found = load(tmp_path, time=TIME, X_position=9.0 * TIME, X_encoder=8.0 * TIME)
    motion = derive_motion(found, "X")
    # A ramp passes the filter; 1e-4 of the speed is left of the ends.
    assert np.allclose(motion.velocity[motion.settled], 8.0, rtol=0, atol=1e-3)
    assert motion.bandwidth == pytest.approx(89.6, abs=0.1)  # of two passes at 100 Hz


def test_uneven_clock_takes_the_spline(tmp_path: Path) -> None:
    time = np.cumsum(np.where(np.arange(2000) % 3 == 0, 0.012, 0.010))
    found = load(tmp_path, time=time, X_position=5.0 * time)
    motion = derive_motion(found, "X")
    assert motion.bandwidth == pytest.approx(10.0)  # a tenth of 100 Hz
    assert np.allclose(motion.velocity, 5.0, rtol=0, atol=1e-6)
    # A spline follows no more than a quarter, whatever the share that a filter would.
    assert derive_motion(found, "X", share=0.3).bandwidth == pytest.approx(25.0)


def test_measurement_without_time_is_refused(tmp_path: Path) -> None:
    found = load(tmp_path, X_position=TIME, Y_position=TIME)
    with pytest.raises(MissingRole, match="'time' to derive the motion of X"):
        derive_motion(found, "X")


def test_short_record_is_refused_with_file_and_role(tmp_path: Path) -> None:
    found = load(tmp_path, time=TIME[:5], X_position=TIME[:5])
    with pytest.raises(
        MeasurementError, match=r"motion\.csv: X\.position: .*5 samples"
    ):
        derive_motion(found, "X")


@pytest.mark.parametrize(
    ("factor", "remedy"), [(-1.0, "sign = -1"), (0.5, "the unit"), (9.81, "the unit")]
)
@pytest.mark.parametrize("what", ["velocity", "acceleration"])
def test_recorded_motion_that_contradicts_the_positions_is_refused(
    tmp_path: Path, what: str, factor: float, remedy: str
) -> None:
    rate = 2.0 * np.pi * 2.0
    motion = {
        "velocity": 20.0 * rate * np.cos(rate * TIME),
        "acceleration": -20.0 * rate**2 * np.sin(rate * TIME),
    }
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(TIME))
    place = 20.0 * np.sin(rate * TIME) + noise
    columns = {f"X_{what}": factor * motion[what]}
    found = load(tmp_path, time=TIME, X_position=place, **columns)
    with pytest.raises(MeasurementError, match=f"what the positions .* state {remedy}"):
        recorded_motion(found, "X", what)
    right = load(tmp_path, time=TIME, X_position=place, **{f"X_{what}": motion[what]})
    assert recorded_motion(right, "X", what) is not None


def test_samples_of_an_even_clock_are_even_however_they_were_stamped(
    tmp_path: Path,
) -> None:
    even = 0.0025 * np.arange(8_000)
    late = np.sort(even + np.random.default_rng(1).uniform(-4e-4, 4e-4, len(even)))

    def encoder(time: np.ndarray) -> np.ndarray:
        place = 50.0 * np.sin(1.3 * time) + 20.0 * np.sin(0.4 * time)
        return np.round(place, 3)

    stamped = load(tmp_path, time=np.round(even, 3), X_encoder=encoder(even))
    found = on_even_clock(stamped, "X")
    # All of them later by what rounding is on average, which is no matter.
    assert np.ptp(found.values["time"] - even) < 1e-5
    assert "with samples every 2.5 ms" in " ".join(found.remarks)
    # What was taken at uneven times stands where it was then.
    uneven = load(tmp_path, time=late, X_encoder=encoder(late))
    assert on_even_clock(uneven, "X") is uneven


def test_an_encoder_that_flickers_about_one_place_is_no_motion(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    still = 50.0 + 3e-4 * rng.standard_normal(TIME.size)
    found = load(tmp_path, time=TIME, X_encoder=10.0 * TIME, Y_encoder=still)
    assert is_log(found, "X")
    assert not is_log(found, "Y")
