"""The circular test: what friction and its list do to a circle."""

import numpy as np
import pytest

from axcomp.ident.proof import circular_test
from axcomp.models import FrictionCompensation, StribeckFriction

LAW = StribeckFriction(2.0, 3.0, 5.0, 1.5, 0.004)
NONE = StribeckFriction(0.0, 0.0, 5.0, 1.5, 0.0)
INERTIA = 0.01


def test_without_friction_the_circle_is_round() -> None:
    test = circular_test(NONE, INERTIA, FrictionCompensation(NONE))
    # What is left is the sampling of a circle: r (ω T)²/24 is 1e-8 mm, the loop's
    # feed-forward from one cycle to the next some 1e-5.
    assert test.spikes[0] < 5e-5


def test_friction_leaves_its_marks_where_the_axis_turns() -> None:
    test = circular_test(LAW, INERTIA, FrictionCompensation(LAW))
    largest = test.angle[np.argmax(np.abs(test.without))] % 180.0
    # Within some degrees after 0° or 180°: the axis sticks first.
    assert min(largest, 180.0 - largest) < 10.0
    assert test.spikes[0] > 1e-3


def test_the_true_law_as_list_takes_nearly_all_of_it_away() -> None:
    without, with_list = circular_test(LAW, INERTIA, FrictionCompensation(LAW)).spikes
    assert with_list < 0.05 * without


def test_a_wrong_sign_makes_it_worse() -> None:
    wrong = FrictionCompensation(LAW, sign=-1.0)
    without, with_list = circular_test(LAW, INERTIA, wrong).spikes
    assert with_list > 1.5 * without


def test_one_whole_turn_is_shown() -> None:
    test = circular_test(LAW, INERTIA, FrictionCompensation(LAW))
    # One cycle short of a turn at most.
    step = np.rad2deg(test.feed / test.radius * 0.001)
    assert test.angle[-1] == pytest.approx(360.0, abs=2 * step)
