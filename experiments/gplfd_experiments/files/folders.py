"""Folders that are complete or absent, and folders of one process at a time."""

import contextlib
import hashlib
import re
import sqlite3
import tempfile
from collections.abc import Iterator
from pathlib import Path


def check_replaceable(folder: Path, mark: str, kind: str, *, overwrite: bool) -> None:
    """Raise ValueError unless a folder is absent, or of a kind that may be replaced."""
    if folder.exists() and not (folder / mark).is_file():
        raise ValueError(f"{folder} exists and is no {kind}; give another folder")
    if folder.exists() and not overwrite:
        raise ValueError(f"{folder} exists; give another folder, or --overwrite")


@contextlib.contextmanager
def complete_folder(path: str | Path, *, replace: bool = True) -> Iterator[Path]:
    """Yield a folder to write to; it becomes ``path`` if the block succeeds.

    Parent folders of ``path`` are created, and a folder that exists now is replaced or
    refused. If the block raises, nothing changes. The yielded path has the same name
    and does not exist; the block creates it.
    """
    target = Path(path).absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    replaced = replace and target.exists()
    with tempfile.TemporaryDirectory(prefix=".", dir=target.parent) as temporary:
        root = Path(temporary)
        written = root / target.name
        try:
            yield written
        except OSError as error:
            # A full disk names no path, or the temporary one, which says nothing.
            file = error.filename
            if error.errno is not None and (file is None or str(root) in str(file)):
                error.filename = str(path)
            raise
        if target.exists() and not replaced:
            raise ValueError(f"{path} was made meanwhile; give another folder")
        if replaced:
            target.rename(root / "replaced")
        try:
            written.rename(target)
        except OSError:
            if (root / "replaced").exists():
                (root / "replaced").rename(target)
            raise


@contextlib.contextmanager
def folder_in_use(folder: Path) -> Iterator[Path]:
    """Create a folder, refuse it to other processes, and yield its absolute path.

    The system releases it when the process ends. One made here that stays empty goes.
    """
    path = folder.absolute()
    if path.exists() and not path.is_dir():
        raise ValueError(f"--out {folder} is a file; give a folder")
    made = [part for part in (path, *path.parents) if not part.exists()]
    path.mkdir(parents=True, exist_ok=True)
    # SQLite locks files on every system.
    mark = path / ".in-use"
    lock = sqlite3.connect(mark, timeout=0.0)
    try:
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError as error:
        lock.close()
        raise ValueError(
            f"{folder} is in use by another command, or cannot be written to; wait "
            "for the other's end, or give another --out"
        ) from error
    try:
        yield path
    finally:
        with contextlib.suppress(OSError):  # One is not empty.
            mark.unlink()  # Before the release: afterwards it may be another's.
            lock.close()
            for part in made:
                part.rmdir()
        lock.close()


def file_name(text: str) -> str:
    """Return a file's name, different for every text; letters, digits, _, - stay."""
    safe = re.sub(r"[^\w-]+", "_", text, flags=re.ASCII)[:60]
    if safe == text:
        return text
    # Different texts may otherwise become equal.
    return f"{safe}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
