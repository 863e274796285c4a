"""The engine for many machines: a Dask cluster that runs already."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import distributed

from experiments.engines import Lost

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

_dask: Any = distributed
"""Only partly annotated, hence not checked."""

_PATIENCE: Final = "10s"
"""How long to wait for an answer of the scheduler."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cluster:
    """Runs items on the workers of a Dask cluster.

    The workers need this package in the same version, and no shared folder: results
    come back over the network. An item whose worker dies is started again elsewhere as
    often as the scheduler allows (``distributed.scheduler.allowed-failures``). Workers
    should have one thread each, as the items keep one core busy.
    """

    address: str
    """Of the scheduler, as in ``tcp://127.0.0.1:8786``."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, None]:
        """See `experiments.engines.Engine.run`.

        Raises:
            OSError: The scheduler does not answer, or not any more.
        """
        client = _dask.Client(self.address, timeout=_PATIENCE, set_as_default=False)
        try:
            running = {client.submit(work, item, pure=False): item for item in items}
            for future in _dask.as_completed(list(running), loop=client.loop):
                if future.cancelled():
                    raise ConnectionError(
                        f"the Dask scheduler at {self.address} went away"
                    )
                yield running.pop(future), _outcome(future)
                future.release()
            # Whatever is left here was not finished and is not wanted any more.
        finally:
            client.cancel(list(running), force=True)
            client.close()


def _outcome(future: Any) -> Any:
    try:
        return future.result()
    except distributed.KilledWorker as error:
        return Lost(reason=f"its worker died in each attempt: {error}")
    # The work raises nothing by itself: the worker could not even load it.
    except Exception as error:
        return Lost(
            reason=f"the worker could not run it ({type(error).__name__}: {error}); is "
            "this package installed there, in the same version?"
        )
