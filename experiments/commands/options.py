"""What the options of several subcommands have in common."""

import dataclasses
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
