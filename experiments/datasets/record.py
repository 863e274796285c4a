"""Let a policy open doors, and keep everything that happens as a data set."""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym

from gplfd.experiments.arguments import check_circumstances, check_folder, check_least
from gplfd.experiments.datasets.minari import RecordedEpisode, Recorder, write_dataset
from gplfd.experiments.datasets.minari.contents import outcome
from gplfd.experiments.episodes.agents import learned, reported_errors
from gplfd.experiments.episodes.doors import named_doors
from gplfd.experiments.progress import LOG, progress_bar
from gplfd.experiments.teacher import Teacher
from gplfd.policies.agent import Agent
from gplfd.policies.method import TrainingInput
from gplfd.policies.one_thread import one_thread
from gplfd.policies.policy import Policy
from gplfd.policies.registry import policy_named
from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.config import DoorConfig

_Plan = Sequence[tuple[str, DoorConfig, int]]
"""Door's name, its configuration and the seed of every episode."""


def record_dataset(
    folder: Path,
    *,
    policy: str,
    doors: Sequence[str],
    episodes: int,
    seed: int,
    demonstrations_per_door: int,
    randomization: str,
    max_steps: int | None,
    overwrite: bool,
    options: Mapping[str, Any],
) -> int:
    """Open every door some times and write the data set.

    Args:
        folder: The data set; its name is its id.
        policy: Name of the policy that acts.
        doors: Names of doors, or radii [m] as text.
        episodes: Number per door; the k-th has seed ``seed + k``.
        seed: First seed of teacher, policy and environment.
        demonstrations_per_door: How often the synthetic human opens each of the three
            demonstrated doors.
        randomization: Name of what the environment draws anew.
        max_steps: Episodes are cut after this many; None for the environment's limit.
        overwrite: Replace a data set that is there already.
        options: The command's, for the record; JSON-able.

    Returns:
        The number of episodes.

    Raises:
        ValueError: An argument is wrong.
        OSError: The data set cannot be written.
    """
    check_least("--episodes", episodes, 1)
    check_least("--seed", seed, 0)
    check_least("--demonstrations-per-door", demonstrations_per_door, 1)
    check_least("--max-steps", max_steps, 1)
    chosen = policy_named(policy)
    check_circumstances(randomization)
    check_folder(folder.parent)
    plan = [
        (name, config, seed + number)
        for name, config in named_doors(doors).items()
        for number in range(episodes)
    ]
    # The environment of the first door, to which resets bring the others.
    arguments: dict[str, Any] = {"door": plan[0][1].as_dict()}
    if randomization != "none":
        arguments["randomization"] = randomization
    if max_steps is not None:
        arguments["max_episode_steps"] = max_steps
    taught = partial(_taught, policy, chosen, demonstrations_per_door)
    # An agent says which environment it acts in; each episode has one of its own.
    made = gym.make(ENVIRONMENT_IDS[taught(seed).control], **arguments)
    with contextlib.closing(made) as env:
        write_dataset(
            folder,
            _recorded(env, plan, policy, chosen, taught),
            env=env,
            policy=policy,
            config=options,
            overwrite=overwrite,
        )
    return len(plan)


def _taught(
    name: str, policy: Policy, demonstrations_per_door: int, seed: int
) -> Agent:
    """Return an agent that has learned from the synthetic human of a seed."""
    shown = Teacher().standard_demonstrations(demonstrations_per_door, seed=seed)
    training = TrainingInput(demonstrations=shown, seed=seed)
    with reported_errors(name, policy):
        return learned(policy, training)()


def _recorded(
    env: gym.Env[Any, Any],
    plan: _Plan,
    name: str,
    policy: Policy,
    taught: Callable[[int], Agent],
) -> Iterator[RecordedEpisode]:
    """Run and yield every episode of the plan."""
    recorder = Recorder(env)
    for door, config, seed in progress_bar(plan, desc="recording", unit="episode"):
        agent = taught(seed)
        with reported_errors(name, policy):
            _act(agent, recorder, config, seed)
        episode = recorder.episode
        LOG.info("%s, seed %d: %s", door, seed, outcome(episode))
        yield episode


def _act(agent: Agent, env: Recorder, door: DoorConfig, seed: int) -> None:
    """Let the agent act from the reset to the end of the episode."""
    inner: Any = env.unwrapped
    # Small matrices: more threads only cost time, and change the order of sums.
    with one_thread:
        options = {"door": door.as_dict()}
        observation, _ = env.reset(seed=seed, options=options)
        agent.inform(inner.door_geometry)
        agent.reset(observation)
        ended = False
        while not ended:
            action = agent.act(observation).command(agent.control)
            observation, _, terminated, truncated, _ = env.step(action)
            ended = terminated or truncated
