"""Arrays in a MATLAB file, versions 4 to 7.2: understood as those of an .npz file."""

import math
from pathlib import Path
from typing import Final

import scipy.io

from experiments.datasets.raw import RawRecording
from experiments.datasets.readers.arrays import recordings
from experiments.datasets.readers.selection import Selection

_NUMERIC: Final = frozenset({"double", "single", "logical"}).union(
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
)
_LARGEST_EXPANSION: Final = 20
_ALLOWANCE: Final = 2**26
_MAT_73: Final = b"MATLAB 7.3"


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read recordings from the arrays of a .mat file.

    Structures, cells and objects are not read; arrays may claim no more than their file
    can hold.

    Raises:
        ValueError: The file is damaged, of version 7.3, or holds no motion.
    """
    with path.open("rb") as stream:
        if stream.read(len(_MAT_73)) == _MAT_73:
            raise ValueError("it is of version 7.3; save it again: save(..., '-v7')")
    free = max(_ALLOWANCE, _LARGEST_EXPANSION * path.stat().st_size)
    listed = scipy.io.whosmat(path)
    wanted = [key for key, _, kind in listed if kind in _NUMERIC]
    claimed = sum(8 * math.prod(shape) for key, shape, kind in listed if key in wanted)
    if claimed > free:
        raise ValueError(f"its arrays claim {claimed:,} bytes, more than it can hold")
    if not wanted:
        kinds = ", ".join(f"{key} ({kind})" for key, _, kind in listed) or "nothing"
        raise ValueError(
            f"it holds no array of numbers but {kinds:.200}; save the fields of a "
            "structure as arrays: save('file.mat', '-struct', 'name')"
        )
    content = scipy.io.loadmat(path, variable_names=wanted)
    return recordings(path.name, {key: content[key] for key in wanted}, selection)
