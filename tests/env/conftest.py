"""Environments that are closed after the test, and the ideal opening motion."""

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.spatial.arc import handle_pose_on_arc


@pytest.fixture
def make_env() -> Iterator[Callable[..., DoorOpeningEnv]]:
    opened: list[gym.Env] = []

    def make(
        door: Any = "medium", *, id: str = gplfd_env.ENVIRONMENT_ID, **arguments: Any
    ) -> DoorOpeningEnv:
        env = gym.make(id, door=door, **arguments)
        opened.append(env)
        assert isinstance(env.unwrapped, DoorOpeningEnv)
        return env.unwrapped

    yield make
    for env in opened:
        env.close()


@pytest.fixture
def make_rl() -> Iterator[Callable[..., gym.Env]]:
    """Return a function: makes environments for learners, in all their wrappers."""
    opened: list[gym.Env] = []

    def make(**arguments: Any) -> gym.Env:
        opened.append(gym.make(gplfd_env.RL_ENVIRONMENT_ID, **arguments))
        return opened[-1]

    yield make
    for env in opened:
        env.close()


@pytest.fixture
def make_vec() -> Iterator[Callable[..., DoorOpeningVectorEnv]]:
    opened: list[gym.vector.VectorEnv] = []

    def make(
        n: int, *, id: str = gplfd_env.ENVIRONMENT_ID, **arguments: Any
    ) -> DoorOpeningVectorEnv:
        envs = gym.make_vec(id, n, **arguments)
        opened.append(envs)
        assert isinstance(envs, DoorOpeningVectorEnv)
        return envs

    yield make
    for envs in opened:
        envs.close()


@pytest.fixture
def arc_commands() -> Callable[..., np.ndarray]:
    """Return a function: minimum-jerk commands along a handle's true arc, (N, 6)."""

    def commands(radius: float, degrees: float = 65.0, duration: float = 8.0):
        time = np.arange(1, round((duration + 2.0) / CONTROL_PERIOD) + 1)
        s = np.minimum(time * CONTROL_PERIOD / duration, 1.0)
        angles = np.radians(degrees) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        return handle_pose_on_arc(radius, angles)

    return commands


@pytest.fixture
def release_handle() -> Callable[[DoorOpeningEnv], None]:
    """Return a function that lets hand and bar pass through each other."""

    def release(env: DoorOpeningEnv) -> None:
        env.model.geom("handle_bar").conaffinity = 0

    return release
