"""Demonstrations and episodes in the forms of other programs, whole or not at all."""

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gplfd_experiments.data.readers import READERS
from gplfd_experiments.data.writers.rows import demonstration_rows
from gplfd_policies.demonstrations.npz import load_demonstrations

WRITERS: Final = ("robomimic", "lerobot")
"""Every form that is written; each is a module of this package, and of the readers."""

_FINEST: Final = 100
_PICTURE_RATE: Final = 10


def export_demonstrations(
    source: Path,
    target: Path,
    form: str,
    *,
    rate: int | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (320, 240),
) -> int:
    """Write a set of demonstrations, or a data set of episodes, in one of `WRITERS`.

    Args:
        source: The set or data set.
        target: File or folder to write.
        form: One of `WRITERS`.
        rate: Rows per second of episodes; None for 100, or 10 with pictures.
        cameras: Whose pictures of episodes are drawn.
        size: Width and height of the pictures [px].

    Returns:
        The number of demonstrations.

    Raises:
        ValueError: The form is unknown, the target is there already, the source is
            damaged or not sampled at equal steps, or it cannot be drawn.
        OSError: A file cannot be read or written, or pictures not be drawn here.
        ModuleNotFoundError: The form's library is not installed.
    """
    if form not in WRITERS:
        raise ValueError(f"form {form!r} must be one of {', '.join(WRITERS)}")
    if target.exists():
        raise ValueError(f"--out {target} exists; give another")
    if cameras and form != "lerobot":
        raise ValueError("--pictures are written in the form lerobot alone")
    # The reader of a form says how to install what both need.
    importlib.import_module(f"gplfd_experiments.data.readers.{form}")
    module = importlib.import_module(f"{__name__}.{form}")
    if any((source / mark).is_file() for mark in READERS["minari"].marks):
        from gplfd_experiments.data.minari import open_dataset
        from gplfd_experiments.data.writers.episodes import episode_rows

        usual = _PICTURE_RATE if cameras else _FINEST
        rows = episode_rows(open_dataset(source), rate or usual, cameras, size)
    elif cameras or rate is not None:
        raise ValueError(
            f"{source} holds motions alone; --pictures and --rate are for episodes of "
            "`gplfd demos record`"
        )
    else:
        rows = demonstration_rows(load_demonstrations(source))
    module.write(target, rows)
    return len(rows)
