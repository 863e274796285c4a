"""Readers of motion files: one module for each kind of file, one list of them all."""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import RawRecording, Selection
from gplfd_policies.arrays.storage import regular_file

__all__ = ["READERS", "Reader", "Selection", "read_recordings"]


@dataclass(frozen=True, slots=True)
class Reader:
    """How one kind of file is read.

    The module has a function ``read(path, selection)`` that returns the motions in the
    order of the file. Their names begin with the name of the file; units and time
    stamps are those of the file. It does not trust the content of the file, and claims
    memory from a `DecodingBudget` before it allocates. Any exception means that the
    file cannot be read, and its text says why.
    """

    summary: str
    """Name in a message."""
    module: str
    """Module of this package; imported when needed, for its libraries."""
    suffixes: tuple[str, ...] = ()
    """Suffixes of such files; none for folders."""
    marks: tuple[str, ...] = ()
    """A folder of this kind contains one of these."""


READERS: Final[Mapping[str, Reader]] = MappingProxyType(
    {
        "csv": Reader(
            "a table in a text file", "csv_tables", (".csv", ".tsv", ".txt", ".log")
        ),
        "numpy": Reader("arrays of NumPy", "arrays", (".npz", ".npy")),
        "matlab": Reader("a MATLAB file", "matlab", (".mat",)),
        "mvnx": Reader("a recording of Xsens MVN", "mvnx", (".mvnx",)),
        "bvh": Reader("a Biovision hierarchy", "bvh", (".bvh",)),
        "c3d": Reader("a C3D file", "c3d", (".c3d",)),
        "ros": Reader(
            "a bag of ROS", "bags", (".mcap", ".db3", ".bag"), ("metadata.yaml",)
        ),
        "robomimic": Reader(
            "demonstrations of robomimic", "robomimic", (".hdf5", ".h5")
        ),
        "lerobot": Reader("a data set of LeRobot", "lerobot", (), ("meta/info.json",)),
        "minari": Reader(
            "a data set of gplfd demos record",
            "minari_episodes",
            marks=("data/metadata.json",),
        ),
        "set": Reader(
            "a set of demonstrations", "arrays", marks=("demonstrations.npz",)
        ),
    }
)
"""Every kind of file that is read."""


def read_recordings(path: str | Path, selection: Selection) -> list[RawRecording]:
    """Read all motions in a file or folder.

    No file is trusted: damaged or forged files raise an error.

    Args:
        path: The file or folder; its name determines its kind.
        selection: What to read, and properties that the file does not state.

    Raises:
        FileNotFoundError: There is no such file.
        OSError: It cannot be read.
        ModuleNotFoundError: Its reader needs a library that is not installed.
        ValueError: It is damaged, of unknown kind, or lacks the selected item. The
            message names file, line or field, and says what to do.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir():
        found = [
            reader
            for reader in READERS.values()
            if any((path / mark).is_file() for mark in reader.marks)
        ]
    else:
        regular_file(path, "a recording in a regular file")
        found = [reader for reader in READERS.values() if suffix in reader.suffixes]
    if not found:
        known = [suffix for reader in READERS.values() for suffix in reader.suffixes]
        marks = [mark for reader in READERS.values() for mark in reader.marks]
        what = "folder" if path.is_dir() else f"kind of file {suffix!r}"
        raise ValueError(
            f"{path}: unknown {what}{nearest_name(suffix, known)}; readable are "
            f"{', '.join(known)}, and folders with {', '.join(marks)}"
        )
    reader = found[0]
    module = importlib.import_module(f"{__name__}.{reader.module}")
    try:
        recordings: list[RawRecording] = module.read(path, selection)
        if not recordings:
            raise ValueError("it holds no recording")
    except ModuleNotFoundError:
        raise
    # Parsers and libraries raise errors of every kind for damaged files.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {reader.summary}: {reason:.600}"
        ) from error
    return recordings
