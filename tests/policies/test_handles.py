"""What many hands do about their handles: gears, what doors are told by, turning on."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DoorConfig
from gplfd_policies.demonstrations.turned_handle import TurnedHandle
from gplfd_policies.handles.compensation import Handles

LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
GEOMETRY = DoorGeometry.of(LEVER)
EXACT = TurnedHandle(
    point=(0.0, 0.0, LEVER.handle_length - 0.03),
    axis=(-1.0, 0.0, 0.0),
    travel=0.8,
    opens=0.2,
)
PULL = np.array([1.0, 0.0, 0.0])
PERIOD = 0.01


def held_shut(handles: Handles, turn: float, force: float = 15.0) -> bool:
    pose = GEOMETRY.hand_poses(0.0, turn)
    return bool(handles.turned_on(pose, PULL, np.float64(force), PERIOD))


def turned_further(seconds: float = 0.2) -> Handles:
    """Return the handle of a door that did not give for a while."""
    handles, turn = Handles([EXACT], ()), 0.8
    for _ in range(round(seconds / PERIOD)):
        assert held_shut(handles, turn)
        turn = float(0.8 * gear(handles))
    return handles


def gear(handles: Handles) -> float:
    """Return what a turn of 1 rad that was shown is on the member's own handle."""
    return -float(handles.asked(GEOMETRY.hand_poses(0.0, 1.0))[3])


def test_a_door_that_does_not_give_has_its_handle_turned_on() -> None:
    assert gear(turned_further(0.2)) == pytest.approx(1.1)
    assert gear(turned_further(0.4)) == pytest.approx(1.2)


def test_a_handle_goes_back_as_shown_from_further_away() -> None:
    """As the geometry has it: all turns are multiplied, and the leaf stays."""
    handles = turned_further()
    angles, turns = np.array([0.0, 0.1, 0.4, 1.0]), np.array([0.8, 0.8, 0.3, 0.1])
    for angle, turn in zip(angles, turns, strict=True):
        shown, own = GEOMETRY.hand_poses(angle, np.array([turn, 1.1 * turn]))
        assert_allclose(handles.asked(shown), own, atol=1e-12)
        assert_allclose(handles.shown(own), shown, atol=1e-12)


@pytest.mark.parametrize(
    ("angle", "turn", "force"),
    [
        pytest.param(0.0, 0.8, 9.0, id="a light door"),
        pytest.param(0.0, 0.5, 15.0, id="still being turned"),
        pytest.param(0.03, 0.8, 15.0, id="open"),
    ],
)
def test_no_handle_is_turned_on_without_need(
    angle: float, turn: float, force: float
) -> None:
    handles = Handles([EXACT], ())
    pose = GEOMETRY.hand_poses(angle, turn)
    assert not handles.turned_on(pose, PULL, np.float64(force), PERIOD)
    assert gear(handles) == pytest.approx(1.0)


def test_a_handle_at_its_stop_is_not_turned_further() -> None:
    """Nor while the hand turns on the lever, which does not follow."""
    handles = Handles([EXACT], ())
    while held_shut(handles, 0.8):
        pass
    assert 0.8 * gear(handles) == pytest.approx(1.0, abs=0.01)
    handles.reset()
    stop = GEOMETRY.hand_poses(0.0, 0.8)
    for angle in np.linspace(0.8, 1.2, 100):
        stop[3] = -angle
        handles.turned_on(stop, PULL, np.float64(15.0), PERIOD)
    assert 0.8 * gear(handles) == pytest.approx(1.0, abs=0.02)


def test_a_knob_is_turned_on_by_the_hand_s_turn_alone() -> None:
    knob = TurnedHandle(point=(0.0, 0.0, 0.0), axis=(-1.0, 0.0, 0.0), travel=0.8)
    handles = Handles([knob], ())
    pose = np.array([0.004, -0.008, 0.003, -0.8, 0.0, 0.0])
    assert handles.turned_on(pose, PULL, np.float64(15.0), PERIOD)


def test_handles_are_turned_on_within_bounds() -> None:
    handles = turned_further(1.1)
    while held_shut(handles, 2.0):
        pass
    assert gear(handles) == pytest.approx(1.6)


def test_reset_forgets_how_far_a_handle_turns() -> None:
    handles = turned_further()
    handles.reset()
    assert gear(handles) == pytest.approx(1.0)


@pytest.mark.parametrize(("angle", "turn"), [(0.0, 0.4), (0.2, 0.8), (0.9, 0.1)])
def test_a_door_is_told_by_its_axis_and_its_leaf(angle: float, turn: float) -> None:
    """However far the handle is turned, and wherever its spring has the hand."""
    mean = GEOMETRY.hand_poses(angle + 0.02, 0.6)
    expected = GEOMETRY.hand_poses(angle, 0.6)
    way = np.array(EXACT.way(mean.tolist()))
    expected[:3] += way * (way @ (EXACT.place(mean.tolist()) - places(expected)))
    handles = Handles([EXACT], ())
    for lag in (0.0, 0.01):
        pose = GEOMETRY.hand_poses(angle, turn)
        pose[:3] += lag * way
        assert_allclose(handles.told(pose, mean, 0), expected, atol=1e-12)


def places(pose: np.ndarray) -> np.ndarray:
    return np.array(EXACT.place(pose.tolist()))


def test_a_bar_tells_all_that_the_hand_does() -> None:
    handles, pose = Handles([None], ()), np.arange(6.0) / 10.0
    assert handles.told(pose, np.zeros(6), 0) is pose
    assert_array_equal(handles.shown(pose), pose)
    assert_array_equal(handles.asked(pose), pose)
    assert not handles.turned_on(pose, PULL, np.float64(50.0), PERIOD)
    assert not handles.hooked()
    assert handles.opening(np.float64(0.1)) == 0.1


def test_a_door_s_way_begins_where_its_handle_s_axis_moves() -> None:
    handles = Handles([None, EXACT], (2,))
    assert_array_equal(handles.opening(np.array([0.1, 0.1])), [0.1, 0.2])
    assert_array_equal(handles.opening(np.array([0.3, 0.3])), [0.3, 0.3])
    assert_array_equal(handles.hooked(), [False, True])


def test_one_hand_and_many_turn_handles_alike() -> None:
    members = np.array([1, 2])
    many = Handles([None, EXACT, EXACT], (3,))
    poses = GEOMETRY.hand_poses(0.0, np.array([0.3, 0.8]))
    forces, paths = np.array([15.0, 15.0]), np.tile(PULL, (2, 1))
    for _ in range(20):
        turned = many.turned_on(poses, paths, forces, PERIOD, members)
        assert_array_equal(turned, [False, True])
    alone = turned_further()
    asked = many.asked(np.tile(poses[1], (3, 1)))
    assert_array_equal(asked[:2], poses[[1, 1]])
    assert_array_equal(asked[2], alone.asked(poses[1]))
