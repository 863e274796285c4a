"""Files that are complete or absent, and archives of arrays from untrusted files."""

import contextlib
import io
import json
import math
import os
import secrets
import stat
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

_LARGEST_EXPANSION: Final = 20
"""Greatest ratio of decoded size to file size; logs reach 2.1."""
_ALLOWANCE: Final = 2**26
"""Bytes that every file may decode to: constant arrays compress a thousandfold."""

_COMPRESSIONS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_FILE_TYPES: Final = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)

RecordT = TypeVar("RecordT")


class DecodingBudget:
    """Bytes of memory that may still be used to decode one file.

    A compressed file of some kilobytes can hold gigabytes. Therefore every reader
    claims the size of an array, converted to float64, before it allocates the array.
    """

    def __init__(self, size: int, *, least: int = _ALLOWANCE) -> None:
        self._size = size
        self._limit = max(_LARGEST_EXPANSION * size, least)
        self.left = self._limit
        """Bytes that may still be claimed."""

    def claim(self, amount: int, what: str) -> None:
        """Claim bytes for ``what`` before its allocation, or raise."""
        if not 0 <= amount <= self.left:
            raise ValueError(
                f"it unpacks to more than its size allows: with {what} of {amount:,} "
                f"bytes it would take more than {self._limit:,} bytes of memory, and "
                f"the file has {self._size:,}. It is damaged, or made to fill the "
                "memory"
            )
        self.left -= amount


class Members:
    """The members of an archive: a call with a name returns this member, once."""

    def __init__(self, archive: zipfile.ZipFile, budget: DecodingBudget) -> None:
        self._archive = archive
        self._budget = budget
        infos = archive.infolist()
        self._infos = {info.filename.removesuffix(".npy"): info for info in infos}
        if len(self._infos) < len(infos):
            raise ValueError("it holds two members of one name")

    def __call__(self, name: str) -> np.ndarray:
        """Return a member that was not yet returned, or raise."""
        if name not in self._infos:
            raise ValueError(f"it lacks {name!r}")
        info = self._infos.pop(name)
        if info.flag_bits & 1 or info.compress_type not in _COMPRESSIONS:
            raise ValueError(f"{name!r} is encrypted, or compressed in an unusual way")
        self._budget.claim(info.file_size, f"{name!r:.40}")
        with self._archive.open(info) as stream:
            # With a given size it does not unpack more, even if there are more bytes.
            array = array_of(stream.read(info.file_size), name)
        if array.dtype.kind in "biuf":
            # Computation converts it to float64.
            self._budget.claim(max(0, 8 * array.size - array.nbytes), f"{name!r:.40}")
        return array

    def __contains__(self, name: str) -> bool:
        return name in self._infos

    @property
    def left(self) -> list[str]:
        """Names of the members that were not yet returned."""
        return list(self._infos)


def regular_file(path: str | Path, kind: str = "a file") -> Path:
    """Return a path that can be opened for reading without waiting for a writer."""
    path = Path(path)
    if path.is_file():
        return path
    if not path.exists():
        raise FileNotFoundError(f"there is no file {path}")
    mode = path.stat().st_mode
    found = next((name for is_type, name in _FILE_TYPES if is_type(mode)), "no file")
    raise ValueError(f"{path} is {found}; give {kind}")


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
    """Build a record from an untrusted file in the format of `write_archive`.

    Nothing in it is executed, only members that ``build`` requests are unpacked, and
    the size of an array must match its bytes. Every error of ``build`` is reported as
    an error of the file.
    """
    path = regular_file(path, f"a file (.npz) that holds {kind}")
    content = path.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = Members(archive, DecodingBudget(len(content)))
            found = str(members("format")) if "format" in members else "something else"
            if found != kind:
                raise ValueError(f"it holds {found:.80}")
            found_version = members("format_version").tolist()
            if found_version != version:
                raise ValueError(
                    f"it has version {found_version!r:.20}, and this program reads "
                    f"version {version}"
                )
            record = build(members)
            for name in members.left:
                raise ValueError(f"it holds {name!r:.80}, which does not belong there")
    # On damaged files zipfile, zlib, NumPy and json raise many types of errors.
    except Exception as error:
        reason = str(error) or type(error).__name__
        raise ValueError(
            f"{path} cannot be read as {kind}: {reason:.300}. Give another file, or "
            "make this one again"
        ) from error
    return record


def array_of(content: bytes, name: str) -> np.ndarray:
    """Return the array of a .npy file, of numbers or text, read-only."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError(f"{name!r} is not an array of version 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    if dtype.kind not in "biufU" or dtype.itemsize == 0:
        raise _NotPlainError(f"{name!r} holds {dtype!s:.40}, not numbers or text")
    start = stream.tell()
    if math.prod(shape) * dtype.itemsize != len(content) - start:
        raise ValueError(f"{name!r} is not as large as its header says")
    if dtype.kind == "U":
        # NumPy would create a str with invalid code points.
        content[start:].decode("utf-32-be" if dtype.str[0] == ">" else "utf-32-le")
    order: Final = "F" if fortran else "C"
    return np.ndarray(shape, dtype, buffer=content, offset=start, order=order)


def settings(member: np.ndarray) -> dict[str, Any]:
    """Parse a member that holds a JSON object."""
    found = json.loads(str(member))
    if not isinstance(found, dict):
        raise ValueError(f"its settings must be a JSON object, got {found!r:.40}")
    return found


class _NotPlainError(ValueError):
    """An array holds neither numbers nor text."""
