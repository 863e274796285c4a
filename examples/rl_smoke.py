"""Reinforcement learning at one door, by a cross-entropy method.

It searches two parameters, radius and duration of the arc that the hand follows. The
file learned_policy.py trains a network instead.
"""

import gymnasium as gym
import numpy as np

from gplfd_env import RL_ENVIRONMENT_ID
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_env.wrappers import action_of

POPULATION, GENERATIONS, ELITE, STEPS = 16, 5, 4, 300
DOOR = 0.42  # [m]; the learner only sees rewards

limits = {"max_episode_steps": STEPS, "autoreset_mode": "Disabled"}
envs = gym.make_vec(RL_ENVIRONMENT_ID, num_envs=POPULATION, door=DOOR, **limits)


def evaluate(candidates):
    """Return the return and the success of every candidate (radius, seconds)."""
    observations, _ = envs.reset(seed=0)
    total, acting = np.zeros(POPULATION), np.ones(POPULATION, dtype=bool)
    for step in range(STEPS):
        share = np.minimum(0.01 * step / candidates[:, 1], 1.0)
        # Five degrees more than the task requires, because the servo is compliant.
        angles = np.radians(65.0) * (0.5 - 0.5 * np.cos(np.pi * share))
        poses = map(handle_pose_on_arc, candidates[:, 0], angles)
        actions = action_of(list(poses), observations[:, :6])
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        total += np.where(acting, rewards, 0.0)
        acting = ~(terminated | truncated)
    return total, infos


rng = np.random.default_rng(0)
mean, std = np.array([0.50, 2.0]), np.array([0.10, 0.4])
for generation in range(GENERATIONS):
    candidates = rng.normal(mean, std, (POPULATION, 2))
    candidates = candidates.clip([0.25, 1.0], [0.70, 2.5])
    scores, infos = evaluate(candidates)
    elite = candidates[np.argsort(scores)[-ELITE:]]
    mean, std = elite.mean(axis=0), elite.std(axis=0)
    std = np.maximum(std, (0.002, 0.02))
    print(
        f"generation {generation}: {infos['success'].sum()}/{POPULATION} opened, mean "
        f"return {scores.mean():.2f}, {np.median(infos['peak_force']):.0f} N, "
        f"radius {mean[0]:.3f} m in {mean[1]:.1f} s"
    )
envs.close()
