"""Shared code of subcommands: options, and commands to suggest."""

import dataclasses
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final

import tyro

from gplfd_experiments.studies.engines import Engine

FAILED: Final = 1
"""Exit status of a command if some or all of its tasks ended in errors."""

Quiet = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Show no progress, only results, warnings and errors."),
]
"""A flag without its opposite."""

Json = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Print JSON and nothing else on standard output."),
]
"""Option of commands that print a table."""

All = Annotated[
    tyro.conf.FlagCreatePairsOff[bool],
    tyro.conf.arg(help="Print all columns of the table, not only five."),
]
"""Option of commands that print a table of many columns."""

Where = Annotated[Engine, tyro.conf.arg(name="")]
"""Option of commands that run a study."""

ON_THIS_MACHINE: Final = Engine()
"""In processes, one per core."""


def recorded(options: Any) -> dict[str, Any]:
    """Return a subcommand's options, also shared ones, as JSON-able data."""
    settings = dataclasses.asdict(options)
    shared = settings.pop("where", {})
    return {
        name: str(value) if isinstance(value, Path) else value
        for name, value in (settings | shared).items()
    }


def open_command(skill: Path, doors: Sequence[str], policy: str) -> str:
    """Return the command that opens doors, or the default ones, with a skill."""
    named = ("--doors", *doors) if doors else ()
    followed = () if policy == "gp" else ("--policy", policy)
    return next_command("run", "--skill", skill, *named, *followed)


def learn_command(folder: Path) -> str:
    """Return the command that learns a skill from a set of demonstrations."""
    out = folder.with_name(f"{folder.name}-skill.npz")
    return next_command("learn", folder, "--out", out)


def next_command(*words: object) -> str:
    """Return a command line of this program."""
    return shlex.join(["gplfd", *map(str, words)])
