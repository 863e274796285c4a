"""The kinds of motion files, one line each: suffixes or marks, and their reader.

The module of a reader has a function ``read(path, settings)`` that returns the motions
in the order of the file. Any exception means that the file cannot be read.
"""

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import ImportSettings
from gplfd_policies.arrays.storage import regular_file


class Reader(NamedTuple):
    """How one kind of file is read."""

    summary: str
    """Name in a message."""
    module: str
    """Module of this package; imported when needed, for its libraries."""
    suffixes: tuple[str, ...] = ()
    """Suffixes of such files; none for folders."""
    marks: tuple[str, ...] = ()
    """A folder of this kind contains one of these."""


READERS: Final = (
    Reader("a table in a text file", "csv_tables", (".csv", ".tsv", ".txt", ".log")),
    Reader("arrays of NumPy", "arrays", (".npz", ".npy")),
    Reader("a MATLAB file", "arrays", (".mat",)),
    Reader("a recording of Xsens MVN", "mvnx", (".mvnx",)),
    Reader("a Biovision hierarchy", "bvh", (".bvh",)),
    Reader("a C3D file", "c3d", (".c3d",)),
    Reader("a bag of ROS", "bags", (".mcap", ".db3", ".bag"), ("metadata.yaml",)),
    Reader("demonstrations of robomimic", "robomimic", (".hdf5", ".h5")),
    Reader("a data set of LeRobot", "lerobot", marks=("meta/info.json",)),
    Reader("a data set of Minari", "own_sets", marks=("data/metadata.json",)),
    Reader("a set of demonstrations", "own_sets", marks=("demonstrations.npz",)),
)
"""Every kind of file that is read."""
_TABLE: Final = ("body", "columns", "time_unit", "angles", "quaternions")
_OPTIONS: Final = {
    **dict.fromkeys(("csv_tables", "arrays"), _TABLE),
    **dict.fromkeys(("mvnx", "bvh", "c3d"), ("body",)),
    "bags": ("body", "urdf", "link", "wrench"),
    "robomimic": ("body", "angles", "wrench"),
    "lerobot": ("body", "columns", "angles", "quaternions", "wrench"),
}
"""Settings that have an effect on some kinds of files only, by the reader's module."""


def reader_of(path: Path) -> Reader:
    """Return the reader of a file or folder, by its suffix or by what it contains."""
    folder = path.is_dir()
    suffix = "" if folder else regular_file(path, "a recording").suffix.lower()
    for reader in READERS:
        if suffix in reader.suffixes or any((path / m).is_file() for m in reader.marks):
            return reader
    suffixes = [suffix for reader in READERS for suffix in reader.suffixes]
    marks = [mark for reader in READERS for mark in reader.marks]
    raise ValueError(
        f"{path}: unknown kind {suffix!r}{nearest_name(suffix, suffixes)}; readable "
        f"are {', '.join(suffixes)}, and folders with {', '.join(marks)}"
    )


def read_here(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read all motions in a file, in this process and without limits."""
    reader = reader_of(path)
    module = importlib.import_module(f"gplfd_experiments.data.readers.{reader.module}")
    try:
        recordings: list[RawRecording] = module.read(path, settings)
        if not recordings:
            raise ValueError("it holds no recording")
    # Libraries raise errors of every kind for damaged files.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {reader.summary}: {reason:.600}"
        ) from error
    used = _OPTIONS.get(reader.module, ())
    notes = [
        f"--{name.replace('_', '-')} has no effect on {reader.summary} such as this"
        for name in sorted({name for names in _OPTIONS.values() for name in names})
        if getattr(settings, name) and name not in used
    ]
    notes = [*recordings[0].notes, *notes]
    recordings[0] = replace(recordings[0], notes=tuple(notes))
    return recordings
