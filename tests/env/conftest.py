"""Environments that are closed after the test, ideal motions, doors on their own."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD, Base
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.spatial.se3 import handle_pose_on_arc


@pytest.fixture
def opened() -> Iterator[Callable[[Any], Any]]:
    """Return a function that keeps an environment and closes it after the test."""
    with contextlib.ExitStack() as stack:

        def keep(env: Any) -> Any:
            stack.callback(env.close)
            return env

        yield keep


@pytest.fixture
def make_env(opened: Callable) -> Callable[..., DoorOpeningEnv]:
    def make(
        door: Any = "medium", *, id: str = gplfd_env.ENVIRONMENT_ID, **arguments: Any
    ) -> DoorOpeningEnv:
        env = opened(gym.make(id, door=door, **arguments)).unwrapped
        assert isinstance(env, DoorOpeningEnv)
        return env

    return make


@pytest.fixture
def start_env(make_env: Callable) -> Callable[..., DoorOpeningEnv]:
    """Return a function: makes an environment and resets it with seed 0."""

    def start(*door: Any, **arguments: Any) -> DoorOpeningEnv:
        env = make_env(*door, **arguments)
        env.reset(seed=0)
        return env

    return start


@pytest.fixture
def make_rl(opened: Callable) -> Callable[..., gym.Env]:
    """Return a function: makes environments for learners, in all their wrappers."""
    return lambda **given: opened(gym.make(gplfd_env.RL_ENVIRONMENT_ID, **given))


@pytest.fixture
def make_vec(opened: Callable) -> Callable[..., DoorOpeningVectorEnv]:
    def make(
        n: int, *, id: str = gplfd_env.ENVIRONMENT_ID, **arguments: Any
    ) -> DoorOpeningVectorEnv:
        envs = opened(gym.make_vec(id, n, **arguments))
        assert isinstance(envs, DoorOpeningVectorEnv)
        return envs

    return make


@pytest.fixture
def scratch_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where MuJoCo writes MUJOCO_LOG.TXT if a simulation diverges."""
    monkeypatch.chdir(tmp_path)


def minimum_jerk(share: np.ndarray) -> np.ndarray:
    s = np.clip(share, 0.0, 1.0)
    return 10 * s**3 - 15 * s**4 + 6 * s**5


@pytest.fixture
def arc_commands() -> Callable[..., np.ndarray]:
    """Return a function: minimum-jerk commands along a handle's true arc, (N, 6)."""

    def commands(radius: float, degrees: float = 65.0, duration: float = 8.0):
        time = np.arange(1, round((duration + 2.0) / CONTROL_PERIOD) + 1)
        share = minimum_jerk(time * CONTROL_PERIOD / duration)
        return handle_pose_on_arc(radius, np.radians(degrees) * share)

    return commands


@pytest.fixture
def opening_poses() -> Callable[..., np.ndarray]:
    """Return a function: poses that turn a handle in 1.5 s and open its door, (N, 6).

    The handle is let back from 3.5 s to 5 s.
    """

    def poses(
        door: DoorGeometry, degrees: float, duration: float, travel: float | None = None
    ) -> np.ndarray:
        travel = door.travel if travel is None else travel
        begin = 1.5 if door.travel else 0.0
        periods = round((begin + duration + 1.0) / CONTROL_PERIOD)
        time = CONTROL_PERIOD * np.arange(1, periods + 1)
        angles = np.radians(degrees) * minimum_jerk((time - begin) / duration)
        back = minimum_jerk((time - 3.5) / 1.5)
        return door.hand_poses(angles, travel * minimum_jerk(time / 1.5) * (1.0 - back))

    return poses


@pytest.fixture
def draw_actions() -> Callable[..., np.ndarray]:
    """Return a function: small motions; all else from the whole range, (n, ...)."""

    def draw(space: gym.spaces.Box, n: int, seed: int = 0) -> np.ndarray:
        rng = np.random.default_rng(seed)
        drawn = rng.uniform(space.low, space.high, (n, *space.shape))
        drawn[..., :6] *= 0.03
        return drawn

    return draw


@pytest.fixture
def release_handle() -> Callable[[DoorOpeningEnv], None]:
    """Return a function that lets hand and bar pass through each other."""

    def release(env: DoorOpeningEnv) -> None:
        env.model.geom("handle_bar").conaffinity = 0

    return release


@pytest.fixture(scope="session")
def push_hand() -> Callable[..., None]:
    """Return a function: applies a force at the hand point [N], and a moment [N m].

    Both are given in the task frame.
    """

    def push(env: DoorOpeningEnv, force_d: Any, moment_d: Any = (0.0, 0.0, 0.0)):
        rotation = task_rotation_w(DoorConfig(), TIAGO_LIKE)
        gripper = env.data.body("gripper_link")
        force, moment = rotation @ force_d, rotation @ moment_d
        lever = env.data.site("hand").xpos - gripper.xipos
        gripper.xfrc_applied[:] = [*force, *(np.cross(lever, force) + moment)]

    return push


@pytest.fixture(scope="session")
def door_alone() -> Callable[..., tuple[mujoco.MjModel, mujoco.MjData]]:
    """Return a function that builds a closed door which the hand passes through."""

    def build(
        base: Base = "fixed", **fields: Any
    ) -> tuple[mujoco.MjModel, mujoco.MjData]:
        model = build_scene(DoorConfig(**fields), robot=TIAGO_LIKE.on(base))
        model.geom("handle_bar").conaffinity = 0
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
        return model, data

    return build
