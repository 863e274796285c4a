"""Checks of command-line arguments before slow computations."""

import errno
import math
import os
from pathlib import Path

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.disturbance import DISTURBANCES
from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_env.validation.named import nearest_name


def check_least(
    option: str, value: float | None, least: float, most: float = math.inf
) -> None:
    """Raise ValueError for a number beyond a limit; None is an option not given."""
    if value is not None and not least <= value <= most:
        allowed = f"{least:g} to {most:g}" if most < math.inf else f"{least:g} or more"
        raise ValueError(f"{option} {value:g} must be {allowed}")


def check_circumstances(
    randomization: str, disturbance: str = "none", start: Start = "grasped"
) -> None:
    """Raise ValueError for an unknown name, or for an incompatible start."""
    for what, name, table in (
        ("randomization", randomization, RANDOMIZATIONS),
        ("disturbance", disturbance, DISTURBANCES),
    ):
        if name not in table:
            allowed = f"{nearest_name(name, table)}; give one of {', '.join(table)}"
            raise ValueError(f"unknown {what} {name!r}{allowed}")
    RANDOMIZATIONS[randomization].check_start(start)


def check_folder(folder: Path) -> None:
    """Raise ValueError or OSError if a folder cannot be written to."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; give a folder")
    above = (folder.absolute(), *folder.absolute().parents)
    nearest = next(path for path in above if path.exists())
    if not (nearest.is_dir() and os.access(nearest, os.W_OK)):
        message = f"is no writable folder, so {folder} cannot be created"
        raise OSError(errno.EACCES, message, str(nearest))
