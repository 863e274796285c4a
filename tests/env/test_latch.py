"""A latch holds, lets go, and catches again, for every side and way."""

import itertools
from typing import Any

import mujoco
import numpy as np
import pytest

from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DoorConfig
from gplfd_env.scene.build import GRASP_KEY, build_scene

pytestmark = pytest.mark.slow

CLOSED = np.radians(0.5)
SIDES = list(itertools.product(("pull", "push"), ("right", "left")))
BASES: tuple[Base, ...] = ("fixed", "mobile")
LEAF = {"radius": 0.53, "leaf_width": 0.584, "backset": 0.055, "panel_mass": 14.0}


def door_alone(
    base: Base = "fixed", **fields: Any
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a latched door that the robot passes through."""
    door = DoorConfig(**{"handle": "lever", "latch": "spring", **LEAF, **fields})
    model = build_scene(door, base=base)
    for touched in ("handle_bar", "leaf"):
        model.geom(touched).conaffinity = 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    return model, data


def push(model: mujoco.MjModel, data: mujoco.MjData, time: float, **torques: float):
    """Let torques act on joints; return the greatest opening angle meanwhile [rad]."""
    greatest = -np.inf
    for _ in range(round(time / model.opt.timestep)):
        for name, torque in torques.items():
            data.joint(name).qfrc_applied = torque
        mujoco.mj_step(model, data)
        greatest = max(greatest, float(data.joint("hinge").qpos[0]))
    return greatest


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("handle", ["lever", "knob"])
@pytest.mark.parametrize(("swing", "side"), SIDES)
def test_a_latch_holds_100_newtons(
    swing: str, side: str, handle: str, base: Base
) -> None:
    model, data = door_alone(base, swing=swing, hinge_side=side, handle=handle)
    assert push(model, data, 2.0, hinge=100.0 * LEAF["radius"]) < CLOSED


@pytest.mark.parametrize(("swing", "side"), SIDES)
def test_before_a_robot_that_drives_a_latch_holds_4000_newtons(
    swing: str, side: str
) -> None:
    """What the palm does to the leaf when the base is driven into the door."""
    model, data = door_alone("mobile", swing=swing, hinge_side=side)
    assert push(model, data, 0.2, hinge=4000.0 * LEAF["radius"]) < CLOSED
    assert push(model, data, 0.5, hinge=0.0) < CLOSED
    assert data.joint("bolt").qpos[0] == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize(("swing", "side"), SIDES)
def test_the_turned_handle_frees_it_and_springs_back(
    swing: str, side: str, base: Base
) -> None:
    model, data = door_alone(base, swing=swing, hinge_side=side)
    assert push(model, data, 0.5, handle=2.0, hinge=5.0) > CLOSED
    assert data.joint("handle").qpos[0] == pytest.approx(0.8, abs=0.02)
    assert data.joint("bolt").qpos[0] == pytest.approx(0.0127, abs=5e-4)
    push(model, data, 1.0, handle=0.0, hinge=0.0)
    assert data.joint("handle").qpos[0] == pytest.approx(0.0, abs=0.01)
    assert data.joint("bolt").qpos[0] == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("dead_travel", [0.0, 0.06, 0.2])
def test_the_bolt_follows_beyond_the_dead_travel(dead_travel: float) -> None:
    """In proportion: not at the dead travel, whole at the whole travel."""
    model, data = door_alone(dead_travel=dead_travel)
    for angle in (0.1, 0.3, 0.5, 0.7):
        for _ in range(300):
            error = angle - data.joint("handle").qpos[0]
            torque = 40.0 * error - 0.5 * data.joint("handle").qvel[0] + 0.6
            push(model, data, 0.002, handle=float(torque))
        at = float(data.joint("handle").qpos[0])
        drawn = 0.0127 * max(at - dead_travel, 0.0) / (0.8 - dead_travel)
        assert data.joint("bolt").qpos[0] == pytest.approx(drawn, abs=2e-4)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0, 8.0])
@pytest.mark.parametrize(("swing", "side"), SIDES)
def test_a_slammed_door_latches(
    swing: str, side: str, speed: float, base: Base
) -> None:
    model, data = door_alone(base, swing=swing, hinge_side=side)
    data.joint("hinge").qpos, data.joint("hinge").qvel = 0.3, -speed
    push(model, data, 1.5, hinge=-2.5)
    assert data.joint("hinge").qpos[0] < CLOSED
    assert push(model, data, 1.0, hinge=100.0 * LEAF["radius"]) < CLOSED


@pytest.mark.parametrize("torque", [5.0, 10.0, 30.0])
def test_a_door_that_is_closed_slowly_latches(torque: float) -> None:
    """What it takes is the bolt's spring on a bevel of 45°, 7.8 N at 0.58 m."""
    model, data = door_alone(hinge_damping=30.0)
    data.joint("hinge").qpos = 0.1
    push(model, data, 4.0, hinge=-torque)
    assert push(model, data, 1.0, hinge=100.0 * LEAF["radius"]) < CLOSED


def test_without_a_latch_a_lever_door_opens_unturned() -> None:
    model, data = door_alone(latch="none")
    assert push(model, data, 0.5, hinge=5.0) > CLOSED
    assert data.joint("handle").qpos[0] == pytest.approx(0.0, abs=0.01)


def test_the_return_spring_is_what_it_is_said_to_be() -> None:
    """At rest in mid-air the joint's force is preload + stiffness * angle."""
    model, data = door_alone(handle_preload=0.4, handle_stiffness=1.1)
    data.joint("handle").qpos = 0.5
    mujoco.mj_forward(model, data)
    spring = data.qfrc_spring[model.joint("handle").dofadr[0]]
    assert spring == pytest.approx(-(0.4 + 1.1 * 0.5), rel=1e-9)
    data.joint("bolt").qpos = 0.004
    mujoco.mj_forward(model, data)
    spring = data.qfrc_spring[model.joint("bolt").dofadr[0]]
    assert spring == pytest.approx(-(4.0 + 300.0 * 0.004), rel=1e-9)
