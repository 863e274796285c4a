"""Commands for demonstrations and doors from other sources: demos and doors."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Union

import tyro

from gplfd_experiments.cli.commands import options
from gplfd_experiments.cli.commands.teach import Teach
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.workflows.settings import RecordSettings


@dataclass(frozen=True, kw_only=True, slots=True)
class Import(ImportSettings):
    """Make a set of demonstrations from recorded motions, with a report.

    Formats: CSV and TSV, .npz and .npy, MATLAB's .mat, Xsens' .mvnx, .bvh, .c3d, ROS
    bags (.mcap, .db3, .bag, folders), LeRobot v3, robomimic's .hdf5, and data sets
    of `gplfd demos record`. SET contains demonstrations.npz, a report, a picture of the
    motions before and after the preparation, and the origin of the data. Lines of the
    report with ! need attention. See docs/your-data.md.
    """

    files: Annotated[
        tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILES")
    ]
    """Recordings: files, or folders for formats that use folders."""

    out: Annotated[Path, tyro.conf.arg(metavar="SET")]
    """Folder to write."""

    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace an existing set."""

    all: options.All = False
    quiet: options.Quiet = False

    def __post_init__(self) -> None:
        """Check nothing; `execute` does."""

    def execute(self) -> int:
        """Make the set, print the report and the next commands."""
        from gplfd_experiments.data.importing import PICTURE, import_recordings, report
        from gplfd_experiments.files.table import FIRST

        if not self.files:
            raise ValueError("give at least one file to import")
        names = [field.name for field in fields(ImportSettings)]
        settings = ImportSettings(**{name: getattr(self, name) for name in names})
        motions, whole = import_recordings(
            self.files, self.out, settings, overwrite=self.overwrite
        )
        print(whole if self.all else report(motions, settings, FIRST))
        number = len(motions)
        print(f"\n{number} demonstration{'s' * (number > 1)} in {self.out}")
        if warnings := sum(note.warning for motion in motions for note in motion.notes):
            print(f"notes marked with ! that need attention: {warnings}")
        print(f"look at them:     {self.out / PICTURE}")
        print(f"learn from them:  {options.learn_command(self.out)}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class DemosExport:
    """Write demonstrations or episodes in the format of another program.

    LeRobot's format (version 3) is a folder. An action is the pose at the next sample;
    in episodes, the last command before it. Replayed demonstrations and episodes are
    what the environment of `gplfd_env.lerobot` gives and takes.
    """

    demonstrations: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SET")]
    """Folder of `gplfd demos import`, or a demonstrations.npz; episodes, the folder
    of `gplfd demos record`; or an official training set: TRACK-6, TRACK-50 or
    TRACK-200, such as learner-6."""

    out: Annotated[Path, tyro.conf.arg(metavar="PATH")]
    """Folder to write."""

    form: Literal["lerobot"] = "lerobot"
    """Format to write."""

    replay: Annotated[tuple[str, ...] | None, tyro.conf.arg(metavar="DOOR ...")] = None
    """Replay the demonstrations, in turn at these doors (names, radii [m], .json
    files), or without a name at bars of their radii; official sets: at their doors."""

    pictures: tuple[str, ...] = ()
    """Cameras whose videos are written: overview, top, head, hand_camera."""

    size: Annotated[tuple[int, int], tyro.conf.arg(metavar="W H")] = (320, 240)
    """Width and height of the videos [px]."""

    rate: Annotated[int | None, tyro.conf.arg(metavar="HZ")] = None
    """Rows per second of replays and episodes, a divisor of 100; 20 by default."""

    action: Literal["pose", "relative", "stiffness"] = "pose"
    """Form of actions, as --env.action of LeRobot's commands."""

    def execute(self) -> int:
        """Write the files, and print their location."""
        from gplfd_experiments.data.writers.lerobot import Form, export_demonstrations
        from gplfd_experiments.episodes.task import named_doors

        named = named_doors(self.replay) if self.replay else {}
        doors = None if self.replay is None else tuple(named.values())
        form = Form(self.rate, self.action, self.pictures, self.size)
        number = export_demonstrations(self.demonstrations, self.out, form, doors)
        print(f"{number} demonstration{'s' * (number > 1)} in {self.out}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class DemosRecord(RecordSettings):
    """Let a policy open doors and write the episodes as a Minari data set.

    DIR is the data set; its name is its Minari id and ends in a version. Every step
    contains the complete state of MuJoCo. Episode k of every door has the seed SEED + k
    for teacher, policy and environment.
    """

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Data set to write; results/demos/POLICY-v0 by default."""

    quiet: options.Quiet = False

    def execute(self) -> int:
        """Record the data set and print its location."""
        from gplfd_experiments.files.folders import file_name
        from gplfd_experiments.workflows.runs import record_dataset

        folder = self.out or Path("results/demos") / f"{file_name(self.policy)}-v0"
        stored = options.recorded(self) | {"out": folder.name}
        number = record_dataset(folder, self, stored)
        print(f"{number} {'episode' if number == 1 else 'episodes'} in {folder}")
        print(f"look at them:  {options.next_command('demos', 'inspect', folder)}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Inspect:
    """Print the contents of a data set, one line per episode."""

    dataset: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATASET")]
    """Folder that `gplfd demos record` wrote."""

    all: options.All = False

    def execute(self) -> int:
        """Print the contents."""
        if (self.dataset / "import.json").is_file():
            raise ValueError(
                f"{self.dataset} is a set of `gplfd demos import`; its contents are in "
                f"{self.dataset / 'report.txt'}"
            )
        from gplfd_experiments.data.minari import open_dataset
        from gplfd_experiments.files.table import FIRST

        print(open_dataset(self.dataset).contents(None if self.all else FIRST))
        return 0


SUBCOMMANDS: Final[Mapping[str, type[Any]]] = {
    "import": Import,
    "export": DemosExport,
    "teach": Teach,
    "record": DemosRecord,
    "inspect": Inspect,
}
_ANY: Any = Union[  # noqa: UP007
    tuple(
        Annotated[command, tyro.conf.subcommand(name)]
        for name, command in SUBCOMMANDS.items()
    )
]


@dataclass(frozen=True, kw_only=True, slots=True)
class Demos:
    """Demonstrations from recordings, a person at a simulated door, or policies."""

    task: tyro.conf.OmitSubcommandPrefixes[_ANY]

    def execute(self) -> int:
        """Run the chosen subcommand."""
        return int(self.task.execute())


@dataclass(frozen=True, kw_only=True, slots=True)
class Doors:
    """Read a door of DoorBench and write it as door parameters.

    FILE is a spec.json of schema 1.0 of a hinged, sliding or folding door. The
    resulting file is accepted by every --doors option, and by an environment as its
    door. Properties that cannot be represented are listed.
    """

    action: Annotated[Literal["import"], tyro.conf.Positional]
    """Action."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """Specification of the door."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="JSON")] = None
    """File to write; by default the door's name with .json."""

    def execute(self) -> int:
        """Write the door and print properties that are lost."""
        from gplfd_experiments.data.doorbench import read_doorbench
        from gplfd_experiments.files.folders import file_name
        from gplfd_experiments.files.plain_data import write_json

        read = read_doorbench(self.file)
        path = self.out or Path(f"{file_name(read.name)}.json")
        if self.out is None and path.exists():
            raise ValueError(f"{path} exists; name the file to write by --out")
        write_json(path, read.door.as_dict())
        print(f"{read.name} is in {path}")
        for line in read.lost:
            print(f"not represented: {line}")
        return 0
