"""Random actions under every id: no latch is passed, no limit exceeded."""

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.doors.config import door_config
from gplfd_env.robot.whole_body import SPEED

pytestmark = pytest.mark.slow

DRIVING = [
    (gplfd_env.ENVIRONMENT_ID, "grasped"),
    (gplfd_env.ENVIRONMENT_ID, "approach"),
    (gplfd_env.IMPEDANCE_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.MOBILE_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.MOBILE_ENVIRONMENT_ID, "approach"),
    (gplfd_env.GRIPPER_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.RL_ENVIRONMENT_ID, "grasped"),
]
"""Ids under which the base can drive, and how their episodes begin."""

HELD = (1, 20, 5, 20, 60)
"""Control periods of an action: two from the whole space, the others from corners."""

BOLT_NOSE = 0.006
"""A bolt that protrudes by less than its nose and the leaf's gap can slip off [m]."""


@pytest.mark.parametrize(
    ("door", "disturbance"),
    [
        ("room-584", "none"),
        ({"preset": "room-709", "swing": "push"}, "none"),
        ({"preset": "room-584", "handle": "knob"}, "locked"),
    ],
)
@pytest.mark.parametrize(("id", "start"), DRIVING)
def test_a_robot_that_drives_obeys_its_drive_whatever_is_commanded(
    id, start, door, disturbance, opened
):
    """Only while its wheels slip does the base turn faster than it is driven.

    Trajectories are chaotic, and differ on another processor: the bounds leave room.
    """
    config = door_config(door)
    lockset = config.lockset
    clear = max(1.0 - BOLT_NOSE / lockset.bolt_throw, 0.0)
    needed = clear * (config.handle_travel - lockset.dead_travel) + lockset.dead_travel
    arguments = {"door": config, "base": "mobile", "disturbance": disturbance}
    env: Any = opened(gym.make(id, start=start, **arguments))
    space = env.action_space
    for kind, hold in enumerate(HELD):
        rng, turned = np.random.default_rng(kind), 0.0
        env.reset(seed=kind)
        for step in range(50):
            if step % hold == 0:
                action = rng.uniform(space.low, space.high)
                if kind > 1:
                    corner = rng.random(space.shape) < 0.5
                    action = np.where(corner, space.low, space.high)
            observation, *_, info = env.step(action.astype(space.dtype))
            turned = max(turned, info["handle_angle"])
            degrees = math.degrees(info["door_angle"])
            vx, vy, turning = info["base_velocity"]
            assert math.hypot(vx, vy) < 1.5 * SPEED[0]
            assert abs(turning) < 2.5 * SPEED[1]
            assert -0.5 < degrees < math.degrees(config.stop_angle) + 0.5
            assert degrees < 1.5 or (turned >= needed and disturbance == "none")
            assert observation in env.observation_space
            assert not info["simulation_error"]
