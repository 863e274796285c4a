"""Readers of motion files, which run in a child process that a forged file may crash.

Each, ``(path, settings)``, returns motions or raises any exception.
"""

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import arrays, bags, motion_capture, tables
from gplfd_experiments.data.settings import ImportSettings
from gplfd_policies.arrays.storage import regular_file

try:
    import resource
except ImportError:  # Windows, where only the time is limited.
    resource = None  # type: ignore[assignment]

_LIMITS: Final = ((700 * 2**20, 8.0), (2**26, 20.0), (10**6, 1.0), (5.0, 5e-6))
"""Memory of the child [bytes], written bytes, for example of a decompressed bag,
samples, and processor time [s]: for any file, and in addition per byte of a file."""
_WAITING: Final = 2.5  # Longest time for a file, as a multiple of its processor time.
_THREADS: Final = ("OPENBLAS", "OMP", "MKL")  # Libraries that would start some.


class Reader(NamedTuple):
    """How one kind of file is read."""

    summary: str  # Name in a message.
    read: Callable[[Path, ImportSettings], list[RawRecording]]
    suffixes: tuple[str, ...] = ()  # Suffixes of such files; none for folders.
    marks: tuple[str, ...] = ()  # A folder of this kind contains one of these.


READERS: Final = (
    Reader("a table in a text file", tables.read, (".csv", ".tsv", ".txt", ".log")),
    Reader("arrays of NumPy", arrays.read, (".npz", ".npy")),
    Reader("a MATLAB file", arrays.read, (".mat",)),
    Reader("a recording of Xsens MVN", motion_capture.mvnx, (".mvnx",)),
    Reader("a Biovision hierarchy", motion_capture.bvh, (".bvh",)),
    Reader("a C3D file", motion_capture.c3d, (".c3d",)),
    Reader("a bag of ROS", bags.read, (".mcap", ".db3", ".bag"), ("metadata.yaml",)),
    Reader("demonstrations of robomimic", arrays.robomimic, (".hdf5", ".h5")),
    Reader("a data set of LeRobot", arrays.lerobot, marks=("meta/info.json",)),
    Reader("a data set of Minari", arrays.own_set, marks=("data/metadata.json",)),
    Reader("a set of demonstrations", arrays.own_set, marks=("demonstrations.npz",)),
)
"""Every kind of file that is read."""
_OPTIONS: Final[Mapping[Any, tuple[str, ...]]] = {
    tables.read: ("body", "columns", "time_unit", "angles", "quaternions"),
    arrays.read: ("body", "columns", "time_unit", "angles", "quaternions"),
    motion_capture.mvnx: ("body",),
    motion_capture.bvh: ("body",),
    motion_capture.c3d: ("body",),
    bags.read: ("body", "urdf", "link", "wrench"),
    arrays.robomimic: ("body", "angles", "wrench"),
    arrays.lerobot: ("body", "columns", "angles", "quaternions", "wrench"),
}
"""Settings that have an effect on some kinds of files only, by their reader."""


def reader_of(path: Path) -> Reader:
    """Return the reader of a file or folder, by its suffix or by what it contains."""
    suffix = "" if path.is_dir() else regular_file(path, "a recording").suffix.lower()
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
    try:
        recordings = reader.read(path, settings)
        if not recordings:
            raise ValueError("it holds no recording")
    except ModuleNotFoundError:
        raise
    # Libraries raise errors of every kind for damaged files.
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {reader.summary}: {reason:.600}"
        ) from error
    used = _OPTIONS.get(reader.read, ())
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

    Raises OSError for files that cannot be read, ModuleNotFoundError for libraries, and
    ValueError for damage, unknown kinds and missing items, naming file, line or field.
    """
    from joblib.externals.loky import ProcessPoolExecutor

    files = [Path(path) for path in paths]
    readers = [reader_of(path) for path in files]
    settings_of_child = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
    with tempfile.TemporaryDirectory() as scratch:
        settings_of_child["TMPDIR"] = scratch
        child = ProcessPoolExecutor(1, env=settings_of_child, initializer=_silent)
        try:
            child.submit(os.getpid).result()  # It has imported its libraries.
            for path, reader in zip(files, readers, strict=True):
                inside = path.rglob("*") if path.is_dir() else [path]
                size = sum(file.stat().st_size for file in inside if file.is_file())
                *_, seconds = limits = [least + by * size for least, by in _LIMITS]
                try:
                    reading = child.submit(_limited, path, settings, limits)
                    outcome = reading.result(_WAITING * seconds)
                except (TimeoutError, BrokenExecutor):
                    raise ValueError(
                        f"{path} cannot be read as {reader.summary}: its reader crashed"
                        f" or ran for more than {seconds:.0f} s. It is damaged, or made"
                        " to fill memory or time"
                    ) from None
                if isinstance(outcome, Exception):
                    raise outcome
                yield outcome
        finally:
            child.shutdown(kill_workers=True)


def _silent() -> None:
    """Let no library print in this process."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def _limited(
    path: Path, settings: ImportSettings, limits: list[float]
) -> list[RawRecording] | Exception:
    """Read the motions in a file, in a process of which nothing else is wanted."""
    memory, written, most, seconds = limits
    if resource is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        for kind, limit in (
            (resource.RLIMIT_DATA, memory),
            (resource.RLIMIT_FSIZE, written),
            (resource.RLIMIT_CPU, used.ru_utime + used.ru_stime + seconds + 1),
        ):
            resource.setrlimit(kind, (int(limit), resource.getrlimit(kind)[1]))
    try:
        motions = read_here(path, settings)
        if sum(len(motion.positions) for motion in motions) > most:
            raise ValueError(f"{path} makes more than {most:,.0f} samples")
    except (OSError, ValueError, ModuleNotFoundError) as error:
        exhausted = "memory allocation failed" in str(error)  # As HDF5 says.
        if exhausted or isinstance(error.__cause__, MemoryError):
            return ValueError(
                f"{path} needs more than {memory / 2**20:,.0f} MB of memory. It is "
                "damaged, or made to fill the memory"
            )
        # Only these have arguments that can be passed on.
        return type(error)(*error.args)
    return motions
