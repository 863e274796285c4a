"""The synthetic human turns handles: press, open, let go back."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    ROOM_RADII,
    Teacher,
    TeacherConfig,
)
from gplfd_experiments.data.teacher.handle_motion import (
    Press,
    doors_like,
    draw_press,
    duration,
    let_back,
    worked,
)

SILENT = TeacherConfig(
    wobble_position_std=0.0, wobble_rotation_std=0.0, grasp_offset_std=0.0,
    vertical_drift_std=0.0, noise_position_std=0.0, noise_rotation_std=0.0,
)  # fmt: skip
LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
KINDS = [
    dataclasses.replace(LEVER, handle=handle, swing=swing, hinge_side=side)
    for handle in ("lever", "knob")
    for swing in ("pull", "push")
    for side in ("right", "left")
]


def shown(door: DoorConfig, seed: int = 0) -> np.ndarray:
    return Teacher(SILENT).demonstrate(door, np.random.default_rng(seed)).poses


def angles_of(door: DoorConfig, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Opening and handle angle of poses: R = exp(φ a) exp(θ t) with a ⟂ t."""
    geometry = DoorGeometry.of(door)
    assert geometry.turn is not None
    axis, turn = np.array(geometry.axis), np.array(geometry.turn)
    rotations = Rotation.from_rotvec(poses[:, 3:].copy())
    # φ from where t goes, θ from the rest.
    image = rotations.apply(turn)
    opened = np.arctan2(np.cross(turn, image) @ axis, image @ turn)
    rest = Rotation.from_rotvec(-opened[:, None] * axis) * rotations
    moved = rest.apply(axis)
    turned = np.arctan2(-moved @ np.cross(axis, turn), moved @ axis)
    # The hand turns by half of the leaf where it pushes a knob.
    share = 0.5 if (door.handle, door.swing) == ("knob", "push") else 1.0
    return opened / share, turned


@pytest.mark.parametrize("door", KINDS, ids=lambda d: "-".join(d.kind.values()))
def test_the_hand_follows_handle_and_door(door: DoorConfig) -> None:
    poses = shown(door)
    opened, turned = angles_of(door, poses)
    # The positions are those of a hand that holds the handle rigidly.
    expected = DoorGeometry.of(door).hand_poses(opened, turned)
    np.testing.assert_allclose(poses[:, :3], expected[:, :3], atol=1e-9)
    assert opened[-1] == pytest.approx(np.radians(67.0), abs=np.radians(4.0))
    assert np.all(np.diff(opened) > -1e-9)
    # Nobody opens a latched door: it begins to move where the handle has gone most of
    # its travel, and the handle is nearly back when the door is half open.
    begins = np.flatnonzero(opened > np.radians(0.2))[0]
    assert turned[begins] > 0.8 * door.handle_travel
    assert turned.max() <= door.handle_travel + 1e-9
    resting = 0.2 * turned.max()
    np.testing.assert_allclose(turned[opened > np.radians(26.0)], resting, atol=1e-9)


def test_a_left_door_is_the_mirror_of_a_right_one() -> None:
    right = shown(LEVER)
    left = shown(dataclasses.replace(LEVER, hinge_side="left"))
    mirrored = right * np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    np.testing.assert_allclose(left, mirrored, atol=1e-12)


def test_a_bar_is_pulled_at_once_and_as_ever() -> None:
    assert draw_press(DoorConfig(), np.random.default_rng(0)) == Press()
    progress = np.linspace(0.0, 1.0, 11)
    share, opening = worked(progress, Press(), 6.0)
    np.testing.assert_array_equal(opening, progress)
    assert not share.any()
    assert duration(Press(), 6.0) == 6.0
    first = Teacher().demonstrate(0.5, np.random.default_rng(3))
    second = Teacher().demonstrate(DoorConfig(radius=0.5), np.random.default_rng(3))
    np.testing.assert_array_equal(first.poses, second.poses)


def test_nobody_turns_a_handle_beyond_its_stop() -> None:
    rng = np.random.default_rng(0)
    presses = [draw_press(LEVER, rng) for _ in range(200)]
    assert max(press.angle for press in presses) <= LEVER.handle_travel
    assert min(press.time for press in presses) >= 0.4
    angles = np.radians([0.0, 8.0, 16.5, 25.0, 60.0])
    back = let_back(Press(time=1.0, angle=0.8), np.ones(5), angles)
    np.testing.assert_allclose(back, [0.8, 0.8, 0.48, 0.16, 0.16], atol=1e-12)


def test_doors_of_a_kind_are_demonstrated() -> None:
    plain = doors_like(DoorConfig(radius=0.42, hinge_friction=2.0))
    assert plain == tuple(DoorConfig(radius=radius) for radius in DEMONSTRATED_RADII)
    heavy = dataclasses.replace(LEVER, hinge_friction=2.0, swing="push")
    rooms = doors_like(heavy)
    assert [door.radius for door in rooms] == list(ROOM_RADII)
    assert all(door.kind == heavy.kind for door in rooms)
    assert all(door.hinge_friction == DoorConfig().hinge_friction for door in rooms)
