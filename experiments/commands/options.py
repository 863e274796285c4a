"""What several subcommands have in common: options, and the command to give next."""

import dataclasses
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

Quiet = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Show no progress, only results."),
]
"""A flag without its opposite."""


def recorded(options: Any) -> dict[str, Any]:
    """Return a subcommand's options as they are kept with its results, JSON-able."""
    return {
        name: str(value) if isinstance(value, Path) else value
        for name, value in dataclasses.asdict(options).items()
    }


def next_command(*words: object) -> str:
    """Return a command of this program, by the name under which it was started now.

    That is no ``gplfd`` alone where the program's folder is not searched for commands:
    without an activated environment.
    """
    program, found = sys.argv[0], shutil.which("gplfd")
    is_command = Path(program).name in ("gplfd", "gplfd.exe")
    if not is_command or (found and Path(found).resolve() == Path(program).resolve()):
        program = "gplfd"
    return shlex.join([program, *map(str, words)])
