"""``gplfd doors import``: a door of another collection as door parameters."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True, kw_only=True, slots=True)
class Doors:
    """Read a door of DoorBench and write it as door parameters.

    FILE is a spec.json of schema 1.0 of a single swing door. The file written can be
    given to every --doors, and to an environment as its door. Properties that cannot
    be represented are listed.
    """

    action: Annotated[Literal["import"], tyro.conf.Positional]
    """What to do."""

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """The door."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="JSON")] = None
    """File to write; the door's name and .json by default."""

    def execute(self) -> int:
        """Write the door and print what of it is lost."""
        from gplfd_experiments.data.doorbench import read_doorbench
        from gplfd_experiments.files.names import file_name
        from gplfd_experiments.files.plain_data import write_json

        found = read_doorbench(self.file)
        path = self.out or Path(f"{file_name(found.name)}.json")
        write_json(path, found.door.as_dict())
        print(f"{found.name} is in {path}")
        for line in found.lost:
            print(f"not represented: {line}")
        return 0
