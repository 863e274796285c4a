"""What closes a door does what its fields say, and creates no energy."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import EN_1154, en1154, leaf, spring_hinge
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.scene.closer import STICTION_ANGLE, CloserLaw

pytestmark = pytest.mark.slow

LIGHT = {"hinge_friction": 0.0, "hinge_damping": 0.0}
OFFICE = {**LIGHT, "radius": 0.65, "panel_mass": 30.0}


def door_alone(**fields: Any) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a door that the hand passes through."""
    model = build_scene(DoorConfig(**fields))
    model.geom("handle_bar").conaffinity = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    return model, data


def torque_on_leaf(
    model: mujoco.MjModel, data: mujoco.MjData, angle: float, velocity: float
) -> float:
    """Return what all that acts on the moving leaf sums to [N m]: I φ̈."""
    dof = int(model.joint("hinge").dofadr[0])
    data.joint("hinge").qpos, data.joint("hinge").qvel = angle, velocity
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return float(mass[dof, dof] * data.qacc[dof])


@pytest.mark.parametrize("velocity", [-0.6, -0.05, 0.05, 0.6])
@pytest.mark.parametrize("degrees", [0.2, 2.0, 10.0, 40.0, 80.0, 95.0])
def test_the_scene_exerts_the_law(degrees: float, velocity: float) -> None:
    """`CloserLaw` within 2 %: what a limit leaves of a damper."""
    fields = {**OFFICE, **en1154(2), "stiction": 3.0, "seal": 2.0}
    fields["closer_stiffness"] = 1.5
    model, data = door_alone(**fields)
    angle = np.radians(degrees)
    expected = CloserLaw.of(DoorConfig(**fields)).torque(angle, velocity)
    actual = -torque_on_leaf(model, data, angle, velocity)
    assert actual == pytest.approx(expected, rel=0.02, abs=0.05)


@given(
    size=st.sampled_from([1, 2, 3, 4]),
    share=st.floats(0.0, 1.0),
)
def test_a_closer_is_what_en_1154_allows(size: int, share: float) -> None:
    """Moments of the law itself, quasi-static, against the rows of table 1."""
    row = EN_1154[size]
    efficiency = row.efficiency + share * (1.0 - row.efficiency)
    door = DoorConfig(**{**OFFICE, **en1154(size, efficiency)})
    slow = 2e-3

    def moment(degrees: float, velocity: float) -> float:
        still = door.closer_damping + door.closing_damping * (velocity < 0.0)
        torque = CloserLaw.of(door).torque(np.radians(degrees), velocity)
        return torque - still * velocity

    closing, opening = moment(0.0, -slow), moment(0.0, slow)
    assert row.closing[0] - 1e-9 <= closing <= row.closing[1] + 1e-9
    assert closing / opening == pytest.approx(efficiency)
    for degrees in range(0, 61, 5):
        assert moment(degrees, slow) <= row.opening + 1e-9
    assert moment(90.0, -slow) >= row.closing_open


@pytest.mark.parametrize("wrong", [{"size": 5}, {"size": 2, "efficiency": 0.4}])
def test_a_closer_that_the_standard_does_not_know(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="EN 1154"):
        en1154(**wrong)


CLOSERS = {
    "none": {},
    "spring hinge": spring_hinge(8.0),
    **{f"EN 1154 size {size}": en1154(size) for size in EN_1154},
    "all at once": {**en1154(2), "stiction": 5.0, "seal": 3.0},
}


@pytest.mark.parametrize("name", CLOSERS)
def test_a_cycle_creates_no_energy(name: str) -> None:
    """Work that an opening and closing hand does on the door is never negative."""
    model, data = door_alone(**{**OFFICE, **CLOSERS[name]})
    hinge, step = data.joint("hinge"), model.opt.timestep
    work, time, duration = 0.0, 0.0, 6.0
    while time < duration:
        wanted = 1.4 * np.sin(np.pi * time / duration) ** 2
        rate = 1.4 * np.pi / duration * np.sin(2.0 * np.pi * time / duration)
        torque = 4e3 * (wanted - hinge.qpos[0]) + 300.0 * (rate - hinge.qvel[0])
        hinge.qfrc_applied = torque
        before = float(hinge.qpos[0])
        mujoco.mj_step(model, data)
        work += float(torque) * (float(hinge.qpos[0]) - before)
        time += step
    assert work > -0.02
    if name.startswith("EN"):
        assert work > 5.0


@settings(max_examples=6)
@given(
    angle=st.floats(0.1, 1.6),
    speed=st.floats(-4.0, 4.0),
    size=st.sampled_from([1, 2, 3, 4]),
)
def test_a_released_door_loses_energy_until_it_is_closed(
    angle: float, speed: float, size: int
) -> None:
    """Kinetic energy and that of the springs together never rise."""
    fields = {**OFFICE, **en1154(size), "seal": 2.0}
    model, data = door_alone(**fields)
    door = DoorConfig(**fields)
    inertia = float(1.0 / model.dof_invweight0[model.joint("hinge").dofadr[0]])
    grid = np.linspace(0.0, 1.8, 3601)
    spring = np.array([CloserLaw.of(door).torque(phi, 0.0) for phi in grid])
    steps = 0.5 * (spring[1:] + spring[:-1]) * (grid[1] - grid[0])
    potential = np.concatenate([[0.0], np.cumsum(steps)])
    hinge = data.joint("hinge")
    hinge.qpos, hinge.qvel = angle, speed
    last = np.inf
    for _ in range(10_000):
        mujoco.mj_step(model, data)
        phi = float(hinge.qpos[0])
        stored = float(np.interp(max(phi, 0.0), grid, potential))
        energy = 0.5 * inertia * float(hinge.qvel[0]) ** 2 + stored
        if 0.0 < phi < door.stop_angle:
            assert energy <= last + 2e-2
        last = min(last, energy)
    assert hinge.qpos[0] < np.radians(0.5)


def test_the_closing_damper_does_not_hinder_opening() -> None:
    gentle = {"closer_damping": 5.0, "closing_damping": 75.0}
    model, data = door_alone(**OFFICE, **gentle)
    assert -torque_on_leaf(model, data, 0.5, 0.4) == pytest.approx(2.0, rel=0.01)
    assert torque_on_leaf(model, data, 0.5, -0.4) == pytest.approx(32.0, rel=0.01)


def test_stiction_is_gone_once_the_door_has_broken_away() -> None:
    model, data = door_alone(**OFFICE, stiction=10.0)
    assert torque_on_leaf(model, data, 0.5 * STICTION_ANGLE, 0.0) == pytest.approx(
        -5.0, rel=1e-3
    )
    assert torque_on_leaf(model, data, 1.1 * STICTION_ANGLE, 0.0) == pytest.approx(
        0.0, abs=1e-9
    )


def test_a_leaf_by_din_has_its_radius_mass_and_friction() -> None:
    fields = leaf(0.709, "tubular-core")
    door = DoorConfig(**{**fields, "radius": 0.65})
    assert fields["radius"] == pytest.approx(0.654)
    assert door.panel_mass == pytest.approx(15.0 * 0.709 * 1.972)
    weight = 9.81 * door.panel_mass
    expected = 0.04 * (weight * 7.5e-3 + 2.0 * weight * 0.3545 / 1.5 * 4.8e-3)
    assert door.hinge_friction == pytest.approx(expected)
