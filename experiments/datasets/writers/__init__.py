"""Sets of demonstrations in the forms of other programs, complete or not at all."""

import importlib
from pathlib import Path
from typing import Final

from experiments.datasets.npz import load_demonstrations
from experiments.datasets.writers.rows import demonstration_rows

WRITERS: Final = ("robomimic", "lerobot")
"""Every form that is written; each is a module of this package, and of the readers."""


def export_demonstrations(source: Path, target: Path, form: str) -> int:
    """Write a set of demonstrations in another form.

    Args:
        source: The set, see `experiments.datasets.npz`.
        target: File or folder to write.
        form: One of `WRITERS`.

    Returns:
        The number of demonstrations.

    Raises:
        ValueError: The form is unknown, the target is there already, or the set is
            damaged or not sampled at equal steps.
        OSError: A file cannot be read or written.
        ModuleNotFoundError: The form's library is not installed.
    """
    if form not in WRITERS:
        raise ValueError(f"form {form!r} must be one of {', '.join(WRITERS)}")
    if target.exists():
        raise ValueError(f"--out {target} exists; give another")
    # The reader of a form says how to install what both need.
    importlib.import_module(f"experiments.datasets.readers.{form}")
    module = importlib.import_module(f"{__name__}.{form}")
    rows = demonstration_rows(load_demonstrations(source))
    module.write(target, rows)
    return len(rows)
