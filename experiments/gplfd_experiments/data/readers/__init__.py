"""Readers of motion files, which run in a child process.

The module of a kind of file has ``read(path, settings)``, which returns its motions or
raises any exception. A damaged or forged file can crash the child alone.
"""

import importlib
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import ImportSettings
from gplfd_policies.arrays.storage import regular_file

try:
    import resource
except ImportError:  # Windows, where only the time is limited.
    resource = None  # type: ignore[assignment]

__all__ = ["ImportSettings", "read_files"]

_LIMITS: Final = ((700 * 2**20, 8.0), (2**26, 20.0), (10**6, 1.0), (6.0, 5e-6))
"""Memory of the child [bytes], written bytes, for example of a decompressed bag,
samples, and processor time [s]: for any file, and in addition per byte of a file."""
_WAITING: Final = 3.0
"""Longest time for a file, as a multiple of its processor time."""
_CHILD: Final = "from gplfd_experiments.data.readers import child; child()"


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
    Reader("a recording of Xsens MVN", "skeletons", (".mvnx",)),
    Reader("a Biovision hierarchy", "skeletons", (".bvh",)),
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
    **dict.fromkeys(("skeletons", "c3d"), ("body",)),
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


def read_files(
    paths: Sequence[str | Path], settings: ImportSettings
) -> Iterator[list[RawRecording]]:
    """Yield all motions in each file or folder, whose name determines its kind.

    Raises:
        OSError: There is no such file, or it cannot be read.
        ModuleNotFoundError: Its reader needs a library that is not installed.
        ValueError: It is damaged, of unknown kind, too large, or lacks the selected
            item. The message names file, line or field, and says what to do.
    """
    files = [Path(path) for path in paths]
    readers = [reader_of(path) for path in files]
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL")}
    modules = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    with (
        tempfile.TemporaryDirectory() as scratch,
        subprocess.Popen(
            [sys.executable, "-c", _CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **threads, "PYTHONPATH": modules, "TMPDIR": scratch},
        ) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            pickle.dump((files, settings), process.stdin)
            process.stdin.close()
            for path, reader in zip(files, readers, strict=True):
                *_, seconds = _limits(path)
                timer = threading.Timer(_WAITING * seconds, process.kill)
                timer.start()
                try:
                    outcome = pickle.load(process.stdout)
                except (EOFError, pickle.UnpicklingError):
                    # A killed child leaves nothing, or a part.
                    raise ValueError(
                        f"{path} cannot be read as {reader.summary}: its reader crashed"
                        f" or ran for more than {seconds:.0f} s (exit status "
                        f"{process.wait()}). It is damaged, or made to fill memory or "
                        "time"
                    ) from None
                finally:
                    timer.cancel()
                if isinstance(outcome, Exception):
                    raise outcome
                yield outcome
        finally:
            process.kill()


def _limits(path: Path) -> list[float]:
    """Return memory [bytes], written bytes, samples and processor time [s]."""
    files = path.rglob("*") if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    return [least + per_byte * size for least, per_byte in _LIMITS]


def child() -> None:
    """Read the files that the parent names, and answer with motions or an error."""
    # Libraries may print.
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)
        paths, settings = pickle.load(sys.stdin.buffer)
        for path in paths:
            memory, written, most, seconds = _limits(path)
            if resource is not None:
                used = resource.getrusage(resource.RUSAGE_SELF)
                for kind, limit in (
                    (resource.RLIMIT_DATA, memory),
                    (resource.RLIMIT_FSIZE, written),
                    (resource.RLIMIT_CPU, used.ru_utime + used.ru_stime + seconds + 1),
                ):
                    hardest = resource.getrlimit(kind)[1]
                    resource.setrlimit(kind, (int(limit), hardest))
            outcome: list[RawRecording] | Exception
            try:
                outcome = read_here(path, settings)
                if sum(len(motion.positions) for motion in outcome) > most:
                    raise ValueError(f"{path} makes more than {most:,.0f} samples")
            except (OSError, ValueError, ModuleNotFoundError) as error:
                # Only these have arguments that can be passed on.
                outcome = type(error)(*error.args)
                if isinstance(error.__cause__, MemoryError):
                    outcome = ValueError(
                        f"{path} needs more than {memory / 2**20:,.0f} MB of memory. "
                        "It is damaged, or made to fill the memory"
                    )
            pickle.dump(outcome, answers)
            answers.flush()
