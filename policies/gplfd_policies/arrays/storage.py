"""Files that are complete or absent, and archives of arrays."""

import contextlib
import json
import os
import secrets
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

RecordT = TypeVar("RecordT")


class Members(dict[str, np.ndarray]):
    """The arrays of an archive by name; a missing one raises a ValueError."""

    def __missing__(self, name: str) -> np.ndarray:
        raise ValueError(f"it lacks {name!r}")


def regular_file(path: str | Path, kind: str = "a file") -> Path:
    """Return a path that is a file."""
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}")
    if not path.is_file():
        raise ValueError(f"{path} is a folder; give {kind}")
    return path


@contextlib.contextmanager
def complete_or_absent(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path to write to; it becomes ``path`` when the block succeeds.

    If the block raises, an existing ``path`` is not changed. The content is written to
    disk before the file is renamed, so that a power loss leaves no incomplete file.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    # A file left by a killed process does not match *.json or *.npz.
    temporary = target.parent / f".{secrets.token_hex(8)}.tmp"
    try:
        temporary.touch(exist_ok=False)
        yield temporary
        with temporary.open("r+b") as written:
            os.fsync(written.fileno())
        temporary.replace(target)
    except OSError as error:
        # The error for a full disk names no file, or the temporary file.
        if error.errno is not None and error.filename in (None, str(temporary)):
            error.filename = str(target)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_archive(
    path: str | Path, *, kind: str, version: int, arrays: Mapping[str, Any]
) -> None:
    """Write named arrays as one compressed .npz file, which is complete or absent."""
    with complete_or_absent(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream, format=np.array(kind), format_version=np.array(version), **arrays
        )


def read_archive(
    path: str | Path, *, kind: str, version: int, build: Callable[[Members], RecordT]
) -> RecordT:
    """Build a record from the arrays of a file in the format of `write_archive`.

    Nothing in it is executed. Every error of ``build`` is reported as one of the file.
    """
    path = regular_file(path, f"a file (.npz) that holds {kind}")
    try:
        if not zipfile.is_zipfile(path):
            raise ValueError("it is no complete .npz archive")
        with (
            path.open("rb") as stream,  # NumPy leaves a damaged file open
            np.load(stream, allow_pickle=False) as archive,
        ):
            members = Members(archive)
        stored = str(members.get("format", "something else"))
        if stored != kind:
            raise ValueError(f"it holds {stored:.80}")
        stored_version = members["format_version"].tolist()
        if stored_version != version:
            raise ValueError(
                f"it has version {stored_version!r:.20}, and this program reads "
                f"version {version}"
            )
        return build(members)
    # On damaged files zipfile, zlib, NumPy and json raise many types of errors.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {kind}: {reason:.300}. Give another file, or "
            "make this one again"
        ) from error


def settings(member: np.ndarray) -> dict[str, Any]:
    """Parse a member that holds a JSON object."""
    parsed = json.loads(str(member))
    if not isinstance(parsed, dict):
        raise ValueError(f"its settings must be a JSON object, got {parsed!r:.40}")
    return parsed
