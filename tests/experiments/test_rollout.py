"""Episodes alone and in lockstep: one log, whichever way they run."""

import functools
import math
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import jaxtyping
import numpy as np
import pytest

from gplfd_env import ENVIRONMENT_ID, ENVIRONMENT_IDS
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import learned
from gplfd_experiments.episodes.log import PARTS, EpisodeLog, arrays_of
from gplfd_experiments.episodes.rollout import rollout, rollouts
from gplfd_policies.agents.agent import batch_agents
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import TrainingInput

pytestmark = pytest.mark.slow

DOORS, SEEDS = (0.35, 0.42, 0.5), (5, 6, 7)
FINAL_ANGLE = math.radians(66.0)
QUIET = (
    *("handle_angle", "slip", "force_tangential", "force_radial", "force_vertical"),
    *("push_force", "person_force", "person_energy", "stop_force", "base_shift"),
    "closer_torque",
)
"""Numbers of the information that are zero."""


class DoorEnv(gym.Env[Any, Any]):
    """The door follows the commanded rotation exactly; the hand is the handle."""

    def __init__(self, outcome: str = "success", n_steps: int = 30) -> None:
        self.data = SimpleNamespace(qpos=np.zeros(1))
        self.door = DoorConfig(radius=0.5)
        self.door_geometry = DoorGeometry.of(self.door)
        self.outcome, self.n_steps = outcome, n_steps
        self.actions: list[Any] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        return self._state()

    def step(self, action: Any) -> Any:
        self.actions.append(action)
        self.data.qpos[0] = action[4]
        last = len(self.actions) == self.n_steps
        observation, info = self._state()
        info["success"] = last and self.outcome == "success"
        if last and self.outcome not in ("success", "time_limit"):
            info["failure"] = self.outcome
        truncated = last and self.outcome in ("time_limit", "stalled")
        return observation, 0.0, last and not truncated, truncated, info

    def _state(self) -> Any:
        angle = float(self.data.qpos[0])
        pose = handle_pose_on_arc(0.5, angle)
        observation = {
            "ee_pose": pose,
            **dict.fromkeys(("ee_twist", "wrench"), np.zeros(6)),
            **dict.fromkeys(("joint_pos", "joint_vel"), np.zeros(7)),
            "time": np.array([0.01 * len(self.actions)]),
        }
        info = {
            **dict.fromkeys(QUIET, 0.0),
            "door_angle": angle,
            "handle_pose": pose,
            "capability": 3,
            "success": False,
            "failure": "",
            "reason": "",
            "grasped": True,
        }
        return observation, info


class ArcAgent:
    """Opens in ``n_steps``; its belief narrows as the door opens."""

    def __init__(self, n_steps: int = 30) -> None:
        self.n_steps, self.calls = n_steps, 0

    def act(self, observation: Any) -> Any:
        self.calls += 1
        phase = min(1.0, self.calls / self.n_steps)
        action = handle_pose_on_arc(0.5, FINAL_ANGLE * phase)
        return AgentStep(action=action, predicted_mean=observation["ee_pose"] + 0.002)

    def forecast(self) -> Any:
        phases = np.linspace(0.0, 1.0, 21)
        arc = np.array([handle_pose_on_arc(0.5, FINAL_ANGLE * s) for s in phases])
        spread = 0.05 / (1.0 + self.calls) * np.outer(phases, np.ones(6)) + 1e-3
        return GaussianTrajectory.from_moments(
            phases, arc, spread, covariance_function=lambda: spread
        )


def run(env: Any = None, agent: Any = None, **options: Any) -> EpisodeLog:
    names = {"policy": "arc", "door": "medium", "seed": 4}
    return rollout(env or DoorEnv(), agent or ArcAgent(), **names, **options)


def test_rows_pair_each_state_with_the_decision_taken_in_it():
    env = DoorEnv()
    log = run(env)
    assert log.times.size == 31
    np.testing.assert_allclose(log.times, 0.01 * np.arange(31), atol=1e-12)
    np.testing.assert_array_equal(log.decisions.action[:-1], np.array(env.actions))
    # The door obeys at once: the angle of a row is the command of the row before.
    np.testing.assert_array_equal(
        log.opening.door_angle[1:], log.decisions.action[:-1, 4]
    )
    np.testing.assert_array_equal(log.motion.qpos[:, 0], log.opening.door_angle)
    np.testing.assert_array_equal(
        log.decisions.predicted_mean, log.motion.ee_pose + 0.002
    )
    assert (log.seed, log.policy, log.dt) == (4, "arc", pytest.approx(0.01))
    # The last row is the state in which the episode ended.
    assert log.opening.solved.tolist() == [False] * 30 + [True]
    assert math.degrees(log.opening.door_angle[-1]) == pytest.approx(66.0)


@pytest.mark.parametrize("failure", ["", "time_limit", "grasp_lost"])
def test_failure_is_the_environments_or_the_time_limit(failure):
    log = run(DoorEnv(failure or "success"))
    assert (log.success, log.failure) == (not failure, failure)


def test_forecasts_are_taken_first_regularly_and_last():
    log = run(forecast_period=0.12)
    np.testing.assert_allclose(log.forecasts.times, [0.0, 0.12, 0.24, 0.3], atol=1e-12)
    # Before the first decision the agent has not been called: its widest belief.
    np.testing.assert_allclose(log.forecasts.std[0, -1], 0.05 + 1e-3)
    assert np.all(np.diff(log.forecasts.std[:, -1, 0]) < 0.0)


def test_latency_is_the_agents_cpu_time_and_its_wall_time():
    class Thinker(ArcAgent):
        def act(self, observation: Any) -> Any:
            time.sleep(0.006)  # as if another process had the core
            end = time.thread_time() + 0.004
            while time.thread_time() < end:
                pass
            return super().act(observation)

    log = run(DoorEnv(n_steps=5), Thinker(n_steps=5))
    assert 0.004 <= log.decisions.latency_s[0] < 0.008
    assert np.isnan(log.decisions.latency_s[1:]).all()
    assert log.decisions.latency_wall_s.min() >= 0.010


@functools.cache
def agents_of(policy: str) -> Callable[[], Any]:
    """Learn once from four demonstrations."""
    given = Teacher().demonstrate_doors((0.35, 0.5), 2, rng=np.random.default_rng(0))
    return learned(policy_named(policy), TrainingInput(demonstrations=given))


def in_lockstep(
    policy: str, make: Any = None, **options: Any
) -> tuple[EpisodeLog, ...]:
    make = make or agents_of(policy)
    agents = batch_agents([make() for _ in DOORS])
    settings = {"door": DOORS, "autoreset_mode": "Disabled", **options}
    envs: Any = gym.make_vec(ENVIRONMENT_IDS[agents.control], len(DOORS), **settings)
    names, same = [str(door) for door in DOORS], [policy] * len(DOORS)
    return tuple(rollouts(envs, agents, policies=same, doors=names, seeds=SEEDS))


@pytest.mark.bits
@pytest.mark.parametrize(
    ("policy", "options"),
    [
        ("gp", {"randomization": "hard", "max_episode_steps": 40}),
        ("gp@impedance", {"randomization": "hard", "max_episode_steps": 25}),
        ("oracle", {"randomization": "hard"}),
        ("hinge-fit", {"randomization": "mild", "max_episode_steps": 40}),
    ],
)
def test_logs_in_lockstep_are_those_of_episodes_alone(policy, options, monkeypatch):
    if policy == "oracle":  # whole episodes, for which checks of types take seconds
        monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    together = in_lockstep(policy, **options)
    for door, seed, log in zip(DOORS, SEEDS, together, strict=True):
        agent = agents_of(policy)()
        env = gym.make(ENVIRONMENT_IDS[agent.control], door=door, **options)
        alone = rollout(env, agent, policy=policy, door=str(door), seed=seed)
        assert repr(log) == repr(alone)
        for part, record in PARTS.items():
            for name in arrays_of(record):
                if not name.startswith("latency_"):
                    pair = (getattr(getattr(one, part), name) for one in (log, alone))
                    np.testing.assert_array_equal(*pair, err_msg=name)


class Softening:
    """Holds the closed handle, ever more softly."""

    control = "impedance"

    def __init__(self) -> None:
        self.stiffness = 400.0

    def act(self, observation: object) -> np.ndarray:
        self.stiffness -= 10.0
        return np.repeat([0.0, self.stiffness, 0.1 * self.stiffness], [6, 3, 3])


def test_an_agent_of_ones_own_commands_the_stiffness_that_is_logged():
    env = gym.make(ENVIRONMENT_IDS["impedance"], door=DOORS[1], max_episode_steps=8)
    alone = rollout(env, Softening(), policy="own", door="medium", seed=SEEDS[1])
    assert alone.decisions.stiffness[:3, 0].tolist() == [390.0, 380.0, 370.0]
    _, together, _ = in_lockstep("own", Softening, max_episode_steps=8)
    np.testing.assert_array_equal(
        together.decisions.stiffness, alone.decisions.stiffness
    )
    np.testing.assert_array_equal(together.motion.ee_pose, alone.motion.ee_pose)


def test_wrong_environments_are_refused():
    message = r"shape \(6,\), commanded position .* got shape \(12,\)"
    with pytest.raises(ValueError, match=message):
        rollout(gym.make(ENVIRONMENT_ID), Softening(), policy="", door="", seed=3)
    with pytest.raises(ValueError, match='autoreset_mode="Disabled"'):
        in_lockstep("own", Softening, autoreset_mode="NextStep")
