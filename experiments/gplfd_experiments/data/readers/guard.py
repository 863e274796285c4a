"""Reads motion files in a child process with limits.

A damaged or forged file can make a library crash, or fill memory, disk or time. It then
ends the child alone. Systems without `resource` limit the time only.
"""

import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.formats import read_here, reader_of
from gplfd_experiments.data.settings import ImportSettings

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

_LIMITS: Final = ((700 * 2**20, 8.0), (2**26, 20.0), (10**6, 1.0), (6.0, 5e-6))
"""Memory of the child [bytes], written bytes, for example of a decompressed bag,
samples, and processor time [s]: for any file, and in addition per byte of a file."""
_WAITING: Final = 3.0
"""Longest time for a file, as a multiple of its processor time."""
_CHILD: Final = "from gplfd_experiments.data.readers.guard import child; child()"


def read_recordings(path: str | Path, settings: ImportSettings) -> list[RawRecording]:
    """Read all motions in a file or folder, whose name determines its kind.

    Raises:
        OSError: There is no such file, or it cannot be read.
        ModuleNotFoundError: Its reader needs a library that is not installed.
        ValueError: It is damaged, of unknown kind, too large, or lacks the selected
            item. The message names file, line or field, and says what to do.
    """
    (recordings,) = read_files([path], settings)
    return recordings


def read_files(
    paths: Sequence[str | Path], settings: ImportSettings
) -> Iterator[list[RawRecording]]:
    """Yield the motions of each file in turn; raises what `read_recordings` raises."""
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
