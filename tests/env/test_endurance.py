"""Many random steps and many random doors; more of them when run as a script:

python tests/env/test_endurance.py endure 100000
python tests/env/test_endurance.py drive 100000
python tests/env/test_endurance.py digest 200
"""

import contextlib
import hashlib
import itertools
import math
import subprocess
import sys
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.doors.config import DoorConfig, DoorSpec, door_config
from gplfd_env.robot.whole_body import SPEED

pytestmark = pytest.mark.slow

IDS = (gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID)
N = 8

DRIVING = (
    (gplfd_env.ENVIRONMENT_ID, "grasped"),
    (gplfd_env.ENVIRONMENT_ID, "approach"),
    (gplfd_env.IMPEDANCE_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.MOBILE_ENVIRONMENT_ID, "grasped"),
    (gplfd_env.MOBILE_ENVIRONMENT_ID, "approach"),
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

    speed: float = 0.0
    """Of the base [m/s]."""
    turning: float = 0.0
    """Of the base [rad/s]."""
    outside: float = 0.0
    """Of a door, beyond frame or stop [deg]."""
    locked: float = 0.0
    """Angle of a locked door [deg]."""
    unlatched: int = 0
    """Steps with a latched door open whose handle was not turned far enough."""
    escaped: int = 0
    """Observations outside their space, and diverged simulations."""

    def worst(self, other: "Extremes") -> "Extremes":
        return Extremes(*map(max, self, other))


def endure(id: str, randomization: str, steps: int) -> dict[str, int]:
    """Step random doors with random actions; return how many episodes ended how.

    Half of the simulations get actions from the whole space, which soon tear the hand
    off; the others small ones, which they survive.
    """
    envs = gym.make_vec(id, N, randomization=randomization, autoreset_mode="SameStep")
    rng = np.random.default_rng(0)
    low, high = envs.single_action_space.low, envs.single_action_space.high
    outcomes = {"grasp_lost": 0, "stalled": 0, "simulation_error": 0, "": 0}
    observations, _ = envs.reset(seed=0)
    for _ in range(-(-steps // N)):
        actions = rng.uniform(low, high, (N, len(low)))
        actions[N // 2 :, :6] *= 0.03
        observations, rewards, terminations, truncations, infos = envs.step(actions)
        assert observations in envs.observation_space
        assert np.isfinite(rewards).all()
        for key, value in infos.items():
            if isinstance(value, np.ndarray) and value.dtype == np.float64:
                assert np.isfinite(value).all(), key
        for row in np.flatnonzero(terminations | truncations):
            outcomes[infos["final_info"]["failure"][row]] += 1
    envs.close()
    return outcomes


def actions(
    space: Any, hold: int, corners: bool, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield random actions, each held for some control periods."""
    while True:
        action = rng.uniform(space.low, space.high)
        if corners:
            action = np.where(rng.random(space.shape) < 0.5, space.low, space.high)
        yield from itertools.repeat(action.astype(space.dtype), hold)


def drive(
    id: str, start: str, door: DoorSpec, disturbance: str, steps: int, seed: int = 0
) -> Extremes:
    """Attack one door with every kind of random actions; episodes go on when lost.

    Args:
        id: Of the environment.
        start: How its episodes begin.
        door: The door.
        disturbance: What happens to it.
        steps: Number of control periods of each kind.
        seed: Of the actions.
    """
    config, found = door_config(door), Extremes()
    travel = config.handle_travel - config.dead_travel
    clear = max(1.0 - BOLT_NOSE / config.bolt_throw, 0.0)
    needed = config.dead_travel + clear * travel
    made = gym.make(
        id, door=config, base="mobile", start=start, disturbance=disturbance
    )
    with contextlib.closing(made):
        env = made
        while isinstance(env, gym.wrappers.TimeLimit | gym.wrappers.OrderEnforcing):
            env = env.env
        for kind, hold in enumerate(HELD):
            rng = np.random.default_rng([seed, kind])
            given = actions(env.action_space, hold, kind > 1, rng)
            for step, action in enumerate(itertools.islice(given, steps)):
                if step % ATTACK == 0:
                    env.reset(seed=step)
                    turned = 0.0
                observation, *_, info = env.step(action)
                turned = max(turned, info["handle_angle"])
                angle = math.degrees(info["door_angle"])
                latched = config.latch == "spring" and turned < needed
                vx, vy, turning = info["base_velocity"]
                sound = env.observation_space.contains(observation)
                found = found.worst(
                    Extremes(
                        speed=math.hypot(vx, vy),
                        turning=float(abs(turning)),
                        outside=max(-angle, angle - math.degrees(config.stop_angle)),
                        locked=angle if disturbance == "locked" else 0.0,
                        unlatched=found.unlatched + (latched and angle > 1.5),
                        escaped=found.escaped + (info["simulation_error"] or not sound),
                    )
                )
    return found


def digest(pair: int) -> str:
    """Return a hash of everything that a random door with a random seed gives."""
    rng = np.random.default_rng(pair)
    door = DoorConfig(radius=rng.uniform(0.30, 0.65), panel_mass=rng.uniform(1.0, 50.0))
    seed = int(rng.integers(2**31))
    env: Any = gym.make(
        IDS[pair % 2], door=door, randomization=("none", "hard")[pair % 3 > 0]
    )
    results = [env.reset(seed=seed)]
    for _ in range(25):
        results.append(
            env.step(rng.uniform(0.2 * env.action_space.low, env.action_space.high))
        )
    env.close()
    return hashlib.sha256(repr(_exact(results)).encode()).hexdigest()


def _exact(value: Any) -> Any:
    """Return nested results with arrays as bytes and floats in hexadecimal."""
    if isinstance(value, dict):
        return {key: _exact(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_exact(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return value.hex() if isinstance(value, float) else value


@pytest.mark.parametrize(
    ("id", "randomization"), [*zip(IDS, ["hard", "mild"], strict=True)]
)
def test_random_actions_before_random_doors(id: str, randomization: str) -> None:
    """No exception, no warning, no NaN, nothing outside its space, no divergence."""
    outcomes = endure(id, randomization, 1600)
    assert outcomes["grasp_lost"] > 5
    assert outcomes["simulation_error"] == 0


@pytest.mark.parametrize(("id", "start"), DRIVING)
def test_a_robot_that_drives_obeys_its_drive_whatever_is_commanded(
    id: str, start: str
) -> None:
    """No latch is passed, no door leaves its frame, no finger its range.

    Only while its wheels slip, under an arm that is flung about, does the base turn
    faster than it is driven.

    The trajectories are chaotic: on another processor they are others. So the bounds
    leave room; the exact extremes are measured with the command ``drive`` above.
    """
    found = Extremes()
    for door, disturbance in ATTACKED[2::3]:
        found = found.worst(drive(id, start, door, disturbance, ATTACK // 2))
    assert found.speed < 1.5 * SPEED[0]
    assert found.turning < 2.5 * SPEED[1]
    assert found.outside < 0.5
    assert found.locked < 1.0
    assert found.unlatched == 0
    assert found.escaped == 0


def test_two_processes_agree_bit_for_bit() -> None:
    pairs = 6
    result = subprocess.run(
        [sys.executable, __file__, "digest", str(pairs)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert result.stdout.split() == [digest(pair) for pair in range(pairs)]
    assert len(set(result.stdout.split())) == pairs


if __name__ == "__main__":
    what, number = sys.argv[1], int(sys.argv[2])
    warnings.simplefilter("error")
    if what == "digest":
        print("\n".join(digest(pair) for pair in range(number)))
    elif what == "drive":
        each = -(-number // (len(DRIVING) * len(ATTACKED) * len(HELD)))
        for id, start in DRIVING:
            found = Extremes()
            for seed, (door, disturbance) in enumerate(ATTACKED):
                found = found.worst(drive(id, start, door, disturbance, each, seed))
            print(id, start, found)
    else:
        for id in IDS:
            for randomization in ("mild", "hard"):
                print(id, randomization, endure(id, randomization, number // 4))
