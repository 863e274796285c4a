"""What times depend on besides the code: processor, threads, libraries."""

from __future__ import annotations

import importlib.metadata
import platform
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info

from experiments.benchmarks.peers import DISTRIBUTIONS, installed
from experiments.benchmarks.report import NOT_INSTALLED


def machine() -> dict[str, Any]:
    """Processor, thread pools in force and versions of the other libraries."""
    return {
        "processor": _processor(),
        "thread_pools": [
            {key: pool.get(key) for key in ("internal_api", "version", "num_threads")}
            for pool in threadpool_info()
        ],
        "clock": "time.process_time",
        "peers": {
            distribution: (
                importlib.metadata.version(distribution)
                if installed(module)
                else NOT_INSTALLED
            )
            for module, distribution in DISTRIBUTIONS.items()
        },
    }


def _processor() -> str:
    """Name of the processor; Linux hides it from `platform`."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if "model name" in line]
    return names[0] if names else platform.processor()
