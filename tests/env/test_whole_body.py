"""The whole-body rule and the drive's limits, as arithmetic."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.robot.whole_body import (
    ACCELERATION,
    BLOCKED_TIME,
    DEAD_BAND,
    LAG,
    SPEED,
    BaseDrive,
    led_by,
)

HAND = (0.8, 0.3)
ROBOT = TIAGO_LIKE.on("mobile")
AXES = task_rotation_w(DoorConfig(), ROBOT)
numbers = st.floats(-1.0, 1.0)


def away(first: tuple[float, ...], second: tuple[float, ...]) -> tuple[float, float]:
    dx, dy, turn = np.subtract(first, second)
    return math.hypot(dx, dy), abs(turn)


@given(
    way=st.floats(0.05, 1.0),
    comes=st.booleans(),
    y=numbers,
    z=numbers,
    yaw=st.floats(-1.5, 1.5),
)
def test_the_base_is_led_as_if_fixed_to_the_hand(way, comes, y, z, yaw):
    """Seen from the base, the hand stays at the same place.

    A hand that comes keeps its direction; one that goes turns by 7/10 of its yaw.
    """
    x = way if comes else -way
    bx, by, turn = led_by([x, y, z, 0.0, yaw, 0.0], HAND, AXES.T.tolist())
    moved = AXES @ [x, y, z]
    back = Rotation.from_rotvec([0.0, 0.0, -turn])
    hand = back.apply([HAND[0] + moved[0] - bx, HAND[1] + moved[1] - by, 0.0])
    assert_allclose(hand[:2], HAND, atol=1e-12)
    assert turn == pytest.approx(yaw if comes else 0.3 * yaw)


@given(x=numbers, y=st.floats(-1.5, 1.5), z=numbers)
def test_of_a_rotation_the_base_takes_the_twist_about_the_vertical(x, y, z):
    """Swing and twist: what is left when the twist is undone has no vertical part."""
    _, _, turn = led_by([0.1, 0.0, 0.0, x, y, z], HAND, AXES.T.tolist())
    whole = Rotation.from_rotvec([x, y, z])
    swing = whole * Rotation.from_rotvec([0.0, turn, 0.0]).inv()
    assert swing.as_quat()[1] == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=25)
@given(st.tuples(numbers, numbers, numbers, *3 * [st.floats(-0.8, 0.8)]))
def test_the_base_comes_within_the_play_of_where_it_is_led(hand):
    """One without inertia, when it has come to rest."""
    target = led_by(list(hand), HAND, AXES.T.tolist())
    drive, base, rates = BaseDrive(HAND, DoorConfig(), ROBOT), (0.0, 0.0, 0.0), []
    for _ in range(800):
        drive.follow(list(hand), base)
        rates.append(drive.rate)
        base = tuple(np.add(base, np.multiply(CONTROL_PERIOD, drive.rate)).tolist())
    distance, turn = away(base, target)
    assert distance <= DEAD_BAND[0] + 1e-3
    assert turn <= DEAD_BAND[1] + 1e-3
    start = away((0.0, 0.0, 0.0), target)
    assert all(away((0.0, 0.0, 0.0), rate)[0] <= SPEED[0] + 1e-9 for rate in rates)
    assert all(abs(rate[2]) <= SPEED[1] + 1e-9 for rate in rates)
    for before, after in itertools.pairwise(rates):
        linear, angular = away(before, after)
        assert linear <= ACCELERATION[0] * CONTROL_PERIOD + 1e-9
        assert angular <= ACCELERATION[1] * CONTROL_PERIOD + 1e-9
    if start[0] <= DEAD_BAND[0] and start[1] <= DEAD_BAND[1]:
        assert base == (0.0, 0.0, 0.0), "what is small is the arm's"


def test_a_base_follows_a_steady_hand_without_lag():
    """At 0.4 m/s a follower with the time constant alone would be 12 cm behind."""
    drive, base = BaseDrive(HAND, DoorConfig(), ROBOT), (0.0, 0.0, 0.0)
    for step in range(300):
        hand = [0.4 * CONTROL_PERIOD * step, 0.0, 0.0, 0.0, 0.0, 0.0]
        drive.follow(hand, base)
        base = tuple(np.add(base, np.multiply(CONTROL_PERIOD, drive.rate)).tolist())
    distance, _ = away(base, led_by(hand, HAND, AXES.T.tolist()))
    assert distance == pytest.approx(DEAD_BAND[0], abs=5e-3)
    assert 2 * DEAD_BAND[0] < 0.4 * LAG


def driven(twist: list[float], heading: float = 0.0) -> BaseDrive:
    drive = BaseDrive(HAND, DoorConfig(), ROBOT)
    for _ in range(500):
        drive.obey(twist, (5.0, 5.0, heading))
    return drive


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_twist_is_meant_in_the_base_s_own_axes(heading):
    drive = driven([0.3, 0.1, -0.2], heading)
    turned = Rotation.from_rotvec([0.0, 0.0, heading]).apply([0.3, 0.1, 0.0])
    assert drive.rate == pytest.approx((*turned[:2], -0.2))
    drive = driven([9.0, 9.0, 9.0], heading)
    assert math.hypot(*drive.rate[:2]) == pytest.approx(SPEED[0])
    assert drive.rate[2] == SPEED[1]


def test_a_base_is_blocked_once_it_has_been_slow_for_a_while():
    """In what it is commanded to do; a moment of 0.16 m/s begins the time anew."""
    steps = round(BLOCKED_TIME / CONTROL_PERIOD)
    drive = driven([0.3, 0.0, 0.0])
    for velocity in (0.1, 0.16, *(steps - 1) * [0.1]):
        drive.update_blocked((velocity, 0.3, 0.0))
        assert not drive.blocked
    drive.update_blocked((0.1, 0.0, 0.0))
    assert drive.blocked
    drive.update_blocked((0.3, 0.0, 0.0))
    assert not drive.blocked

    drive = driven([0.0, 0.0, -0.5])
    for turning, blocked in ((-0.4, False), (-0.2, True)):
        for _ in range(steps):
            drive.update_blocked((0.0, 0.0, turning))
        assert drive.blocked == blocked

    drive = BaseDrive(HAND, DoorConfig(), ROBOT)
    for _ in range(2 * steps):
        drive.update_blocked((0.0, 0.0, 0.0))
    assert not drive.blocked, "it is not commanded"
