"""The engine for debugging: one item after the other, in this process."""

import contextlib
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import NoReturn, TypeVar
from unittest.mock import patch

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class Serial:
    """Runs items here, in order."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT], None, None]:
        """See `gplfd.experiments.study.engines.Engine.run`."""
        for item in items:
            with _exits_refused():
                result = work(item)
            yield item, result


@contextlib.contextmanager
def _exits_refused() -> Iterator[None]:
    """Let `os._exit` raise SystemExit: else it ends all items, silently, with status 0.

    Other engines see how a worker ended; this process cannot see its own end.
    """
    leave, process = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # a process that the item forked
            leave(status)
        raise SystemExit(f"os._exit({status}) was called")

    with patch.object(os, "_exit", refuse):
        yield
