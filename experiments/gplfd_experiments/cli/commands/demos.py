"""``gplfd demos``: import, export; record, look at and repeat episodes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

import tyro

from gplfd_experiments.cli.commands.options import Quiet, next_command, recorded
from gplfd_experiments.cli.commands.recordings import Export, Import
from gplfd_experiments.console.interruption import postponed_interruption

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
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters."""

    episodes: int = 1
    """Episodes per door, 1 or more."""

    seed: int = 0
    """First seed, 0 or more."""

    demonstrations_per_door: int = 2
    """How often the synthetic human opens each of the three demonstrated doors."""

    randomization: str = "none"
    """What is drawn at random for each episode: none, mild, hard or standard; see
    `gplfd list`."""

    start: Literal["grasped", "approach"] = "grasped"
    """What episodes begin with: the handle in the hand, or the open hand 10 to 20 cm
    before it, which then reaches as the demonstrations do."""

    max_steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Cut episodes after this many steps; the environment's own limit by default."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Data set to write; results/demos/POLICY-v0 by default."""

    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace the data set that is there already."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Record the data set and print where it is."""
        with postponed_interruption():
            from gplfd_experiments.episodes.dataset import record_dataset
            from gplfd_experiments.files.names import file_name

        folder = self.out or Path("results/demos") / f"{file_name(self.policy)}-v0"
        number = record_dataset(
            folder,
            policy=self.policy,
            doors=self.doors,
            episodes=self.episodes,
            seed=self.seed,
            demonstrations_per_door=self.demonstrations_per_door,
            randomization=self.randomization,
            start=self.start,
            max_steps=self.max_steps,
            overwrite=self.overwrite,
            options=recorded(self) | {"out": folder.name},
        )
        print(f"{number} {'episode' if number == 1 else 'episodes'} in {folder}")
        print(f"run them again:  {next_command('demos', 'replay', folder)}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Replay:
    """Run recorded episodes again and compare with the recording, bit for bit.

    Exit status 0 when all are the same, 1 when one departs, 2 for bad input.
    """

    dataset: DatasetPath
    """Folder that `gplfd demos record` wrote."""

    episodes: tuple[int, ...] = ()
    """Episodes to run, from 0; all by default."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Print a line per episode; return `DEPARTED` if one departs."""
        with postponed_interruption():
            from gplfd_experiments.data.minari import open_dataset
            from gplfd_experiments.data.minari.contents import title
            from gplfd_experiments.data.replay import changes_since, replays

        dataset = open_dataset(self.dataset)
        numbers = self.episodes or tuple(range(dataset.n_episodes))
        dataset.check(numbers)
        print(title(dataset))
        changes = changes_since(dataset.origin)
        for what, (then, now) in changes.items():
            print(f"not as recorded: {what} was {then}, is {now}")
        if changes:
            print("so equal to a tolerance only, see docs/reproducibility.md")
        exact = 0
        for number, comparison in replays(dataset, numbers):
            exact += comparison.exact
            print(f"episode {number}: {comparison}", flush=True)
        print(f"{exact} of {len(numbers)} episodes are the recording, bit for bit")
        return 0 if exact == len(numbers) else DEPARTED


@dataclass(frozen=True, kw_only=True, slots=True)
class Inspect:
    """Print what a data set holds, one line per episode."""

    dataset: DatasetPath
    """Folder that `gplfd demos record` wrote."""

    def execute(self) -> int:
        """Print the contents."""
        with postponed_interruption():
            from gplfd_experiments.data.minari import open_dataset
            from gplfd_experiments.data.minari.contents import contents

        print(contents(open_dataset(self.dataset)))
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Demos:
    """Demonstrations from recordings, for other programs, and of policies."""

    task: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Import, tyro.conf.subcommand("import")]
        | Annotated[Export, tyro.conf.subcommand("export")]
        | Annotated[Record, tyro.conf.subcommand("record")]
        | Annotated[Replay, tyro.conf.subcommand("replay")]
        | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    ]

    def execute(self) -> int:
        """Run the chosen one."""
        return self.task.execute()
