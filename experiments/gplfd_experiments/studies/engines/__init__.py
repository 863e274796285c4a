"""Where the jobs of a study run: in this process, on its cores, or on a cluster."""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, Protocol, TypeVar

from gplfd_experiments.console.interruption import (
    os_exit_raises,
    postponed_interruption,
)

__all__ = [
    "ATTEMPTS",
    "ONE_THREAD",
    "Engine",
    "EngineName",
    "Lost",
    "Serial",
    "engine_named",
]

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

EngineName = Literal["loky", "serial", "dask"]
"""Names that `engine_named` knows."""

ATTEMPTS: Final = 3
"""Number of attempts before an item counts as the cause of its workers' death."""

ONE_THREAD: Final[Mapping[str, str]] = MappingProxyType(
    {
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "VECLIB_MAXIMUM_THREADS": "1",
    }
)
"""Environment of a process whose linear algebra uses one thread."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Lost:
    """Result of an engine for an item that no worker finished."""

    reason: str
    """Reason, in a sentence."""
    crashed: bool = False
    """Whether the item ended its own worker, by leaving Python or by a crash, each time
    it ran alone; otherwise the machine may have ended it."""


class Engine(Protocol):
    """Runs the same work on many items."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, None]:
        """Yield each item with its result, in the order in which they finish.

        Closing the generator ends running items.

        Args:
            work: Called once per item, possibly in another process; never raises.
            items: Small records.
        """
        ...


@dataclass(frozen=True, slots=True)
class Serial:
    """Runs items in this process, in order; for debugging."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT], None, None]:
        """See `Engine.run`."""
        for item in items:
            with os_exit_raises():
                result = work(item)
            yield item, result


def engine_named(
    name: EngineName, *, workers: int | None = None, address: str | None = None
) -> Engine:
    """Return an engine: loky with a number of processes, Dask with an address.

    Raises:
        ValueError: An option does not fit the engine, a required one is missing, or
            Dask is not installed.
        OSError: The scheduler does not answer.
    """
    if workers is not None and name != "loky":
        raise ValueError(
            f"--workers {workers} is for --engine loky; --engine {name} has its own "
            "workers" + (" or none" if name == "serial" else "")
        )
    if workers is not None and workers < 1:
        raise ValueError(f"--workers {workers} must be 1 or more")
    if address is not None and name != "dask":
        raise ValueError(f"--address {address} is for --engine dask, not for {name}")
    # Engines are imported when used: Dask is optional, and `gplfd --help` stays fast.
    if name == "serial":
        return Serial()
    if name == "loky":
        with postponed_interruption():
            from gplfd_experiments.studies.engines.processes import Processes

        return Processes(workers=workers)
    if address is None:
        raise ValueError(
            "--engine dask needs the scheduler of a running cluster: --address "
            "tcp://HOST:8786 (`dask scheduler` prints it)"
        )
    try:
        with postponed_interruption():
            from gplfd_experiments.studies.engines.cluster import Cluster
    except ImportError as error:
        raise ValueError(
            f"--engine dask needs Dask ({error}); pip install 'gplfd[dask]'"
        ) from error
    cluster = Cluster(address=address)
    cluster.check()
    return cluster
