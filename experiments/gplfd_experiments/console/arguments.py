"""Checks of what a person gave on the command line, before anything slow."""

import errno
import os
from pathlib import Path

from gplfd_env.doors.disturbance import DISTURBANCES
from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_env.validation.named import nearest_name


def check_least(option: str, value: float | None, least: float) -> None:
    """Check a number; None is an option that was not given.

    Raises:
        ValueError: It is smaller than allowed.
    """
    if value is not None and not value >= least:
        raise ValueError(f"{option} {value:g} must be {least:g} or more")


def check_circumstances(randomization: str, disturbance: str = "none") -> None:
    """Check two names. In Python there is more than names, on a command line not.

    Raises:
        ValueError: One is unknown.
    """
    for what, name, known in (
        ("randomization", randomization, RANDOMIZATIONS),
        ("disturbance", disturbance, DISTURBANCES),
    ):
        if name not in known:
            hint = nearest_name(name, known)
            names = ", ".join(known)
            raise ValueError(f"unknown {what} {name!r}{hint}; give one of {names}")


def check_folder(folder: Path) -> None:
    """Check that there is, or can be, such a folder to write to.

    Raises:
        ValueError: It is a file.
        OSError: It is below a file, or the disk is read-only.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; give a folder")
    nearest = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not nearest.is_dir():
        raise NotADirectoryError(
            errno.ENOTDIR, f"is a file, so that --out {folder} cannot be", str(nearest)
        )
    if not os.access(nearest, os.W_OK):
        raise PermissionError(
            errno.EACCES, f"cannot be written to, which --out {folder} needs", nearest
        )
