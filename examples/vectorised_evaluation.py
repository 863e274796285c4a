"""Success rate per radius: twenty doors at once, with placement errors of the robot.

The simulations step on all cores and the agents decide in lockstep, so this takes a few
seconds. Every episode equals, bit for bit, a single episode with its seed.
"""

import copy
import time

import gymnasium as gym
import numpy as np

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_policies import make_agent
from gplfd_policies.agents.lockstep import batch_agents

RADII, EPISODES = (0.32, 0.41, 0.50, 0.59), 5

# One policy, learned from six demonstrations of 0.35, 0.50 and 0.65 m.
demonstrations = Teacher().demonstrate_doors(
    DEMONSTRATED_RADII, per_door=2, rng=np.random.default_rng(0)
)
agent = make_agent("gp", demonstrations)

doors = np.repeat(RADII, EPISODES)
envs = gym.make_vec(
    ENVIRONMENT_ID,
    num_envs=doors.size,
    door=doors.tolist(),
    randomization="mild",  # friction, mass, placement, grasp, noise, delay
    max_episode_steps=900,
    autoreset_mode="Disabled",  # an ended episode stops and keeps its info
)
# An agent stores information about its door, so every door needs its own copy.
agents = batch_agents([copy.deepcopy(agent) for _ in doors])

started = time.perf_counter()
observations, infos = envs.reset(seed=0)  # simulation i is seeded with 0 + i
agents.reset(observations)
acting, steps = np.ones(doors.size, dtype=bool), 0
while acting.any():
    steps += np.count_nonzero(acting)
    actions = agents.act(observations, acting).action
    observations, rewards, terminated, truncated, infos = envs.step(actions)
    acting = ~(terminated | truncated)
envs.close()

for radius in RADII:
    here = doors == radius
    angle = np.degrees(infos["door_angle"][here])
    print(
        f"radius {radius:.2f} m: {infos['success'][here].sum()}/{EPISODES} opened, "
        f"door at {angle.min():.0f} to {angle.max():.0f} deg"
    )
print(f"{steps / (time.perf_counter() - started):.0f} control steps per second")
