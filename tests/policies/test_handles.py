"""Handles that are turned first: axis, gear, load compensation, and batches of them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import Demonstration, align
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.handles import HandleLoad, HandleMovements
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import ContactState, LearnedLoad
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.demonstrations.turned_handle import TurnedHandle, turned_handle
from gplfd_policies.movements.baselines.dmp import fit_dmp
from gplfd_policies.movements.movement import EmpiricalDistribution
from gplfd_policies.phase.phase_rule import PathPhase

LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
# Preparing demonstrations says what it found.
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

GEOMETRY = DoorGeometry.of(LEVER)
ARM = LEVER.lockset.handle_length - 0.03
EXACT = TurnedHandle(
    point=(0.0, 0.0, ARM), axis=(-1.0, 0.0, 0.0), travel=0.8, opens=0.2
)
PULL = np.array([1.0, 0.0, 0.0])
PERIOD = 0.01


# --- The handle that demonstrations turn -------------------------------------


@pytest.mark.parametrize(
    ("hinge_side", "seed"), [("right", 0), ("right", 1), ("right", 2), ("left", 0)]
)
def test_demonstrations_tell_where_a_lever_s_axis_is(hinge_side, seed):
    """To the centimetre by which the sensor is beside the place of the grasp."""
    door = replace(LEVER, hinge_side=hinge_side)
    shown = Teacher().standard_demonstrations(seed=seed, like=door)
    handle = turned_handle(align(shown))
    side = 1.0 if hinge_side == "right" else -1.0
    assert handle is not None
    assert_allclose(handle.point, np.multiply(side, EXACT.point), atol=0.012)
    assert_allclose(handle.axis, np.multiply(side, EXACT.axis), atol=0.06)


def test_the_axis_goes_along_the_door_s_circle_whatever_the_handle_does():
    angles = np.linspace(0.0, 1.2, 13)
    turns = 0.7 * np.sin(5.0 * angles) ** 2
    places = EXACT.axis_positions(GEOMETRY.hand_poses(angles, turns))[:, :3]
    closed = EXACT.axis_positions(GEOMETRY.hand_poses(angles))[:, :3]
    assert_allclose(places, closed, atol=1e-12)
    assert_array_equal(EXACT.axis_positions(np.zeros((1, 6)))[:, :3], np.zeros((1, 3)))


@pytest.mark.parametrize(
    ("angle", "turn"), [(0.0, 0.3), (0.5, 0.7), (1.0, 0.0), (1.2, -0.1)]
)
def test_a_hand_s_turn_is_the_leaf_s_and_the_handle_s(angle, turn):
    """And its way is where it goes while the handle turns."""
    before, here, after = GEOMETRY.hand_poses(angle, turn + np.array([-1e-4, 0, 1e-4]))
    leaf, handle = EXACT.swing_twist(here[3:].tolist())
    assert_allclose(leaf, (0.0, angle, 0.0), atol=1e-12)
    assert handle == pytest.approx(turn)
    way = (after - before)[:3]
    assert_allclose(
        EXACT.turning_direction(here.tolist()), way / np.linalg.norm(way), atol=1e-6
    )


def test_a_handle_that_goes_back_tells_nothing_of_the_door():
    """It goes back because the policy has it go: the phase is that of the leaf."""
    aligned = align(Teacher().standard_demonstrations(seed=0, like=LEVER))
    angles = np.linspace(0.0, 0.6, 200)
    pressed = np.minimum(np.linspace(0.0, 4.0, 200), 1.0) * 0.75
    phases = []
    for kept in (1.0, 0.2):
        back = np.where(angles > 0.15, kept, 1.0)
        rule, phase = PathPhase(EmpiricalDistribution(aligned=aligned)), np.zeros(())
        opening = np.maximum(angles - 0.15, 0.0)
        for pose in GEOMETRY.hand_poses(opening, pressed * back):
            phase = rule.update(pose, phase, phase).phase
        phases.append(float(phase))
    assert phases[0] > 0.3
    assert phases[0] == pytest.approx(phases[1], abs=0.01)


# --- How far it is turned on this door ---------------------------------------


def gridded():
    angles = np.linspace(0.0, 1.0, 200)
    poses = GEOMETRY.hand_poses(angles, 0.8 * np.sin(3.0 * angles))
    demonstration = Demonstration(times=5.0 * angles, poses=poses)
    return GriddedMovement(fit_dmp(align([demonstration] * 2)), None, 100)


def compensation():
    return HandleMovements(gridded(), [EXACT])


def held_shut(handles, turn, force=15.0):
    pose = GEOMETRY.hand_poses(0.0, turn)
    handles.geared(GEOMETRY.hand_poses(0.0, 0.8), 1)
    return bool(handles.turn_further(pose, np.True_, np.float64(force), PERIOD))


def turned_further(seconds=0.2):
    """Return the handle of a door that did not give for a while."""
    handles, turn = compensation(), 0.8
    for _ in range(round(seconds / PERIOD)):
        assert held_shut(handles, turn)
        turn = float(0.8 * gear(handles))
    return handles


def gear(handles):
    """Return what a demonstrated turn of 1 rad is on this handle."""
    return -1.0 / float(handles.geared(GEOMETRY.hand_poses(0.0, 1.0), -1)[3])


def test_a_door_that_does_not_give_has_its_handle_turned_on():
    assert gear(turned_further(0.2)) == pytest.approx(1.1)
    handles = turned_further(0.4)
    assert gear(handles) == pytest.approx(1.2)
    handles.reset()
    assert gear(handles) == pytest.approx(1.0)


def test_a_handle_of_short_travel_is_turned_as_far_as_any():
    handles = HandleMovements(gridded(), [replace(EXACT, travel=0.4)])
    for _ in range(round(5.0 / PERIOD)):
        handles.geared(GEOMETRY.hand_poses(0.0, 0.4), 1)
        pose = GEOMETRY.hand_poses(0.0, 0.4 * gear(handles))
        handles.turn_further(pose, np.True_, np.float64(15.0), PERIOD)
    assert 0.4 * gear(handles) == pytest.approx(1.3)


def test_a_handle_goes_back_as_shown_from_further_away():
    """As the geometry has it: all turns are multiplied, and the leaf stays.

    Not while the door is closed, where the set-point is ahead.
    """
    handles = turned_further()
    for turn, held in ((0.8, 0.88), (0.3, 0.88), (0.9, 0.99)):
        ahead, expected = GEOMETRY.hand_poses(0.2, np.array([turn, held]))
        assert_allclose(handles.geared(ahead, 1), expected, atol=1e-12)
    handles.turn_further(ahead, np.False_, np.float64(0.0), PERIOD)
    angles, turns = np.array([0.0, 0.1, 0.4, 1.0]), np.array([0.8, 0.8, 0.3, 0.1])
    for angle, turn in zip(angles, turns, strict=True):
        demonstrated, turned = GEOMETRY.hand_poses(angle, np.array([turn, 1.1 * turn]))
        assert_allclose(handles.geared(demonstrated, 1), turned, atol=1e-12)
        assert_allclose(handles.geared(turned, -1), demonstrated, atol=1e-12)


@pytest.mark.parametrize(
    ("angle", "turn", "force", "commanded", "further"),
    [
        pytest.param(0.0, 0.8, 9.0, 0.8, False, id="a light door"),
        pytest.param(0.0, 0.5, 15.0, 0.8, False, id="still being turned"),
        pytest.param(0.0, 0.4, 15.0, 0.4, False, id="still being pressed"),
        pytest.param(0.03, 0.8, 15.0, 0.8, False, id="open"),
        pytest.param(0.0, 0.6, 15.0, 0.7, True, id="a mean that turns less"),
    ],
)
def test_no_handle_is_turned_on_without_need(angle, turn, force, commanded, further):
    pose, handles = GEOMETRY.hand_poses(angle, turn), compensation()
    handles.geared(GEOMETRY.hand_poses(0.0, commanded), 1)
    closed = np.bool_(angle == 0.0)
    turned = handles.turn_further(pose, closed, np.float64(force), PERIOD)
    assert turned == further
    assert (gear(handles) > 1.0) is further


def test_a_knob_is_turned_on_by_the_commanded_angle():
    knob = HandleMovements(gridded(), [replace(EXACT, point=(0.0, 0.0, 0.0))])
    knob.geared(GEOMETRY.hand_poses(0.0, 0.7), 1)
    pose = GEOMETRY.hand_poses(0.0, 0.6)  # more than 0.8 of 0.7 rad, less than of 0.8
    assert knob.turn_further(pose, np.True_, np.float64(15.0), PERIOD)


def test_a_handle_at_its_stop_is_not_turned_further():
    """Nor while the hand turns on the lever, which does not follow."""
    handles = compensation()
    while held_shut(handles, 0.8):
        pass
    assert 0.8 * gear(handles) == pytest.approx(1.0, abs=0.01)
    handles.reset()
    stop = GEOMETRY.hand_poses(0.0, 0.8)
    for angle in np.linspace(0.8, 1.2, 100):
        stop[3] = -angle
        handles.geared(GEOMETRY.hand_poses(0.0, 0.8), 1)
        handles.turn_further(stop, np.True_, np.float64(15.0), PERIOD)
    assert 0.8 * gear(handles) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("angle", "turn"), [(0.0, 0.4), (0.2, 0.8), (0.9, 0.1)])
def test_a_door_is_told_by_its_axis_and_its_leaf(angle, turn):
    """However far the handle is turned, and wherever its spring has the hand."""
    mean = GEOMETRY.hand_poses(angle + 0.02, 0.6)
    expected = GEOMETRY.hand_poses(angle, 0.6)
    way = np.array(EXACT.turning_direction(mean.tolist()))
    beside = np.subtract(
        EXACT.axis_displacement(mean.tolist()),
        EXACT.axis_displacement(expected.tolist()),
    )
    expected[:3] += way * (way @ beside)
    for lag in (0.0, 0.01):
        pose = GEOMETRY.hand_poses(angle, turn)
        pose[:3] += lag * way
        axis = EXACT.without_handle_motion(pose.tolist(), mean.tolist())
        assert_allclose(axis, expected, atol=1e-12)


def test_a_door_s_way_begins_where_its_handle_s_axis_moves():
    handles = [replace(EXACT, opens=0.1), replace(EXACT, opens=0.5)]
    movements = HandleMovements([gridded(), gridded()], handles)
    ways = [movements.ahead(np.full(2, phase))[2] for phase in (0.05, 0.1, 0.5, 0.6)]
    assert_array_equal(ways[0][0], ways[1][0])
    assert_array_equal(ways[0][1], ways[2][1])
    assert not np.allclose(ways[2], ways[3], atol=1e-3)


# --- Its load, and the door's ------------------------------------------------

PRESSED = GEOMETRY.hand_poses(0.0, 0.7)
WAY = np.array(EXACT.turning_direction(PRESSED.tolist()))


def contact(force):
    wrench = np.concatenate([force, np.zeros(3)])
    return ContactState(
        wrench=wrench, direction=PULL, pose=PRESSED, displacement=np.zeros(3)
    )


@pytest.fixture
def load():
    return HandleLoad(ComplianceConfig(control_period=PERIOD), compensation())


def test_the_spring_of_a_lever_is_carried_while_the_door_is_pulled(load):
    """And what is across both ways is yielded to, as it is where nothing turns."""
    spring, across = -6.0 * WAY, 3.0 * np.cross(PULL, WAY)
    response = load.update(contact(spring + across - 8.0 * PULL))
    assert_allclose(response.compliant_wrench[:3], across, atol=1e-9)
    assert response.compensated_load == pytest.approx(8.0)


def test_a_door_behind_a_handle_may_be_heavier_than_a_friction_grasp_holds(load):
    bar = LearnedLoad().begin(DEFAULT_PROFILE)
    for hand, carried in ((bar, 25.0), (load, 45.0)):
        response = hand.update(contact(-45.0 * PULL))
        assert response.compensated_load == pytest.approx(carried)


def test_a_hand_pulls_harder_at_a_closed_door_and_gives_up(load):
    """What a held hand bears, 26 N, rises at 20 N/s to 58 N, for half a second."""
    stuck = replace(contact(-60.0 * PULL), displacement=-0.03 * PULL)
    borne = [load.update(stuck).compensated_load for _ in range(round(4.0 / PERIOD))]
    rises = np.diff(borne[: round(1.5 / PERIOD)]) / PERIOD
    assert_allclose(rises[1:], 20.0)
    assert max(borne) == pytest.approx(58.0)
    assert np.mean(np.greater(borne, 57.0)) * 4.0 == pytest.approx(0.5, abs=0.1)
    assert_allclose(borne[round(2.5 / PERIOD) :], 23.2, rtol=1e-3)
    load.reset()
    again = [load.update(stuck).compensated_load for _ in range(round(2.0 / PERIOD))]
    assert max(again) == pytest.approx(58.0)
    load.reset()
    person = replace(stuck, pose=GEOMETRY.hand_poses(0.03, 0.7))
    moved = [load.update(person).compensated_load for _ in range(round(4.0 / PERIOD))]
    assert max(moved) == pytest.approx(23.2, rel=1e-3)


def test_a_hand_does_not_pull_harder_while_it_turns_the_handle():
    movements = compensation()
    load = HandleLoad(ComplianceConfig(control_period=PERIOD), movements)
    movements.geared(PRESSED, 1)
    stuck = replace(contact(-60.0 * PULL), displacement=-0.03 * PULL)
    borne = [float(load.update(stuck).compensated_load) for _ in range(4)]
    assert gear(movements) == pytest.approx(1.0 + 4 * 0.5 * PERIOD)
    assert borne == pytest.approx([23.2] * 4, rel=1e-3)


def test_turning_a_handle_teaches_nothing_of_the_door(load):
    """A door behind a light lever is expected to be as heavy as any other."""
    poses = [GEOMETRY.hand_poses(0.0, turn) for turn in np.linspace(0.0, 0.7, 60)]
    for pose in poses:
        way = np.array(EXACT.turning_direction(pose.tolist()))
        load.update(replace(contact(-2.0 * way), direction=way, pose=pose))
    held = load.update(contact(-20.0 * PULL))
    assert held.compensated_load == pytest.approx(20.0)
    stop = load.update(contact(-20.0 * WAY)).compliant_wrench[:3] @ -WAY
    # The lever: from 25 N to 2 N over 3 cm, and over 6 cm from the middle of it on.
    turned = np.sqrt((np.diff(poses, axis=0)[:, :3] ** 2).sum(axis=1)).sum()
    lever = 2.0 + 11.5 * np.exp((0.03 * np.log(2.0) - turned) / 0.06)
    assert 20.0 - stop == pytest.approx(lever, rel=0.1)
