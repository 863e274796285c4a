"""A latch holds, lets go, and catches again; a hand turns its handle and opens."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

pytestmark = pytest.mark.slow

CLOSED = np.radians(0.5)
LEAF = {"radius": 0.53, "leaf": {"width": 0.584, "backset": 0.055}, "panel_mass": 14.0}
LATCHED = {"handle": "lever", "latch": "spring", **LEAF}
HOLD = 100.0 * LEAF["radius"]
"""Torque of 100 N at the handle [N m]."""

both_bases = pytest.mark.parametrize("base", ["fixed", "mobile"])
everywhere = pytest.mark.parametrize(
    ("swing", "hinge_side"),
    list(itertools.product(("pull", "push"), ("right", "left"))),
)


@pytest.fixture
def latched_door(door_alone: Callable) -> Callable:
    """Return a function that builds a latched door which the robot passes through."""

    def build(base: str = "fixed", **fields: Any) -> tuple[Any, Any]:
        model, data = door_alone(base, **{**LATCHED, **fields})
        model.geom("leaf").conaffinity = 0
        return model, data

    return build


def push(model: Any, data: Any, time: float, **torques: float) -> float:
    """Let torques act on joints; return the greatest opening angle meanwhile [rad]."""
    greatest = -np.inf
    for _ in range(round(time / model.opt.timestep)):
        for name, torque in torques.items():
            data.joint(name).qfrc_applied = torque
        mujoco.mj_step(model, data)
        greatest = max(greatest, float(data.joint("hinge").qpos[0]))
    return greatest


def bolt_and_handle(data: Any) -> tuple[float, float]:
    return float(data.joint("bolt").qpos[0]), float(data.joint("handle").qpos[0])


@both_bases
@pytest.mark.parametrize(("handle", "torque"), [("lever", 2.0), ("knob", 0.875)])
@everywhere
def test_a_latch_holds_until_the_handle_is_turned_which_springs_back(
    swing, hinge_side, handle, torque, base, latched_door
):
    """100 N do not open it; 5 N m do once the handle is turned."""
    door = latched_door(base, swing=swing, hinge_side=hinge_side, handle=handle)
    assert push(*door, 1.0, hinge=HOLD) < CLOSED
    push(*door, 0.1, hinge=0.0)
    assert push(*door, 0.5, handle=torque, hinge=5.0) > CLOSED
    bolt, turn = bolt_and_handle(door[1])
    assert turn == pytest.approx(0.8, abs=0.02)
    assert bolt == pytest.approx(0.0127, abs=5e-4)
    push(*door, 1.0, handle=0.0, hinge=0.0)
    bolt, turn = bolt_and_handle(door[1])
    assert turn == pytest.approx(0.0, abs=0.01)
    assert bolt == pytest.approx(0.0, abs=5e-4)


@everywhere
def test_before_a_robot_that_drives_a_latch_holds_4000_newtons(
    swing, hinge_side, latched_door
):
    """What the palm does to the leaf when the base is driven into the door."""
    door = latched_door("mobile", swing=swing, hinge_side=hinge_side)
    assert push(*door, 0.2, hinge=40.0 * HOLD) < CLOSED
    assert push(*door, 0.5, hinge=0.0) < CLOSED
    assert bolt_and_handle(door[1])[0] == pytest.approx(0.0, abs=5e-4)


@pytest.mark.parametrize("dead_travel", [0.0, 0.06, 0.2])
def test_the_bolt_follows_beyond_the_dead_travel(dead_travel, latched_door):
    """In proportion: not at the dead travel, whole at the whole travel."""
    model, data = latched_door(lockset={"dead_travel": dead_travel})
    for angle in (0.1, 0.3, 0.5, 0.7):
        for _ in range(300):
            error = angle - data.joint("handle").qpos[0]
            torque = 40.0 * error - 0.5 * data.joint("handle").qvel[0] + 0.6
            push(model, data, 0.002, handle=float(torque))
        bolt, at = bolt_and_handle(data)
        drawn = 0.0127 * max(at - dead_travel, 0.0) / (0.8 - dead_travel)
        assert bolt == pytest.approx(drawn, abs=2e-4)


@both_bases
@pytest.mark.parametrize("speed", [0.3, 1.0, 3.0, 8.0])
@everywhere
def test_a_slammed_door_latches(swing, hinge_side, speed, base, latched_door):
    model, data = latched_door(base, swing=swing, hinge_side=hinge_side)
    data.joint("hinge").qpos, data.joint("hinge").qvel = 0.3, -speed
    push(model, data, 1.5, hinge=-2.5)
    assert push(model, data, 0.5, hinge=HOLD) < CLOSED


def test_the_return_springs_are_what_they_are_said_to_be(latched_door):
    """At rest in mid-air a joint's force is preload + stiffness * displacement."""
    model, data = latched_door(lockset={"handle_preload": 0.4, "handle_stiffness": 1.1})
    for name, place, force in (("handle", 0.5, 0.4 + 1.1 * 0.5), ("bolt", 0.004, 5.2)):
        data.joint(name).qpos = place
        mujoco.mj_forward(model, data)
        spring = data.qfrc_spring[model.joint(name).dofadr[0]]
        assert spring == pytest.approx(-force, rel=1e-9)


# --- A hand that turns the handle ----------------------------------------------------

LEVER = dict(handle="lever", latch="spring", radius=0.53, leaf={"backset": 0.055})
KNOB = {
    "handle": "knob",
    "latch": "spring",
    "radius": 0.45,
    "lockset": {"handle_preload": 0.2, "handle_stiffness": 0.3},
}


@pytest.mark.parametrize("fields", [LEVER, KNOB], ids=["lever", "knob"])
@everywhere
def test_a_hand_turns_the_handle_and_opens(
    fields, swing, hinge_side, start_env, opening_poses
):
    env = start_env({**fields, "hinge_side": hinge_side, "swing": swing})
    most = dict.fromkeys(("handle_angle", "bolt", "force", "slip"), 0.0)
    for pose in opening_poses(env.door_geometry, 35.0, 4.0, travel=0.8):
        *_, info = env.step(pose)
        forces = [info[f"force_{a}"] for a in ("tangential", "radial", "vertical")]
        now = {**info, "force": math.hypot(*forces)}
        most = {name: max(now[name], value) for name, value in most.items()}
        if info["bolt"] < 0.004:
            assert info["door_angle"] < CLOSED or most["bolt"] > 0.006
    assert most["handle_angle"] > 0.7
    assert most["bolt"] > 0.011
    assert info["door_angle"] > math.radians(30.0)
    assert info["grasped"]
    assert info["handle_angle"] < 0.05
    assert info["bolt"] < 5e-4
    assert most["slip"] < 0.005
    assert most["force"] < 30.0


def test_a_pull_alone_does_not_open(start_env, opening_poses):
    env = start_env(LEVER)
    poses = opening_poses(env.door_geometry, 35.0, 4.0, travel=0.0)[:300]
    for pose in poses:
        *_, info = env.step(pose)
        assert info["door_angle"] < CLOSED
    assert info["failure"] == ""
    for _ in range(60):
        *_, info = env.step(pose)
    assert info["failure"] == "latched"
