"""Folders that are complete or absent."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path


def check_replaceable(folder: Path, mark: str, kind: str, *, overwrite: bool) -> None:
    """Raise ValueError unless a folder is absent, or of a kind that may be replaced."""
    if folder.exists() and not (folder / mark).is_file():
        raise ValueError(f"{folder} exists and is no {kind}; give another folder")
    if folder.exists() and not overwrite:
        raise ValueError(
            f"{folder} exists; give another folder, or --overwrite to replace it"
        )


@contextlib.contextmanager
def complete_folder(path: str | Path) -> Iterator[Path]:
    """Yield a folder to write to; it becomes ``path`` if the block succeeds.

    Parent folders of ``path`` are created, and an existing folder is replaced. If the
    block raises, nothing changes. The yielded path has the same name and does not
    exist; the block creates it.
    """
    target = Path(path).absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=target.parent) as temporary:
        root = Path(temporary)
        written = root / target.name
        try:
            yield written
        except OSError as error:
            # The error of a full disk has no path, and the temporary one is not
            # informative.
            file = error.filename
            if error.errno is not None and (file is None or str(root) in str(file)):
                error.filename = str(path)
            raise
        if target.exists():
            target.rename(root / "replaced")
        try:
            written.rename(target)
        except OSError:
            if (root / "replaced").exists():
                (root / "replaced").rename(target)
            raise
