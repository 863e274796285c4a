"""Where the jobs of a study run: in this process, on its cores, or on a cluster."""

import contextlib
import ctypes
import gc
import importlib.util
import itertools
import logging
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, Literal, TypeVar

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

EngineName = Literal["loky", "serial", "dask"]


class Lost(str):
    """Result of an engine for an item that no worker finished: why, in a sentence."""

    __slots__ = ()


@dataclass(frozen=True, kw_only=True, slots=True)
class Engine:
    """Where the tasks of a study are run."""

    engine: EngineName = "loky"
    """Where tasks run: loky (processes on this machine), serial (one after another in
    this process), or dask (a cluster; pip install 'gplfd[dask]')."""

    workers: int | None = None
    """Number of processes of loky; one per core by default."""

    address: str | None = None
    """Scheduler of the Dask cluster, tcp://HOST:PORT."""

    def check(self) -> None:
        """Raise ValueError for options that do not fit, or if Dask is not installed."""
        if self.workers is not None and self.engine != "loky":
            raise ValueError(f"--workers {self.workers} is for --engine loky")
        if self.workers is not None and self.workers < 1:
            raise ValueError(f"--workers {self.workers} must be 1 or more")
        if self.address is not None and self.engine != "dask":
            raise ValueError(f"--address {self.address} is for --engine dask")
        if self.engine == "dask" and self.address is None:
            raise ValueError(
                "--engine dask needs the scheduler of a running cluster: --address "
                "tcp://HOST:8786 (`dask scheduler` prints it)"
            )
        if self.engine == "dask" and importlib.util.find_spec("distributed") is None:
            raise ValueError("--engine dask needs Dask; pip install 'gplfd[dask]'")

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, None]:
        """Yield each item with its result, in the order in which they finish.

        The work is called once per item, possibly in another process, and never raises.
        The death of a worker may end what runs beside it: these items are run again,
        one at a time, so that only the item whose worker dies again is lost. Closing
        the generator ends running items. OSError: the cluster does not answer.
        """
        if self.engine == "serial":
            for item in items:
                yield item, work(item)
            return
        # No worker imports a file such as `re.py` from the working folder.
        os.environ["PYTHONSAFEPATH"] = "1"
        # Interrupted, a call of loky can leave a lock taken for which its threads then
        # wait for ever. Only the main thread is interrupted: it makes no such call.
        results, ended = SimpleQueue[Any](), SimpleQueue[Any]()

        def put_results() -> None:
            # Workers inherit it, and leave Ctrl-C to the parent from their beginning.
            if hasattr(signal, "pthread_sigmask"):
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                for result in self._results(work, items, ended):
                    results.put(result)
                results.put(None)
            except BaseException as error:
                results.put(error)

        thread = threading.Thread(target=put_results)
        thread.start()
        warned = set[str]()
        try:
            while (result := results.get()) is not None:
                if isinstance(result, BaseException):
                    raise result
                item, outcome, texts = result
                for text in texts:
                    # Those of other seeds differ in numbers only.
                    kind = re.sub(r"\d[\d.e-]*", "", text)
                    if kind not in warned:
                        warned.add(kind)
                        warnings.warn(text, stacklevel=1)
                yield item, outcome
        finally:
            ended.put(None)
            thread.join()

    def _results(
        self, work: Callable[[Any], Any], items: Sequence[Any], ended: SimpleQueue[Any]
    ) -> Iterator[tuple[Any, Any, Sequence[str]]]:
        """Yield items, results and warnings until None is among the ended calls."""
        lost: list[tuple[Any, Lost]] = []
        with self._workers() as (submit, number):
            for at_once in (number, 1):
                waiting = iter([item for item, _ in lost] if lost else items)
                running: dict[Future[Any], Any] = {}
                lost = []
                while True:
                    for item in itertools.islice(waiting, at_once - len(running)):
                        call = submit(_in_worker, work, item)
                        running[call] = item
                        call.add_done_callback(ended.put)
                    if not running:
                        break
                    if (call := ended.get()) is None:
                        return
                    item = running.pop(call)
                    try:
                        yield item, *call.result()
                    except (OSError, CancelledError):
                        raise
                    # The work never raises: a worker died or cannot import it.
                    except Exception as error:
                        lost.append((item, Lost(_reason(error))))
                if not lost:
                    return
        yield from ((item, reason, ()) for item, reason in lost)

    @contextlib.contextmanager
    def _workers(self) -> Iterator[tuple[Callable[..., Future[Any]], int]]:
        """Yield a function that submits a call, and the number of calls at once."""
        if self.engine == "loky":
            import joblib
            from joblib.externals.loky import get_reusable_executor

            number = self.workers or joblib.cpu_count()
            warnings.filterwarnings("ignore", "A worker stopped")  # It is replaced.

            pool: Any = get_reusable_executor(number, initializer=_begin_worker)

            def submit(*call: Any) -> Any:
                nonlocal pool  # A new one after the death of a worker.
                pool = get_reusable_executor(number, initializer=_begin_worker)
                return pool.submit(*call)

            try:
                yield submit, number
            finally:
                # Killed first: loky's own `kill_workers` ends its thread with a
                # traceback where a call was not yet taken up.
                for worker in [*pool._processes.values()]:
                    worker.terminate()
                pool.shutdown()
            return
        import distributed

        # Its tracebacks of a lost scheduler say less than the error below.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        client_type: Any = distributed.Client  # Its annotations are incomplete.
        try:
            with client_type(self.address, timeout=10, set_as_default=False) as client:
                client.wait_for_workers(1, timeout=60.0)
                # Dask itself hands them out to its workers.
                yield client.get_executor(pure=False).submit, sys.maxsize
        except (OSError, CancelledError) as error:
            raise ConnectionError(
                f"no Dask scheduler with workers answers at {self.address} "
                f"({str(error) or 'it ended'}): "
                "start `dask scheduler`, which prints its address, and `dask worker`, "
                "and run the same command again; finished tasks are kept"
            ) from error


def _begin_worker() -> None:
    """Leave Ctrl-C and standard output to the parent, and MuJoCo's stages untimed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)
    # Its timers, `mjData.timer`, which nobody reads here, take 4 % of a small step.
    with contextlib.suppress(ImportError, OSError, ValueError):
        library = ctypes.CDLL(importlib.import_module("mujoco._structs").__file__)
        ctypes.c_void_p.in_dll(library, "mjcb_time").value = None


def _in_worker(
    work: Callable[[ItemT], ResultT], item: ItemT
) -> tuple[ResultT, list[str]]:
    """Return result and texts of warnings, and give memory back to the system."""
    with warnings.catch_warnings(record=True) as caught:
        result = work(item)
    # Agents refer to themselves; glibc keeps what is freed in pieces.
    gc.collect()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # of other systems
        ctypes.CDLL(None).malloc_trim(0)
    return result, [str(warning.message) for warning in caught]


def _reason(error: Exception) -> str:
    name = type(error).__name__
    # Dask's KilledWorker is not imported, because Dask is optional.
    if isinstance(error, BrokenExecutor) or name == "KilledWorker":
        return "its worker died: it crashed, was killed or had no memory left"
    return f"no worker could run it ({name}: {error}); does it have this package?"
