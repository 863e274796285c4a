"""The forces of the synthetic human: against energy, MuJoCo and the motion alone."""

import dataclasses
import functools
import math
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import en1154
from gplfd_env.doors.motion import CloserLaw
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_experiments.data import teacher
from gplfd_experiments.data.teacher.forces import (
    ForceConfig,
    handle_torque,
    hinge_torque,
)
from gplfd_experiments.data.teacher.motion import MESSY, TIDY, minimum_jerk
from gplfd_experiments.studies.tasks import noisy_teacher

SIZES = [one.name for one in dataclasses.fields(ForceConfig) if "time" not in one.name]
NEEDED = ForceConfig(**dict.fromkeys(SIZES, 0.0), variation_time=0.05)
"""Neither variation nor an error of measurement."""
CLOSER = {"closer": en1154(2), "seal": 2.0, "stiction": 1.0}
ROOM = {"handle": "lever", "latch": "spring", "radius": 0.65}
DOORS: dict[str, dict[str, Any]] = {
    "bar": {},
    "pushed, left": {"swing": "push", "hinge_side": "left", "closer": {"preload": 5.0}},
    "closer": CLOSER,
    "lever": ROOM,
    "lever and closer, left": {**ROOM, **CLOSER, "hinge_side": "left"},
    "pushed knob": {**ROOM, "handle": "knob", "swing": "push"},
}


@functools.cache
def needed_by(door, seed):
    return shown(door, seed=seed)


def shown(door, forces=NEEDED, habits=TIDY, seed: int = 0, **changes: float) -> Any:
    config = teacher.TeacherConfig(**(noisy_teacher(0.0) | changes))
    rng = np.random.default_rng(seed)
    return teacher.Teacher(config, habits, forces).demonstrate(door, rng)


def bolt_ratio(door: DoorConfig) -> float:
    """How far an angle of the handle draws the bolt [m/rad]."""
    return door.lockset.bolt_throw / (door.handle_travel - door.lockset.dead_travel)


@pytest.mark.parametrize("name", DOORS)
def test_the_hand_does_the_work_that_the_door_takes(name):
    """∫ f·v + m·ω dt is the springs' energy and what friction and damping take.

    Wherever the sensor is on the hand; the door is at rest at both ends. A minimum-jerk
    motion by Φ in T has ∫ φ̇² dt = 10/7 Φ²/T.
    """
    door = DoorConfig(**DOORS[name])
    even = dict.fromkeys(("duration_std", "angle_std", "timing_std"), 0.0)
    given = shown(door, grasp_offset_std=0.03, **even)
    rotations = Rotation.from_rotvec(given.poses[:, 3:].copy())
    turned = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    moved = np.hstack([np.diff(given.poses[:, :3], axis=0), turned])
    work = (moved * (given.wrenches[1:] + given.wrenches[:-1]) / 2).sum()

    end, duration = (
        teacher.standard_teacher()[f"{x}_mean"] for x in ("angle", "duration")
    )
    angles = np.linspace(0.0, end, 10_000)
    expected = trapezoid(CloserLaw.of(door).torque(angles, 0.0 * angles), angles)
    damping = door.hinge_damping + door.closer.damping
    expected += door.friction * end + damping * 10 / 7 * end**2 / duration
    if door.handle != "bar":
        turn = abs(rotations[-1].as_euler("YXZ")[1])
        bolt = bolt_ratio(door) * (turn - door.lockset.dead_travel)
        preload, stiffness = door.handle_spring
        expected += preload * turn + stiffness * turn**2 / 2
        expected += (
            door.lockset.bolt_preload * bolt + door.lockset.bolt_stiffness * bolt**2 / 2
        )
    assert work == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("name", DOORS)
def test_the_simulated_door_takes_the_same_torques(name):
    """Inverse dynamics of the scene, without the bolt's contact with the strike."""
    door, rate = DoorConfig(**DOORS[name]), 500.0
    times, ratio = np.arange(0.0, 4.0, 1.0 / rate), bolt_ratio(door)
    angles = 1.2 * minimum_jerk((times - 0.7) / 3.0)
    turns = 0.9 * door.handle_travel * minimum_jerk(times / 0.8)
    motions = {"hinge": angles}
    if door.handle != "bar":
        bolt = ratio * np.maximum(turns - door.lockset.dead_travel, 0.0)
        motions |= {"handle": turns, "bolt": bolt}
    model = build_scene(door, robot=TIAGO_LIKE.on(base_for(door, TIAGO_LIKE)))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    torque, on_handle = hinge_torque(door, angles, rate), handle_torque(door, turns)
    rates = {name: np.gradient(each, 1 / rate) for name, each in motions.items()}
    for index in np.flatnonzero((angles > math.radians(1.0)) & (angles < 1.19))[::25]:
        for name, each in motions.items():
            data.joint(name).qpos, data.joint(name).qvel = (
                each[index],
                rates[name][index],
            )
        mujoco.mj_forward(model, data)
        data.qacc[:] = 0.0
        for name, each in rates.items():
            data.joint(name).qacc = np.gradient(each, 1 / rate)[index]
        mujoco.mj_inverse(model, data)
        needed = {name: data.joint(name).qfrc_inverse[0] for name in motions}
        needed["hinge"] -= data.joint("hinge").qfrc_actuator[0]
        assert torque[index] == pytest.approx(needed["hinge"], rel=0.02, abs=0.05)
        if door.handle != "bar":
            # The tendon's force between handle and bolt cancels.
            both = needed["handle"] + ratio * needed["bolt"]
            assert on_handle[index] == pytest.approx(both, rel=0.02, abs=0.05)


@pytest.mark.parametrize("habits", [TIDY, MESSY])
def test_forces_leave_the_motion_alone_and_are_the_same_again(habits):
    door, each = DoorConfig(**ROOM), []
    for forces in (ForceConfig(), ForceConfig(), None):
        human, rng = (
            teacher.Teacher(habits=habits, forces=forces),
            np.random.default_rng(3),
        )
        each.append([human.demonstrate(door, rng) for _ in range(2)])
    for one, again, alone in zip(*each, strict=True):
        assert one.times.tobytes() == alone.times.tobytes()
        assert one.poses.tobytes() == alone.poses.tobytes()
        assert_array_equal(one.wrenches, again.wrenches)
        assert alone.wrenches is None


def test_forces_are_those_of_the_hand_on_the_handle():
    """It pulls towards x, or pushes against it, and presses a lever down."""
    assert (shown(DoorConfig()).wrenches[1:60, 0] > 0.0).all()
    assert (shown(DoorConfig(swing="push")).wrenches[1:60, 0] < 0.0).all()
    pressing = shown(DoorConfig(**ROOM)).wrenches[1:30]
    assert (pressing[:, 1] < 0.0).all()
    assert_allclose(pressing[:, 0], 0.0, atol=1e-9)


def test_a_pause_holds_the_closer_and_lost_samples_lose_their_wrench():
    door = DoorConfig(closer={"preload": 10.0})
    pausing = dataclasses.replace(TIDY, pauses=1, longest_pause=10.0)
    given = shown(door, habits=pausing, seed=1)
    speed = np.abs(np.gradient(given.poses[:, 4]))
    still = np.convolve(speed, np.ones(15), "same")[:-60] < 1e-9
    assert np.count_nonzero(still) > 60
    pull = np.linalg.norm(given.wrenches[:-60][still, :3], axis=1)
    assert_allclose(pull * door.radius, 10.0, rtol=1e-6)
    whole = shown(door, habits=dataclasses.replace(MESSY, dropped=0.0))
    part = shown(door, habits=MESSY)
    kept = np.isin(whole.times, part.times)
    assert not kept.all()
    assert_array_equal(part.wrenches, whole.wrenches[kept])


@pytest.mark.slow
@pytest.mark.parametrize("field", SIZES)
def test_each_variation_has_its_size_and_axes(field):
    """In axes along the path, up, and along the leaf."""
    axes = {"effo": [0], "acro": [1, 2]}.get(field[:4], [0, 1, 2])
    axes = [3, 4, 5] if "moment" in field else axes
    door, squares = DoorConfig(closer={"preload": 10.0}), []
    varied = dataclasses.replace(NEEDED, **{field: 0.2})
    for seed in range(30):
        needed, given = needed_by(door, seed), shown(door, varied, seed=seed)
        leaf = Rotation.from_rotvec(np.repeat(given.poses[60:-60, 3:], 2, axis=0)).inv()
        difference, pull = (
            leaf.apply(one[60:-60].reshape(-1, 3).copy()).reshape(-1, 6)
            for one in (given.wrenches - needed.wrenches, needed.wrenches)
        )
        scale = pull[:, :1] if field in ("effort_std", "across_share") else 1.0
        squares.append(((difference / scale) ** 2).mean(axis=0))
    size = np.sqrt(np.mean(squares, axis=0))
    assert_allclose(size[axes], 0.2, rtol=0.3)
    assert_allclose(np.delete(size, axes), 0.0, atol=1e-12)
