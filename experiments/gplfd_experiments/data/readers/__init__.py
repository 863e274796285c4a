"""Readers of recordings: one module for each kind of file, one list of them all."""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection
from gplfd_policies.arrays.storage import regular_file


@dataclass(frozen=True, kw_only=True, slots=True)
class Reader:
    """How one kind of file is read."""

    summary: str
    """What it is called in a message."""
    suffixes: tuple[str, ...]
    """How such files end; none for folders."""
    module: str
    """Module of this package with ``read(path, selection)``; imported when needed, for
    it may need libraries of its own."""
    marks: tuple[str, ...] = ()
    """A folder of this kind holds one of these."""


READERS: Final[Mapping[str, Reader]] = MappingProxyType(
    {
        "csv": Reader(
            summary="a table in a text file",
            suffixes=(".csv", ".tsv", ".txt", ".log"),
            module="csv_tables",
        ),
        "numpy": Reader(
            summary="arrays of NumPy", suffixes=(".npz", ".npy"), module="arrays"
        ),
        "matlab": Reader(summary="a MATLAB file", suffixes=(".mat",), module="matlab"),
        "mvnx": Reader(
            summary="a recording of Xsens MVN", suffixes=(".mvnx",), module="mvnx"
        ),
        "bvh": Reader(
            summary="a Biovision hierarchy", suffixes=(".bvh",), module="bvh"
        ),
        "c3d": Reader(summary="a C3D file", suffixes=(".c3d",), module="c3d"),
        "ros": Reader(
            summary="a bag of ROS",
            suffixes=(".mcap", ".db3", ".bag"),
            module="bags",
            marks=("metadata.yaml",),
        ),
        "robomimic": Reader(
            summary="demonstrations of robomimic",
            suffixes=(".hdf5", ".h5"),
            module="robomimic",
        ),
        "lerobot": Reader(
            summary="a data set of LeRobot",
            suffixes=(),
            module="lerobot",
            marks=("meta/info.json",),
        ),
        "minari": Reader(
            summary="a data set of gplfd demos record",
            suffixes=(),
            module="minari_episodes",
            marks=("data/metadata.json",),
        ),
        "set": Reader(
            summary="a set of demonstrations",
            suffixes=(),
            module="arrays",
            marks=("demonstrations.npz",),
        ),
    }
)
"""Every kind of file that is read."""


def read_recordings(path: str | Path, selection: Selection) -> list[RawRecording]:
    """Read all recordings in a file or folder.

    No file is trusted: what is damaged or forged is refused, whatever it claims.

    Args:
        path: The file or folder; its name says of what kind it is.
        selection: What to read, and what the file does not say itself.

    Raises:
        FileNotFoundError: There is no such file.
        OSError: It cannot be read.
        ModuleNotFoundError: Its reader needs a library that is not installed.
        ValueError: It is damaged, of no known kind, or has not what was asked for. The
            message names file, line or field, and says what to do.
    """
    path = Path(path)
    if not path.is_dir():
        regular_file(path, "a recording in a regular file")
    reader = _reader(path)
    module = importlib.import_module(f"{__name__}.{reader.module}")
    try:
        recordings: Sequence[RawRecording] = module.read(path, selection)
        if not recordings:
            raise ValueError("it holds no recording")
    except ModuleNotFoundError:
        raise
    # Parsers and libraries answer damaged files with errors of every kind.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {reader.summary}: {reason:.600}"
        ) from error
    return list(recordings)


def _reader(path: Path) -> Reader:
    """Return the reader of a file or folder, by its name or what is in it."""
    suffix = path.suffix.lower()
    for reader in READERS.values():
        if path.is_dir() and any((path / mark).is_file() for mark in reader.marks):
            return reader
        if path.is_file() and suffix in reader.suffixes:
            return reader
    known = [suffix for reader in READERS.values() for suffix in reader.suffixes]
    hint = nearest_name(suffix, known)
    marks = [mark for reader in READERS.values() for mark in reader.marks]
    what = "folder" if path.is_dir() else f"kind of file {suffix!r}"
    raise ValueError(
        f"{path}: unknown {what}{hint}; readable are {', '.join(known)}"
        + (f", and folders with {', '.join(marks)}" if marks else "")
    )
