"""Vector environment on MuJoCo Warp, see `gplfd_env.simulation.warp`."""

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from gplfd_env import TIME_LIMIT
from gplfd_env.envs.reinforcement import for_learners, refuse_reward
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.simulation.command import COMMANDS
from gplfd_env.simulation.warp import WarpPhysics
from gplfd_env.validation.fields import check_choice

__all__ = ["DoorOpeningWarpVectorEnv", "make_warp"]


def make_warp(
    num_envs: int = 1, **arguments: Any
) -> gym.vector.VectorEnv[NDArray[np.float32], Any, Any]:
    """Return ``gplfd/DoorOpeningRL-v1`` with n doors on Warp's default device."""
    refuse_reward(arguments)
    arguments.setdefault("max_episode_steps", TIME_LIMIT)
    return for_learners(DoorOpeningWarpVectorEnv(num_envs, **arguments))


class DoorOpeningWarpVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `gplfd_env.envs.door_opening.DoorOpeningEnv` on MuJoCo Warp.

    MuJoCo Warp has no servo on the whole orientation, so three servos turn the hand,
    one per axis of its rotation vector: it equals ``gplfd/DoorOpeningImpedance-v1`` at
    its greatest stiffness. Physics runs on Warp's default device (``warp.set_device``);
    draws, rewards, success and failure are computed on the CPU, as elsewhere.

    The arguments are those of `DoorOpeningVectorEnv` except `num_threads`. The base
    must be fixed, and the hand must hold the handle from the start by friction:
    float32 is too coarse for the forces of a weld. Raises a ValueError otherwise.
    """

    command = dataclasses.replace(COMMANDS["pose"], control="impedance")
    physics = WarpPhysics

    def __init__(self, num_envs: int = 1, *args: Any, **arguments: Any) -> None:
        for name, only in (
            ("base", "fixed"),
            ("start", "grasped"),
            ("grasp", "contact"),
            ("num_threads", 0),
        ):
            check_choice(f"{name} on MuJoCo Warp", arguments.get(name, only), (only,))
        super().__init__(num_envs, *args, **arguments)
