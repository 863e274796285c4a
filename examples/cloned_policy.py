"""A small network that imitates the policy `gp`, evaluated like the policies.

Observation and action are those of ``gplfd/DoorOpeningRL-v1``. The network learns from
episodes in which `gp` opens doors with small random differences.

    gplfd run --policy examples/cloned_policy.py:make
    gplfd benchmark --config small --policies gp examples/cloned_policy.py:make
"""

import copy

import gymnasium as gym
import numpy as np
from sklearn.neural_network import MLPRegressor
from sklearn.preprocessing import StandardScaler

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.wrappers import action_of, command_of, flat_of
from gplfd_policies import make_agent
from gplfd_policies.agents.agent import batch_agents

RADII = np.linspace(0.30, 0.65, 16)  # [m]; doors that `gp` opens for training
EPISODES = 2  # per door
EPOCHS = 30


class Clone:
    """An agent: the action of the network for the observation, as a pose."""

    def __init__(self, observations, actions, seed):
        self.inputs, self.outputs = StandardScaler(), StandardScaler()
        scaled = self.inputs.fit_transform(observations)
        targets = self.outputs.fit_transform(actions)
        random = np.random.RandomState(seed)
        shape = {"hidden_layer_sizes": (64, 64), "activation": "tanh"}
        self.network = MLPRegressor(**shape, batch_size=256, random_state=random)
        for _ in range(EPOCHS):
            self.network.partial_fit(scaled, targets)

    def act(self, observation):
        scaled = self.inputs.transform(flat_of(observation)[None])
        action = self.outputs.inverse_transform(self.network.predict(scaled))[0]
        return command_of(action, observation["ee_pose"])


def lessons(teacher, seed):
    """Return observations (N, 33) and actions (N, 6) of `gp` in units of ±1."""
    doors = {"door": RADII.tolist(), "randomization": "mild"}
    envs = gym.make_vec(ENVIRONMENT_ID, len(RADII), autoreset_mode="Disabled", **doors)
    teachers = batch_agents([copy.deepcopy(teacher) for _ in RADII])
    observations, _ = envs.reset(seed=seed)
    teachers.reset(observations)
    acting = np.ones(len(RADII), dtype=bool)
    inputs, targets = [], []
    while acting.any():
        commands = teachers.act(observations, acting).action
        inputs.append(flat_of(observations)[acting])
        targets.append(action_of(commands, observations["ee_pose"])[acting])
        observations, _, terminated, truncated, _ = envs.step(commands)
        acting &= ~(terminated | truncated)
    envs.close()
    return np.concatenate(inputs), np.concatenate(targets)


def make(training):
    """Imitation of `gp` by a network of two layers of 64."""
    seed = training.seed
    teacher = make_agent("gp", training.demonstrations, seed=seed)
    rounds = [lessons(teacher, 1000 * seed + number) for number in range(EPISODES)]
    observations, actions = map(np.concatenate, zip(*rounds, strict=True))
    return Clone(observations, np.clip(actions, -1.0, 1.0), seed)
