"""Provenance of a result: versions, source state, machine, command, settings."""

import contextlib
import functools
import hashlib
import importlib.metadata
import math
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from threadpoolctl import threadpool_info

PACKAGES: Final = ("gplfd", "mujoco", "gymnasium", "numpy", "scipy", "rerun-sdk")
"""Distributions whose versions can change a result or a recording."""

_GIT_TIMEOUT: Final = 5.0


def provenance(config: Mapping[str, Any]) -> dict[str, Any]:
    """Collect the data that is needed to repeat a run with some settings."""
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "config": dict(config),
        **code_state(),
        "platform": {
            "system": platform.platform(),
            "python": platform.python_version(),
            "machine": platform.machine(),
            "cpus": os.cpu_count(),
        },
    }


def content_hash(path: Path) -> str:
    """Return the SHA-256 of a file's content, which identifies it."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@functools.cache
def code_state() -> Mapping[str, Any]:
    """Code of this process, when first asked: ``versions``, ``git``, ``arithmetic``."""
    return {
        "versions": dict(versions()),
        "git": git_state(Path(__file__).resolve().parents[3]),
        "arithmetic": dict(arithmetic()),
    }


@functools.cache
def versions() -> Mapping[str, str]:
    """Installed versions of `PACKAGES` by name; "unknown" when not installed."""
    installed = dict.fromkeys(PACKAGES, "unknown")
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            installed[name] = importlib.metadata.version(name)
    return installed


@functools.cache
def arithmetic() -> Mapping[str, str]:
    """Properties of this machine that determine the last bits of a result, by name.

    Libraries round differently by processor; see docs/reference.md.
    """
    # Libraries are visible after they are loaded, and SciPy has its own.
    importlib.import_module("scipy.linalg")
    kernels = {
        f"{pool['internal_api']} {pool['version']} {pool.get('architecture', '')}"
        for pool in threadpool_info()
        if pool["user_api"] == "blas"
    }
    numbers = np.linspace(-3.0, 3.0, 1001)
    alone = [(math.sin(x), math.cos(x), math.exp(x), math.atan(x)) for x in numbers]
    together = [np.sin(numbers), np.cos(numbers), np.exp(numbers), np.arctan(numbers)]
    values = np.concatenate([np.ravel(alone), np.ravel(together)])
    return {
        "system": platform.system(),
        "machine": platform.machine(),
        "C library": " ".join(platform.libc_ver()).strip(),
        "functions": hashlib.sha256(values.tobytes()).hexdigest()[:16],
        "linear algebra": ", ".join(sorted(kernels)),
    }


def git_state(folder: Path) -> dict[str, Any] | None:
    """Return ``commit`` and ``dirty`` of a checkout's root; None without one or git."""
    if not (folder / ".git").exists():
        return None
    words = ("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    try:
        described = subprocess.run(
            ["git", "-C", str(folder), *words],
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT,
            check=True,
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
    commit = described.removesuffix("-dirty")
    return {"commit": commit, "dirty": commit != described}
