"""Numbers in a MATLAB file, versions 4 to 7.2: understood as those of an .npz file.

Several recordings in a file are the cells of one array, or the structures of one.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import scipy.io
from numpy.typing import NDArray

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.arrays import recordings
from gplfd_experiments.data.readers.mat5 import read_arrays
from gplfd_experiments.data.readers.selection import Selection
from gplfd_policies.arrays.storage import DecodingBudget

_MAT_73: Final = b"MATLAB 7.3"


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read recordings from the arrays of a .mat file.

    Texts, objects and sparse matrices are left out; arrays may claim no more than their
    file can hold.

    Raises:
        ValueError: The file is damaged, of version 7.3, or holds no motion.
    """
    with path.open("rb") as stream:
        first = stream.read(len(_MAT_73))
    if first == _MAT_73:
        raise ValueError("it is of version 7.3; save it again: save(..., '-v7')")
    budget = DecodingBudget(path.stat().st_size)
    # Version 4 has no text in front, but a small number of four bytes.
    old = 0 in first[:4]
    arrays = _version_4(path, budget) if old else read_arrays(path, budget)
    return recordings(path.name, arrays, selection)


def _version_4(path: Path, budget: DecodingBudget) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of a file without cells and structures."""
    listed = scipy.io.whosmat(path)
    for name, shape, _ in listed:
        budget.claim(8 * math.prod(shape), f"{name!r:.40}")
    names = [name for name, _, _ in listed]
    content = scipy.io.loadmat(path, variable_names=names)
    return {name: content[name] for name in names}
