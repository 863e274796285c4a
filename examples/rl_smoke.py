"""Reinforcement learning against one door: spaces, wrappers, and a learner that learns.

The learner is a cross-entropy method over two numbers, the radius of the arc that the
hand follows and the time that it takes: the smallest search that finds the door. The
environment around it is what any library sees: a flat observation, actions within ±1.

With Stable-Baselines3 instead (one environment; pip install stable-baselines3):

    env = gym.make("gplfd/DoorOpening-v0", door=0.42, max_episode_steps=300)
    env = gym.wrappers.RescaleAction(gym.wrappers.FlattenObservation(env), -1.0, 1.0)
    stable_baselines3.SAC("MlpPolicy", env).learn(100_000)

An action is an absolute pose in metres and radians, so most actions within ±1 are far
from the hand. Let the network command a small step from the observed pose instead.
"""

import gymnasium as gym
import numpy as np
from gymnasium.wrappers.vector import FlattenObservation, RescaleAction

import gplfd_env  # noqa: F401  (registers the ids)
from gplfd_env.task import handle_pose_on_arc

POPULATION, GENERATIONS, ELITE, STEPS = 16, 5, 4, 300
DOOR = 0.42  # [m]; the learner only sees rewards

envs = gym.make_vec(
    "gplfd/DoorOpening-v0",
    num_envs=POPULATION,
    door=DOOR,
    max_episode_steps=STEPS,
    autoreset_mode="Disabled",
)
limits = envs.single_action_space.high
envs = RescaleAction(FlattenObservation(envs), -1.0, 1.0)
print(f"observation {envs.single_observation_space.shape}, action within ±1 (6,)")


def evaluate(candidates):
    """Return the return and the success of every candidate (radius, seconds)."""
    envs.reset(seed=0)
    total, acting = np.zeros(POPULATION), np.ones(POPULATION, dtype=bool)
    for step in range(STEPS):
        share = np.minimum(0.01 * step / candidates[:, 1], 1.0)
        # Five degrees more than the task asks for: the servo gives way a little.
        angles = np.radians(65.0) * (0.5 - 0.5 * np.cos(np.pi * share))
        poses = map(handle_pose_on_arc, candidates[:, 0], angles)
        actions = np.array(list(poses)) / limits
        _, rewards, terminated, truncated, infos = envs.step(actions)
        # The reward alone hardly minds force; infos hold what to shape it with.
        total += np.where(acting, rewards - 2e-4 * abs(infos["force_radial"]), 0.0)
        acting = ~(terminated | truncated)
    return total, infos["success"]


rng = np.random.default_rng(0)
mean, std = np.array([0.50, 2.0]), np.array([0.10, 0.4])
for generation in range(GENERATIONS):
    candidates = rng.normal(mean, std, (POPULATION, 2))
    candidates = candidates.clip([0.25, 1.0], [0.70, 2.5])
    scores, opened = evaluate(candidates)
    elite = candidates[np.argsort(scores)[-ELITE:]]
    mean, std = elite.mean(axis=0), elite.std(axis=0)
    std = np.maximum(std, (0.002, 0.02))
    print(
        f"generation {generation}: {opened.sum()}/{POPULATION} opened, mean return "
        f"{scores.mean():.2f}, radius {mean[0]:.3f} m in {mean[1]:.1f} s"
    )
envs.close()
