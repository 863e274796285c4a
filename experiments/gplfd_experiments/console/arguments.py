"""Checks of command-line arguments before slow computations."""

import errno
import os
from pathlib import Path

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.disturbance import DISTURBANCES
from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_env.validation.named import nearest_name


def check_least(option: str, value: float | None, least: float) -> None:
    """Raise ValueError for a number below the limit; None is an option not given."""
    if value is not None and not value >= least:
        raise ValueError(f"{option} {value:g} must be {least:g} or more")


def check_circumstances(
    randomization: str, disturbance: str = "none", start: Start = "grasped"
) -> None:
    """Raise ValueError for an unknown name, or for an incompatible start.

    The Python interface accepts more than names.
    """
    for what, name, known in (
        ("randomization", randomization, RANDOMIZATIONS),
        ("disturbance", disturbance, DISTURBANCES),
    ):
        if name not in known:
            hint = nearest_name(name, known)
            names = ", ".join(known)
            raise ValueError(f"unknown {what} {name!r}{hint}; give one of {names}")
    RANDOMIZATIONS[randomization].check_start(start)


def check_folder(folder: Path) -> None:
    """Raise ValueError or OSError if a folder cannot be written to."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; give a folder")
    nearest = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not nearest.is_dir():
        raise NotADirectoryError(
            errno.ENOTDIR,
            f"is a file, so --out {folder} cannot be created",
            str(nearest),
        )
    if not os.access(nearest, os.W_OK):
        raise PermissionError(
            errno.EACCES,
            f"is not writable, so --out {folder} cannot be created",
            nearest,
        )
