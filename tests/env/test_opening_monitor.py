"""Success, failure and reward against sequences whose outcome is known in advance."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import (
    FAILURES,
    GRASP_LOST_TIME,
    HOLD_TIME,
    STALL_ANGLE,
    STALL_TIME,
    SUCCESS_ANGLE,
    OpeningMonitor,
    reward_terms,
)

DT = 0.01
OPEN = SUCCESS_ANGLE + 1e-6


def test_the_task_s_numbers() -> None:
    assert math.radians(60.0) == SUCCESS_ANGLE
    assert (HOLD_TIME, GRASP_LOST_TIME, STALL_TIME) == (0.5, 0.25, 3.0)
    assert math.radians(0.5) == STALL_ANGLE


def test_success_needs_exactly_half_a_second() -> None:
    monitor = OpeningMonitor()
    for _ in range(49):
        monitor.update(OPEN, True)
        assert not monitor.success
    monitor.update(OPEN, True)
    assert monitor.success
    assert FAILURES[monitor.failure] == ""


def test_success_angle_itself_counts_and_less_does_not() -> None:
    exact, below = OpeningMonitor(), OpeningMonitor()
    for _ in range(100):
        exact.update(SUCCESS_ANGLE, True)
        below.update(np.nextafter(SUCCESS_ANGLE, 0.0), True)
    assert exact.success
    assert not below.success


@pytest.mark.parametrize("interruption", [(SUCCESS_ANGLE - 0.01, True), (OPEN, False)])
def test_an_interruption_restarts_the_half_second(
    interruption: tuple[float, bool],
) -> None:
    monitor = OpeningMonitor()
    for _ in range(49):
        monitor.update(OPEN, True)
    monitor.update(*interruption)
    for _ in range(49):
        monitor.update(OPEN, True)
    assert not monitor.success
    monitor.update(OPEN, True)
    assert monitor.success


def test_success_is_kept_and_silences_failures() -> None:
    monitor = OpeningMonitor()
    for _ in range(50):
        monitor.update(OPEN, True)
    for _ in range(1000):
        monitor.update(0.0, False)
    assert monitor.success
    assert FAILURES[monitor.failure] == ""


def test_grasp_is_lost_after_a_quarter_of_a_second_for_good() -> None:
    monitor = OpeningMonitor()
    for _ in range(24):
        monitor.update(0.1, False)
        assert FAILURES[monitor.failure] == ""
    monitor.update(0.1, False)
    assert FAILURES[monitor.failure] == "grasp_lost"
    for _ in range(10):
        monitor.update(0.1, True)
    assert FAILURES[monitor.failure] == "grasp_lost"


def test_a_short_release_is_forgiven() -> None:
    monitor = OpeningMonitor()
    for step in range(200):
        monitor.update(0.001 * step, grasped=step % 20 != 0)
    assert FAILURES[monitor.failure] == ""


def test_a_door_that_stands_still_has_stalled_until_it_moves() -> None:
    monitor = OpeningMonitor()
    monitor.update(0.2, True)
    for _ in range(299):
        monitor.update(0.2, True)
        assert FAILURES[monitor.failure] == ""
    monitor.update(0.2, True)
    assert FAILURES[monitor.failure] == "stalled"
    monitor.update(0.2 + STALL_ANGLE, True)
    assert FAILURES[monitor.failure] == ""


def test_a_slow_door_has_not_stalled() -> None:
    """Half a degree in just under three seconds is progress."""
    monitor = OpeningMonitor()
    rate = STALL_ANGLE / (STALL_TIME - 5 * DT)
    for step in range(2000):
        monitor.update(rate * step * DT, True)
        assert FAILURES[monitor.failure] == ""


def test_swinging_back_and_forth_is_a_stall() -> None:
    monitor = OpeningMonitor()
    for step in range(400):
        monitor.update(0.3 + 0.1 * math.cos(step / 10), True)
    assert FAILURES[monitor.failure] == "stalled"


@given(
    angles=st.lists(st.floats(0.0, 1.7), min_size=2, max_size=60),
    forces=st.lists(st.floats(-50, 50), min_size=60, max_size=60),
)
def test_progress_telescopes_to_the_angle_over_sixty_degrees(
    angles: list[float], forces: list[float]
) -> None:
    total = sum(
        reward_terms(after - before, force, False)["progress"]
        for before, after, force in zip(angles, angles[1:], forces, strict=False)
    )
    assert total == pytest.approx((angles[-1] - angles[0]) / SUCCESS_ANGLE, abs=1e-9)


def test_reward_terms_are_what_the_page_says() -> None:
    terms = reward_terms(SUCCESS_ANGLE / 4, -10.0, True)
    assert terms == pytest.approx(
        {"progress": 0.25, "radial_force": -0.01 * DT, "success": 1.0}
    )
    assert all(type(value) is float for value in terms.values())


@given(radius=st.floats(0.1, 1.0), angle=st.floats(-3.0, 3.0))
def test_arc_keeps_its_distance_from_the_hinge(radius: float, angle: float) -> None:
    x, y, z, *rotation = handle_pose_on_arc(radius, angle)
    assert math.hypot(x, z + radius) == pytest.approx(radius)
    assert math.atan2(x, z + radius) == pytest.approx(angle)
    assert y == 0.0
    assert rotation == [0.0, angle, 0.0]


def test_many_poses_on_an_arc_are_those_of_one_at_a_time() -> None:
    """Bit for bit: a command must not depend on how many were computed with it."""
    radii, angles = np.array([[0.3], [0.65]]), np.linspace(-0.1, 1.6, 101)
    poses = handle_pose_on_arc(radii, angles)
    assert poses.shape == (2, 101, 6)
    for row, (radius,) in enumerate(radii):
        for column, angle in enumerate(angles.tolist()):
            alone = handle_pose_on_arc(radius, angle)
            assert np.array_equal(poses[row, column], alone)


def test_a_latched_door_is_told_from_one_that_is_stuck() -> None:
    monitor = OpeningMonitor()
    for _ in range(400):
        monitor.update(0.0, True, 0.0, latched=True)
    assert FAILURES[monitor.failure] == "latched"
    monitor.update(0.0, True, 0.0, latched=False)
    assert FAILURES[monitor.failure] == "stalled"


def test_turning_the_handle_is_no_stall() -> None:
    monitor = OpeningMonitor()
    for step in range(800):
        monitor.update(0.0, True, math.radians(2.0) * step * DT, latched=True)
        assert FAILURES[monitor.failure] == ""
    for _ in range(301):
        monitor.update(0.0, True, math.radians(16.0), latched=True)
    assert FAILURES[monitor.failure] == "latched"
