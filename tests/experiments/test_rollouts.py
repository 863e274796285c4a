"""Episodes in lockstep are the episodes that run alone."""

import dataclasses
import time
from collections.abc import Sequence

import gymnasium as gym
import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from gplfd_env import ENVIRONMENT_ID, ENVIRONMENT_IDS
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import rollout, rollouts
from gplfd_policies.agents.lockstep import batch_agents
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.catalogue import make_agent

DOORS, SEEDS = (0.35, 0.42, 0.5), (5, 6, 7)


@pytest.fixture(scope="module")
def demonstrations() -> tuple[Demonstration, ...]:
    return Teacher().demonstrate_doors((0.35, 0.5), 2, rng=np.random.default_rng(0))


def in_lockstep(
    policy: str,
    demonstrations: Sequence[Demonstration],
    *,
    autoreset_mode: str = "Disabled",
    n_names: int = 3,
    **options: object,
) -> tuple[EpisodeLog, ...]:
    agents = batch_agents([make_agent(policy, demonstrations) for _ in DOORS])
    envs = gym.make_vec(
        ENVIRONMENT_IDS[agents.control],
        num_envs=len(DOORS),
        door=DOORS,
        autoreset_mode=autoreset_mode,
        **options,
    )
    return rollouts(
        envs,
        agents,
        policy=policy,
        doors=[str(door) for door in DOORS][:n_names],
        seeds=SEEDS,
    )


@pytest.mark.bits
@pytest.mark.parametrize(
    ("policy", "randomization"),
    [
        ("gp", "hard"),
        ("gp-impedance", "hard"),
        ("oracle", "hard"),
        ("hinge-fit", "mild"),
    ],
)
def test_logs_are_those_of_episodes_alone(
    policy: str, randomization: str, demonstrations: tuple[Demonstration, ...]
) -> None:
    together = in_lockstep(policy, demonstrations, randomization=randomization)
    lengths = {log.times.size for log in together}
    assert len(lengths) > 1, "episodes must end at different times to prove anything"
    for door, seed, log in zip(DOORS, SEEDS, together, strict=True):
        agent = make_agent(policy, demonstrations)
        id = ENVIRONMENT_IDS[agent.control]
        env = gym.make(id, door=door, randomization=randomization)
        alone = rollout(env, agent, policy=policy, door=str(door), seed=seed)
        for field in dataclasses.fields(EpisodeLog):
            if field.name.startswith("latency_"):
                continue
            first, second = getattr(log, field.name), getattr(alone, field.name)
            np.testing.assert_array_equal(first, second, err_msg=field.name)


def test_wall_times_include_waiting() -> None:
    class Waiting(Softening):
        def act(self, observation: object) -> np.ndarray:
            time.sleep(0.004)
            return super().act(observation)

    envs = gym.make_vec(
        ENVIRONMENT_IDS["impedance"],
        num_envs=2,
        max_episode_steps=4,
        autoreset_mode="Disabled",
    )
    agents = batch_agents([Waiting(), Waiting()])
    names = {"policy": "own", "doors": ["medium", "medium"], "seeds": [2, 3]}
    for log in rollouts(envs, agents, **names):
        # Half of the batch's decision, in which both wait.
        assert log.latency_wall_s.min() >= 0.004
        assert np.median(log.latency_s) < 0.004


class Softening:
    """Holds the closed handle, ever more softly."""

    control = "impedance"

    def __init__(self) -> None:
        self.stiffness = 400.0

    def act(self, observation: object) -> np.ndarray:
        self.stiffness -= 10.0
        return np.repeat([0.0, self.stiffness, 0.1 * self.stiffness], [6, 3, 3])


def test_an_agent_of_ones_own_commands_the_stiffness_that_is_logged() -> None:
    arm: list[np.ndarray] = []

    class Watched(gym.Wrapper):  # type: ignore[type-arg]
        def step(self, action: np.ndarray) -> object:
            result = self.env.step(action)
            arm.append(self.env.unwrapped.model.actuator_gainprm[:6, 0].copy())
            return result

    id = ENVIRONMENT_IDS["impedance"]
    env = Watched(gym.make(id, max_episode_steps=8))
    alone = rollout(env, Softening(), policy="own", door="medium", seed=3)
    np.testing.assert_array_equal(arm, alone.stiffness[:-1])
    np.testing.assert_array_equal(alone.stiffness[:3, 0], [390.0, 380.0, 370.0])
    envs = gym.make_vec(id, num_envs=2, max_episode_steps=8, autoreset_mode="Disabled")
    own = batch_agents([Softening(), Softening()])
    together = rollouts(
        envs, own, policy="own", doors=["medium", "medium"], seeds=[2, 3]
    )
    np.testing.assert_array_equal(together[1].stiffness, alone.stiffness)
    np.testing.assert_array_equal(together[1].ee_pose, alone.ee_pose)


def test_the_wrong_environment_says_what_it_takes() -> None:
    env = gym.make(ENVIRONMENT_ID)
    message = r"shape \(6,\), commanded position .* got shape \(12,\)"
    with pytest.raises(ValueError, match=message):
        rollout(env, Softening(), policy="own", door="medium", seed=3)


@pytest.mark.bits
def test_number_of_threads_changes_no_number() -> None:
    """Of BLAS: learning and acting take one, whatever the caller has set."""
    ends = []
    for threads in (1, 2):
        with threadpool_limits(limits=threads, user_api="blas"):
            demonstrations = Teacher().demonstrate_doors(
                (0.35, 0.5), 2, rng=np.random.default_rng(0)
            )
            logs = in_lockstep("gp", demonstrations, max_episode_steps=30)
        ends.append([log.action.tobytes() for log in logs])
    assert ends[0] == ends[1]


def test_an_episode_that_is_cut_off_says_so(
    demonstrations: tuple[Demonstration, ...],
) -> None:
    for log in in_lockstep("gp", demonstrations, max_episode_steps=40):
        assert log.times.size == 41
        assert (log.success, log.failure) == (False, "time_limit")


def test_simulations_must_stand_still_when_they_end(
    demonstrations: tuple[Demonstration, ...],
) -> None:
    with pytest.raises(ValueError, match='autoreset_mode="Disabled"'):
        in_lockstep("gp", demonstrations, autoreset_mode="NextStep")


def test_doors_and_seeds_are_as_many_as_simulations(
    demonstrations: tuple[Demonstration, ...],
) -> None:
    with pytest.raises(ValueError, match="3 simulations need as many doors and seeds"):
        in_lockstep("gp", demonstrations, n_names=2)
