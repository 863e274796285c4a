"""Files that are complete or absent, and named arrays in one .npz file."""

from __future__ import annotations

import contextlib
import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


@contextlib.contextmanager
def complete_or_absent(path: str | Path) -> Iterator[Path]:
    """Give a temporary path to write to; it becomes ``path`` when the block succeeds.

    Folders above ``path`` are created. When the block raises, the temporary file is
    removed and whatever stood at ``path`` before stays as it was.

    Raises:
        OSError: The folder or the file cannot be written.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(
        prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes the file private to its owner; a result is for everyone the
        # user's umask allows.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_archive(
    path: str | Path, *, kind: str, version: int, arrays: Mapping[str, Any]
) -> None:
    """Write ``arrays`` compressed and complete, or not at all.

    Args:
        path: File to write; an existing one is replaced.
        kind: What the file holds, checked on reading.
        version: Version of the layout of ``kind``.
        arrays: Numbers, strings and arrays of them by name; no objects.

    Raises:
        OSError: The file cannot be written.
    """
    with complete_or_absent(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream, format=np.array(kind), format_version=np.array(version), **arrays
        )


def read_archive(
    path: str | Path, *, kind: str, version: int
) -> dict[str, NDArray[Any]]:
    """Read what `write_archive` wrote.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is cut, is not an .npz, holds something else, or has
            another version.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with np.load(_checked_zip(path), allow_pickle=False) as archive:
            entries = dict(archive)
    except (zipfile.BadZipFile, zlib.error, EOFError, KeyError, ValueError) as error:
        raise ValueError(
            f"{path} cannot be read as .npz: it is cut off, damaged, or another kind "
            f"of file ({error})"
        ) from error
    found = str(entries.pop("format", "something else"))
    if found != kind:
        raise ValueError(f"{path} does not hold {kind}: it holds {found}")
    found_version = int(entries.pop("format_version", np.array(0)))
    if found_version != version:
        raise ValueError(
            f"{path} has version {found_version} of {kind}; this program reads "
            f"version {version}"
        )
    return entries


def _checked_zip(path: Path) -> Path:
    # NumPy takes other files for pickles and says nothing useful about them.
    if not zipfile.is_zipfile(path):
        raise zipfile.BadZipFile("no directory of entries at its end")
    return path
