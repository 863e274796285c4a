"""``gplfd demos``: record episodes as a data set, look at one, run one again."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import tyro

from experiments.commands.complaint import complain
from experiments.study.doors import named_doors

if TYPE_CHECKING:
    import gymnasium as gym

    from experiments.datasets.minari import RecordedEpisode
    from policies.agent import Agent

DEPARTED: Final = 1
"""Exit status of a replay that is not the recording, bit for bit."""

DatasetPath = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]


@dataclass(frozen=True, kw_only=True, slots=True)
class Record:
    """Let a policy open doors and write everything as a Minari data set.

    DIR is the data set; its name is its Minari id and ends in a version. Every step
    holds MuJoCo's whole state, so that `gplfd demos replay` can tell whether this
    machine and this version compute the same. Episode k of every door has seed
    SEED + k for teacher, policy and environment.
    """

    policy: str = "gp"
    """Policy that acts; see `gplfd list`."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`) or radii in metres."""

    episodes: int = 1
    """Episodes per door, 1 or more."""

    seed: int = 0
    """First seed, 0 or more."""

    demonstrations_per_door: int = 2
    """How often the synthetic human opens each of the three demonstrated doors."""

    randomization: str | None = None
    """What the environment varies between episodes: a preset's name."""

    max_steps: int | None = None
    """Cut episodes after this many steps; the environment's own limit by default."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Data set to write; results/demos/POLICY-v0 by default."""

    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace the data set that is there already."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        folder = self.out or Path("results/demos") / f"{self.policy}-v0"
        try:
            from experiments.datasets.minari import write_dataset

            plan = self._plan()
            with contextlib.closing(self._environment(plan)) as env:
                write_dataset(
                    folder,
                    self._recorded(env, plan),
                    env=env,
                    policy=self.policy,
                    config=dataclasses.asdict(self) | {"out": folder.name},
                    overwrite=self.overwrite,
                )
        except (ModuleNotFoundError, ValueError, TypeError, OSError) as error:
            return complain(error)
        episodes = "1 episode" if len(plan) == 1 else f"{len(plan)} episodes"
        print(f"{episodes} in {folder}")
        print(f"run them again:  gplfd demos replay {folder}")
        return 0

    def _plan(self) -> list[tuple[str, dict[str, Any], int]]:
        """Door, reset options and seed of every episode.

        Raises:
            ValueError: An argument is wrong.
        """
        from policies.registry import policy_named

        policy_named(self.policy)
        for option, value, least in (
            ("--episodes", self.episodes, 1),
            ("--seed", self.seed, 0),
            ("--demonstrations-per-door", self.demonstrations_per_door, 1),
            ("--max-steps", self.max_steps, 1),
        ):
            if value is not None and value < least:
                raise ValueError(f"{option} {value} must be {least} or more")
        return [
            (name, {"door": dataclasses.asdict(config)}, self.seed + number)
            for name, config in named_doors(self.doors).items()
            for number in range(self.episodes)
        ]

    def _recorded(
        self, env: gym.Env[Any, Any], plan: Sequence[tuple[str, dict[str, Any], int]]
    ) -> Iterator[RecordedEpisode]:
        """Run and yield every episode of the plan."""
        from experiments.datasets.minari import Recorder
        from experiments.datasets.minari.contents import outcome

        recorder = Recorder(env)
        for name, options, seed in _with_bar(plan, "recording"):
            agent = self._agent(options["door"]["radius"], seed)
            act(agent, recorder, seed=seed, options=options)
            episode = recorder.episode
            print(f"{name}, seed {seed}: {outcome(episode)}", file=sys.stderr)
            yield episode

    def _environment(
        self, plan: Sequence[tuple[str, dict[str, Any], int]]
    ) -> gym.Env[Any, Any]:
        """Make the environment of the first door, to which resets bring the others."""
        import gymnasium as gym

        from gplfd_env import ENVIRONMENT_ID

        _, options, _ = plan[0]
        arguments = dict(options)
        if self.randomization is not None:
            arguments["randomization"] = self.randomization
        if self.max_steps is not None:
            arguments["max_episode_steps"] = self.max_steps
        return gym.make(ENVIRONMENT_ID, **arguments)

    def _agent(self, radius: float, seed: int) -> Agent:
        import numpy as np

        from experiments.teacher import DEMONSTRATED_RADII, Teacher
        from policies.registry import make_agent

        demonstrations = Teacher().demonstrate_doors(
            DEMONSTRATED_RADII,
            self.demonstrations_per_door,
            rng=np.random.default_rng(seed),
        )
        return make_agent(self.policy, demonstrations, seed=seed, radius=radius)


def act(
    agent: Agent,
    env: gym.Env[Any, Any],
    *,
    seed: int,
    options: Mapping[str, Any] | None = None,
) -> None:
    """Let the agent act from the reset to the end of the episode."""
    from threadpoolctl import threadpool_limits

    # Small matrices: more threads only cost time, and change the order of sums.
    with threadpool_limits(limits=1, user_api="blas"):
        observation, _ = env.reset(seed=seed, options=dict(options or {}) or None)
        agent.reset(observation)
        ended = False
        while not ended:
            action = agent.act(observation).action
            observation, _, terminated, truncated, _ = env.step(action)
            ended = terminated or truncated


@dataclass(frozen=True, kw_only=True, slots=True)
class Replay:
    """Run recorded episodes again and compare with the recording, bit for bit.

    Exit status 0 when all are the same, 1 when one departs, 2 for bad input.
    """

    dataset: DatasetPath
    """Folder that `gplfd demos record` wrote."""

    episodes: tuple[int, ...] = ()
    """Episodes to run, from 0; all by default."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        exact = 0
        try:
            from experiments.datasets.minari import open_dataset
            from experiments.datasets.minari.contents import title
            from experiments.datasets.replay import changes_since, replays

            dataset = open_dataset(self.dataset)
            numbers = self.episodes or range(dataset.n_episodes)
            dataset.check(numbers)
            print(title(dataset))
            for what, (then, now) in changes_since(dataset.origin).items():
                print(f"not as recorded: {what} was {then}, is {now}")
            for number, comparison in replays(dataset, _with_bar(numbers, "replaying")):
                exact += comparison.exact
                print(f"episode {number}: {comparison}", flush=True)
        except (ModuleNotFoundError, ValueError, OSError) as error:
            return complain(error)
        print(f"{exact} of {len(numbers)} episodes are the recording, bit for bit")
        return 0 if exact == len(numbers) else DEPARTED


@dataclass(frozen=True, kw_only=True, slots=True)
class Inspect:
    """Print what a data set holds, one line per episode."""

    dataset: DatasetPath
    """Folder that `gplfd demos record` wrote."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        try:
            from experiments.datasets.minari import open_dataset
            from experiments.datasets.minari.contents import contents

            print(contents(open_dataset(self.dataset)))
        except (ModuleNotFoundError, ValueError, OSError) as error:
            return complain(error)
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Demos:
    """Record episodes as a Minari data set, look into one, run one again."""

    task: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Record, tyro.conf.subcommand("record")]
        | Annotated[Replay, tyro.conf.subcommand("replay")]
        | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    ]

    def execute(self) -> int:
        """Run the command and return the exit status."""
        return self.task.execute()


def _with_bar(items: Sequence[Any], what: str) -> Iterator[Any]:
    from tqdm import tqdm

    # disable=None: no bar when stderr is not a terminal.
    return iter(tqdm(items, desc=what, unit="episode", leave=False, disable=None))
