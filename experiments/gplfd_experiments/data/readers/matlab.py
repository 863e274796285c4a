"""MATLAB files, versions 4 to 7.2: arrays of numbers, also in cells and structures."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.arrays import recordings
from gplfd_experiments.data.settings import ImportSettings


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read motions from arrays, with the same rules as for an .npz file.

    Texts, objects and sparse matrices are left out.
    """
    with path.open("rb") as stream:
        if stream.read(10) == b"MATLAB 7.3":
            raise ValueError("it is of version 7.3; save it again: save(..., '-v7')")
    arrays: dict[str, NDArray[Any]] = {}
    for variable, value in scipy.io.loadmat(path, appendmat=False).items():
        if not variable.startswith("__"):
            arrays.update(numeric_arrays(value, variable))
    return recordings(path.name, arrays, settings)


def numeric_arrays(value: Any, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and numbers of an array, or of all arrays in a cell or structure.

    The names are those of MATLAB: ``pos``, ``data{3}``, ``demos{2}.pos``, ``s(4).t``;
    the index of a single structure is omitted.
    """
    if not isinstance(value, np.ndarray):
        return
    parts = enumerate(value.ravel(order="F"), start=1)
    if value.dtype.names is not None:
        for number, structure in parts:
            index = f"({number})" if value.size > 1 else ""
            for field in value.dtype.names:
                yield from numeric_arrays(structure[field], f"{name}{index}.{field}")
    elif value.dtype == object:
        for number, cell in parts:
            yield from numeric_arrays(cell, f"{name}{{{number}}}")
    elif value.dtype.kind in "biuf":
        yield name, value
