"""Policies from outside this project: identification and transfer to workers.

A task has the name and hash of a user's file and of what it imports from its folder.
The file is sent with the jobs, for machines that lack it.
"""

import functools
import hashlib
import os
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gplfd_experiments.episodes.task import PolicySource, Task
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import Policy

Files = Mapping[str, bytes]
"""Contents of users' files, when the study was planned, by the name of their policy."""

NO_FILES: Final[Files] = MappingProxyType({})
"""Location of every policy on this machine."""


def chosen(name: str) -> Policy:
    """Return a policy as first loaded by this process."""
    return _chosen(name, Path.cwd())


@functools.cache
def _chosen(name: str, folder: Path) -> Policy:
    """Load a policy; what its module changes in this process is undone."""
    path = sys.path[:]
    handlers = {number: signal.getsignal(number) for number in signal.valid_signals()}
    try:
        with np.errstate(), warnings.catch_warnings():
            return policy_named(name, folder)
    finally:
        sys.path[:] = path
        os.chdir(folder)
        for number, handler in handlers.items():
            if handler != signal.getsignal(number):
                signal.signal(number, handler)


def policy_fields(name: str) -> dict[str, Any]:
    """Return the fields of a task that identify a policy and its content."""
    return {"policy": name, "policy_source": source_of(chosen(name))}


def source_of(policy: Policy) -> PolicySource | None:
    """Return the identification of a policy's content; None for a built-in policy."""
    origin = policy.origin
    if origin is None or origin.kind == "built-in":
        return None
    names = ("kind", "distribution", "version", "file", "sha256")
    source = {name: getattr(origin, name) for name in names}
    source["file"] = Path(origin.file).name
    return {name: text for name, text in source.items() if text}


def files_of(study: Iterable[Task]) -> Files:
    """Read the users' files that tasks were planned with."""
    files = {}
    for name, source in {task.policy: task.policy_source for task in study}.items():
        if source is None or source["kind"] != "module" or "sha256" not in source:
            continue
        origin = chosen(name).origin
        files[name] = Path(origin.file).read_bytes() if origin is not None else b""
        policy_named(name)  # raises if the file has changed since it was imported
    return files


def policy_of(task: Task, files: Files) -> Policy:
    """Return the policy of a task in this process, possibly on another machine."""
    try:
        policy = policy_named(task.policy)
        if (here := source_of(policy)) != task.policy_source:
            raise ValueError(
                f"policy {task.policy!r} is not the one that the task was planned "
                f"with: that was {task.policy_source}, here is {here}"
            )
        return policy
    except ValueError:
        if task.policy not in files:
            raise
        # Named by its content, because a worker may outlive a version of the file.
        planned, content = task.policy_source or {}, files[task.policy]
        digest = hashlib.sha256(content).hexdigest()
        stem = Path(planned["file"]).stem
        path = Path(_folder().name) / f"{stem}_{digest[:12]}.py"
        with complete_or_absent(path) as temporary:
            temporary.write_bytes(content)
        try:
            policy = policy_named(f"{path}:{task.policy.rpartition(':')[2]}")
        except ValueError as error:
            raise ValueError(
                f"{error}. On other machines a policy is a single file; install there "
                "what it imports"
            ) from error
        if (source_of(policy) or {}).get("sha256") != planned.get("sha256"):
            raise  # It imports other files, which differ on this machine.
        return policy


@functools.cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Return the folder of imported files; it is deleted when this process ends."""
    return tempfile.TemporaryDirectory(prefix="gplfd-")
