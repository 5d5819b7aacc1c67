"""Friction in a current: what a list can hold, and what not."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.signal import butter, sosfiltfilt

from axcomp.ident.discover import Discovery, Observed, discover

EMPS = Path(__file__).parents[3] / "../shared/data/emps/DATA_EMPS.mat"


def recorded(
    velocity: np.ndarray, step: float, current: np.ndarray, position: np.ndarray
) -> Discovery:
    rows = np.zeros(len(velocity), dtype=np.int64)
    data = Observed(
        time=step * np.arange(len(velocity)),
        run=rows,
        source=rows,
        position={"X": position},
        velocity={"X": velocity},
        acceleration={"X": np.gradient(velocity, step)},
        current={"X": current},
    )
    return discover(data, ("X",))


def speeds(*values: float, back: bool = True) -> np.ndarray:
    """Constant speeds with soft ramps, in mm/s, a sample per 4 ms."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.minimum(1, np.arange(300) / 60))
    ways = (1, -1) if back else (1,)
    return np.concatenate([way * v * ramp * ramp[::-1] for v in values for way in ways])


SPEEDS = (1, 2, 4, 8, 16, 40, 100, 70, 25, 5, 3, 120)


def drive(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and current of a drive with Coulomb and viscous friction."""
    rng = np.random.default_rng(3)
    current = 2.0 * np.sign(velocity) + 0.02 * velocity + 0.3
    current += 0.002 * np.gradient(velocity, 0.004)
    return 0.004 * np.cumsum(velocity), current + 0.05 * rng.normal(size=len(velocity))


def test_friction_that_a_list_can_hold_is_found() -> None:
    velocity = speeds(*SPEEDS)
    place, current = drive(velocity)
    found = recorded(velocity, 0.004, current, place)
    (one,) = found.found
    assert (one.compensation, one.axis, one.group) == ("friction", "X", None)
    assert "Coulomb, viscous" in one.sentence
    assert not found.unexplained


def test_a_stribeck_drop_at_low_speeds_is_named() -> None:
    velocity = speeds(*SPEEDS)
    place, current = drive(velocity)
    current = current + 0.8 * np.sign(velocity) * np.exp(-((velocity / 4.0) ** 2))
    found = recorded(velocity, 0.004, current, place)
    (one,) = found.found
    assert "Coulomb, viscous, Stribeck" in one.sentence
    # 0.05 A were added; coarse velocities of the law and few readings leave a tenth more.
    assert found.axes[0].noise == pytest.approx(0.05, rel=0.15)


def test_friction_that_changes_with_position_is_beyond_the_kernel() -> None:
    velocity = speeds(*SPEEDS)
    place, current = drive(velocity)
    share = (place - place.min()) / np.ptp(place)
    current = current + 0.5 * np.sign(velocity) * np.cos(3 * np.pi * share)
    found = recorded(velocity, 0.004, current, place)
    assert [one.compensation for one in found.found] == ["friction"]
    assert [one.what for one in found.unexplained] == [
        "position-dependent friction of X"
    ]


def test_friction_that_falls_while_the_axis_warms_is_no_scatter() -> None:
    velocity = speeds(*SPEEDS)
    place, current = drive(velocity)
    falling = 0.6 * np.sign(velocity) * np.linspace(0.5, -0.5, len(velocity))
    found = recorded(velocity, 0.004, current + falling, place)
    assert [one.compensation for one in found.found] == ["friction"]
    (one,) = found.unexplained
    assert one.what == "friction of X that changes over the recording"
    # Over 30 % of 2 A evenly: 0.6 A / √12, of which the noise hides little.
    assert one.rms == pytest.approx(0.6 / np.sqrt(12.0), rel=0.1)
    assert found.axes[0].noise == pytest.approx(0.05, rel=0.15)


def test_one_direction_only_cannot_tell_friction_from_load() -> None:
    velocity = speeds(*SPEEDS, back=False)
    place, current = drive(velocity)
    found = recorded(velocity, 0.004, current, place)
    assert not found.found
    assert found.confused
    assert "one direction only" in found.unexplained[0].sentence


def test_emps_shows_the_direction_dependent_viscous_term() -> None:
    if not EMPS.exists():
        pytest.skip("needs ../shared/data/emps/DATA_EMPS.mat")
    data = loadmat(EMPS)
    low = np.asarray(butter(4, 0.2, output="sos"))  # 100 Hz at 1 kHz
    place = sosfiltfilt(low, 1e3 * data["qm"].ravel())
    force = (data["gtau"] * data["vir"]).ravel()
    found = recorded(np.gradient(place, 1e-3), 1e-3, force, place)
    assert [one.compensation for one in found.found] == ["friction"]
    beyond = {one.what: one for one in found.unexplained}
    one = beyond["direction-dependent viscous friction of X"]
    assert one.verdict == "the kernel cannot express this"
