"""The files of a user's module, and a hash of their content.

A module consists of its own file and of the files in its folder that it imports, and so
on. They are found by reading, not by importing, so that the result does not depend on
earlier imports of the process.
"""

import ast
import contextlib
import hashlib
import traceback
from collections.abc import Collection, Iterator, Sequence
from importlib.util import resolve_name
from pathlib import Path
from typing import Final

_OURS: Final = frozenset({"experiments", "gplfd_env", "policies"})
"""Packages in the working folder of a checkout that do not belong to a user's
module."""

_FIRST_SEEN: Final[dict[Path, str]] = {}
"""Hashes of files when this process first read them: it imports a file only once."""


def module_file(name: str, folder: Path) -> Path | None:
    """Return the source file in a folder for a dotted name, or None."""
    path = folder.joinpath(*name.split("."))
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if file.is_file()), None)


def module_files(name: str, folder: Path) -> tuple[Path, ...]:
    """Return the files of a module in a folder, sorted; none if it is elsewhere."""
    files: dict[str, Path | None] = {}
    waiting = [name]
    while waiting:
        name = waiting.pop()
        package = name.rpartition(".")[0]
        if not name or name in files or name.partition(".")[0] in _OURS:
            continue
        file = files[name] = module_file(name, folder)
        waiting.append(package)
        if file is not None:
            waiting += _imports(file, name if file.stem == "__init__" else package)
    return tuple(sorted({file for file in files.values() if file is not None}))


def content_hash(files: Sequence[Path], folder: Path) -> str:
    """Return the SHA-256 of a file, or of the names and contents of several."""
    hashes = {file: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    for file, sha256 in hashes.items():
        if _FIRST_SEEN.setdefault(file, sha256) != sha256:
            raise ValueError(
                f"{file} has changed since this process imported it; start the "
                "process (of a cluster: its workers) again"
            )
    if len(files) == 1:
        return hashes[files[0]]
    lines = [f"{file.relative_to(folder).as_posix()} {hashes[file]}" for file in files]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def place_in(files: Collection[str], error: BaseException) -> str:
    """Return file, line and function of an error in one of some files, or ""."""
    places = traceback.extract_tb(error.__traceback__)
    for place in reversed(places):
        if place.filename in files:
            return f"{Path(place.filename).name}, line {place.lineno}, in {place.name}"
    return ""


def _imports(file: Path, package: str) -> Iterator[str]:
    """Yield the names that a file may import: ``from a import b`` may import a.b."""
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError):  # the error of the import is clearer
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                with contextlib.suppress(ImportError):  # beyond the topmost package
                    origin = resolve_name("." * node.level + origin, package)
            yield origin
            yield from (f"{origin}.{alias.name}" for alias in node.names)
