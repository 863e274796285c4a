"""From a door's configuration to a compiled MuJoCo model with a settled grasp."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import mujoco

from gplfd_env.config import DoorConfig
from gplfd_env.door import BAR_RADIUS, add_door
from gplfd_env.placement import ARM_JOINTS, solve_closed_posture
from gplfd_env.robot import Grasp, load_robot
from gplfd_env.room import add_room
from gplfd_env.sensors import add_sensors

GRASP_KEY: Final = 0
"""Index of the keyframe "grasp": door closed, handle held, everything at rest."""

_SETTLING_TIME: Final = 1.5


def build_spec(door: DoorConfig, grasp: Grasp = "contact") -> mujoco.MjSpec:
    """Assemble room, robot, door and sensors without compiling them.

    Args:
        door: Geometry and hinge of the door.
        grasp: ``"contact"`` holds the bar by friction between the finger pads;
            ``"weld"`` adds a rigid joint between hand and bar.
    """
    spec = load_robot()
    add_room(spec)
    add_door(spec, door)
    add_sensors(spec)
    if grasp == "weld":
        spec.add_equality(
            name="grasp_weld",
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1="hand",
            name2="handle",
            solref=[0.01, 1.0],
        )
    return spec


def build_scene(door: DoorConfig, grasp: Grasp = "contact") -> mujoco.MjModel:
    """Compile a scene and settle the grasp.

    Scenes are cached by configuration, and every call returns a model of its own:
    callers may edit it.

    Args:
        door: Geometry and hinge of the door.
        grasp: See `build_spec`.

    Returns:
        The model; its keyframe `GRASP_KEY` is the state after a reset.

    Raises:
        ValueError: The closed handle is out of reach.
    """
    return _settled_model(door, grasp).__copy__()


@lru_cache(maxsize=32)
def _settled_model(door: DoorConfig, grasp: Grasp) -> mujoco.MjModel:
    spec = build_spec(door, grasp)
    spec.add_key(name="grasp")
    model = spec.compile()
    _settle(model, door)
    return model


def _settle(model: mujoco.MjModel, door: DoorConfig) -> None:
    """Close the fingers on the bar and store the state at rest as the keyframe."""
    data = mujoco.MjData(model)
    data.qpos[:] = solve_closed_posture(model, door)
    arm = [int(model.joint(name).qposadr[0]) for name in ARM_JOINTS]
    model.qpos_spring[arm] = data.qpos[arm]
    for side in ("right", "left"):
        data.joint(f"gripper_{side}_finger_joint").qpos = BAR_RADIUS
    data.actuator("torso_hold").ctrl = data.joint("torso_lift_joint").qpos
    mujoco.mj_step(model, data, nstep=round(_SETTLING_TIME / model.opt.timestep))
    model.key_qpos[GRASP_KEY] = data.qpos
    model.key_qvel[GRASP_KEY] = 0.0
    model.key_ctrl[GRASP_KEY] = data.ctrl
