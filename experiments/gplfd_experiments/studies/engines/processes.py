"""The engine for one machine: loky's worker processes."""

import contextlib
import os
import re
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, TypeAlias

import loky

from gplfd_experiments.console.interruption import postponed_interruption
from gplfd_experiments.studies.engines import ATTEMPTS, ONE_THREAD, ItemT, Lost, ResultT

Caught: TypeAlias = list[tuple[str, type[Warning]]]
"""Texts and categories of warnings."""

# One thread per worker, because each core has a worker; and no worker imports a file
# such as `re.py` from the working folder.
_ENVIRONMENT: Final = {**ONE_THREAD, "PYTHONSAFEPATH": "1"}
_CRASHES: Final = (signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE, signal.SIGILL)
"""Signals of a process that ends itself; other signals come from the machine."""
_PULSE: Final = 1.0
"""Interval at which a worker checks that its parent still runs [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Processes:
    """Runs items in worker processes of this machine.

    A worker that dies breaks the pool. The running items are then run again, one at a
    time, so that only the item that kills its worker is lost. The exit code of the
    worker shows whether the item or the machine caused it.
    """

    workers: int | None = None
    """Number of processes; None for one per core."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, None]:
        """See `gplfd_experiments.studies.engines.Engine.run`."""
        waiting = deque(items)
        workers = self.workers or loky.cpu_count()
        watched = partial(_with_warnings, work)
        while waiting:
            suspects = yield from _together(watched, waiting, workers)
            for item in suspects:
                yield item, _alone(watched, item)


def _with_warnings(
    work: Callable[[ItemT], ResultT], item: ItemT
) -> tuple[ResultT, Caught]:
    """Return a result and the warnings of its computation.

    A worker shares the terminal with the parent's progress bar and cannot print them.
    Each category is replaced by the built-in one that it derives from, because only
    these are known in every process.
    """
    with warnings.catch_warnings(record=True) as caught:
        result = work(item)
    kept: Caught = []
    for one in caught:
        kinds = (kind for kind in one.category.__mro__ if kind.__module__ == "builtins")
        kept.append((str(one.message), next(kinds)))
    return result, kept


def _warned(outcome: tuple[ResultT, Caught]) -> ResultT:
    """Repeat a worker's warnings in this process and return its result."""
    result, caught = outcome
    for text, category in caught:
        # With one place for all, a text is shown once for any number of tasks.
        warnings.warn(text, category, stacklevel=1)
    return result


def _together(
    work: Callable[[ItemT], tuple[ResultT, Caught]], waiting: deque[ItemT], workers: int
) -> Generator[tuple[ItemT, ResultT], None, list[ItemT]]:
    """Run items until none waits or a worker dies; return those without a result."""
    running: dict[Any, ItemT] = {}
    with _pool(min(workers, len(waiting))) as pool:
        try:
            while waiting or running:
                # Only as many items as workers, because all of them are suspects if a
                # worker dies.
                while waiting and len(running) < workers:
                    # Workers start here with Ctrl-C blocked.
                    with postponed_interruption():
                        running[pool.submit(work, waiting[0])] = waiting[0]
                    waiting.popleft()
                done, _ = loky.wait(running, return_when=loky.FIRST_COMPLETED)
                # Results before the failure of the pool are kept.
                for future in sorted(
                    done,
                    key=lambda one: isinstance(one.exception(), loky.BrokenProcessPool),
                ):
                    yield running[future], _warned(future.result())
                    del running[future]
        except loky.BrokenProcessPool:
            return list(running.values())
    return []


def _alone(
    work: Callable[[ItemT], tuple[ResultT, Caught]], item: ItemT
) -> ResultT | Lost:
    """Repeat an item that was running when a worker died."""
    crashed, ends = True, dict[str, None]()
    for _ in range(ATTEMPTS - 1):
        with _pool(1) as pool:
            with postponed_interruption():
                future = pool.submit(work, item)
            try:
                result: ResultT = _warned(future.result())
            except loky.BrokenProcessPool as error:
                how, by_itself = _end_of_worker(error)
                ends[how] = None
                crashed &= by_itself
            else:
                return result
    how = ", ".join(ends)
    reason = f"its worker process died in each of {ATTEMPTS} attempts: {how}"
    return Lost(reason=reason, crashed=crashed)


def _end_of_worker(error: loky.BrokenProcessPool) -> tuple[str, bool]:
    """Return how a pool's only worker ended, as text, and whether by itself."""
    # loky states the exit code only in a text.
    found = re.search(r"exit codes of the workers are \{\w+\((-?\d+)\)\}", str(error))
    if found is None:
        return "killed, crashed or out of memory", False
    end = int(found[1])
    if end >= 0:
        return f"it left Python with exit status {end}", True
    crashed = -end in _CRASHES
    kind = "crashed" if crashed else "killed, possibly out of memory"
    # Most real-time signals have no name.
    names = {one.value: one.name for one in signal.Signals}
    return f"{kind} ({names.get(-end, f'signal {-end}')})", crashed


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[loky.ProcessPoolExecutor]:
    pool = loky.ProcessPoolExecutor(
        workers, initializer=_prepare, initargs=(os.getpid(),), env=_ENVIRONMENT
    )
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, kill_workers=True)


def _prepare(parent: int) -> None:
    """Leave Ctrl-C and standard output to the parent, and end with it."""
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end_with_parent() -> None:
        # There is no process for the results.
        while os.getppid() == parent:
            time.sleep(_PULSE)
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
