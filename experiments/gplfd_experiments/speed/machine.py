"""The machine of a measurement: processor, threads, load, libraries."""

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info, threadpool_limits

from gplfd_experiments.speed.peers import DISTRIBUTIONS, NOT_INSTALLED, installed


def machine() -> dict[str, Any]:
    """Return processor, load, thread pools, and versions of other libraries."""
    with threadpool_limits(1):
        pools = threadpool_info()
    return {
        "processor": processor(),
        "load": load(),
        "thread_pools": [
            {key: pool.get(key) for key in ("internal_api", "version", "num_threads")}
            for pool in pools
        ],
        "peers": {
            distribution: (
                importlib.metadata.version(distribution)
                if installed(module)
                else NOT_INSTALLED
            )
            for module, distribution in DISTRIBUTIONS.items()
        },
    }


def load() -> str:
    """Return the average number of runnable processes in the last minute."""
    try:
        wanted = f"{os.getloadavg()[0]:.1f}"
    except (AttributeError, OSError):  # Windows has no load average.
        wanted = "unknown"
    return f"load {wanted} on {os.cpu_count()} cores"


def processor() -> str:
    """Return the name of the processor, which `platform` lacks on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
    return names[0] if names else platform.processor()
