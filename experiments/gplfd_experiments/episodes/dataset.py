"""Let a policy open doors, and write the episodes as a data set."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import door_config
from gplfd_experiments.console.arguments import (
    check_circumstances,
    check_folder,
    check_least,
)
from gplfd_experiments.console.progress import LOG, progress_bar
from gplfd_experiments.data.minari import Recorder, outcome, write_dataset
from gplfd_experiments.episodes.build import (
    learned_agents,
    make_environment,
    reported_errors,
)
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import Policy


def record_dataset(
    folder: Path,
    *,
    policy: str,
    doors: Sequence[str],
    episodes: int,
    seed: int,
    demonstrations_per_door: int,
    demonstrated_forces: bool,
    randomization: str,
    start: Start,
    robot: str,
    max_steps: int | None,
    overwrite: bool,
    options: Mapping[str, Any],
) -> int:
    """Open every door several times and write the data set."""
    check_least("--episodes", episodes, 1, 100_000)
    check_least("--seed", seed, 0)
    check_least("--demonstrations-per-door", demonstrations_per_door, 1, 1000)
    check_least("--max-steps", max_steps, 1)
    chosen = policy_named(policy)
    check_circumstances(randomization, start=start)
    check_folder(folder.parent)
    folder = folder.absolute()  # A policy may change the working folder.
    tasks = [
        episode_task(
            door,
            config,
            policy=policy,
            seed=seed + number,
            demonstrations_per_door=demonstrations_per_door,
            demonstrated_forces=demonstrated_forces,
            randomization=randomization,
            start=start,
            robot=robot,
        )
        for door, config in named_doors(doors, start=start, robot=robot).items()
        for number in range(episodes)
    ]
    first = tasks[0]
    if other := next((task for task in tasks if task.base != first.base), None):
        raise ValueError(
            f"door {first.door} is opened with base={first.base!r} and door "
            f"{other.door} with base={other.base!r}; a data set has one environment: "
            "record two data sets"
        )
    limit = {} if max_steps is None else {"max_episode_steps": max_steps}
    # The first agent determines the environment of all episodes, whose resets change
    # the door.
    with reported_errors(policy, chosen):
        control = learned_agents(first, chosen)().control
    with contextlib.closing(make_environment(first, control, **limit)) as env:
        write_dataset(
            folder,
            _recorded(env, tasks, chosen),
            env=env,
            policy=policy,
            config=options,
            overwrite=overwrite,
        )
    return len(tasks)


def _recorded(
    env: gym.Env[Any, Any], tasks: Sequence[EpisodeTask], policy: Policy
) -> Iterator[Any]:
    """Run and yield the episode of every task."""
    recorder, inner = Recorder(env), env.unwrapped
    for task in progress_bar(tasks, desc="recording", unit="episode"):
        with reported_errors(task.policy, policy):
            agent = learned_agents(task, policy)()
            # HDF5 keeps no empty mapping, which the default door would be.
            radius = door_config(dict(task.door_config)).radius
            door = {"radius": radius, **task.door_config}
            observation, _ = recorder.reset(
                seed=task.reset_seed, options={"door": door}
            )
            agent.inform(inner.door_geometry)  # type: ignore[attr-defined]
            agent.reset(observation)
            ended = False
            while not ended:
                action = agent.act(observation).command(agent.control)
                observation, _, terminated, truncated, _ = recorder.step(action)
                ended = terminated or truncated
        episode = recorder.episode
        LOG.info("%s, seed %d: %s", task.door, task.seed, outcome(episode))
        yield episode
