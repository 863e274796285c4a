"""Where the jobs of a study run: in this process, on its cores, or on a cluster."""

import contextlib
import importlib.util
import logging
import os
import re
import signal
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar

import tyro

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

EngineName = Literal["loky", "serial", "dask"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Lost:
    """Result of an engine for an item that no worker finished."""

    reason: str
    """Reason, in a sentence."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Engine:
    """Where the tasks of a study are run."""

    engine: EngineName = "loky"
    """Where tasks run: loky (processes on this machine), serial (one after another in
    this process), or dask (a cluster; pip install 'gplfd[dask]')."""

    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of processes of loky; one per core by default."""

    address: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """Scheduler of the Dask cluster."""

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

        The death of a worker ends all that runs beside it. These items are run again,
        one at a time, so that only the item whose worker dies again is lost. Closing
        the generator ends running items. An OSError says that the scheduler of the
        cluster does not answer.

        Args:
            work: Called once per item, possibly in another process; never raises.
            items: Small records.
        """
        if self.engine == "serial":
            for item in items:
                yield item, work(item)
            return
        import joblib

        # No worker imports a file such as `re.py` from the working folder.
        os.environ["PYTHONSAFEPATH"] = "1"
        unfinished = set(range(len(items)))
        started, warned = set[int](), set[str]()

        def calls(numbers: Iterable[int]) -> Iterator[Any]:
            for number in numbers:
                started.add(number)
                yield joblib.delayed(_with_warnings)(work, number, items[number])

        with self._parallel() as parallel:

            def attempt(numbers: Iterable[int]) -> Iterator[tuple[ItemT, ResultT]]:
                started.clear()
                results = parallel(calls(numbers))
                try:
                    for number, result, texts in results:
                        # Dask may repeat an item whose worker dies after its end.
                        if number not in unfinished:
                            continue
                        unfinished.remove(number)
                        for text in texts:
                            # Those of other seeds differ in numbers only.
                            kind = re.sub(r"\d[\d.e-]*", "", text)
                            if kind not in warned:
                                warned.add(kind)
                                warnings.warn(text, stacklevel=1)
                        yield items[number], result
                finally:
                    with warnings.catch_warnings(action="ignore"):
                        results.close()  # warns of items that it ends

            while unfinished:
                try:
                    yield from attempt(sorted(unfinished))
                except OSError:
                    raise
                # The work never raises, so a worker died or could not import it.
                except Exception:
                    suspects = sorted(started & unfinished)
                    if not suspects:
                        raise
                    for number in suspects:
                        try:
                            yield from attempt([number])
                        except OSError:
                            raise
                        except Exception as error:
                            unfinished.remove(number)
                            yield items[number], Lost(reason=_reason(error))

    @contextlib.contextmanager
    def _parallel(self) -> Iterator[Any]:
        """Yield `joblib.Parallel`, which returns results in the order of their ends."""
        import joblib

        options = {"return_as": "generator_unordered", "batch_size": 1}
        if self.engine == "loky":
            workers = self.workers or joblib.cpu_count()
            # joblib runs the items of a single worker in this process, which they
            # could end. Therefore it has two, but at most `workers` items run.
            with joblib.parallel_config(
                "loky", n_jobs=max(2, workers), inner_max_num_threads=1
            ):
                yield joblib.Parallel(
                    **options,
                    pre_dispatch=workers,
                    max_nbytes=None,
                    initializer=_begin_worker,
                )
            return
        import distributed

        # Its tracebacks of a lost scheduler say less than the error below.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        client_type: Any = distributed.Client  # Its annotations are incomplete.
        try:
            with (
                client_type(self.address, timeout=10.0, set_as_default=False) as client,
                joblib.parallel_config(_cluster_backend(client)),
            ):
                yield joblib.Parallel(**options, pre_dispatch="n_jobs")
        except (OSError, CancelledError) as error:
            raise ConnectionError(
                f"no Dask scheduler answers at {self.address} ({error}): start one by "
                "`dask scheduler`, which prints its address, and run the same command "
                "again; finished tasks are kept"
            ) from error


def _cluster_backend(client: Any) -> Any:
    """Return joblib's backend for a Dask client."""
    from joblib._dask import DaskDistributedBackend

    class ClusterBackend(DaskDistributedBackend):  # type: ignore[misc]
        """joblib's own waits forever for an item whose worker died."""

        def effective_n_jobs(self, n_jobs: int) -> Any:
            """Return at least 2; joblib would run a single job in this process."""
            return max(2, super().effective_n_jobs(n_jobs))

        def submit(self, func: Any, callback: Any = None) -> Any:
            """Start an item; call back when it ends, also if its worker died."""
            future = super().submit(func, lambda _: None)
            future.add_done_callback(callback)
            return future

        def retrieve_result_callback(self, out: Any) -> Any:
            """Return the result of a future, or raise its error."""
            return super().retrieve_result_callback(out.result())

    # A worker that died may take long to come back on a busy machine.
    return ClusterBackend(client=client, wait_for_workers_timeout=60)


def _begin_worker() -> None:
    """Leave Ctrl-C and standard output to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.dup2(2, 1)


def _with_warnings(
    work: Callable[[ItemT], ResultT], number: int, item: ItemT
) -> tuple[int, ResultT, list[str]]:
    """Return number, result, and texts of warnings, which a worker cannot show."""
    with warnings.catch_warnings(record=True) as caught:
        result = work(item)
    return number, result, [str(warning.message) for warning in caught]


def _reason(error: Exception) -> str:
    name = type(error).__name__
    # Dask's KilledWorker is not imported, because Dask is optional.
    if isinstance(error, BrokenExecutor) or name == "KilledWorker":
        return "its worker died: it crashed, was killed or had no memory left"
    return f"no worker could run it ({name}: {error}); does it have this package?"
