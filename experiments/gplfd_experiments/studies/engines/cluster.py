"""The engine for many machines: a running Dask cluster."""

import asyncio
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import distributed

from gplfd_experiments.studies.engines import ItemT, Lost, ResultT

_dask: Any = distributed
"""Untyped, because its annotations are incomplete."""

_PATIENCE: Final = 10.0
"""Longest wait for an answer of the scheduler [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Cluster:
    """Runs items on the workers of a Dask cluster.

    The workers need the same version of this package. They need no shared folder,
    because results are sent over the network. They should have one thread each, because
    an item keeps one core busy.

    An item whose worker dies is started again elsewhere as often as the scheduler
    allows (``distributed.scheduler.allowed-failures``). The scheduler also blames items
    that only waited on that worker, so blamed items are tried once more at the end, one
    at a time.
    """

    address: str
    """Address of the scheduler, as in ``tcp://127.0.0.1:8786``."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, None]:
        """See `gplfd_experiments.studies.engines.Engine.run`."""
        client = _dask.Client(self.address, timeout=_PATIENCE, set_as_default=False)
        try:
            blamed = yield from self._together(client, work, items)
            for item in blamed:
                yield from self._together(client, work, [item], last=True)
        finally:
            client.close()

    def check(self) -> None:
        """Connect to the scheduler, with the certificates of Dask's configuration.

        Dask's client waits forever if another program listens at the address.
        """

        async def connect() -> None:
            security = _dask.Security().get_connection_args("client")
            async with asyncio.timeout(_PATIENCE):
                comm = await _dask.comm.connect(self.address, **security)
            await comm.close()

        try:
            asyncio.run(connect())
        # Another server at the address may cause any error in Dask.
        except Exception as error:
            reason = str(error) or f"no answer within {_PATIENCE:g} s"
            raise ConnectionError(
                f"no Dask scheduler answers at {self.address} ({reason}); `dask "
                "scheduler` prints its address"
            ) from error

    def _together(
        self,
        client: Any,
        work: Callable[[ItemT], ResultT],
        items: Sequence[ItemT],
        *,
        last: bool = False,
    ) -> Generator[tuple[ItemT, ResultT | Lost], None, list[ItemT]]:
        """Run items; return those whose workers died, or give them up if ``last``."""
        running = {client.submit(work, item, pure=False): item for item in items}
        blamed = []
        try:
            for future in _dask.as_completed(list(running), loop=client.loop):
                if future.cancelled():
                    raise ConnectionError(
                        f"the connection to the Dask scheduler at {self.address} was "
                        "lost"
                    )
                item = running.pop(future)
                try:
                    outcome = future.result()
                except distributed.KilledWorker:
                    if not last:
                        blamed.append(item)
                        continue
                    outcome = Lost(reason="its worker died in each attempt")
                # The work never raises, so the worker could not import it.
                except Exception as error:
                    outcome = Lost(
                        reason=f"the worker could not run it ({type(error).__name__}: "
                        f"{error}); is this package installed there, in the same "
                        "version?"
                    )
                yield item, outcome
        finally:
            # Cancel unfinished items.
            client.cancel(list(running), force=True)
        return blamed
