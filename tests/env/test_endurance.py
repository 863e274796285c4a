"""Random actions under every id; more of them when run as a script:

python tests/env/test_endurance.py 100000
"""

import contextlib
import math
import sys
import warnings
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.doors.config import DoorSpec, door_config
from gplfd_env.robot.whole_body import SPEED

pytestmark = pytest.mark.slow

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID
MOBILE = gplfd_env.MOBILE_ENVIRONMENT_ID


DRIVING = (
    (POSE, "grasped"),
    (POSE, "approach"),
    (IMPEDANCE, "grasped"),
    (MOBILE, "grasped"),
    (MOBILE, "approach"),
    (gplfd_env.GRIPPER_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.RL_ENVIRONMENT_ID, "grasped"),
)
"""Ids under which the base can drive, and how their episodes begin."""

ATTACKED: tuple[tuple[DoorSpec, str], ...] = (
    ("medium", "none"),
    ("large", "locked"),
    ("room-584", "none"),
    ("room-834", "locked"),
    ("office-closer-2", "none"),
    ({"preset": "room-709", "swing": "push"}, "none"),
    ({"preset": "room-709", "swing": "push", "hinge_side": "left"}, "none"),
    ({"preset": "room-834", "swing": "push"}, "locked"),
    ({"preset": "room-584", "handle": "knob"}, "none"),
    ({"preset": "room-584", "handle": "knob", "swing": "push"}, "none"),
)
"""Doors, and what happens to them."""

HELD = (1, 20, 5, 20, 60)
"""Control periods for which an action is held; the first two are drawn from the whole
space, the others from its corners."""

ATTACK = 150
"""Control periods of an attacked episode."""

BOLT_NOSE = 0.006
"""A bolt that stands out by less than its nose and the leaf's gap can slip off [m]."""


class Extremes(NamedTuple):
    """What a robot that drives did at worst."""

    speed: float = 0.0  # of the base [m/s]
    turning: float = 0.0  # of the base [rad/s]
    outside: float = 0.0  # of a door, beyond frame or stop [deg]
    locked: float = 0.0  # angle of a locked door [deg]
    unlatched: int = 0  # periods with a latched door open, its handle turned too little
    escaped: int = 0  # observations outside their space, and diverged simulations

    def worst(self, other: "Extremes") -> "Extremes":
        return Extremes(*map(max, self, other))


def drive(
    id: str, start: str, door: DoorSpec, disturbance: str, steps: int, seed: int = 0
) -> Extremes:
    """Attack one door with every kind of random actions; episodes go on when lost.

    Of each kind there are as many control periods as steps.
    """
    config, worst = door_config(door), Extremes()
    travel = config.handle_travel - config.lockset.dead_travel
    clear = max(1.0 - BOLT_NOSE / config.lockset.bolt_throw, 0.0)
    needed = config.lockset.dead_travel + clear * travel
    given = {"door": config, "base": "mobile", "disturbance": disturbance}
    with contextlib.closing(gym.make(id, start=start, **given)) as made:
        env: Any = made
        while isinstance(env, gym.wrappers.TimeLimit | gym.wrappers.OrderEnforcing):
            env = env.env
        space = env.action_space
        for kind, hold in enumerate(HELD):
            rng = np.random.default_rng([seed, kind])
            for step in range(steps):
                if step % hold == 0:
                    action = rng.uniform(space.low, space.high)
                    if kind > 1:
                        corner = rng.random(space.shape) < 0.5
                        action = np.where(corner, space.low, space.high)
                    action = action.astype(space.dtype)
                if step % ATTACK == 0:
                    env.reset(seed=step)
                    turned = 0.0
                observation, *_, info = env.step(action)
                turned = max(turned, info["handle_angle"])
                angle = math.degrees(info["door_angle"])
                latched = config.latch == "spring" and turned < needed
                vx, vy, turning = info["base_velocity"]
                sound = env.observation_space.contains(observation)
                worst = worst.worst(
                    Extremes(
                        speed=math.hypot(vx, vy),
                        turning=float(abs(turning)),
                        outside=max(-angle, angle - math.degrees(config.stop_angle)),
                        locked=angle if disturbance == "locked" else 0.0,
                        unlatched=worst.unlatched + (latched and angle > 1.5),
                        escaped=worst.escaped + (info["simulation_error"] or not sound),
                    )
                )
    return worst


@pytest.mark.parametrize(("id", "start"), DRIVING)
def test_a_robot_that_drives_obeys_its_drive_whatever_is_commanded(id, start):
    """No latch is passed, no door leaves its frame, no finger its range.

    Only while its wheels slip, under an arm that is flung about, does the base turn
    faster than it is driven.

    The trajectories are chaotic: on another processor they are others. So the bounds
    leave room; the exact extremes are measured with the command above.
    """
    worst = Extremes()
    for door, disturbance in ATTACKED[2::3]:
        worst = worst.worst(drive(id, start, door, disturbance, ATTACK // 3))
    assert worst.speed < 1.5 * SPEED[0]
    assert worst.turning < 2.5 * SPEED[1]
    assert worst.outside < 0.5
    assert worst.locked < 1.0
    assert (worst.unlatched, worst.escaped) == (0, 0)


if __name__ == "__main__":
    warnings.simplefilter("error")
    periods = -(-int(sys.argv[1]) // (len(DRIVING) * len(ATTACKED) * len(HELD)))
    for id, start in DRIVING:
        worst = Extremes()
        for seed, (door, disturbance) in enumerate(ATTACKED):
            worst = worst.worst(drive(id, start, door, disturbance, periods, seed))
        print(id, start, worst)
