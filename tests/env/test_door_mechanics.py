"""The door against closed forms: arc, inertia, friction, closer, stops, energy."""

import dataclasses

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.hardware import EN_1154, en1154, leaf
from gplfd_env.doors.motion import CloserLaw, LeafPath
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.task.observation import Sensors

pytestmark = pytest.mark.slow

FREE = {"hinge_friction": 0.0, "hinge_damping": 0.0}
OFFICE = {**FREE, "radius": 0.65, "panel_mass": 30.0}
READER = Sensors.of("contact", "pose", TIAGO_LIKE)


def hinge_inertia(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    mass_matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass_matrix)
    dof = int(model.joint("hinge").dofadr[0])
    return float(mass_matrix[dof, dof])


def test_hinge_inertia_is_that_of_leaf_and_handle(door_alone):
    radius, mass, standoff = 0.6, 20.0, 0.08
    model, data = door_alone(
        radius=radius, panel_mass=mass, leaf={"handle_standoff": standoff}
    )
    width, thickness = radius + 0.01 + 0.08, 0.04
    middle = radius + 0.08 - width / 2
    panel = mass * ((width**2 + thickness**2) / 12 + middle**2 + standoff**2)
    handle = (0.3 + 2 * 0.05) * radius**2
    assert hinge_inertia(model, data) == pytest.approx(panel + handle + 0.01, rel=2e-3)


@pytest.mark.parametrize("friction", [0.5, 2.0, 20.0])
def test_hinge_friction_holds_below_and_yields_above(friction, door_alone):
    """Held, it does not creep; from rest, φ = (τ - τ_f) t² / (2 I)."""
    for torque in (0.9 * friction, friction + 0.1):
        model, data = door_alone(hinge_friction=friction, hinge_damping=0.0)
        data.joint("hinge").qpos = 0.3
        data.joint("hinge").qfrc_applied = torque
        inertia = hinge_inertia(model, data)
        mujoco.mj_step(model, data, nstep=1000)
        angle = max(torque - friction, 0.0) * 2.0**2 / (2.0 * inertia)
        moved = data.joint("hinge").qpos[0] - 0.3
        assert moved == pytest.approx(angle, abs=3e-3 if angle else np.radians(0.02))


@pytest.mark.parametrize("base", ["fixed", "mobile"])
@pytest.mark.parametrize("name", ["small", "room-834"])
def test_the_torque_at_the_stop_presses_the_leaf_against_it(name, base, door_alone):
    door = DOORS[name]
    model, data = door_alone(base, **door.as_dict())
    data.joint("hinge").qpos = door.stop_angle
    data.joint("hinge").qfrc_applied = 50.0
    mujoco.mj_step(model, data, nstep=500)
    reader = Sensors.of("contact", "pose", TIAGO_LIKE.on(base), door.handle, door.swing)
    reading = reader.door_reading(data.sensordata.tolist(), LeafPath())
    assert reading.angle == pytest.approx(door.stop_angle, abs=2e-3)
    assert reading.stop_torque == pytest.approx(50.0, rel=0.03)
    assert reading.handle_angle == pytest.approx(0.0, abs=0.01)
    data.joint("hinge").qpos = 0.1
    data.joint("hinge").qfrc_applied = -50.0
    mujoco.mj_step(model, data, nstep=2000)
    assert data.joint("hinge").qpos == pytest.approx(0.0, abs=0.01)


def test_work_at_the_handle_is_what_the_door_takes(start_env, arc_commands):
    """∫(F_t R + M) dφ = friction·φ + damping·∫ω dφ + closer work + kinetic energy.

    M is the moment that the pads transmit about the bar. Summed over physics steps:
    within a control period the force falls as the hand catches up with its command.
    """
    friction, damping, preload, stiffness, radius = 2.0, 3.0, 1.0, 2.0, 0.5
    env = start_env(
        {
            "radius": radius,
            "hinge_friction": friction,
            "hinge_damping": damping,
            "closer": {"preload": preload, "stiffness": stiffness},
        }
    )
    data = env.data
    torque, speed, angle = [], [], [data.joint("hinge").qpos[0]]
    for command in arc_commands(radius, degrees=45.0, duration=4.0)[:400]:
        data.ctrl[:6] = command
        for _ in range(5):
            mujoco.mj_step(env.model, data)
            values = data.sensordata.tolist()
            moment = -READER.wrench(values)[4]
            tangential, _, _ = READER.door_reading(values, LeafPath()).forces
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


# --- Closers -------------------------------------------------------------------------


@pytest.mark.parametrize("velocity", [-0.6, -0.05, 0.05, 0.6])
@pytest.mark.parametrize("degrees", [0.2, 2.0, 10.0, 40.0, 80.0, 95.0])
def test_the_scene_exerts_the_law(degrees, velocity, door_alone):
    """`CloserLaw` within 2 %, what a limit leaves of a damper; what acts is I φ̈."""
    closer = dataclasses.replace(en1154(2), stiffness=1.5)
    fields = {**OFFICE, "closer": closer, "stiction": 3.0, "seal": 2.0}
    angle = np.radians(degrees)
    expected = CloserLaw.of(DoorConfig(**fields)).torque(angle, velocity)
    model, data = door_alone(**fields)
    hinge = data.joint("hinge")
    hinge.qpos, hinge.qvel = angle, velocity
    actual = -hinge_inertia(model, data) * hinge.qacc[0]
    assert actual == pytest.approx(expected, rel=0.02, abs=0.05)


@given(size=st.sampled_from([1, 2, 3, 4]), share=st.floats(0.0, 1.0))
def test_a_closer_is_what_en_1154_allows(size, share):
    """Moments of the law itself, quasi-static, against the rows of table 1."""
    row = EN_1154[size]
    efficiency = row.efficiency + share * (1.0 - row.efficiency)
    door = DoorConfig(**OFFICE, closer=en1154(size, efficiency))
    slow = 2e-3

    def moment(degrees: float, velocity: float) -> float:
        still = door.closer.damping + door.closer.closing_damping * (velocity < 0.0)
        torque = CloserLaw.of(door).torque(np.radians(degrees), velocity)
        return torque - still * velocity

    closing, opening = moment(0.0, -slow), moment(0.0, slow)
    assert row.closing[0] - 1e-9 <= closing <= row.closing[1] + 1e-9
    assert closing / opening == pytest.approx(efficiency)
    for degrees in range(0, 61, 5):
        assert moment(degrees, slow) <= row.opening + 1e-9
    assert moment(90.0, -slow) >= row.closing_open


@settings(max_examples=4)
@given(
    angle=st.floats(0.1, 1.6),
    speed=st.floats(-4.0, 4.0),
    size=st.sampled_from([1, 2, 3, 4]),
)
def test_a_released_door_loses_energy_until_it_shuts(angle, speed, size, door_alone):
    """Kinetic energy and that of the springs together never rise."""
    fields = {**OFFICE, "closer": en1154(size), "seal": 2.0}
    model, data = door_alone(**fields)
    door = DoorConfig(**fields)
    inertia = float(1.0 / model.dof_invweight0[model.joint("hinge").dofadr[0]])
    grid = np.linspace(0.0, 1.8, 3601)
    spring = np.array([CloserLaw.of(door).torque(phi, 0.0) for phi in grid])
    steps = 0.5 * (spring[1:] + spring[:-1]) * (grid[1] - grid[0])
    potential = np.concatenate([[0.0], np.cumsum(steps)])
    hinge = data.joint("hinge")
    hinge.qpos, hinge.qvel = angle, speed
    rows = []
    for _ in range(10_000):
        mujoco.mj_step(model, data)
        rows.append((hinge.qpos[0], hinge.qvel[0]))
    phi, rate = np.array(rows).T
    energy = 0.5 * inertia * rate**2 + np.interp(phi, grid, potential)
    rise = energy[1:] - np.minimum.accumulate(energy)[:-1]
    moving = (phi[1:] > 0.0) & (phi[1:] < door.stop_angle)
    assert rise[moving].max() <= 2e-2
    assert phi[-1] < np.radians(0.5)


def test_a_leaf_by_din_has_its_radius_mass_and_friction():
    fields = leaf(0.709, "tubular-core")
    door = DoorConfig(**{**fields, "radius": 0.65})
    assert fields["radius"] == pytest.approx(0.654)
    assert door.panel_mass == pytest.approx(15.0 * 0.709 * 1.972)
    weight = 9.81 * door.panel_mass
    expected = 0.04 * (weight * 7.5e-3 + 2.0 * weight * 0.3545 / 1.5 * 4.8e-3)
    assert door.hinge_friction == pytest.approx(expected)
