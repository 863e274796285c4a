"""A handle that is turned first: its axis, the way about it, and its spring's load."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies.control.load import CarriedLoad, Encounter, LearnedLoad
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.turned_handle import TurnedHandle, turned_handle
from gplfd_policies.handles.compensation import Handles
from gplfd_policies.handles.load import HandleAndDoor
from gplfd_policies.movements.empirical import EmpiricalDistribution
from gplfd_policies.phase.path_phase import PathPhase

LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
# Preparing demonstrations says what it found.
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

GEOMETRY = DoorGeometry.of(LEVER)
ARM = LEVER.handle_length - 0.03
EXACT = TurnedHandle(point=(0.0, 0.0, ARM), axis=(-1.0, 0.0, 0.0))


def shown(door: DoorConfig, seed: int = 0) -> TurnedHandle | None:
    return turned_handle(align(Teacher().standard_demonstrations(seed=seed, like=door)))


@pytest.mark.parametrize("seed", range(4))
def test_demonstrations_tell_where_a_lever_s_axis_is(seed: int) -> None:
    """To the centimetre by which the sensor is beside the place of the grasp."""
    handle = shown(LEVER, seed)
    assert handle is not None
    assert_allclose(handle.point, EXACT.point, atol=0.012)
    assert_allclose(handle.axis, EXACT.axis, atol=0.06)


def test_a_left_hinged_door_s_lever_points_to_the_other_side() -> None:
    handle = shown(DoorConfig(handle="lever", latch="spring", hinge_side="left"))
    assert handle is not None
    assert_allclose(handle.point, (0.0, 0.0, -ARM), atol=0.012)
    assert_allclose(handle.axis, (1.0, 0.0, 0.0), atol=0.06)


def test_a_bar_is_no_handle_that_turns() -> None:
    assert shown(DoorConfig()) is None


def test_a_hand_that_turns_while_it_goes_on_turns_no_handle() -> None:
    """About one axis first and about another later, but no point of it rests."""
    s = np.linspace(0.0, 1.0, 200)
    first, later = np.minimum(s / 0.4, 1.0), np.maximum(s - 0.4, 0.0)
    turns = Rotation.from_rotvec(np.outer(2.0 * later, [0.0, 1.0, 0.0]))
    turns = turns * Rotation.from_rotvec(np.outer(0.5 * first, [1.0, 0.0, 0.0]))
    away = np.outer(s, [0.5, 0.0, 0.0])
    poses = np.hstack([away, turns.as_rotvec()])
    aligned = align([Demonstration(times=5.0 * s, poses=poses)] * 2)
    assert turned_handle(aligned) is None


def test_the_axis_goes_along_the_door_s_circle_whatever_the_handle_does() -> None:
    angles = np.linspace(0.0, 1.2, 13)
    turns = 0.7 * np.sin(5.0 * angles) ** 2
    places = EXACT.places(GEOMETRY.hand_poses(angles, turns))[:, :3]
    closed = EXACT.places(GEOMETRY.hand_poses(angles))[:, :3]
    assert_allclose(places, closed, atol=1e-12)
    assert_array_equal(EXACT.places(np.zeros((1, 6)))[:, :3], np.zeros((1, 3)))


@pytest.mark.parametrize(("angle", "turn"), [(0.0, 0.3), (0.5, 0.7), (1.0, 0.0)])
def test_the_way_is_where_the_hand_goes_while_the_handle_turns(
    angle: float, turn: float
) -> None:
    before, here, after = GEOMETRY.hand_poses(angle, turn + np.array([-1e-4, 0, 1e-4]))
    way = (after - before)[:3]
    assert_allclose(EXACT.way(here.tolist()), way / np.linalg.norm(way), atol=1e-6)


@pytest.mark.parametrize(("angle", "turn"), [(0.0, 0.0), (0.4, 0.7), (1.2, -0.1)])
def test_a_hand_s_turn_is_the_leaf_s_and_the_handle_s(
    angle: float, turn: float
) -> None:
    rotation = GEOMETRY.hand_poses(angle, turn)[3:].tolist()
    leaf, handle = EXACT.turns(rotation)
    assert_allclose(leaf, (0.0, angle, 0.0), atol=1e-12)
    assert handle == pytest.approx(turn)


def test_a_handle_that_goes_back_tells_nothing_of_the_door() -> None:
    """It goes back because the policy has it go: the phase is that of the leaf."""
    aligned = align(Teacher().standard_demonstrations(seed=0, like=LEVER))
    angles = np.linspace(0.0, 0.6, 200)
    pressed = np.minimum(np.linspace(0.0, 4.0, 200), 1.0) * 0.75
    phases = []
    for kept in (1.0, 0.2):
        back = np.where(angles > 0.15, kept, 1.0)
        rule, phase = PathPhase(EmpiricalDistribution(aligned), aligned), np.zeros(())
        opening = np.maximum(angles - 0.15, 0.0)
        for pose in GEOMETRY.hand_poses(opening, pressed * back):
            phase = rule.update(pose, phase, phase).phase
        phases.append(float(phase))
    assert phases[0] > 0.3
    assert phases[0] == pytest.approx(phases[1], abs=0.01)


def test_a_knob_has_no_way() -> None:
    handle = shown(DoorConfig(handle="knob", latch="spring"))
    assert handle is not None
    assert handle.way([0.0] * 6) == (0.0, 0.0, 0.0)


PERIOD = 0.01
LEARNED = LearnedLoad()
PRESSED = GEOMETRY.hand_poses(0.0, 0.7)
WAY = np.array(EXACT.way(PRESSED.tolist()))
PULL = np.array([1.0, 0.0, 0.0])


def met(force: np.ndarray) -> Encounter:
    wrench = np.concatenate([force, np.zeros(3)])
    return Encounter(
        wrench=wrench, direction=PULL, pose=PRESSED, displacement=np.zeros(3)
    )


def test_the_spring_of_a_lever_is_carried_while_the_door_is_pulled() -> None:
    """And what is across both ways is yielded to, as it is where nothing turns."""
    spring, across = -6.0 * WAY, 3.0 * np.cross(PULL, WAY)
    load = HandleAndDoor(
        LearnedLoad(), DEFAULT_PROFILE, Handles([EXACT], ()), (), PERIOD
    )
    response = load.meet(met(spring + across - 8.0 * PULL))
    assert_allclose(response.wrench[:3], across, atol=1e-9)
    assert response.carried == pytest.approx(8.0)


def test_what_presses_a_lever_further_is_yielded_to() -> None:
    load = HandleAndDoor(
        LearnedLoad(), DEFAULT_PROFILE, Handles([EXACT], ()), (), PERIOD
    )
    response = load.meet(met(6.0 * WAY))
    assert_allclose(response.wrench[:3], 6.0 * WAY)


def test_a_door_behind_a_handle_may_be_heavier_than_a_friction_grasp_holds() -> None:
    for handle, carried in ((None, 25.0), (EXACT, 45.0)):
        handles = Handles([handle], ())
        load = HandleAndDoor(LearnedLoad(), DEFAULT_PROFILE, handles, (), PERIOD)
        assert load.meet(met(-45.0 * PULL)).carried == pytest.approx(carried)


def test_turning_a_handle_teaches_nothing_of_the_door() -> None:
    """A door behind a light lever is expected to be as heavy as any other."""
    load = HandleAndDoor(
        LearnedLoad(limit=25.0), DEFAULT_PROFILE, Handles([EXACT], ()), (), PERIOD
    )
    for turn in np.linspace(0.0, 0.7, 60):
        pose = GEOMETRY.hand_poses(0.0, turn)
        way = np.array(EXACT.way(pose.tolist()))
        wrench = np.concatenate([-2.0 * way, np.zeros(3)])
        turning = Encounter(
            wrench=wrench, direction=way, pose=pose, displacement=np.zeros(3)
        )
        load.meet(turning)
    assert load.meet(met(-20.0 * PULL)).carried == pytest.approx(20.0)
    stop = load.meet(met(-20.0 * WAY)).wrench[:3] @ -WAY
    assert 14.0 < stop < 18.0


def test_one_hand_and_many_meet_the_same() -> None:
    handles = [None, EXACT, None]
    poses = np.stack([PRESSED, PRESSED, np.zeros(6)])
    forces = np.random.default_rng(0).normal(size=(3, 6))
    many = HandleAndDoor(
        LearnedLoad(), DEFAULT_PROFILE, Handles(handles, (3,)), (3,), PERIOD
    )
    together = many.meet(
        Encounter(
            wrench=forces,
            direction=np.tile(PULL, (3, 1)),
            pose=poses,
            displacement=np.zeros((3, 3)),
        )
    )
    for row, handle in enumerate(handles):
        alone = HandleAndDoor(
            LearnedLoad(), DEFAULT_PROFILE, Handles([handle], ()), (), PERIOD
        ).meet(
            Encounter(
                wrench=forces[row],
                direction=PULL,
                pose=poses[row],
                displacement=np.zeros(3),
            )
        )
        assert_array_equal(together.wrench[row], alone.wrench)
        assert together.pace[row] == alone.pace


def test_a_bar_is_met_by_the_rule_alone() -> None:
    rule = CarriedLoad()
    load = HandleAndDoor(rule, DEFAULT_PROFILE, Handles([None], ()), (), PERIOD)
    encounter = met(np.array([-30.0, 2.0, 1.0]))
    expected = rule.meet(encounter)
    response = load.meet(encounter)
    assert_array_equal(response.wrench, expected.wrench)
    assert response.carried == expected.carried
