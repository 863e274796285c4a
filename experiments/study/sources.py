"""Where policies come from that are not this project's, and how they reach workers.

A policy of the user's is a file. What is kept of it is its name and the hash of its
content, which is part of a task; the file itself goes with the jobs, for workers on
machines that lack it.
"""

from __future__ import annotations

import functools
import hashlib
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from experiments.study.tasks import PolicySource, Task
from policies.policy import Policy
from policies.registry import policy_named

Files = Mapping[str, bytes]
"""Contents of the files that policies of the user's come from, by the policy's name."""

NO_FILES: Final[Files] = MappingProxyType({})
"""Where every policy is on this machine."""


def chosen(name: str) -> Policy:
    """Return a policy as it was when this process first looked.

    Raises:
        ValueError: There is no such policy, or it cannot be used.
    """
    return _chosen(name, Path.cwd())


_chosen = functools.cache(policy_named)


def source_of(policy: Policy) -> PolicySource | None:
    """Return what names a policy's content, for files; None for a built-in one."""
    origin = policy.origin
    if origin is None or origin.kind == "built-in":
        return None
    said = {
        "kind": origin.kind,
        "distribution": origin.distribution,
        "version": origin.version,
        "file": Path(origin.file).name,
        "sha256": origin.sha256,
    }
    return {name: text for name, text in said.items() if text}


def files_of(study: Iterable[Task]) -> Files:
    """Read the files of the user's that tasks were planned with.

    Raises:
        ValueError: One has changed since.
        OSError: One cannot be read any more.
    """
    files = {}
    for name, source in {task.policy: task.policy_source for task in study}.items():
        if source is None or source["kind"] != "module" or "sha256" not in source:
            continue
        origin = chosen(name).origin
        content = Path(origin.file).read_bytes() if origin is not None else b""
        if hashlib.sha256(content).hexdigest() != source["sha256"]:
            raise ValueError(f"policy {name!r}: its file has just changed; start again")
        files[name] = content
    return files


def policy_of(task: Task, files: Files) -> Policy:
    """Find the policy of a task in this process, which may be another machine's.

    Raises:
        ValueError: It is neither here nor among the files, or it is another one.
    """
    name, source = task.policy, task.policy_source
    problem: object = ""
    try:
        policy = policy_named(name)
        if source_of(policy) == source:
            return policy
        problem = (
            f"policy {name!r} is not the one that the task was planned with: that is "
            f"{dict(source or {})}, here is {source_of(policy)}"
        )
    except ValueError as error:
        problem = error
    if source is None or name not in files:
        raise ValueError(problem)
    try:
        return policy_named(_unpacked(name, source, files[name]))
    except ValueError as error:
        raise ValueError(
            f"{error}. On other machines a policy is a single file; install there what "
            "it imports"
        ) from error


def _unpacked(name: str, source: PolicySource, content: bytes) -> str:
    """Write a policy's file, and return under which name the policy is found there.

    A module by its content: a worker may live longer than a version of the file.
    """
    _, _, attribute = name.rpartition(":")
    module = f"{Path(source['file']).stem}_{source['sha256'][:12]}"
    file = Path(_folder().name) / f"{module}.py"
    file.write_bytes(content)
    return f"{file}:{attribute}"


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Folder of unpacked files, which goes with this process."""
    return tempfile.TemporaryDirectory(prefix="gplfd-")
