"""The door against closed forms: arc, inertia, closer, friction, damping, energy."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.observation import Reader

STOP_ANGLE = DoorConfig().stop_angle

READER = Reader.of("contact", "pose")


def door_alone(**fields: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A scene whose hand and bar pass through each other."""
    model = build_scene(DoorConfig(**fields))
    model.geom("handle_bar").conaffinity = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    return model, data


def hinge_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mass_matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass_matrix)
    dof = int(model.joint("hinge").dofadr[0])
    return float(mass_matrix[dof, dof])


@settings(max_examples=30)
@given(radius=st.floats(0.30, 0.65), angle=st.floats(0.0, STOP_ANGLE))
def test_handle_moves_on_the_closed_form_arc(radius: float, angle: float) -> None:
    model, data = door_alone(radius=radius)
    data.joint("hinge").qpos = angle
    mujoco.mj_forward(model, data)
    frame, handle = data.site("task_frame"), data.site("handle")
    axes = frame.xmat.reshape(3, 3)
    expected = handle_pose_on_arc(radius, angle)
    position = axes.T @ (handle.xpos - frame.xpos)
    assert_allclose(position, expected[:3], atol=1e-12)
    rotation = axes.T @ handle.xmat.reshape(3, 3)
    assert_allclose(
        rotation, Rotation.from_rotvec(expected[3:]).as_matrix(), atol=1e-12
    )
    reading = READER.door_reading(data.sensordata.tolist())
    assert_allclose(reading.handle_position, expected[:3], atol=1e-12)
    assert reading.angle == angle


def test_hinge_inertia_is_that_of_leaf_and_handle() -> None:
    radius, mass, standoff = 0.6, 20.0, 0.08
    model, data = door_alone(radius=radius, panel_mass=mass, handle_standoff=standoff)
    width, thickness = radius + 0.01 + 0.08, 0.04
    middle = radius + 0.08 - width / 2
    leaf = mass * ((width**2 + thickness**2) / 12 + middle**2 + standoff**2)
    handle = (0.3 + 2 * 0.05) * radius**2
    assert hinge_inertia(model, data) == pytest.approx(leaf + handle + 0.01, rel=2e-3)


@pytest.mark.parametrize("degrees", [0.0, 20.0, 70.0])
def test_closer_torque_is_preload_plus_stiffness_times_angle(degrees: float) -> None:
    model, data = door_alone(closer_preload=3.0, closer_stiffness=2.0)
    angle = np.radians(degrees)
    data.joint("hinge").qpos = angle
    mujoco.mj_forward(model, data)
    assert data.joint("hinge").qfrc_actuator == pytest.approx(-(3.0 + 2.0 * angle))


@pytest.mark.parametrize("degrees", [10.0, 45.0])
def test_force_at_the_handle_balances_the_closer(degrees: float) -> None:
    """Static balance: a tangential force F at radius R against preload + k φ."""
    radius, angle = 0.5, np.radians(degrees)
    model, data = door_alone(
        radius=radius, closer_preload=4.0, closer_stiffness=3.0, hinge_friction=0.0
    )
    data.joint("hinge").qpos = angle
    mujoco.mj_forward(model, data)
    tangent = data.site("handle").xmat.reshape(3, 3)[:, 0]
    force = (4.0 + 3.0 * angle) / radius * tangent
    dof = model.joint("hinge").dofadr[0]
    for extra, sign in ((0.0, 0.0), (0.1, 1.0), (-0.1, -1.0)):
        data.qfrc_applied[:] = 0.0
        push = force + extra * tangent
        mujoco.mj_applyFT(
            model,
            data,
            push,
            np.zeros(3),
            data.site("handle").xpos,
            model.body("door").id,
            data.qfrc_applied,
        )
        mujoco.mj_forward(model, data)
        assert np.sign(round(float(data.qacc[dof]), 6)) == sign


@pytest.mark.parametrize("friction", [0.5, 2.0, 20.0])
def test_a_stuck_hinge_does_not_creep(friction: float) -> None:
    model, data = door_alone(hinge_friction=friction, hinge_damping=0.0)
    data.joint("hinge").qpos = 0.3
    data.joint("hinge").qfrc_applied = 0.9 * friction
    mujoco.mj_step(model, data, nstep=2500)
    assert abs(np.degrees(data.joint("hinge").qpos[0] - 0.3)) < 0.05


def test_hinge_friction_holds_below_and_yields_above() -> None:
    for torque, moves in ((1.9, False), (2.1, True)):
        model, data = door_alone(hinge_friction=2.0, hinge_damping=0.0)
        dof = model.joint("hinge").dofadr[0]
        data.qfrc_applied[dof] = torque
        mujoco.mj_step(model, data, nstep=1000)
        net = (torque - 2.0) if moves else 0.0
        # Starting from rest for 2 s: φ = (τ - τ_f) t² / (2 I).
        angle = net * 2.0**2 / (2 * hinge_inertia(model, data))
        assert data.joint("hinge").qpos == pytest.approx(angle, abs=3e-3)


def test_hinge_damping_sets_the_terminal_speed() -> None:
    model, data = door_alone(hinge_friction=0.0, hinge_damping=8.0, radius=0.3)
    dof = model.joint("hinge").dofadr[0]
    data.qfrc_applied[dof] = 2.0
    mujoco.mj_step(model, data, nstep=1500)
    time_constant = hinge_inertia(model, data) / 8.0
    expected = 2.0 / 8.0 * (1 - np.exp(-3.0 / time_constant))
    assert data.joint("hinge").qvel == pytest.approx(expected, rel=2e-3)


def test_a_frictionless_closer_turns_its_work_into_kinetic_energy() -> None:
    model, data = door_alone(
        hinge_friction=0.0,
        hinge_damping=0.0,
        closer_preload=2.0,
        closer_stiffness=5.0,
    )
    start = np.radians(60.0)
    data.joint("hinge").qpos = start
    inertia = hinge_inertia(model, data)
    angles, speeds = [], []
    for _ in range(2000):
        if data.joint("hinge").qpos < 0.05:
            break
        angles.append(data.joint("hinge").qpos[0])
        speeds.append(data.joint("hinge").qvel[0])
        mujoco.mj_step(model, data)
    work = 2.0 * (start - np.array(angles)) + 2.5 * (start**2 - np.array(angles) ** 2)
    assert work[-1] > 4.0
    # Semi-implicit steps of 2 ms err by one step's work: 7 N m times 1.7 rad/s * 2 ms.
    assert_allclose(0.5 * inertia * np.square(speeds), work, atol=0.025)


def test_hinge_stops_at_its_range() -> None:
    model, data = door_alone(hinge_friction=0.0, hinge_damping=1.0)
    dof = model.joint("hinge").dofadr[0]
    for torque, stop in ((5.0, STOP_ANGLE), (-5.0, 0.0)):
        data.qfrc_applied[dof] = torque
        mujoco.mj_step(model, data, nstep=4000)
        assert data.joint("hinge").qpos == pytest.approx(stop, abs=0.01)


def test_work_at_the_handle_is_what_the_door_takes(
    make_env: Callable, arc_commands: Callable
) -> None:
    """∫(F_t R + M) dφ = friction·φ + damping·∫ω dφ + closer work + kinetic energy.

    M is the moment that the pads transmit about the bar. Summed over physics steps:
    within a control period the force falls as the hand catches up with its command.
    """
    friction, damping, preload, stiffness, radius = 2.0, 3.0, 1.0, 2.0, 0.5
    env = make_env(
        {
            "radius": radius,
            "hinge_friction": friction,
            "hinge_damping": damping,
            "closer_preload": preload,
            "closer_stiffness": stiffness,
        }
    )
    env.reset(seed=0)
    data = env.data
    torque, speed, angle = [], [], [data.joint("hinge").qpos[0]]
    for command in arc_commands(radius, degrees=45.0, duration=4.0)[:400]:
        data.ctrl[:6] = command
        for _ in range(5):
            mujoco.mj_step(env.model, data)
            values = data.sensordata.tolist()
            moment = -READER.wrench(values)[4]
            tangential, _, _ = READER.door_reading(values).forces
            torque.append(radius * tangential + moment)
            speed.append(data.joint("hinge").qvel[0])
            angle.append(data.joint("hinge").qpos[0])
    advance = np.diff(angle)
    opened = angle[-1] - angle[0]
    work = torque @ advance
    expected = friction * opened + damping * (speed @ advance)
    expected += preload * opened + stiffness * angle[-1] ** 2 / 2
    expected += hinge_inertia(env.model, data) * speed[-1] ** 2 / 2
    assert opened > np.radians(40)
    assert work == pytest.approx(expected, rel=0.005)
